"""Other programs' centres of dots, as their users call them.

trackpy: D. B. Allan et al., https://soft-matter.github.io/trackpy. Blob detector: OpenCV's
`SimpleBlobDetector`.
"""

import warnings
from importlib.util import find_spec

import cv2
import numpy as np
from jaxtyping import Float, Int

from estimation.pictures.dots.find import Dots, DotStyle


def locate_by_trackpy(
    grey: Float[np.ndarray, "h w"], seeds: Int[np.ndarray, "n 2"], style: DotStyle
) -> Dots:
    """Centres of mass after a band pass, refined; the window is as wide as ours is.

    Args:
        grey: the picture, 0 to 255.
        seeds: not used: trackpy finds its own.
        style: typical radius, and whether the dots are dark.
    """
    import trackpy

    diameter = 2 * int(np.ceil(1.5 * style.radius)) + 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pandas, which it calls
        found = trackpy.locate(255.0 - grey if style.dark else grey, diameter)
    return _dots(found[["x", "y"]].to_numpy(), found["ep"].to_numpy())


def locate_by_blobs(
    grey: Float[np.ndarray, "h w"], seeds: Int[np.ndarray, "n 2"], style: DotStyle
) -> Dots:
    """Mean centres of contours at many thresholds.

    Args:
        grey: the picture, 0 to 255.
        seeds: not used: the detector finds its own.
        style: typical radius, and whether the dots are dark.
    """
    told = cv2.SimpleBlobDetector.Params()
    told.blobColor = 0 if style.dark else 255
    told.minArea, told.maxArea = (factor * np.pi * style.radius**2 for factor in (0.3, 3.0))
    told.minDistBetweenBlobs = 2.0 * style.radius
    picture = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    found = cv2.SimpleBlobDetector.create(told).detect(picture)
    centre = np.array([one.pt for one in found]).reshape(-1, 2)
    return _dots(centre, np.full(len(centre), np.nan))


def _dots(centre: Float[np.ndarray, "n 2"], error: Float[np.ndarray, " n"]) -> Dots:
    """Dots of which only the centres and what is claimed of them are known [px]."""
    unknown = np.full(len(centre), np.nan)
    shape = np.full((len(centre), 2, 2), np.nan)
    return Dots(centre, error[:, None, None] ** 2 * np.eye(2), shape, unknown, unknown, unknown)


RIVALS = {"trackpy": locate_by_trackpy} if find_spec("trackpy") else {}
RIVALS |= {"OpenCV's blobs": locate_by_blobs}
"""By name; trackpy is left out where it is not installed."""
