"""What a softness requires of a contact, what it adds to it, and the contacts it was fitted on."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.common.settings import key_of, unit
from estimation.fields.measure import Fields

Range = tuple[float, float]
RATIO_METADATA = unit(least=0.0, required="give k, 0 for a rigid object")
"""Of the field k, which every file must have."""


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
    """What is to be added at some markers, as matrices on what all markers show."""

    displacement: Float[np.ndarray, "m 2 n 2"]
    rotation: Float[np.ndarray, "m n"]

    def of(self, moved: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
        """What is to be added to displacements."""
        rows, columns = 2 * len(self.rotation), 2 * len(moved)
        return (self.displacement.reshape(rows, columns) @ moved.ravel()).reshape(-1, 2)


@dataclass(frozen=True)
class Validity:
    """The contacts that a softness was found on, each as lowest and highest value, or unknown.

    Attributes:
        rotation: φ of the elastomer [rad].
        normal_force: [N].
        contact_radius: of the contact region, see `disc_radius` [mm].

    Raises:
        ValueError: a range whose lower end is not first.
    """

    rotation: Range | None = field(default=None, metadata=unit("deg", most=np.inf))
    normal_force: Range | None = field(default=None, metadata=unit("n", most=np.inf))
    contact_radius: Range | None = field(default=None, metadata=unit("mm", most=np.inf))

    def __post_init__(self) -> None:
        """Check the ranges."""
        for one in fields(self):
            low, high = getattr(self, one.name) or (0.0, 0.0)
            if not low <= high:
                raise ValueError(f"{key_of(one)} is out of order: give the lower end first")

    def covers(self, rotation: float, contact: Contact) -> bool:
        """Whether a contact is like those; what is not known of it does not speak against it."""
        radius = contact.radius if self.contact_radius else np.nan
        return not any(
            known and (value < known[0] or value > known[1])
            for value, known in (
                (rotation, self.rotation),
                (contact.normal_force, self.normal_force),
                (radius, self.contact_radius),
            )
        )


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
