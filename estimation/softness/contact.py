"""What a softness is told of a contact, what it adds to it, and the contacts it was found on."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.common.inputs import as_matrix, as_numbers, as_table, expect_keys
from estimation.fields.measure import Fields

Range = tuple[float, float]


class Contact(NamedTuple):
    """What a softness may ask about the contact of one frame.

    Attributes:
        fields: of the frame.
        normal_force: pressing force [N]; NaN where the source does not have it.
        stick: the markers that the rotation was measured with, where they are known.
        as_seen: displacement of the markers in the plane, before a softness has lifted it [mm];
            None where none has.
    """

    fields: Fields
    normal_force: float = float("nan")
    stick: Bool[np.ndarray, " n"] | None = None
    as_seen: Float[np.ndarray, "n 2"] | None = None

    @property
    def radius(self) -> float:
        """Size of the contact region, see `disc_radius` [mm]."""
        return disc_radius(self.fields.positions[self.fields.contact, :2])


def disc_radius(points: Float[np.ndarray, "n 2"]) -> float:
    """Radius of a disc whose points lie as far from their centre, root mean square [mm]."""
    if not len(points):
        return float("nan")
    return float(np.sqrt(2.0 * np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


class Lifting(NamedTuple):
    """What is to be added at some markers, as matrices on what all markers show.

    Attributes:
        displacement: on displacements in the plane.
        rotation: on rotations.
    """

    displacement: Float[np.ndarray, "m 2 n 2"]
    rotation: Float[np.ndarray, "m n"]

    def of(self, moved: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
        """What is to be added to displacements."""
        rows, columns = 2 * len(self.rotation), 2 * len(moved)
        return (self.displacement.reshape(rows, columns) @ moved.ravel()).reshape(-1, 2)


class Validity(NamedTuple):
    """The contacts that a softness was found on, each as lowest and highest value.

    Attributes:
        rotation: φ of the elastomer [rad].
        normal_force: [N].
        contact_radius: of the contact region, see `disc_radius` [mm].
    """

    rotation: Range = (-np.inf, np.inf)
    normal_force: Range = (-np.inf, np.inf)
    contact_radius: Range = (-np.inf, np.inf)

    def covers(self, rotation: float, contact: Contact) -> bool:
        """Whether a contact is like those; what is not known of it does not speak against it."""
        values = (rotation, contact.normal_force, contact.radius)
        return not any(
            value < low or value > high for value, (low, high) in zip(values, self, strict=True)
        )


def check_ratio(stiffness_ratio: float) -> None:
    """Refuse a k that no object has.

    Raises:
        ValueError: it is below 0 or no number.
    """
    if not (np.isfinite(stiffness_ratio) and stiffness_ratio >= 0.0):
        raise ValueError(f"stiffness ratio k is {stiffness_ratio}; it must be ≥ 0")


def check_covariance(covariance: Sequence[Sequence[float]], names: Sequence[str]) -> None:
    """Refuse a covariance that no numbers of these names have.

    Raises:
        ValueError: it is not square, not symmetric, or has a negative eigenvalue.
    """
    matrix, count = np.asarray(covariance, dtype=float), len(names)
    if (
        matrix.shape != (count, count)
        or not np.isfinite(matrix).all()
        or not np.array_equal(matrix, matrix.T)
        or np.linalg.eigvalsh(matrix)[0] < -1e-12 * np.trace(matrix)
    ):
        raise ValueError(
            f"covariance of ({', '.join(names)}) is {covariance}; it must be a symmetric "
            f"{count}×{count} matrix without negative eigenvalues"
        )


_VALIDITY_KEYS = ("rotation_deg", "normal_force_N", "contact_radius_mm")


def show_validity(validity: Validity) -> dict[str, list[float]]:
    """The ranges that are bounded, in the units of the file."""
    shown = (tuple(np.degrees(validity.rotation).tolist()), *validity[1:])
    pairs = zip(_VALIDITY_KEYS, shown, strict=True)
    return {name: list(ends) for name, ends in pairs if np.isfinite(ends).all()}


def read_validity(content: Any) -> Validity:
    """The ranges of a file's table `validity`."""
    expect_keys(as_table(content, "validity"), "validity", _VALIDITY_KEYS)
    ranges = []
    for name in _VALIDITY_KEYS:
        low, high = as_numbers(content.get(name, [-np.inf, np.inf]), name, 2)
        if not low <= high:
            raise ValueError(f"validity: {name} is [{low}, {high}]; give the lower end first")
        ranges.append((low, high))
    rotation = tuple(np.radians(ranges[0]).tolist())
    return Validity((rotation[0], rotation[1]), *ranges[1:])


def read_covariance(content: dict[str, Any], count: int) -> Any:
    """The rows of a file's `covariance` of so many numbers; zeros where it is not given."""
    none = [[0.0] * count] * count
    return tuple(map(tuple, as_matrix(content.get("covariance", none), "covariance").tolist()))
