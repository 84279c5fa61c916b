"""The slow light around each pixel of a picture with gaps."""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float32

Level = Callable[[Float32[np.ndarray, "h w"]], Float32[np.ndarray, "h w"]]


def mean_around(clear: Float32[np.ndarray, "h w"], reach: int) -> Level:
    """A function that averages a plane around each pixel, over clear pixels only.

    Args:
        clear: 1 at clear pixels, else 0.
        reach: half the side of the square around each pixel [px].
    """
    share = _blur(clear, reach) + np.float32(1e-3)
    return lambda plane: _blur(plane * clear, reach) / share


def slope_around(clear: Float32[np.ndarray, "h w"], reach: int) -> Level:
    """A function that fits level and slope of a plane around each pixel, over clear pixels only.

    It gives the level at the pixel. Beside a part of the picture that is not read, all clear pixels
    lie on one side, where a mean has the light of a place further in.

    Args:
        clear: as for `mean_around`.
        reach: as for `mean_around`.
    """
    # mean square of the distances in a direction [px²], below which the slope counts less
    least = np.float32(0.1)
    height, width = clear.shape
    # from the middle, so that differences of large moments keep their digits
    x = np.arange(width, dtype=np.float32)[None, :] - np.float32(0.5 * width)
    y = np.arange(height, dtype=np.float32)[:, None] - np.float32(0.5 * height)

    def moments(plane: np.ndarray) -> tuple[np.ndarray, ...]:
        whole = _blur(plane, reach)
        return whole, _blur(plane * x, reach) - x * whole, _blur(plane * y, reach) - y * whole

    share, sx, sy = moments(clear)
    share += np.float32(1e-6)
    _, sxx, sxy = moments(clear * x)
    _, _, syy = moments(clear * y)
    # means over the clear pixels: of their offsets from the pixel, and of the products of these
    xx, xy, yy = (sxx - x * sx) / share + least, (sxy - x * sy) / share, (syy - y * sy) / share
    mx, my, yy = sx / share, sy / share, yy + least
    # first row of the inverse of the normal equations, with the sum that it has for a plane of ones
    weights = xx * yy - xy * xy, xy * my - mx * yy, mx * xy - xx * my
    total = share * (weights[0] + mx * weights[1] + my * weights[2])

    def level(plane: np.ndarray) -> Float32[np.ndarray, "h w"]:
        value, along, across = moments(plane * clear)
        return (weights[0] * value + weights[1] * along + weights[2] * across) / total

    return level


def _blur(plane: Float32[np.ndarray, "h w"], reach: int) -> Float32[np.ndarray, "h w"]:
    """The mean over a square around each pixel; the picture is mirrored at its sides."""
    return cv2.blur(plane, (2 * reach + 1,) * 2)
