"""Standard methods on pictures: track dots or corners, then fit one rigid motion to them.

trackpy: D. B. Allan et al., https://soft-matter.github.io/trackpy (extra `peers`). Optical flow:
OpenCV's pyramidal Lucas–Kanade. The rigid fit is that of [Kabsch1976]. Neither method knows the
contact region, so the fit takes all points that have moved since the first picture.
"""

import warnings
from collections.abc import Iterable
from importlib.util import find_spec

import cv2
import numpy as np
from jaxtyping import Complex, Float, UInt8

from estimation.fields.plane import fit_motion
from papers.slip_lifts.outside import track_points

Grey = UInt8[np.ndarray, "h w"]

DIAMETER_PX = 15
"""Window of trackpy, odd: about the width of a dot with its rim [px]."""
REACH_PX = 8
"""Largest motion of a dot from picture to picture [px]."""
MOVED_PX = 1.0
"""Distance from which a point counts as moved [px]."""
LEAST_POINTS = 9


def follow_by_trackpy(pictures: Iterable[Grey]) -> Float[np.ndarray, " frames"]:
    """Angles since the first picture, from dots that trackpy finds and links [rad]."""
    import trackpy

    trackpy.quiet()
    places: list[dict[int, complex]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pandas, which it calls
        located = [trackpy.locate(255 - picture, DIAMETER_PX) for picture in pictures]
    centres = [dots[["x", "y"]].to_numpy() for dots in located]
    for _, numbers in trackpy.link_iter(centres, REACH_PX, memory=3):
        place = centres[len(places)] @ np.array([1.0, 1j])
        places.append(dict(zip(numbers, place, strict=True)))
    table = np.full((len(places), 1 + max(map(max, filter(None, places)), default=0)), np.nan + 0j)
    for frame, row in enumerate(places):
        table[frame, list(row)] = list(row.values())
    return _turn(table)


def follow_by_flow(pictures: Iterable[Grey]) -> Float[np.ndarray, " frames"]:
    """Angles since the first picture, from corners tracked by optical flow [rad]."""
    grey = list(pictures)
    corners = cv2.goodFeaturesToTrack(grey[0], 300, 0.01, 5)
    if corners is None:
        return np.zeros(len(grey))
    return _turn(track_points(grey, corners) @ np.array([1.0, 1j]))


def _turn(places: Complex[np.ndarray, "frames points"]) -> Float[np.ndarray, " frames"]:
    """Rotation of the points that have moved [rad]; 0 before any has, NaN with too few."""
    angles = np.full(len(places), np.nan)
    for frame, place in enumerate(places):
        far = np.abs(place - places[0])
        moved = far > MOVED_PX  # False where one is NaN
        if moved.sum() >= LEAST_POINTS:
            before, after = places[0][moved], place[moved]
            angles[frame] = fit_motion(before, after).angle
        elif not moved.any():
            angles[frame] = 0.0
    return angles


METHODS = {"optical flow + kabsch": follow_by_flow}
"""Methods by name; without trackpy installed, its method is missing."""
if find_spec("trackpy"):
    METHODS = {"trackpy + kabsch": follow_by_trackpy} | METHODS
