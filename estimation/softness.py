"""Softness of the object: what Eq. (13) adds to the rotation of the elastomer.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (2), (12) and (13).

L is the paper's L_xy − L_yx everywhere in this project, so that counter-clockwise the object has
turned by (1 + k) φ − L/2.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.inputs import (
    as_flag,
    as_matrix,
    as_number,
    as_numbers,
    as_table,
    as_text,
    expect_keys,
    naming,
    read_toml,
)
from contactmodel.rotation import object_rotation
from estimation.estimators.measurement import Z95, Measurement
from estimation.fields import Fields
from estimation.files import toml_text, write_whole

FORMAT_VERSION = 1
Range = tuple[float, float]
Covariance = tuple[tuple[float, float], tuple[float, float]]


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


def disc_radius(points: Float[np.ndarray, "n 2"]) -> float:
    """Radius of a disc whose points lie as far from their centre, root mean square [mm]."""
    if not len(points):
        return float("nan")
    return float(np.sqrt(2.0 * np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


@runtime_checkable
class Softness(Protocol):
    """Turns the rotation of an elastomer into that of the object that sticks to it."""

    @property
    def stiffness_ratio(self) -> float:
        """A typical k [-], for what must be known before there is a contact."""
        ...

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> "Lifting | None":
        """What is to be added to what markers show before a rotation is sought; None for nothing.

        Args:
            points: the markers in the unloaded elastomer [mm].
        """
        ...

    def at(self, contact: Contact) -> "ScalarSoftness":
        """The k and L that stand for it in one contact, its fields lifted.

        Raises:
            ValueError: the contact lacks what the softness needs to know.
        """
        ...

    def content(self) -> dict[str, Any]:
        """What stands in its file, `kind` first: plain values and tables of such."""
        ...


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


@dataclass(frozen=True)
class ScalarSoftness:
    """Stiffness ratio and load term of an object on a sensor.

    Attributes:
        stiffness_ratio: k = G_S/G_B, elastomer over object [-]; 0 for a rigid object.
        load_term: L = L_xy − L_yx [rad], in the paper's sign; per newton of the normal force
            [rad/N] where `load_by_force`.
        covariance: of (k, L), row by row.
        load_by_force: whether L grows in proportion to the normal force.
        validity: the contacts that it was found on.
        provenance: where it came from, for readers: recordings, reference, sensor, versions.

    Raises:
        ValueError: k below 0, or a covariance that is none.
    """

    stiffness_ratio: float = 0.0
    load_term: float = 0.0
    covariance: Covariance = ((0.0, 0.0), (0.0, 0.0))
    load_by_force: bool = False
    validity: Validity = field(default_factory=Validity)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values."""
        if not (np.isfinite(self.stiffness_ratio) and self.stiffness_ratio >= 0.0):
            raise ValueError(f"stiffness ratio k is {self.stiffness_ratio}; it must be ≥ 0")
        if not np.isfinite(self.load_term):
            raise ValueError(f"load term L is {self.load_term}; it must be a number")
        matrix = np.asarray(self.covariance, dtype=float)
        if (
            matrix.shape != (2, 2)
            or not np.isfinite(matrix).all()
            or matrix[0, 1] != matrix[1, 0]
            or np.linalg.eigvalsh(matrix)[0] < -1e-12 * np.trace(matrix)
        ):
            raise ValueError(
                f"covariance of (k, L) is {self.covariance}; it must be a symmetric 2×2 matrix "
                "without negative eigenvalues"
            )

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> None:
        """Nothing: what moves as one body is multiplied as a whole."""

    def at(self, contact: Contact) -> "ScalarSoftness":
        """Itself, or with L for the contact's normal force where it grows with that.

        Raises:
            ValueError: L grows with a force that is not known.
        """
        if not self.load_by_force:
            return self
        force = contact.normal_force
        if not np.isfinite(force):
            raise ValueError("the load term needs the normal force, which this frame does not have")
        (kk, kl), (_, ll) = self.covariance
        return ScalarSoftness(
            self.stiffness_ratio,
            self.load_term * force,
            ((kk, kl * force), (kl * force, ll * force**2)),
            validity=self.validity,
        )

    def correct(self, gel: Measurement) -> tuple[float, float, float]:
        """The object's angle and the ends of its 95 % interval [rad, counter-clockwise].

        [Li2024] Eq. (13) with the sign turned; the interval takes in the covariance of (k, L).
        """
        angle = float(object_rotation(gel.angle, self.stiffness_ratio, self.load_term))
        gradient = np.array([gel.angle, -0.5])
        spread = Z95 * np.sqrt(gradient @ np.asarray(self.covariance) @ gradient)
        gain = 1.0 + self.stiffness_ratio
        below = np.hypot(gain * (gel.angle - gel.low), spread)
        above = np.hypot(gain * (gel.high - gel.angle), spread)
        return angle, float(angle - below), float(angle + above)

    def content(self) -> dict[str, Any]:
        """What stands in its file."""
        return {
            "kind": "scalar",
            "stiffness_ratio": self.stiffness_ratio,
            "load_term_rad": self.load_term,
            "load_by_force": self.load_by_force,
            "covariance": [list(row) for row in self.covariance],
            "validity": show_validity(self.validity),
            "provenance": dict(self.provenance),
        }


def write_softness(softness: Softness, path: Path) -> None:
    """Write a softness as a file that `read_softness` reads.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, toml_text({"format_version": FORMAT_VERSION} | softness.content()))


def read_softness(path: Path) -> Softness:
    """Read a softness file.

    A TOML file with `format_version = 1`, `stiffness_ratio` k [-] and, if known, `load_term_rad`
    L [rad, or rad/N with `load_by_force = true`], `covariance`, the 2×2 matrix of (k, L), a table
    `validity` with `rotation_deg`, `normal_force_N` and `contact_radius_mm`, each as lowest and
    highest value, and a table `provenance` of anything that readers should know.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    content = read_toml(path, FORMAT_VERSION)
    with naming(path):
        kind = as_text(content.pop("kind", "scalar"), "kind")
        if kind not in READERS:
            raise ValueError(f"no kind {kind!r} of softness; there are {', '.join(READERS)}")
        return READERS[kind](content)


def _read_scalar(content: dict[str, Any]) -> ScalarSoftness:
    expect_keys(content, "the file", _SCALAR_KEYS)
    if "stiffness_ratio" not in content:
        raise ValueError("no stiffness_ratio: give k, 0 for a rigid object")
    return ScalarSoftness(
        stiffness_ratio=as_number(content["stiffness_ratio"], "stiffness_ratio"),
        load_term=as_number(content.get("load_term_rad", 0.0), "load_term_rad"),
        covariance=read_covariance(content, 2),
        load_by_force=as_flag(content.get("load_by_force", False), "load_by_force"),
        validity=read_validity(content.get("validity", {})),
        provenance=as_table(content.get("provenance", {}), "provenance"),
    )


def read_covariance(content: dict[str, Any], count: int) -> Any:
    """The rows of a file's `covariance` of so many numbers; zeros where it is not given."""
    none = [[0.0] * count] * count
    return tuple(map(tuple, as_matrix(content.get("covariance", none), "covariance").tolist()))


def _read_layered(content: dict[str, Any]) -> Softness:
    from estimation.layered_softness import read_layered  # which builds on this module

    return read_layered(content)


READERS: dict[str, Callable[[dict[str, Any]], Softness]] = {
    "scalar": _read_scalar,
    "layered": _read_layered,
}
"""What makes a softness of a file's content, by its `kind`."""

_SCALAR_KEYS = ("stiffness_ratio", "load_term_rad", "load_by_force", "covariance")
_SCALAR_KEYS += ("validity", "provenance")
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
