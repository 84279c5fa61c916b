"""The indentation around an object, as a function of the gel's thickness and the object's shape.

Tabulated once, from the solution for a bonded layer (`contactmodel.analytic.press_layer_punch`).
Faces that are flat up to some radius and round beyond range from balls to flat ends.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.analytic.layer_punch import press_layer_punch


class Indentation(NamedTuple):
    """Indentation at some distances from the axis, over the depth of the object.

    Attributes:
        value: the indentation.
        by_distance: its derivative by the distance.
        by_thinness: its derivative by a/(a + h), 0 beyond the table.
        by_flat: its derivative by the flat part, 0 beyond the table.
    """

    value: Float[np.ndarray, " m"]
    by_distance: Float[np.ndarray, " m"]
    by_thinness: Float[np.ndarray, " m"]
    by_flat: Float[np.ndarray, " m"]


class FacePrior(NamedTuple):
    """Thinness and flat part of a face before it is seen, and their standard deviations."""

    mean: tuple[float, float] = (0.35, 0.45)
    spread: tuple[float, float] = (0.25, 0.35)


class _Table(NamedTuple):
    """Indentation and its derivatives over thinness, flat part and distance, and arms."""

    thinness: Float[np.ndarray, " thin"]
    flat: Float[np.ndarray, " punches"]
    distance: Float[np.ndarray, " points"]
    fields: Float[np.ndarray, "thin punches points 4"]
    arms: Float[np.ndarray, "thin punches"]


def press_face(distance: Float[np.ndarray, " m"], thinness: float, flat: float) -> Indentation:
    """The indentation at points around an object.

    Args:
        distance: distance from the axis over the contact's radius, constant beyond the table [-].
        thinness: a/(a + h) of the contact's radius a and the gel's thickness h, 0 for a half-space
            [-].
        flat: radius of the face's flat part over that of the contact [-].
    """
    table = _table()
    nearest = clip_face(thinness, flat)
    i, x, _ = find_place(thinness, table.thinness)
    j, y, _ = find_place(flat, table.flat)
    corners = table.fields[i : i + 2, j : j + 2]
    along = (1.0 - y) * corners[:, 0] + y * corners[:, 1]
    line = (1.0 - x) * along[0] + x * along[1]
    place = np.minimum(distance / table.distance[1], len(line) - 1.001)
    left = place.astype(int)
    start = line.take(left, axis=0)
    fields = start + (place - left)[:, None] * (line.take(left + 1, axis=0) - start)
    value, by_distance, by_thinness, by_flat = fields.T
    return Indentation(
        value, by_distance, by_thinness * (thinness == nearest[0]), by_flat * (flat == nearest[1])
    )


def face_arm(thinness: float, flat: float) -> float:
    """Mean distance of the pressure under a face from the axis, over the contact's radius [-]."""
    table = _table()
    i, x, _ = find_place(thinness, table.thinness)
    j, y, _ = find_place(flat, table.flat)
    return float(np.array([1.0 - x, x]) @ table.arms[i : i + 2, j : j + 2] @ [1.0 - y, y])


def clip_face(thinness: float, flat: float) -> tuple[float, float]:
    """The nearest thinness and flat part in the table."""
    table = _table()
    within = np.clip((thinness, flat), 0.0, (table.thinness[-1], table.flat[-1]))
    return float(within[0]), float(within[1])


def coarse_faces() -> tuple[Float[np.ndarray, "faces 2"], Float[np.ndarray, "faces points"]]:
    """Thinness and flat part of some faces, and their indentation over the table's distances."""
    table = _table()
    thin, flat = table.thinness[::2], table.flat[[0, 3, 5, 7, 8]]
    faces = np.stack(np.meshgrid(thin, flat, indexing="ij"), axis=-1).reshape(-1, 2)
    return faces, table.fields[::2, [0, 3, 5, 7, 8], :, 0].reshape(len(faces), -1)


def distance_step() -> float:
    """Step of the table's distances, over the contact's radius [-]."""
    return float(_table().distance[1])


def find_place(
    value: float, knots: Sequence[float] | Float[np.ndarray, " knots"]
) -> tuple[int, float, float]:
    """The interval of a value, its place within, from 0 to 1, and the derivative of the place."""
    within = min(max(value, knots[0]), knots[-1])
    i = min(int(np.searchsorted(knots, within, side="right")) - 1, len(knots) - 2)
    width = float(knots[i + 1] - knots[i])
    return i, float(within - knots[i]) / width, 1.0 / width


@cache
def _table() -> _Table:
    thinness = np.linspace(0.0, 0.76, 14)
    flat = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.88, 0.94])
    distance = 0.02 * np.arange(400)
    # the closed forms at fewer points, closer together at the edge
    inner = np.r_[np.linspace(0.0, 0.95, 39)[:-1], 1.0 + 0.05 * np.linspace(-1.0, 1.0, 21) ** 3]
    points = np.r_[inner, np.linspace(1.05, 2.5, 30)[1:], np.geomspace(2.5, 8.0, 30)[1:]]
    punches = [press_layer_punch(points, 1.0 / u - 1.0 if u else np.inf, flat) for u in thinness]
    value = np.array(
        [[np.interp(distance, points, one.indentation) for one in row] for row in punches]
    )
    arms = np.array([[one.arm for one in row] for row in punches])
    slopes = [np.gradient(value, at, axis=k) for k, at in ((2, distance), (0, thinness), (1, flat))]
    return _Table(thinness, flat, distance, np.stack([value, *slopes], axis=-1), arms)
