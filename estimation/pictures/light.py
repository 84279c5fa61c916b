"""Grey levels of a picture, 0 to 255."""

import cv2
import numpy as np
from jaxtyping import Float, Float32, Shaped


def to_light(picture: Shaped[np.ndarray, "h w *colour"]) -> Float32[np.ndarray, "h w"]:
    """Convert a picture of 8 or 16 bit, grey or BGR, to grey levels, 0 to 255."""
    if picture.ndim == 3:
        picture = cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_BGR2GRAY)
    scale = 1.0 / 257.0 if picture.dtype == np.uint16 else 1.0
    return picture.astype(np.float32) * np.float32(scale)


def to_grey(picture: Shaped[np.ndarray, "h w *colour"], dark: bool) -> Float[np.ndarray, "h w"]:
    """Convert a picture to one channel in which dots stand out from coloured light, 0 to 255.

    Dark dots are dark in every colour, so only they are dark in the brightest channel. Bright dots
    are bright in every colour, so only they are bright in the darkest channel.
    """
    if picture.ndim == 3:
        order = cv2.dilate if dark else cv2.erode  # over three neighbours: one pixel's channels
        rows = np.ascontiguousarray(picture[..., :3]).reshape(len(picture), -1)
        picture = order(rows, np.ones((1, 3), np.uint8))[:, 1::3]
    grey = picture.astype(np.float32)
    return grey * np.float32(1.0 / 257.0) if picture.dtype == np.uint16 else grey
