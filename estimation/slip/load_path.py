"""Moment and shear of a turning contact as one load.

All of a contact slips where moment M and shear Q meet its limit surface, nearly an ellipsoid
([Howe1996]): where M² + (Q d)² reaches (μP d)², with the arm d of the friction
(`estimation.slip.friction`). The load is therefore the vector (M, Q_x d, Q_y d). Since the turn
began, it has moved along a line, whose limit is that of the surface.

[Howe1996] R. D. Howe, M. R. Cutkosky, "Practical Force-Motion Models for Sliding Manipulation".
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Loads(NamedTuple):
    """Moment and shear on a contact [N·mm]; NaN where unknown.

    Attributes:
        moment: moment about the contact's centre.
        shear_x: shear force along x times the arm of the friction.
        shear_y: the same along y.
    """

    moment: float = np.nan
    shear_x: float = np.nan
    shear_y: float = np.nan


class Direction(NamedTuple):
    """The direction in which the load has moved since the turn began; the default has no shear.

    Attributes:
        turning: moment along the turn over the load along the direction [-].
        rise: slope of the moment along the turn over the load now [-].
        twist_share: share of the moment in the square of the load, before much of the contact slips
            [-]. Later the moment hardly grows, since the torsional stiffness falls with the cube of
            the disc that sticks, and that of the shear with its radius.
        across: size of the load across the direction [N·mm].
        offset: moment across the direction, along the turn [N·mm].
    """

    turning: float = 1.0
    rise: float = 1.0
    twist_share: float = 1.0
    across: float = 0.0
    offset: float = 0.0


class LoadPath(NamedTuple):
    """The load since the turn began, along its direction [N·mm]."""

    along: Float[np.ndarray, " points"]
    direction: Direction = Direction()


def since_turn(
    points: Float[np.ndarray, "points 4"], sign: float, least: float
) -> Float[np.ndarray, "later 4"]:
    """The points since the object began to turn, without a shear before.

    Args:
        points: angle [rad] and loads of each.
        sign: direction of the turn, ±1.
        least: least turn [rad].
    """
    rests = 0.1  # of the turn so far, and of the least turn
    turned = sign * points[:, 0]
    level = np.median(turned[turned <= turned.min() + rests * np.ptp(turned)])
    return points[np.flatnonzero(turned <= level + rests * least)[-1] :]


def follow_load(loads: Float[np.ndarray, "points 3"], sign: float) -> LoadPath:
    """The load along its direction since the first point.

    Args:
        loads: moment and shear as in `Loads` [N·mm].
        sign: direction of the turn, ±1.
    """
    fewest = 4  # points that show how the direction bends
    moved = loads - loads[0]
    size = np.linalg.norm(moved, axis=1)
    if not loads[:, 1:].any() or not size[-1] > 0.0:
        return LoadPath(sign * loads[:, 0])
    direction = moved[-3:].mean(axis=0)
    direction /= np.linalg.norm(direction)
    initial, now = direction, direction
    early = (size > 0.0) & (size <= 0.8 * size[-1])
    if early.sum() >= fewest:
        bent = np.column_stack([size, size**2])
        initial = np.linalg.lstsq(bent[early], moved[early])[0][0]
        now = np.array([1.0, 2.0 * size[-1]]) @ np.linalg.lstsq(bent, moved)[0]
    start = float(loads[0] @ direction)
    across = loads[0] - start * direction
    found = Direction(
        turning=float(sign * direction[0]),
        rise=float(np.clip(sign * now[0], -1.0, 1.0)),
        twist_share=round(float(initial[0] ** 2 / (initial @ initial)), 2),
        across=float(np.linalg.norm(across)),
        offset=float(sign * across[0]),
    )
    return LoadPath(start + np.copysign(size, moved @ direction), found)
