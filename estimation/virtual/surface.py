"""The whole surface of a virtual pivot, for pictures of the patterns printed on it."""

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
"""Maps points of the unloaded, flat surface to their current positions [mm]."""


class VirtualSurface(NamedTuple):
    """A surface on which an object pivots.

    Attributes:
        motions: motion of its points in each frame, with the middle of the markers as origin.
        truth: of the markers of `lay_out_markers`.
    """

    motions: list[Motion]
    truth: Truth


def simulate_surface(
    model: PivotModel, load: Float[np.ndarray, " frames"], twist: Float[np.ndarray, " frames"]
) -> VirtualSurface:
    """Simulate the surface along a path.

    Args:
        model: sphere, elastomer and markers; its noise is not used.
        load: in each frame, as a share of the full approach [-]; 0 without contact.
        twist: the object's angle in each frame [rad].
    """
    # radius and step of the table of displacements [mm]; linear interpolation errs by 1e-5 mm
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
