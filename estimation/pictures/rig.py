"""The two views that mirrors give one camera: splitting, triangulation and the calibration file.

[Li2024] Section IV-A splits the picture of one camera into a left and a right view. The left view
is orthographic and looks at the gel from straight behind. Its axes are the sensor's: x to the
right, y down, z away from the camera, out of the elastomer.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped
from scipy.spatial.transform import Rotation

from contactmodel.common.inputs import naming
from contactmodel.common.settings import check_limits, from_table, read_toml, toml_text, unit
from estimation.frames.files import write_whole

FORMAT_VERSION = 1
"""Version of the format that is written and read."""
VIEW_NAMES = ("left", "right")
"""Names of the two views, in the order of their halves of the picture."""


@dataclass(frozen=True)
class View:
    """A virtual camera.

    Attributes:
        orthographic: whether its rays are parallel.
        focal: focal length [px], or the scale of an orthographic view [px/mm].
        centre: of the image [px].
        distortion: radial distortion: an image point at q from the centre, in units of the focal
            length, lies at q (1 + distortion q²) [-; 1/mm² if orthographic].
        rotation: from the sensor's axes to the camera's, as an axis times an angle [rad].
        translation: the sensor's origin in the camera's axes [mm].

    Raises:
        ValueError: the focal length is not above 0, or a vector has the wrong length.
    """

    orthographic: bool
    focal: float = field(metadata=unit(above=0.0))
    centre: tuple[float, float] = field(metadata=unit("px"))
    distortion: float
    rotation: tuple[float, float, float] = field(metadata=unit("rad"))
    translation: tuple[float, float, float] = field(metadata=unit("mm"))

    def __post_init__(self) -> None:
        """Check the values."""
        check_limits(self)
        if (len(self.centre), len(self.rotation), len(self.translation)) != (2, 3, 3):
            raise ValueError(
                "a view's centre must have 2 numbers, its rotation and its translation 3 each; got "
                f"{len(self.centre)}, {len(self.rotation)} and {len(self.translation)}"
            )

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """The rotation as a matrix."""
        return Rotation.from_rotvec(self.rotation).as_matrix()

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Positions of points [mm] in the view [px]."""
        seen = points @ self.matrix.T + np.array(self.translation)
        ray = seen[:, :2] if self.orthographic else seen[:, :2] / seen[:, 2:]
        stretch = 1.0 + self.distortion * np.sum(ray**2, axis=1, keepdims=True)
        return self.focal * stretch * ray + np.array(self.centre)


@dataclass(frozen=True)
class Rig:
    """Both views of a sensor.

    Attributes:
        left: the view whose axes are the sensor's.
        right: the other view.
        width: of each view, half of the picture's [px].
        height: of the pictures [px].
        error: root mean square reprojection error of the calibration per coordinate [px].
        mirrored: the `VIEW_NAMES` that an odd number of mirrors reverses.

    Raises:
        ValueError: `mirrored` names an unknown view.
    """

    left: View
    right: View
    width: int = field(metadata=unit("px"))
    height: int = field(metadata=unit("px"))
    error: float = field(metadata=unit("px"))
    mirrored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the names of the mirrored views."""
        check_mirrored(self.mirrored)

    def split(
        self, picture: Shaped[np.ndarray, "h w *colour"]
    ) -> tuple[Shaped[np.ndarray, "h half *colour"], Shaped[np.ndarray, "h half *colour"]]:
        """Split a picture into its left and right view, and flip mirrored views back.

        Raises:
            ValueError: the picture's size differs from the calibration's.
        """
        height, width = picture.shape[:2]
        if (width, height) != (2 * self.width, self.height):
            raise ValueError(
                f"the pictures are {width}×{height}, the stereo calibration is for "
                f"{2 * self.width}×{self.height}: calibrate at this size"
            )
        return split_views(picture, self.mirrored)

    def locate(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 n 2"]:
        """Positions of points [mm] in the whole picture [px], in the left and the right view."""
        seen = np.stack([self.left.project(points), self.right.project(points)])
        for i, name in enumerate(VIEW_NAMES):
            if name in self.mirrored:
                seen[i, :, 0] = self.width - 1 - seen[i, :, 0]
        seen[1, :, 0] += self.width
        return seen


def check_mirrored(names: Collection[str]) -> None:
    """Check the names of mirrored views.

    Raises:
        ValueError: a name is not one of `VIEW_NAMES`.
    """
    for name in names:
        if name not in VIEW_NAMES:
            raise ValueError(f"mirrored is {name!r}; it must be {' or '.join(VIEW_NAMES)}")


def split_views(
    picture: Shaped[np.ndarray, "h w *colour"], mirrored: Collection[str] = ()
) -> tuple[Shaped[np.ndarray, "h half *colour"], Shaped[np.ndarray, "h half *colour"]]:
    """The left and right half of a picture, with mirrored halves flipped back."""
    half = picture.shape[1] // 2
    left, right = (
        view[:, ::-1] if name in mirrored else view
        for name, view in zip(
            VIEW_NAMES, (picture[:, :half], picture[:, half : 2 * half]), strict=True
        )
    )
    return left, right


class Triangulated(NamedTuple):
    """Points in space.

    Attributes:
        points: their positions [mm]; NaN where a view lacks the point.
        misfit: root mean square reprojection error per coordinate [px]. Of the four coordinates of
            two views, one is redundant and so checks the fit.
    """

    points: Float[np.ndarray, "n 3"]
    misfit: Float[np.ndarray, " n"]


def triangulate(
    rig: Rig, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
) -> Triangulated:
    """Find the points with the least reprojection error in both views, by Gauss–Newton.

    Args:
        rig: both views.
        left: points in the left view [px]; NaN where not visible.
        right: the same points in the right view.
    """
    steps = 6
    points = np.full((len(left), 3), np.nan)
    misfit = np.full(len(left), np.nan)
    matched = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    seen = np.concatenate([left[matched], right[matched]], axis=1)

    def project(at: np.ndarray) -> np.ndarray:
        return np.concatenate([rig.left.project(at), rig.right.project(at)], axis=1)

    at, step = _start(rig, left[matched]), 1e-4
    for _ in range(steps):
        slopes = [(project(at + step * e) - project(at - step * e)) / (2 * step) for e in np.eye(3)]
        jacobian = np.stack(slopes, axis=-1)
        transposed = jacobian.transpose(0, 2, 1)
        right_side = transposed @ (seen - project(at))[..., None]
        normal, move = transposed @ jacobian, np.full((len(at), 3, 1), np.nan)
        located = np.asarray(np.isfinite(normal).all(axis=(1, 2)))
        located[located] = np.linalg.det(normal[located]) != 0.0
        move[located] = np.linalg.solve(normal[located], right_side[located])
        at = at + move[..., 0]
    points[matched] = at
    misfit[matched] = np.sqrt(np.mean((seen - project(at)) ** 2, axis=1))
    return Triangulated(points, misfit)


def _start(rig: Rig, left: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Starting points on the left view's rays, at the depth where both views' axes meet."""
    ray = (left - np.array(rig.left.centre)) / rig.left.focal
    aim = rig.right.matrix
    eye = -aim.T @ np.array(rig.right.translation)
    depth = float(
        eye[2]
        - aim[2, 2]
        * (eye[0] * aim[2, 0] + eye[1] * aim[2, 1])
        / max(aim[2, 0] ** 2 + aim[2, 1] ** 2, 1e-12)
    )
    if rig.left.orthographic:
        return np.column_stack([ray, np.full(len(ray), depth)])
    return depth * np.column_stack([ray, np.ones(len(ray))])


def write_rig(rig: Rig, path: Path) -> None:
    """Write a calibration; a failed write leaves no partial file.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, toml_text(rig, FORMAT_VERSION))


def read_rig(path: Path) -> Rig:
    """Read a calibration that `write_rig` has written.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a stereo calibration.
    """
    # keys of version 0.1.0 and their present names
    renamed = {"width": "width_px", "height": "height_px"} | {
        f"{view}.{key}": f"{view}.{key}_{name}"
        for view in VIEW_NAMES
        for key, name in (("centre", "px"), ("rotation", "rad"), ("translation", "mm"))
    }
    content = read_toml(path, FORMAT_VERSION, renamed)
    with naming(path, "no stereo calibration"):
        return from_table(content, Rig)
