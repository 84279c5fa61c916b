"""The surface of a virtual pivot as a whole, for pictures of what is printed on it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.virtual.recording import (
    PivotModel,
    Truth,
    deform,
    lay_out_markers,
    press_depth,
    twist_rotation,
)

Motion = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 3"]]
"""Takes points of the unloaded, flat surface to where they are [mm]."""


class VirtualSurface(NamedTuple):
    """A surface that an object pivots on.

    Attributes:
        motions: of its points, one for each frame; the middle of the markers is the origin.
        truth: of the markers of `lay_out_markers`.
    """

    motions: list[Motion]
    truth: Truth


def simulate_surface(
    model: PivotModel, load: Float[np.ndarray, " frames"], twist: Float[np.ndarray, " frames"]
) -> VirtualSurface:
    """The surface along a path.

    Args:
        model: what is pressed into what; its noise plays no part.
        load: share of the approach, 0 where the object does not touch.
        twist: the object's angle [rad].
    """
    # radius of the table of displacements, and its step [mm]: linear in between, good to 1e-5 mm
    reach, step = 40.0, 0.02
    radius = np.arange(0.0, reach, step)
    turned, _, _ = twist_rotation(model, radius, twist)
    depth, stretch = press_depth(model, radius, load)
    offset = np.array(model.offset)

    def motion(frame: int) -> Motion:
        def move(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
            arm = (points - offset) @ np.array([1.0, 1.0j])
            r = np.abs(arm)
            turn, sink, scale = (
                np.interp(r, radius, table[frame]) for table in (turned, depth, stretch)
            )
            moved = scale * arm * np.exp(1j * turn)
            return np.stack([moved.real + offset[0], moved.imag + offset[1], -sink], axis=1)

        return move

    _, truth = deform(model, lay_out_markers(model), load, np.where(load > 0, twist, np.nan))
    return VirtualSurface([motion(frame) for frame in range(len(load))], truth)
