"""Calibration of mirror-split stereo from pictures of a plane checkerboard in several poses.

Each view is first calibrated by itself. OpenCV calibrates a perspective view ([Zhang2000]). An
orthographic view is calibrated by the affine map from the target, as placed by the other view, to
its picture. Then both views and all poses are refined together, to minimise the sum of squared
reprojection errors.

[Zhang2000] Z. Zhang, "A flexible new technique for camera calibration".
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Shaped
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from estimation.pictures.corners.board import connect_corners, read_cells
from estimation.pictures.corners.fit import find_corners
from estimation.pictures.corners.pattern import Pattern
from estimation.pictures.corners.tracking import find_corner_style
from estimation.pictures.light import to_light
from estimation.pictures.rig import Rig, View, check_mirrored, split_views
from estimation.pictures.stream import read_pictures

FEWEST_POSES = 4
COVERED = 0.05
"""Share of a view that the target must cover."""
WORST = 1.0
"""Root mean square error from which a calibration is rejected [px]."""


class Pose(NamedTuple):
    """The target's corners in one picture.

    Attributes:
        left: corners in the left view [px].
        right: corners in the right view [px].
    """

    left: Float[np.ndarray, "n 2"]
    right: Float[np.ndarray, "n 2"]


def find_target(
    view: Shaped[np.ndarray, "h w *colour"], shape: tuple[int, int]
) -> Float[np.ndarray, "n 2"]:
    """Find the target's inner corners in a view, row by row from the top left [px].

    Args:
        view: a view of the whole target, with its rows within 45° of the picture's.
        shape: rows and columns of inner corners.

    Raises:
        ValueError: not all corners are visible.
    """
    grey = to_light(view)
    style = find_corner_style(grey, COVERED)
    corners = find_corners(grey, style)
    cells = read_cells(grey, corners, connect_corners(corners, style.pitch), 0)
    for turns in range(4):
        corner = np.rot90(cells.corner, turns).T  # its columns, then its rows, turn from x to y
        if corner.shape != shape or (corner < 0).any():
            continue
        points = corners.position[corner]
        down, right = points[-1, 0] - points[0, 0], points[0, -1] - points[0, 0]
        if down[1] > abs(down[0]) and right[0] > abs(right[1]):
            return points.reshape(-1, 2)
    raise ValueError(
        f"{(cells.corner >= 0).sum()} corners were detected instead of {shape[0]} rows of "
        f"{shape[1]}: show the whole target, with its rows along the picture's"
    )


def calibrate_from_pictures(
    path: Path,
    shape: tuple[int, int],
    pitch: float,
    orthographic_left: bool = True,
    mirrored: tuple[str, ...] = (),
) -> tuple[Rig, list[str]]:
    """Calibrate both views of a sensor from split pictures of a plane checkerboard.

    Args:
        path: a folder of pictures, or a video.
        shape: rows and columns of the checkerboard's inner corners.
        pitch: side of its cells [mm].
        orthographic_left: whether the left view is orthographic.
        mirrored: views that are mirrored, `left` or `right`.

    Returns:
        The views, and a reason for each picture that was left out.

    Raises:
        ValueError: too few pictures can be used, or no two views fit them.
        OSError: the pictures cannot be read.
    """
    check_mirrored(mirrored)
    poses, left_out, size = [], [], (0, 0)
    for picture in read_pictures(path):
        if picture.image is None or picture.flaw:
            left_out.append(f"picture {picture.number}: {picture.flaw}")
            continue
        height, width = picture.image.shape[0], picture.image.shape[1] // 2
        size = (width, height)
        views = split_views(picture.image, mirrored)
        try:
            poses.append(Pose(*(find_target(view, shape) for view in views)))
        except ValueError as error:
            left_out.append(f"picture {picture.number}: {error}")
    if len(poses) < FEWEST_POSES and left_out:
        raise ValueError(
            f"{len(poses)} pictures show the target in both views; {FEWEST_POSES} are required. "
            "Check the rows and columns of inner corners, and show the whole target in both views. "
            f"The first picture without it: {left_out[0]}"
        )
    target = Pattern(shape, pitch).corners()
    rig = calibrate_stereo(poses, target, size, orthographic_left)
    return replace(rig, mirrored=mirrored), left_out


def calibrate_stereo(
    poses: Sequence[Pose],
    target: Float[np.ndarray, "n 2"],
    size: tuple[int, int],
    orthographic_left: bool = True,
) -> Rig:
    """Calibrate both views of a sensor from corners of a plane target.

    The origin is the centre of a perspective left view. An orthographic left view does not
    determine depth; its origin lies on its axis, at the mean depth of the first pose.

    Args:
        poses: corners of the target in each picture; the poses must have different tilts.
        target: positions of the corners on the target [mm].
        size: width and height of each view [px].
        orthographic_left: whether the left view is orthographic.

    Raises:
        ValueError: there are too few poses, or no two views fit them.
    """
    if len(poses) < FEWEST_POSES:
        raise ValueError(
            f"{len(poses)} poses; at least {FEWEST_POSES} with different tilts are needed"
        )
    flat = np.column_stack([target, np.zeros(len(target))])
    right, placed = _perspective([pose.right for pose in poses], flat, size)
    if orthographic_left:
        left, from_right = _orthographic([pose.left for pose in poses], placed, size)
    else:
        left, seen = _perspective([pose.left for pose in poses], flat, size)
        from_right = _rigid(np.concatenate(placed), np.concatenate(seen))
    turn, shift = from_right
    placed = [points @ turn.T + shift for points in placed]
    depth = float(placed[0][:, 2].mean()) if orthographic_left else 0.0
    placed = [points - np.array([0.0, 0.0, depth]) for points in placed]
    shift = shift - np.array([0.0, 0.0, depth])
    right = _View(right.focal, right.centre, right.distortion, turn.T, -turn.T @ shift)
    motions = [_rigid(flat, points) for points in placed]
    return _refine(poses, flat, size, left, right, motions, orthographic_left)


class _View(NamedTuple):
    focal: float
    centre: np.ndarray
    distortion: float
    rotation: np.ndarray
    translation: np.ndarray

    def freeze(self, orthographic: bool) -> View:
        x, y, z = cv2.Rodrigues(self.rotation)[0][:, 0].tolist()
        (middle_x, middle_y), (a, b, c) = map(np.ndarray.tolist, (self.centre, self.translation))
        centre, distortion = (middle_x, middle_y), float(self.distortion)
        return View(orthographic, float(self.focal), centre, distortion, (x, y, z), (a, b, c))


def _perspective(
    seen: Sequence[np.ndarray], flat: np.ndarray, size: tuple[int, int]
) -> tuple[_View, list[np.ndarray]]:
    """A perspective view, and the target's corners in each pose in its coordinates [mm]."""
    objects = [flat.astype(np.float32)] * len(seen)
    images = [corners.astype(np.float32) for corners in seen]
    width, height = size
    guess = np.array([[2.0 * width, 0, width / 2], [0, 2.0 * width, height / 2], [0, 0, 1.0]])
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        objects, images, size, guess, np.zeros(5), flags=flags
    )
    placed = [
        flat @ cv2.Rodrigues(turn)[0].T + shift.ravel()
        for turn, shift in zip(turns, shifts, strict=True)
    ]
    centre = np.array([matrix[0, 2], matrix[1, 2]])
    view = _View(matrix[0, 0], centre, float(distortion.ravel()[0]), np.eye(3), np.zeros(3))
    return view, placed


def _orthographic(
    seen: Sequence[np.ndarray], placed: Sequence[np.ndarray], size: tuple[int, int]
) -> tuple[_View, tuple[np.ndarray, np.ndarray]]:
    """An orthographic view, and the rigid motion from the other view's coordinates to its own."""
    points = np.concatenate(placed)
    design = np.column_stack([points, np.ones(len(points))])
    affine = np.linalg.lstsq(design, np.concatenate(seen), rcond=None)[0]
    linear, offset = affine[:3].T, affine[3]
    u, scales, vt = np.linalg.svd(linear, full_matrices=False)
    scale, rows = float(scales.mean()), u @ vt
    turn = np.vstack([rows, np.cross(rows[0], rows[1])])
    centre = 0.5 * (np.array(size) - 1.0)
    shift = np.append((offset - centre) / scale, 0.0)
    return _View(scale, centre, 0.0, np.eye(3), np.zeros(3)), (turn, shift)


def _rigid(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rigid motion that brings points closest to others (Kabsch)."""
    middle, target = before.mean(axis=0), after.mean(axis=0)
    u, _, vt = np.linalg.svd((after - target).T @ (before - middle))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn, target - turn @ middle


def _refine(
    poses: Sequence[Pose],
    flat: np.ndarray,
    size: tuple[int, int],
    left: _View,
    right: _View,
    motions: list[tuple[np.ndarray, np.ndarray]],
    orthographic: bool,
) -> Rig:
    """Refine all views and poses together; in an orthographic view the first depth is fixed."""
    seen = np.concatenate([np.concatenate([pose.left, pose.right]) for pose in poses])
    vectors = [np.append(cv2.Rodrigues(turn)[0].ravel(), shift) for turn, shift in motions]
    own = [left.focal, left.distortion, right.focal, right.distortion]
    aim = np.append(cv2.Rodrigues(right.rotation)[0].ravel(), right.translation)
    start = np.concatenate([own, right.centre, left.centre, aim, *vectors])
    free = np.ones(len(start), dtype=bool)
    if orthographic:
        free[[6, 7, 14 + 5]] = False  # centre of the left view, and depth of the first pose

    def views(p: np.ndarray) -> tuple[View, View]:
        first = left._replace(focal=p[0], distortion=p[1], centre=p[6:8])
        second = _View(p[2], p[4:6], p[3], Rotation.from_rotvec(p[8:11]).as_matrix(), p[11:14])
        return first.freeze(orthographic), second.freeze(False)

    def misfit(unknowns: np.ndarray) -> np.ndarray:
        p = start.copy()
        p[free] = unknowns
        first, second = views(p)
        parts = []
        for motion in p[14:].reshape(-1, 6):
            points = flat @ Rotation.from_rotvec(motion[:3]).as_matrix().T + motion[3:]
            parts += [first.project(points), second.project(points)]
        return (np.concatenate(parts) - seen).ravel()

    fit = least_squares(misfit, start[free], x_scale="jac", method="trf", max_nfev=60)
    error = float(np.sqrt(np.mean(fit.fun**2)))
    if not error < WORST:
        raise ValueError(
            f"no two views fit the {len(poses)} poses: the residual is {error:.2f} px rms, "
            f"{WORST:g} px are allowed; check the target's size and the order of the views"
        )
    p = start.copy()
    p[free] = fit.x
    first, second = views(p)
    return Rig(first, second, *size, error)
