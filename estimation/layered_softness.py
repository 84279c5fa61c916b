"""Softness of an object on an elastomer of finite thickness, its markers below the surface.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (2) and (13).

Every wave q that turns the elastomer turns the object's surface against it by
k̂(q) = k coth(qh) (`contactmodel.transfer_function`, the object a half-space), and markers at the
depth z turn by D(q) = sinh(q(h − z))/sinh(qh) of the surface. Where the object sticks to it the
elastomer therefore does not move as one body, and no one rotation φ is there to be multiplied by
1 + k. But the displacement u of the markers, lifted to

    ũ = u + (1/D − 1) u + k/(1 + k) · (coth qh − 1)/D · u

by its waves that turn (transverse ones), is (1 + k)⁻¹ of the object's own motion there, whatever
slips beside: what a thick elastomer's surface would show. Frames are lifted before anything is
sought in them, and Eq. (13) with the number k holds for what is found.

Longitudinal waves have no curl, but a rigid fit of a long contact takes in the shear that they
bring across it. Between incompressible bodies they count with
k̂_L(q) = k (sinh²x + x² + 1)/(sinh x cosh x + x), x = qh. Frames are not lifted by them: most of
what they carry is the squeeze of a thin elastomer, which would make the contact larger than it is.
What they add to the rotation of what sticks is a load term L of Eq. (13) instead, of which the
squeeze, by its symmetry, is no part.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull
from scipy.special import j0, j1

from contactmodel.inputs import as_number, as_table, expect_keys
from estimation.softness import (
    Contact,
    Lifting,
    ScalarSoftness,
    Validity,
    read_covariance,
    read_validity,
    show_validity,
)

_RESOLUTION = 0.5  # standard deviation, in pitches, of what markers resolve
_WAVES, _NODES = 6.5, 600  # up to e^{-21} of the resolution
_REACH = 40.0  # pitches
_STEPS = 1200
_FAR = 25  # pitches over which the lattice is added up
_STEP = 1e-3  # of thickness, for derivatives
_FEWEST = 3  # markers that have a rotation
_THICK = 40.0  # qh beyond which nothing is left of the base

Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LayeredSoftness:
    """Stiffness ratio of an object, and the elastomer that it is held against.

    The object is a half-space.

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

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> Lifting | None:
        """What is to be added to what markers show.

        Args:
            points: the markers in the unloaded elastomer [mm].
        """
        if np.isinf(self.thickness) and self.depth == 0.0:
            return None
        share = self.stiffness_ratio / (1.0 + self.stiffness_ratio)
        kernels = lifting_kernels(points, points, self.thickness, self.depth)
        parts = zip(kernels.below, kernels.thin, strict=True)
        return Lifting(*(below + share * thin for below, thin in parts))

    def at(self, contact: Contact) -> ScalarSoftness:
        """k and L for a frame that has been lifted; in L's covariance that of h and z."""
        seen = _Seen.of(contact)
        if seen is None:
            spread = self.covariance[0][0]
            return ScalarSoftness(
                self.stiffness_ratio, 0.0, ((spread, 0.0), (0.0, 0.0)), validity=self.validity
            )
        k = self.stiffness_ratio
        turns = seen.turns(self.thickness, self.depth)
        # θ = (1 + k)(φ + below) + k (thin + along), and (1 + k) times the lifted φ lacks `along`
        slopes = [turns.thin / (1.0 + k) + turns.along, *self._slopes(seen)]
        to = np.array([[1.0, 0.0, 0.0], [-2.0 * slope for slope in slopes]])
        (kk, kl), (_, ll) = (to @ np.asarray(self.covariance) @ to.T).tolist()
        return ScalarSoftness(
            k, -2.0 * k * turns.along, ((kk, kl), (kl, ll)), validity=self.validity
        )

    def _slopes(self, seen: "_Seen") -> list[float]:
        """Derivatives of the object's angle by thickness and depth, where these are uncertain."""
        k, found = self.stiffness_ratio, []
        for place, name in ((1, "thickness"), (2, "depth")):
            if self.covariance[place][place] == 0.0:
                found.append(0.0)
                continue
            step = _STEP * self.thickness
            least = 0.0 if name == "depth" else 0.5 * self.thickness
            start = max(getattr(self, name) - step, least)
            here = {"thickness": self.thickness, "depth": self.depth}
            ends = [seen.turns(**(here | {name: value})) for value in (start, start + 2.0 * step)]
            below, thin, along = np.subtract(ends[1], ends[0]) / (2.0 * step)
            found.append(float((1.0 + k) * below + k * (thin + along)))
        return found

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


class Kernels(NamedTuple):
    """What is lacking at some markers, from what all of them show.

    Attributes:
        below: 1/D − 1, what markers below the surface do not show.
        thin: (coth qh − 1)/D of the waves that turn, to be multiplied by k/(1 + k).
        along: (k̂_L/k − 1)/D of the longitudinal ones, likewise; their D is that of the others, as
            it is for waves longer than the elastomer is thick.
    """

    below: Lifting
    thin: Lifting
    along: Lifting


def lifting_kernels(
    at: Float[np.ndarray, "m 2"], points: Float[np.ndarray, "n 2"], thickness: float, depth: float
) -> Kernels:
    """What is lacking at some of the markers.

    Args:
        at: markers where it is wanted, some of `points` [mm].
        points: all markers in the unloaded elastomer [mm].
        thickness: h [mm].
        depth: z [mm].
    """
    pitch = _pitch(points)
    away = (at[:, None] - points) / pitch
    thin, along = (
        _Kernel.of(thickness / pitch, depth / pitch, name).at(away) for name in ("thin", "along")
    )
    if depth == 0.0:
        return Kernels(Lifting(*(np.zeros_like(part) for part in thin)), thin, along)
    return Kernels(_Kernel.of(thickness / pitch, depth / pitch, "below").at(away), thin, along)


class Added(NamedTuple):
    """What `Kernels` add to the rotation of some markers [rad]."""

    below: float
    thin: float
    along: float


def lifting_turns(
    at: Float[np.ndarray, "m 2"],
    points: Float[np.ndarray, "n 2"],
    moved: Float[np.ndarray, "n 2"],
    thickness: float,
    depth: float,
) -> Added:
    """Rotation of some markers that is lacking in what all of them show.

    Args:
        at: markers that turn as one body, some of `points` [mm].
        points: all markers in the unloaded elastomer [mm].
        moved: their displacement, as seen [mm].
        thickness: h [mm].
        depth: z [mm].
    """
    kernels = lifting_kernels(at, points, thickness, depth)
    return Added(*(small_turn(at, kernel.of(moved)) for kernel in kernels))


class _Seen(NamedTuple):
    """Markers of a contact before they were lifted: those that stick, all, and how these moved."""

    at: Float[np.ndarray, "m 2"]
    points: Float[np.ndarray, "n 2"]
    moved: Float[np.ndarray, "n 2"]

    @classmethod
    def of(cls, contact: Contact) -> "_Seen | None":
        """None where nothing has been lifted or nothing sticks."""
        fields, moved = contact.fields, contact.as_seen
        region = fields.contact if contact.stick is None else contact.stick
        points = (fields.positions - fields.displacement)[:, :2]
        known = np.isfinite(points[:, 0])
        if moved is None or np.count_nonzero(region & known) < _FEWEST:
            return None
        return cls(points[region & known], points[known], moved[known])

    def turns(self, thickness: float, depth: float) -> Added:
        return lifting_turns(self.at, self.points, self.moved, thickness, depth)


def small_turn(points: Float[np.ndarray, "m 2"], moved: Float[np.ndarray, "m 2"]) -> float:
    """Rotation of the rigid motion that is nearest to small displacements of points [rad]."""
    arm = points - points.mean(axis=0)
    return float(np.sum(arm[:, 0] * moved[:, 1] - arm[:, 1] * moved[:, 0]) / np.sum(arm**2))


def _pitch(points: Float[np.ndarray, "n 2"]) -> float:
    """Side of the square that a marker has for itself [mm]."""
    return float(np.sqrt(ConvexHull(points).volume)) / (np.sqrt(len(points)) - 1.0)


@dataclass(frozen=True)
class _Kernel:
    """A function of the wave number, as functions of distance in pitches to be summed over markers.

    Attributes:
        even: ∫ f q J0 dq/2π.
        odd: ± ∫ f q J2 dq/2π, of the part that depends on the direction; − for longitudinal waves.
        at_itself: what a marker's own value counts with.
    """

    even: Float[np.ndarray, " steps"]
    odd: Float[np.ndarray, " steps"]
    at_itself: float

    def at(self, away: Float[np.ndarray, "m n 2"]) -> Lifting:
        """Its matrices between markers that are so far apart, in pitches.

        The transverse part δ_ij − q_i q_j/q² is ½δ_ij J0 + (n_i n_j − ½δ_ij) J2 in space, the
        longitudinal one, q_i q_j/q², the rest of δ_ij J0.
        """
        distance = np.linalg.norm(away, axis=-1)
        itself = distance == 0.0
        even = np.where(itself, self.at_itself, _interpolate(self.even, distance))
        odd = np.where(itself, 0.0, _interpolate(self.odd, distance))
        along = away / np.where(itself, 1.0, distance)[..., None]
        turned = np.einsum("mni,mnj->mnij", along, along) - 0.5 * np.eye(2)
        whole = 0.5 * even[..., None, None] * np.eye(2) + odd[..., None, None] * turned
        return Lifting(np.ascontiguousarray(whole.transpose(0, 2, 1, 3)), even)

    @staticmethod
    @lru_cache(maxsize=64)
    def of(thickness: float, depth: float, name: Literal["below", "thin", "along"]) -> "_Kernel":
        """One of the `Kernels`, over the waves that markers resolve."""
        h, z = thickness, depth
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        top = _WAVES / _RESOLUTION
        q = 0.5 * top * (nodes + 1.0)
        x = np.minimum(q * h, _THICK)
        base, lift = np.exp(-2.0 * x), np.exp(q * z)
        inverse = lift * (1.0 - base) / (1.0 - np.exp(-2.0 * q * (h - z)))  # 1/D
        if name == "thin":
            wave = inverse * 2.0 * base / (1.0 - base)
        elif name == "along":
            both = (1.0 - base**2) + 4.0 * x * base  # 4 (sinh x cosh x + x) e^{−2x}
            wave = inverse * ((1.0 - base) ** 2 + 4.0 * (x**2 + 1.0) * base - both) / both
        else:
            wave = (inverse - 1.0) * np.exp(-0.5 * (q * _RESOLUTION) ** 2)
        wave = wave * q * 0.5 * top * weights / (2.0 * np.pi)
        distance = np.linspace(0.0, _REACH, _STEPS + 1)
        phase = np.outer(distance, q)
        zeroth = j0(phase)
        second = 2.0 * j1(phase) / np.maximum(phase, 1e-9) - zeroth
        even, odd = zeroth @ wave, second @ wave
        if name == "along":
            odd = -odd
        if name != "below":  # smooth: markers are points of it
            return _Kernel(even, odd, float(even[0]))
        far = np.arange(-_FAR, _FAR + 1.0)
        others = np.hypot(*np.meshgrid(far, far)).ravel()
        others = others[others > 0.0]
        uniform = 0.0 if np.isinf(h) else z / (h - z)  # of a wave of infinite length
        return _Kernel(even, odd, float(uniform - np.sum(_interpolate(even, others))))


def _interpolate(
    table: Float[np.ndarray, " steps"], distance: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Values of a table at distances in pitches; its end beyond."""
    place = np.minimum(distance * (_STEPS / _REACH), _STEPS - 1.0)
    whole = np.minimum(place.astype(int), _STEPS - 1)
    rest = place - whole
    return table[whole] * (1.0 - rest) + table[whole + 1] * rest


def read_layered(content: dict[str, Any]) -> LayeredSoftness:
    """A layered softness from a file's content.

    Raises:
        ValueError: the content is not that of a layered softness.
    """
    known = {"stiffness_ratio", "thickness_mm", "depth_mm", "covariance", "validity", "provenance"}
    expect_keys(content, "the file", known)
    for name in ("stiffness_ratio", "thickness_mm"):
        if name not in content:
            raise ValueError(f"no {name}: a layered softness needs it")
    return LayeredSoftness(
        as_number(content["stiffness_ratio"], "stiffness_ratio"),
        as_number(content["thickness_mm"], "thickness_mm"),
        as_number(content.get("depth_mm", 0.0), "depth_mm"),
        read_covariance(content, 3),
        validity=read_validity(content.get("validity", {})),
        provenance=as_table(content.get("provenance", {}), "provenance"),
    )
