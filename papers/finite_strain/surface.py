"""Motion of a gel's round surface along a path, and markers on it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import PchipInterpolator


class Surface(NamedTuple):
    """Motion of a gel's top along a path.

    Attributes:
        radius: radius of the undeformed top's points [mm].
        moved: displacement u_r, u_θ and u_z, in the basis of the undeformed point [mm].
        twist: twist of the object, counter-clockwise [rad].
        stick: mask of the points in contact that do not slip in the step.
    """

    radius: Float[np.ndarray, " points"]
    moved: Float[np.ndarray, "steps points 3"]
    twist: Float[np.ndarray, " steps"]
    stick: Bool[np.ndarray, "steps points"]


def move_markers(
    surface: Surface, reference: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "steps n 3"], Bool[np.ndarray, "steps n"]]:
    """Displacements of markers [mm], and the mask of those that stick, in each step.

    Args:
        surface: motion of the gel's top.
        reference: positions of the markers on the unloaded gel [mm].
    """
    x, y = reference[:, :2].T
    r = np.hypot(x, y)
    radial, around, up = np.moveaxis(
        PchipInterpolator(surface.radius, surface.moved, axis=1)(r), 2, 0
    )
    c, s = x / r, y / r
    moved = np.stack([c * radial - s * around, s * radial + c * around, up], axis=-1)
    nearest = np.abs(surface.radius[:, None] - r).argmin(axis=0)
    return moved, surface.stick[:, nearest]
