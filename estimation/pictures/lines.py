"""Rotation of the line features at a marker: its own edges, and the lines to its neighbours.

[Li2024] Fig. 5(a) uses the edges through an x-corner, Fig. 5(b) the lines between markers. Edges
are local; lines are longer and thus more precise. This module combines both, weighted by the
inverse of their variances.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class Rotation(NamedTuple):
    """Mean rotation of two lines at each marker.

    Attributes:
        angle: φ [rad, from x to y]; NaN where unknown.
        variance: of the angle [rad²]; infinite where unknown.
    """

    angle: Float[np.ndarray, " m"]
    variance: Float[np.ndarray, " m"]


def rotation_of_edges(
    rest: Float[np.ndarray, "m 2"],
    now: Float[np.ndarray, "m 2"],
    variance: Float[np.ndarray, " m"],
) -> Rotation:
    """Mean rotation of both edges through each corner.

    Args:
        rest: directions of the two edges at rest [rad].
        now: their current directions [rad]; NaN where not visible.
        variance: of the mean of the two edges, sum of rest and now [rad²].
    """
    angle = _mean(now - rest)
    return Rotation(angle, np.where(np.isfinite(angle), variance, np.inf))


def rotation_of_lines(
    neighbours: Int[np.ndarray, "m 4"],
    rest: Float[np.ndarray, "m 2"],
    now: Float[np.ndarray, "m 2"],
    variance: Float[np.ndarray, " m"],
) -> Rotation:
    """Mean rotation of the two lines through each marker's opposite neighbours.

    A line ends at the marker itself if a neighbour is not visible.

    Args:
        neighbours: of each marker, the two neighbours on one line, then the two on the other; −1
            for none.
        rest: positions at rest.
        now: current positions; NaN where not visible.
        variance: of each marker's position per coordinate, sum of rest and now.
    """
    itself = np.arange(len(rest))
    seen = (neighbours >= 0) & np.isfinite(now[neighbours, 0])
    ends = np.where(seen, neighbours, itself[:, None]).reshape(-1, 2, 2)
    complex_rest, complex_now = (points @ np.array([1.0, 1.0j]) for points in (rest, now))
    before = complex_rest[ends[..., 1]] - complex_rest[ends[..., 0]]
    after = complex_now[ends[..., 1]] - complex_now[ends[..., 0]]
    apart = np.abs(before) > 0
    turned = np.where(apart, np.angle(after * np.conj(before)), np.nan)
    length = np.where(apart & np.isfinite(after), np.abs(after), np.nan)
    angle = _mean(turned)
    spread = 0.25 * (variance[ends].sum(axis=-1) / length**2).sum(axis=1)
    return Rotation(angle, np.where(np.isfinite(angle), spread, np.inf))


def fuse_rotations(one: Rotation, other: Rotation) -> Rotation:
    """Average two independent measurements, weighted by the inverse of their variances."""
    weights = np.stack([1.0 / one.variance, 1.0 / other.variance])
    total = weights.sum(axis=0)
    measured = total > 0
    total = np.where(measured, total, 1.0)
    apart = np.angle(np.exp(1j * (other.angle - one.angle)))
    mean = one.angle + weights[1] / total * apart
    angle = np.where(weights[0] == 0, other.angle, np.where(weights[1] == 0, one.angle, mean))
    return Rotation(np.where(measured, angle, np.nan), np.where(measured, 1.0 / total, np.inf))


def straighten_edges(
    neighbours: Int[np.ndarray, "m 4"],
    position: Float[np.ndarray, "m 2"],
    heading: Float[np.ndarray, "m 2"],
    radius: float,
) -> Float[np.ndarray, "m 2"]:
    """Correct fitted corner positions for the curvature of their edges.

    The fit assumes straight edges. A straight line fitted to an edge of curvature κ misses the
    corner by κ times the window's squared size times a factor of 0.17 to 0.23, which depends on the
    edge's direction and follows from the fit's linearisation. The curvature comes from the line
    through the neighbours. Positions stay uncorrected where a neighbour is not visible.

    Args:
        neighbours: of each corner, the two neighbours on one line, then the two on the other; −1
            for none.
        position: fitted positions [px]; NaN where not visible.
        heading: directions of both edges [rad].
        radius: half the side of the fit's window [px].
    """
    # shift of a corner's fit by a curved edge, over the curvature and the squared window
    shift_factor = 0.19
    points = np.where((neighbours >= 0)[..., None], position[neighbours], np.nan)
    before, after = points[:, 0::2] - position[:, None], points[:, 1::2] - position[:, None]
    lengths = np.linalg.norm(before, axis=-1) * np.linalg.norm(after, axis=-1)
    normals = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    shift = shift_factor * radius**2 * np.sum(normals * (before + after), axis=-1) / lengths
    (a, b), (c, d) = normals[:, 0].T, normals[:, 1].T
    away = np.stack([d * shift[:, 0] - b * shift[:, 1], a * shift[:, 1] - c * shift[:, 0]], axis=1)
    away /= (a * d - b * c)[:, None]
    return np.where(np.isfinite(away), position - away, position)


def _mean(turned: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
    """Mean of two angles that differ by less than half a turn."""
    between = np.angle(np.exp(1j * (turned[:, 1] - turned[:, 0])))
    return np.angle(np.exp(1j * (turned[:, 0] + 0.5 * between)))
