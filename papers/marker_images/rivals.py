"""Centres of dots by other programs, called as their users do.

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
    """Refined centres of mass after a band pass, in a window as wide as ours, without the seeds."""
    import trackpy

    diameter = 2 * int(np.ceil(1.5 * style.radius)) + 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pandas, which it calls
        located = trackpy.locate(255.0 - grey if style.dark else grey, diameter)
    return _dots(located[["x", "y"]].to_numpy(), located["ep"].to_numpy())


def locate_by_blobs(
    grey: Float[np.ndarray, "h w"], seeds: Int[np.ndarray, "n 2"], style: DotStyle
) -> Dots:
    """Mean centres of contours at many thresholds, without the seeds."""
    settings = cv2.SimpleBlobDetector.Params()
    settings.blobColor = 0 if style.dark else 255
    settings.minArea, settings.maxArea = (factor * np.pi * style.radius**2 for factor in (0.3, 3.0))
    settings.minDistBetweenBlobs = 2.0 * style.radius
    picture = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    blobs = cv2.SimpleBlobDetector.create(settings).detect(picture)
    centre = np.array([blob.pt for blob in blobs]).reshape(-1, 2)
    return _dots(centre, np.full(len(centre), np.nan))


def _dots(centre: Float[np.ndarray, "n 2"], error: Float[np.ndarray, " n"]) -> Dots:
    """Dots with centres and standard deviations only [px]; all other values are NaN."""
    unknown = np.full(len(centre), np.nan)
    shape = np.full((len(centre), 2, 2), np.nan)
    return Dots(centre, error[:, None, None] ** 2 * np.eye(2), shape, unknown, unknown, unknown)


RIVALS = {"trackpy": locate_by_trackpy} if find_spec("trackpy") else {}
RIVALS |= {"OpenCV's blobs": locate_by_blobs}
"""Programs by name; trackpy is missing if it is not installed."""
