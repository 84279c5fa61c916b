"""Thin strokes nearly as dark as the dots: text, hairs and other marks that no object prints.

Ink makes dots as dark as anything that the gel shows. An object prints through the gel by light and
shade, which the gel blurs.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from estimation.pictures.dots.find import Dots, DotStyle


def find_strokes(
    grey: Float[np.ndarray, "h w"], dots: Dots, style: DotStyle
) -> Bool[np.ndarray, "h w"] | None:
    """Find strokes thinner than dots, with their edges; bright strokes among bright dots.

    Strokes that together are smaller than two dots may be worn dots. None are then returned.

    Args:
        grey: levels of a picture [grey levels of 255].
        dots: all dots of the picture; their median contrast must be that of the sensor's dots.
        style: the dots' typical appearance.
    """
    # width of a stroke, over a dot's diameter, and its contrast, over a dot's [-]: together, such
    # strokes are as large as 0.5 dots in published lifts and clips, and as 3.6 to 12 in drawn text
    widest, least = 0.6, 0.8
    reach = 1.7  # of a dot's blurred edge [radii]
    level = np.clip(grey, 0.0, 255.0).astype(np.uint8)
    level = level if style.dark else 255 - level
    side = 2 * int(widest * style.radius) + 1
    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    depth = cv2.morphologyEx(level, cv2.MORPH_BLACKHAT, window)
    contrast = np.median(dots.contrast)
    strokes = np.where(depth > 0.5 * least * contrast, depth, 0)  # with their blurred edges
    for x, y in np.rint(dots.centre).astype(int).tolist():
        cv2.circle(strokes, (x, y), int(reach * style.radius) + 1, 0, -1)
    rim = round(2.0 * style.radius)  # width of the edge, where dots may be cut and so not detected
    strokes[:rim] = strokes[-rim:] = strokes[:, :rim] = strokes[:, -rim:] = 0
    if np.count_nonzero(strokes > least * contrast) < 2.0 * np.pi * style.radius**2:
        return None
    return cv2.dilate(strokes, np.ones((3, 3), np.uint8)) > 0
