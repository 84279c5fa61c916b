"""Displacements of markers lifted by their waves, as sums over the markers (see `layered`)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float

from contactmodel.elasticity.transfer import ball_gain, layer_gain
from estimation.frames.recording import MarkerLayout
from estimation.softness.bar import (
    bar_compliance,
    bar_shortening,
    edge_compliance,
    force_weights,
    moment_weights,
    tip_share,
)
from estimation.softness.contact import Lifting, disc_radius

_TABLE_REACH = 40.0
"""Distance to which kernels are tabulated [pitches]."""
_MARKER_RESOLUTION = 0.5
"""Standard deviation of what markers resolve [pitches]."""


class Kernels(NamedTuple):
    """What is lacking at some markers, from what all of them show.

    Attributes:
        below: 1/D − 1, what markers below the surface do not show.
        thin: (b coth qh − 1)/D of the waves that turn, to be multiplied by k/(1 + k); b is 1, or
            that of a ball (`ball_gain`).
        along: (k̂_L/k − 1)/D of the longitudinal ones, likewise; their D is that of the others, as
            it is for waves longer than the elastomer is thick.
        ball: the part of `thin` that a flat object has not.
        plate: the part of `thin` that an object gripped at its back has, below 0.
    """

    below: Lifting
    thin: Lifting
    along: Lifting
    ball: Lifting
    plate: Lifting


class Sizes(NamedTuple):
    """Lengths of the elastomer and of the object [mm], and their stiffness ratio.

    Attributes:
        thickness: h.
        depth: z of the markers.
        radius: R of a ball or of a round tip; infinite of a flat object.
        height: H from the contact to the grip; infinite if it is much more than the contact's size.
        side: radius W of the side of a cylinder; infinite of a body wider than the contact.
        edge: radius of the edge between a cylinder's flat face and its side.
        stiffness_ratio: k, by which a ball and the elastomer share their deformation [-].
    """

    thickness: float
    depth: float = 0.0
    radius: float = np.inf
    height: float = np.inf
    side: float = np.inf
    edge: float = 0.0
    stiffness_ratio: float = 1.0


def lifting_kernels(
    at: Float[np.ndarray, "m 2"], points: Float[np.ndarray, "n 2"], sizes: Sizes
) -> Kernels:
    """What is lacking at some of the markers.

    A body that is pressed in by a slope s turns less under the same moment, by 0.15 s: the mean of
    rigid spheres on thick gels at finite strain (`papers.finite_strain.samples`, no soft object).
    Two bodies share the slope a/R as 1 : k, so k rises by 0.15 (a/R) (1 − k)/(1 + k). The part of
    a ball is 0.9 a/R, and takes this in as a factor.

    Args:
        at: markers where it is wanted, some of `points` [mm].
        points: all markers in the unloaded elastomer [mm].
        sizes: of the elastomer and the object.
    """
    pitch, k = marker_pitch(points), sizes.stiffness_ratio
    away = (at[:, None] - points) / pitch
    layer, height = (sizes.thickness / pitch, sizes.depth / pitch), sizes.height / pitch
    thin, along = (_Kernel.of(*layer, height, name).at(away) for name in ("thin", "along"))
    none = Lifting(*(np.zeros_like(part) for part in thin))
    below = none if sizes.depth == 0.0 else _Kernel.of(*layer, np.inf, "below").at(away)
    plate = none
    if np.isfinite(sizes.height):
        wide = _Kernel.of(*layer, np.inf, "thin").at(away)
        plate = Lifting(*(part - less for part, less in zip(thin, wide, strict=True)))
    if np.isinf(sizes.radius):
        return Kernels(below, thin, along, none, plate)
    stiffer = 1.0 + 0.15 / 0.9 * (1.0 - k) / (1.0 + k)
    ball = _Kernel.of_ball(*layer, height, sizes.radius / pitch).at(away)
    ball = Lifting(*(stiffer * part for part in ball))
    thin = Lifting(*(part + more for part, more in zip(thin, ball, strict=True)))
    return Kernels(below, thin, along, ball, plate)


class Added(NamedTuple):
    """What `Kernels` add to the rotation of some markers [rad].

    `along` includes the turn of a cylinder beyond that of a wide plate, less the share of a round
    tip's part that is missing beside a side.
    """

    below: float
    thin: float
    along: float
    ball: float
    plate: float


class Seen(NamedTuple):
    """Markers of a contact as they are seen, before they are lifted.

    Attributes:
        at: markers that turn as one body, some of `points` [mm].
        points: all markers in the unloaded elastomer [mm].
        moved: their displacement [mm].
        contact: those of `points` in contact [mm].
        pressed: indentation of `points` [mm]; 0 if the source does not measure it.
    """

    at: Float[np.ndarray, "m 2"]
    points: Float[np.ndarray, "n 2"]
    moved: Float[np.ndarray, "n 2"]
    contact: Float[np.ndarray, "c 2"]
    pressed: Float[np.ndarray, " n"]

    @classmethod
    def of(
        cls,
        reference: Float[np.ndarray, "n 2"],
        moved: Float[np.ndarray, "n 2"],
        risen: Float[np.ndarray, " n"],
        stick: Bool[np.ndarray, " n"],
        contact: Bool[np.ndarray, " n"],
    ) -> "Seen":
        """The known markers of a frame.

        Args:
            reference: markers in the unloaded elastomer; NaN where unknown [mm].
            moved: their displacement in the plane; NaN where unknown [mm].
            risen: their displacement along z; NaN where it is not measured [mm].
            stick: mask of the markers that turn as one body.
            contact: mask of the markers in contact.
        """
        known = np.isfinite(reference[:, 0]) & np.isfinite(moved[:, 0])
        places = (reference[mask] for mask in (stick & known, known, contact & known))
        at, points, touching = places
        return cls(at, points, moved[known], touching, np.nan_to_num(-risen[known]))

    def turns(self, sizes: Sizes) -> Added:
        """Rotation of what turns as one body that is lacking in what the markers show.

        Args:
            sizes: of the elastomer and the object.
        """
        kernels = lifting_kernels(self.at, self.points, sizes)
        added = Added(*(small_turn(self.at, kernel.of(self.moved)) for kernel in kernels))
        if np.isinf(sizes.side):
            return added
        less = (1.0 - tip_share(disc_radius(self.contact), sizes.side)) * added.ball
        return added._replace(along=added.along + self._bar(sizes) - less)

    def _bar(self, sizes: Sizes) -> float:
        """Turn of a cylinder beyond that of a wide plate, times k's divisor [rad].

        The moment is that on the gel, over G_S; the turn is `bar_compliance` times it. A gel under
        a pressing force P is stiffer by 0.27 P/(3 G_S π a²), which is 0.15 a/R under a rigid ball
        (see `lifting_kernels`). Under a flat face, k rises by (1 − k) times this, as under a ball.
        """
        stiffens = 0.27
        pitch, centre = marker_pitch(self.points), self.contact.mean(axis=0)
        k, side, height = sizes.stiffness_ratio, sizes.side, sizes.height
        reach = min(disc_radius(self.contact), 0.98 * side)
        stuck = min(disc_radius(self.at), reach)
        arm = self.points - centre
        turning = arm[:, 0] * self.moved[:, 1] - arm[:, 1] * self.moved[:, 0]
        edge = min(1.15 * reach + 0.5 * pitch, side) / pitch
        place = np.linalg.norm(arm, axis=1) / pitch, sizes.thickness / pitch, sizes.depth / pitch
        # weights have no unit, displacement times arm is mm²; the lattice is counted in pitches
        moment = pitch * float(moment_weights(*place, edge) @ turning)
        force = pitch * float(force_weights(*place, edge) @ self.pressed)
        strain = max(force, 0.0) / (3.0 * np.pi)  # times the square of a radius
        stiffer = stiffens * strain / reach**2
        compliance = bar_compliance(side, height, reach, stuck) + edge_compliance(side, sizes.edge)
        turn = (1.0 + stiffer) * moment * compliance
        turn *= bar_shortening(side, height, k * strain / side**2)
        if np.isfinite(sizes.radius):
            return turn
        firm = np.isin(self.points @ [1.0, 1.0j], self.at @ [1.0, 1.0j])
        return turn + (1.0 - k) * stiffer * small_turn(self.at, self.moved[firm])


def displacement_as_seen(
    layout: MarkerLayout, positions: Float[np.ndarray, "n d"], valid: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2"]:
    """Displacement of all markers in the plane [mm]; unseen ones have that of their neighbours."""
    moved = positions[:, :2] - layout.reference[:, :2]
    beside = layout.neighbours
    counts = (beside >= 0) & valid[beside]
    total = np.sum(np.where(counts[..., None], moved[beside], 0.0), axis=1)
    mean = total / np.maximum(counts.sum(axis=1), 1)[:, None]
    return np.where(valid[:, None], moved, mean)


def small_turn(points: Float[np.ndarray, "m 2"], moved: Float[np.ndarray, "m 2"]) -> float:
    """Rotation of the rigid motion that is nearest to small displacements of points [rad]."""
    arm = points - points.mean(axis=0)
    return float(np.sum(arm[:, 0] * moved[:, 1] - arm[:, 1] * moved[:, 0]) / np.sum(arm**2))


def marker_pitch(points: Float[np.ndarray, "n 2"]) -> float:
    """Side of the square that a marker has for itself [mm]."""
    return float(np.sqrt(scipy.spatial.ConvexHull(points).volume)) / (np.sqrt(len(points)) - 1.0)


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
    def of(
        thickness: float, depth: float, height: float, name: Literal["below", "thin", "along"]
    ) -> "_Kernel":
        """One of the `Kernels` of a flat object, over the waves that markers resolve."""
        beyond = 25  # pitches over which the lattice is added up
        h, z = thickness, depth
        q, weights, zeroth, second = _quadrature()
        gain, plate = layer_gain(q * h, q * z), layer_gain(q * height, 0.0 * q)
        transverse = (1.0 + gain.transverse) / (1.0 + plate.transverse) - 1.0
        longitudinal = (1.0 + gain.longitudinal) / (1.0 + plate.longitudinal) - 1.0
        waves = {
            "below": gain.below * np.exp(-0.5 * (q * _MARKER_RESOLUTION) ** 2),
            "thin": (1.0 + gain.below) * transverse,
            "along": (1.0 + gain.below) * longitudinal,
        }
        wave = waves[name] * q * weights / (2.0 * np.pi)
        even, odd = zeroth @ wave, second @ wave
        if name == "along":
            odd = -odd
        if name != "below":  # smooth: markers are points of it
            return _Kernel(even, odd, float(even[0]))
        others = _distances(beyond)
        uniform = 0.0 if np.isinf(h) else z / (h - z)  # of a wave of infinite length
        return _Kernel(even, odd, float(uniform - np.sum(_interpolate(even, others))))

    @staticmethod
    @lru_cache(maxsize=64)
    def of_ball(thickness: float, depth: float, height: float, object_radius: float) -> "_Kernel":
        """The kernel `ball`, b − 1 in place of b: (b − 1) coth qh/D.

        At a grip at the height H, it fades like tanh³ qH: between 2 and 3 in linear torsion of
        plates with a round tip (`papers.finite_strain.torsion`).

        It falls like 1/q only, so the kernel grows like 1/r towards the marker itself. Its own
        weight is that with which the sum over the lattice is the integral for a wide bell.
        """
        bell = 8.0  # pitches, standard deviation; 0 at the table's reach
        cut = 0.35  # pitches; waves as short are cut off, and those that markers resolve stay
        q, weights, zeroth, second = _quadrature()
        gain = layer_gain(q * thickness, q * depth)
        x = 0.5 * (q * cut) ** 2
        seen = (1.0 + x) * np.exp(-x) + gain.below * np.exp(-0.5 * (q * _MARKER_RESOLUTION) ** 2)
        wave = (
            seen * (1.0 + gain.transverse) * ball_gain(q * object_radius) * np.tanh(q * height) ** 3
        )
        wave = wave * q * weights / (2.0 * np.pi)
        even = zeroth @ wave
        others = _distances(int(_TABLE_REACH))
        around = np.sum(_interpolate(even, others) * np.exp(-0.5 * (others / bell) ** 2))
        whole = 2.0 * np.pi * bell**2 * np.sum(wave * np.exp(-0.5 * (q * bell) ** 2))
        return _Kernel(even, second @ wave, float(whole - around))


def _distances(reach: int) -> Float[np.ndarray, " others"]:
    """Distances of the other points of a square lattice, up to a reach along its axes."""
    along = np.arange(-reach, reach + 1.0)
    distance = np.hypot(*np.meshgrid(along, along)).ravel()
    return distance[distance > 0.0]


@lru_cache(maxsize=1)
def _quadrature() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Wave numbers and weights, and J0 and J2 by distance and wave number; the same for all."""
    wave_range, node_count = 6.5, 600  # up to e^{-21} of the resolution
    steps = 1200  # of the table
    nodes, weights = scipy.special.roots_legendre(node_count)
    half = 0.5 * wave_range / _MARKER_RESOLUTION
    q = half * (nodes + 1.0)
    phase = np.outer(np.linspace(0.0, _TABLE_REACH, steps + 1), q)
    zeroth = scipy.special.j0(phase)
    second = 2.0 * scipy.special.j1(phase) / np.maximum(phase, 1e-9) - zeroth
    return q, half * weights, zeroth, second


def _interpolate(
    table: Float[np.ndarray, " steps"], distance: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Values of a table at distances in pitches; its end beyond."""
    steps = len(table) - 1
    place = np.minimum(distance * (steps / _TABLE_REACH), steps - 1.0)
    whole = np.minimum(place.astype(int), steps - 1)
    rest = place - whole
    return table[whole] * (1.0 - rest) + table[whole + 1] * rest
