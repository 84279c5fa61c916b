"""Softness of an object on an elastomer of finite thickness, its markers below the surface.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (2) and (13).

Every wave q of the rotation turns the object's surface against the elastomer's by
k̂(q) = k coth(qh) (`contactmodel.transfer_function`, the object a half-space), and markers at the
depth z turn by D(q) = sinh(q(h − z))/sinh(qh) of the surface. Where the object sticks it has
therefore turned by the wave sum of (1 + k̂)/D over the φ that the markers show, whatever slips
beside. Eq. (13)'s (1 + k)φ is part of it; the rest is L, other in every frame, a sum over all
markers of φ times a function of distance.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull
from scipy.special import j0

from estimation.softness import (
    READERS,
    Contact,
    ScalarSoftness,
    Validity,
    read_validity,
    show_validity,
)

_RESOLUTION = 0.5  # standard deviation, in pitches, of what markers resolve
_WAVES, _NODES = 6.5, 600  # up to e^{-21} of the resolution
_REACH = 40.0  # pitches
_STEPS = 1200
_FAR = 25  # pitches over which the lattice is added up
_STEP = 1e-3  # of thickness, for derivatives

Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LayeredSoftness:
    """Stiffness ratio of an object, and the elastomer that it is held against.

    The object is a half-space. Angles that are counted from a loaded frame, not from the unloaded
    reference, take the load term with them that this frame already had.

    Attributes:
        stiffness_ratio: k = G_S/G_B, elastomer over object [-]; 0 for a rigid object.
        thickness: h of the elastomer, bonded to its base; infinite for a half-space [mm].
        depth: z of the markers below the surface [mm].
        covariance: of (k, h, z), row by row.
        validity: the contacts that it was found on.
        provenance: where it came from, for readers.

    Raises:
        ValueError: a value out of range, or a covariance that is none.
    """

    stiffness_ratio: float
    thickness: float
    depth: float = 0.0
    covariance: Matrix = ((0.0, 0.0, 0.0),) * 3
    validity: Validity = field(default_factory=Validity)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values."""
        if not (np.isfinite(self.stiffness_ratio) and self.stiffness_ratio >= 0.0):
            raise ValueError(f"stiffness ratio k is {self.stiffness_ratio}; it must be ≥ 0")
        if not self.thickness > 0.0:
            raise ValueError(f"thickness is {self.thickness} mm; it must be above 0, inf for thick")
        if not 0.0 <= self.depth < self.thickness:
            raise ValueError(
                f"depth is {self.depth} mm; it must lie between 0 and the thickness, "
                f"{self.thickness} mm"
            )
        matrix = np.asarray(self.covariance, dtype=float)
        if (
            matrix.shape != (3, 3)
            or not np.isfinite(matrix).all()
            or not np.array_equal(matrix, matrix.T)
            or np.linalg.eigvalsh(matrix)[0] < -1e-12 * np.trace(matrix)
        ):
            raise ValueError(
                f"covariance of (k, h, z) is {self.covariance}; it must be a symmetric 3×3 matrix "
                "without negative eigenvalues"
            )

    def at(self, contact: Contact) -> ScalarSoftness:
        """The k and the L that stand for it in one contact."""
        below, thin = self._load(contact)
        slopes = [-2.0 * thin, *(self._slope(name, contact) for name in ("thickness", "depth"))]
        to = np.array([[1.0, 0.0, 0.0], slopes])
        (kk, kl), (_, ll) = (to @ np.asarray(self.covariance) @ to.T).tolist()
        return ScalarSoftness(
            self.stiffness_ratio,
            -2.0 * (below + self.stiffness_ratio * thin),
            ((kk, kl), (kl, ll)),
            validity=self.validity,
        )

    def _load(self, contact: Contact) -> tuple[float, float]:
        return missed_rotation(contact, self.thickness, self.depth)

    def _slope(self, name: str, contact: Contact) -> float:
        """Derivative of L by the thickness or the depth; 0 where that is known exactly."""
        place = 1 if name == "thickness" else 2
        if self.covariance[place][place] == 0.0:
            return 0.0
        step = _STEP * self.thickness
        start = max(getattr(self, name) - step, 0.0 if name == "depth" else 0.5 * self.thickness)
        ends = [
            replace(self, **{name: value})._load(contact) for value in (start, start + 2.0 * step)
        ]
        below, thin = np.subtract(ends[1], ends[0]) / (2.0 * step)
        return -2.0 * float(below + self.stiffness_ratio * thin)

    def content(self) -> dict[str, Any]:
        """What stands in its file."""
        return {
            "kind": "layered",
            "stiffness_ratio": self.stiffness_ratio,
            "thickness_mm": self.thickness,
            "depth_mm": self.depth,
            "covariance": [list(row) for row in self.covariance],
            "validity": show_validity(self.validity),
            "provenance": dict(self.provenance),
        }


def missed_rotation(contact: Contact, thickness: float, depth: float) -> tuple[float, float]:
    """What the object has turned beyond (1 + k)φ: one part, and another for each unit of k [rad].

    The mean over the markers that stick, weighted as a rigid fit of them weighs the rotations of a
    disc; over the contact where none sticks.

    Args:
        contact: fields of a frame, and what sticks in it.
        thickness: h [mm].
        depth: z [mm].
    """
    fields = contact.fields
    seen = np.isfinite(fields.rotation) & np.isfinite(fields.positions[:, 0])
    region = _region(contact) & seen
    if np.count_nonzero(region) < 3:
        return 0.0, 0.0
    points = (fields.positions - fields.displacement)[seen, :2]
    phi, inside = fields.rotation[seen], region[seen]
    pitch = _pitch(points)
    apart = np.linalg.norm(points[inside][:, None] - points, axis=-1) / pitch
    weight = _disc_weights(points[inside])
    thin = _Kernel.of(thickness / pitch, depth / pitch, thin=True)
    turned = weight @ thin.at(apart) @ phi
    if depth == 0.0:
        return 0.0, float(turned)
    below = _Kernel.of(thickness / pitch, depth / pitch, thin=False)
    matrix = below.at(apart)
    matrix[np.arange(len(apart)), np.flatnonzero(inside)] = below.at_itself
    lifted = float(weight @ matrix @ phi)
    return lifted, lifted + float(turned)


def _region(contact: Contact) -> Bool[np.ndarray, " n"]:
    """The markers over which the correction is averaged."""
    stick = contact.stick
    return contact.fields.contact if stick is None or not stick.any() else stick


def _pitch(points: Float[np.ndarray, "n 2"]) -> float:
    """Side of the square that a marker has for itself [mm]."""
    return float(np.sqrt(ConvexHull(points).volume)) / (np.sqrt(len(points)) - 1.0)


def _disc_weights(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
    """R² − r², as the rigid fit of a disc of radius R weighs its rotations; their sum is 1."""
    square = np.sum((points - points.mean(axis=0)) ** 2, axis=1)
    weight = np.maximum(2.3 * square.mean() - square, 0.0)  # 2 for a disc of no markers' width
    return weight / weight.sum()


@dataclass(frozen=True)
class _Kernel:
    """A function of distance in pitches, to be summed over markers, and its value at distance 0."""

    table: Float[np.ndarray, " steps"]
    at_itself: float

    def at(self, distance: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Its value at distances in pitches."""
        place = np.minimum(distance * (_STEPS / _REACH), _STEPS - 1.0)
        whole = np.minimum(place.astype(int), _STEPS - 1)
        rest = place - whole
        return self.table[whole] * (1.0 - rest) + self.table[whole + 1] * rest

    @staticmethod
    @lru_cache(maxsize=64)
    def of(thickness: float, depth: float, *, thin: bool) -> "_Kernel":
        """(coth qh − 1)/D, or 1/D − 1 where not `thin`, over the waves that markers resolve."""
        h, z = thickness, depth
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        top = _WAVES / _RESOLUTION
        q = 0.5 * top * (nodes + 1.0)
        base, lift = np.exp(-2.0 * q * h), np.exp(q * z)
        inverse = lift * (1.0 - base) / (1.0 - np.exp(-2.0 * q * (h - z)))  # 1/D
        wave = inverse * 2.0 * base / (1.0 - base) if thin else inverse - 1.0
        wave = wave * q * np.exp(-0.5 * (q * _RESOLUTION) ** 2) * 0.5 * top * weights
        distance = np.linspace(0.0, _REACH, _STEPS + 1)
        table = j0(np.outer(distance, q)) @ wave / (2.0 * np.pi)
        far = np.arange(-_FAR, _FAR + 1.0)
        others = np.hypot(*np.meshgrid(far, far)).ravel()
        others = others[others > 0.0]
        uniform = 0.0 if np.isinf(h) or thin else z / (h - z)  # of a wave of infinite length
        rest = uniform - np.sum(np.interp(others, distance, table))
        return _Kernel(table, float(rest))


def _read_layered(content: dict[str, Any]) -> LayeredSoftness:
    """A layered softness from a file's content."""
    known = {"stiffness_ratio", "thickness_mm", "depth_mm", "covariance", "validity", "provenance"}
    if unknown := sorted(set(content) - known):
        raise ValueError(f"unknown key {unknown[0]!r}; known are {sorted(known)}")
    for name in ("stiffness_ratio", "thickness_mm"):
        if name not in content:
            raise ValueError(f"no {name}: a layered softness needs it")
    for name in ("stiffness_ratio", "thickness_mm", "depth_mm"):
        if isinstance(content.get(name), bool):
            raise ValueError(f"{name} is {content[name]}; it must be a number")
    rows = content.get("covariance", [[0.0] * 3] * 3)
    return LayeredSoftness(
        float(content["stiffness_ratio"]),
        float(content["thickness_mm"]),
        float(content.get("depth_mm", 0.0)),
        tuple(tuple(float(value) for value in row) for row in rows),
        validity=read_validity(content.get("validity", {})),
        provenance=dict(content.get("provenance", {})),
    )


READERS["layered"] = _read_layered
