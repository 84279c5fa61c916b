"""How gel turns around a disc, as a function of its thickness.

Tabulated once, from the solution for a bonded layer (`contactmodel.analytic.turn_layer_disc`).
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.analytic import punch_displacement, turn_layer_disc

LARGEST_THINNESS = 4.0
"""Largest radius of the disc over the thickness in the table [-]."""


class Share(NamedTuple):
    """Rotation of gel around a disc that turns, over that of the disc [-].

    Attributes:
        value: the rotation.
        by_distance: its derivative by the logarithm of the distance from the axis.
        by_radius: its derivative by the logarithm of the disc's radius.
        by_thickness: its derivative by the logarithm of the gel's thickness.
    """

    value: Float[np.ndarray, " m"]
    by_distance: Float[np.ndarray, " m"]
    by_radius: Float[np.ndarray, " m"]
    by_thickness: Float[np.ndarray, " m"]


def share_around(within: Float[np.ndarray, " m"], thinness: float) -> Share:
    """The rotation of points around a disc.

    Args:
        within: radius of the disc over each point's distance from the axis, at most 1 [-].
        thinness: radius of the disc over the gel's thickness, 0 for a half-space [-].
    """
    root = np.sqrt(1.0 - within * within)
    half_space = 2.0 / np.pi * (np.arcsin(within) - within * root)
    # the slope is unbounded in the table's coordinate at the rim
    steep = within * within / np.maximum(root, 0.05) * (within < 1.0)
    table = _table()
    thin = min(thinness, LARGEST_THINNESS) / (1.0 + min(thinness, LARGEST_THINNESS))
    row = thin * (len(table) - 1) * (1.0 + LARGEST_THINNESS) / LARGEST_THINNESS
    before = min(int(row), len(table) - 2)
    near = table[before] + (row - before) * (table[before + 1] - table[before])
    place = root * (len(near) - 1)
    left = np.minimum(place.astype(int), len(near) - 2)
    start = near.take(left, axis=0)
    part, along, across = (
        start + (place - left)[:, None] * (near.take(left + 1, axis=0) - start)
    ).T
    thicker = half_space * across * (thin * (thin - 1.0) * (thinness < LARGEST_THINNESS))
    by_within = steep * (4.0 / np.pi * within * part - half_space * along)
    return Share(half_space * part, -by_within, by_within - thicker, thicker)


@cache
def _table() -> Float[np.ndarray, "thin roots 3"]:
    """The rotation over that around a disc on a half-space, and its derivatives.

    Over thinness/(1 + thinness), and √(1 − (radius/distance)²) from 0 at the rim to 1.
    """
    from scipy.interpolate import RectBivariateSpline  # slow to import, as in `edge`

    coarse = np.linspace(0.0, 1.0, 61)[:-1]
    distance = 1.0 / np.sqrt(1.0 - coarse**2)
    thin = np.linspace(0.0, LARGEST_THINNESS / (1.0 + LARGEST_THINNESS), 33)
    alone = punch_displacement(distance, 1.0)
    shares = [turn_layer_disc(distance, 1.0 / s - 1.0)[0] / alone for s in thin[1:]]
    spline = RectBivariateSpline(coarse, thin, np.stack([np.ones(len(coarse)), *shares], axis=1))
    root, thin = np.linspace(0.0, 1.0, 481), np.linspace(0.0, thin[-1], 129)
    fields = [spline(root, thin, dx=dx, dy=dy).T for dx, dy in ((0, 0), (1, 0), (0, 1))]
    return np.stack(fields, axis=2).copy(order="C")
