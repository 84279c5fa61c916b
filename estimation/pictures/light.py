"""Grey levels of a picture, 0 to 255."""

from functools import reduce

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped


def to_light(picture: Shaped[np.ndarray, "h w *colour"]) -> Float32[np.ndarray, "h w"]:
    """Convert a picture of 8 or 16 bit, grey or BGR, to grey levels, 0 to 255."""
    if picture.ndim == 3:
        picture = cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_BGR2GRAY)
    scale = 1.0 / 257.0 if picture.dtype == np.uint16 else 1.0
    return picture.astype(np.float32) * np.float32(scale)


def is_grey(picture: Shaped[np.ndarray, "h w *colour"]) -> bool:
    """Whether a picture has one channel, or equal ones, as decoded grey videos have."""
    if picture.ndim == 2:
        return True
    most = 2.0  # difference of the channels [grey levels of 255]
    scale = 1.0 / 257.0 if picture.dtype == np.uint16 else 1.0
    return float(np.ptp(picture[::2, ::2, :3], axis=2).max()) * scale <= most


def find_gain(
    picture: Shaped[np.ndarray, "h w *colour"], seen: Bool[np.ndarray, "h w"] | None = None
) -> float:
    """Factor that brightens the pictures of a dark clip to the usual exposure; 1 if not dark [-].

    Least textures and changes of light are given in grey levels of pictures exposed as usual. In a
    darker clip, a print has proportionally less of both.

    Args:
        picture: the first of the clip.
        seen: pixels that are read; all by default.
    """
    usual = 80.0  # median grey level of 255; 81 to 140 in published clips
    most = 4.0  # in darker pictures, compression leaves too little of a print
    light = to_light(picture)
    level = float(np.median(light if seen is None else light[seen]))
    return min(max(usual / max(level, 1.0), 1.0), most)


def to_grey(picture: Shaped[np.ndarray, "h w *colour"], dark: bool) -> Float[np.ndarray, "h w"]:
    """Convert a picture to one channel in which dots stand out from coloured light, 0 to 255.

    Dark dots are dark in every colour, so only they are dark in the brightest channel. Bright dots
    are bright in every colour, so only they are bright in the darkest channel.
    """
    if picture.ndim == 3:
        picture = reduce(cv2.max if dark else cv2.min, cv2.split(picture[..., :3]))
    grey = picture.astype(np.float32)
    return grey * np.float32(1.0 / 257.0) if picture.dtype == np.uint16 else grey
