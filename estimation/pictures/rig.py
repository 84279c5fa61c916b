"""Two virtual cameras that mirrors make of one: split, triangulate, and their calibration's file.

[Li2024] Section IV-A: the picture of one camera is split into a left and a right view, the left an
orthographic one, seen from straight behind the gel. The left view's axes are the sensor's: x to the
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
RENAMED = {"width": "width_px", "height": "height_px"} | {
    f"{view}.{key}": f"{view}.{key}_{name}"
    for view in ("left", "right")
    for key, name in (("centre", "px"), ("rotation", "rad"), ("translation", "mm"))
}
"""Keys of version 0.1.0, and what they are called now."""
VIEWS = ("left", "right")


@dataclass(frozen=True)
class View:
    """A virtual camera.

    Attributes:
        orthographic: whether it sees along parallel rays.
        focal: focal length [px], or the scale of an orthographic view [px/mm].
        centre: of the image [px].
        distortion: radial: an image point at q from the centre, in units of the focal length,
            lies at q (1 + distortion q²) [-, 1/mm² where orthographic].
        rotation: from the sensor's axes to the camera's, as an axis times an angle [rad].
        translation: the sensor's origin seen from the camera [mm].

    Raises:
        ValueError: a focal length that is not above 0, or vectors of another length.
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
            raise ValueError("a view has a centre of 2, a rotation and a translation of 3 numbers")

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """The rotation as a matrix."""
        return Rotation.from_rotvec(self.rotation).as_matrix()

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Where points [mm] are in the view [px]."""
        seen = points @ self.matrix.T + np.array(self.translation)
        ray = seen[:, :2] if self.orthographic else seen[:, :2] / seen[:, 2:]
        stretch = 1.0 + self.distortion * np.sum(ray**2, axis=1, keepdims=True)
        return self.focal * stretch * ray + np.array(self.centre)


@dataclass(frozen=True)
class Rig:
    """Both views of a sensor.

    Attributes:
        left: the view whose axes are the sensor's.
        right: the other.
        width: of each view, half of the camera's [px].
        height: of the pictures [px].
        error: root mean square reprojection error of the calibration per coordinate [px].
        mirrored: which of `VIEWS` an odd number of mirrors shows the wrong way round.

    Raises:
        ValueError: `mirrored` names something else.
    """

    left: View
    right: View
    width: int = field(metadata=unit("px"))
    height: int = field(metadata=unit("px"))
    error: float = field(metadata=unit("px"))
    mirrored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check what is mirrored."""
        check_mirrored(self.mirrored)

    def split(
        self, picture: Shaped[np.ndarray, "h w *colour"]
    ) -> tuple[Shaped[np.ndarray, "h half *colour"], Shaped[np.ndarray, "h half *colour"]]:
        """The left and the right view of a picture, the right way round.

        Raises:
            ValueError: the picture is not of the calibration's size.
        """
        height, width = picture.shape[:2]
        if (width, height) != (2 * self.width, self.height):
            raise ValueError(
                f"the pictures are {width}×{height}, the stereo calibration is for "
                f"{2 * self.width}×{self.height}: calibrate at this size"
            )
        return split_views(picture, self.mirrored)

    def locate(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 n 2"]:
        """Where points [mm] are in the whole picture, in the left and in the right view [px]."""
        seen = np.stack([self.left.project(points), self.right.project(points)])
        for i, name in enumerate(VIEWS):
            if name in self.mirrored:
                seen[i, :, 0] = self.width - 1 - seen[i, :, 0]
        seen[1, :, 0] += self.width
        return seen


def check_mirrored(names: Collection[str]) -> None:
    """Check that names are of views.

    Raises:
        ValueError: one is not.
    """
    for name in names:
        if name not in VIEWS:
            raise ValueError(f"mirrored is {name!r}; it must be {' or '.join(VIEWS)}")


def split_views(
    picture: Shaped[np.ndarray, "h w *colour"], mirrored: Collection[str] = ()
) -> tuple[Shaped[np.ndarray, "h half *colour"], Shaped[np.ndarray, "h half *colour"]]:
    """The two halves of a picture, those that are mirrored turned round."""
    half = picture.shape[1] // 2
    left, right = (
        one[:, ::-1] if name in mirrored else one
        for name, one in zip(VIEWS, (picture[:, :half], picture[:, half : 2 * half]), strict=True)
    )
    return left, right


class Triangulated(NamedTuple):
    """Points in space.

    Attributes:
        points: of them [mm]; NaN where one of the views has none.
        misfit: root mean square distance per coordinate between what is seen and where the point
            would be seen [px]. Two views leave one of four coordinates to check.
    """

    points: Float[np.ndarray, "n 3"]
    misfit: Float[np.ndarray, " n"]


def triangulate(
    rig: Rig, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
) -> Triangulated:
    """The points that are seen nearest to where both views have them, by Gauss–Newton.

    Args:
        rig: both views.
        left: points in the left view [px]; NaN where not seen.
        right: in the right view.
    """
    steps = 6
    points = np.full((len(left), 3), np.nan)
    misfit = np.full(len(left), np.nan)
    both = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    seen = np.concatenate([left[both], right[both]], axis=1)

    def project(at: np.ndarray) -> np.ndarray:
        return np.concatenate([rig.left.project(at), rig.right.project(at)], axis=1)

    at, step = _start(rig, left[both]), 1e-4
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
    points[both] = at
    misfit[both] = np.sqrt(np.mean((seen - project(at)) ** 2, axis=1))
    return Triangulated(points, misfit)


def _start(rig: Rig, left: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Points on the left view's rays, where the middle of the right view sees the middle one."""
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
    """Write a calibration, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    write_whole(path, toml_text(rig, FORMAT_VERSION))


def read_rig(path: Path) -> Rig:
    """Read a calibration that `write_rig` has written.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    content = read_toml(path, FORMAT_VERSION, RENAMED)
    with naming(path, "no stereo calibration"):
        return from_table(content, Rig)
