"""Motion of the object relative to the gripper, from the outside camera's pictures.

The camera is fixed to the hand and looks along the fingers at an angle. An object that slides along
its axis moves away from the camera, towards the vanishing point of that axis, and its image
shrinks. Near the fingers, 1 mm of this motion is `FINGER_PX_PER_MM` times the sine of the angle
between the line of sight and the axis. The distance to the vanishing point gives this angle.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from papers.slip_lifts import settings
from papers.slip_lifts.settings import View

Patch = tuple[int, int, int, int]


def measure_motion(
    pictures: Sequence[UInt8[np.ndarray, "h w"]], view: View
) -> Float[np.ndarray, " frames"]:
    """Distance of the object's motion relative to the gripper since the first picture [mm]."""
    smooth = [cv2.GaussianBlur(picture, (0, 0), 1.0) for picture in pictures]
    points = follow_points(smooth, view.object_)
    finger = np.median(follow_points(smooth, view.gripper), axis=1)
    moved = np.median(points - points[0], axis=1) - (finger - finger[0])
    return np.linalg.norm(moved, axis=1) / _px_per_mm(np.median(points[0], axis=0), view)


def _px_per_mm(place: Float[np.ndarray, "2"], view: View) -> float:
    across = np.linalg.norm(place - view.vanishing)
    return float(settings.FINGER_PX_PER_MM * across / np.hypot(across, settings.FOCAL_PX))


def follow_points(
    pictures: Sequence[UInt8[np.ndarray, "h w"]], patch: Patch
) -> Float[np.ndarray, "frames points 2"]:
    """Positions of the first picture's corners in all pictures; lost corners are left out [px].

    Args:
        pictures: pictures in order.
        patch: left, top, width and height of the region with the corners [px].

    Raises:
        ValueError: the patch has no corner, or none is tracked through all pictures.
    """
    left, top, width, height = patch
    mask = np.zeros_like(pictures[0])
    mask[top : top + height, left : left + width] = 255
    corners = cv2.goodFeaturesToTrack(pictures[0], 200, 0.01, 4, mask=mask)
    if corners is None:
        raise ValueError(f"the patch {patch} of the outside pictures has no corner to track")
    tracks = track_points(pictures, corners, winSize=(17, 17), maxLevel=2)
    good = np.isfinite(tracks[-1, :, 0])
    if not good.any():
        raise ValueError(f"no corner of the patch {patch} is tracked through all outside pictures")
    return tracks[:, good].astype(float)


def track_points(
    pictures: Sequence[UInt8[np.ndarray, "h w"]], points: Float[np.ndarray, "n 1 2"], **flow: Any
) -> Float[np.ndarray, "frames n 2"]:
    """Positions of the first picture's points in all pictures; NaN from where one is lost [px].

    A point is lost if optical flow, with OpenCV's settings, does not lead back to within 0.5 px.
    """
    tracks, good = [points[:, 0]], np.ones((len(points), 1), dtype=bool)
    for before, after in pairwise(pictures):
        moved, there, _ = cv2.calcOpticalFlowPyrLK(before, after, points, points.copy(), **flow)
        back, again, _ = cv2.calcOpticalFlowPyrLK(after, before, moved, moved.copy(), **flow)
        near = np.linalg.norm(back - points, axis=-1) < 0.5
        good &= (there > 0) & (again > 0) & near
        tracks.append(np.where(good, moved[:, 0], np.nan))
        points = moved
    return np.array(tracks)
