"""The sensor description: properties of a sensor that are known before a recording.

It is a TOML file, written by `python -m calibration sensor` or by hand. Every table and key except
`format_version` is optional:

    format_version = 1

    [camera]
    width_px = 640               # of the pictures
    height_px = 480
    mm_per_px = 0.04             # scale where the markers are
    matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]   # of the lens, in OpenCV's convention [px]
    distortion = [k1, k2, p1, p2, k3]

    [markers]
    kind = "dots"
    radius_px = 4.3
    dark = true
    reference_mm = [[0.5, 0.5], [1.5, 0.5]]     # unloaded, two or three values; or reference_px

    [noise]
    in_plane_mm = 0.001          # standard deviations; or in_plane_px and normal_px
    normal_mm = 0.0035
    correlation = [0.5, 0.2]     # of a marker's errors, one and two frames apart
    frames = 300                 # from which the noise was estimated

    [pad]                        # see `contactmodel.elasticity.pad`
    shear_modulus_mpa = 0.2
    poisson_ratio = 0.48
    thickness_mm = 3.0
    marker_depth_mm = 0.3
    dome_radius_mm = 30.0
    size_mm = [20.0, 20.0]
"""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from contactmodel.common.arrays import make_arrays
from contactmodel.common.inputs import naming
from contactmodel.common.settings import (
    check_limits,
    from_table,
    read_toml,
    rename_keys,
    toml_text,
    unit,
)
from contactmodel.elasticity.pad import RENAMED, SENSOR_VERSION, Pad
from estimation.frames.files import write_whole
from estimation.frames.noise import Noise
from estimation.frames.recording import LARGEST_VALUE
from estimation.pictures.part import Part

MARKER_KINDS = ("corners", "dots", "speckle")
"""Marker types that can be read, in the order of detection: the most regular first, because the
cells of a checkerboard can pass for dots, and both can pass for speckle."""


@dataclass(frozen=True)
class Lens:
    """A lens in OpenCV's camera model.

    Attributes:
        matrix: of the camera [px].
        distortion: coefficients in OpenCV's order.

    Raises:
        ValueError: the matrix is not a camera's, or OpenCV has no model with so many coefficients.

    Examples:
        >>> import numpy as np
        >>> from estimation import Lens
        >>> matrix = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])  # px
        >>> lens = Lens(matrix, distortion=np.array([-0.2, 0.0, 0.0, 0.0]))
        >>> print(lens.undistort(np.array([[160.0, 120.0], [310.0, 120.0]])).round(1))
        [[160.  120. ]
         [318.9 120. ]]
    """

    matrix: Float[np.ndarray, "rows columns"]
    distortion: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        """Check the shapes."""
        make_arrays(self)
        object.__setattr__(self, "distortion", self.distortion.ravel())  # OpenCV gives (1, k)
        if self.matrix.shape != (3, 3) or not (np.diag(self.matrix) > 0).all():
            raise ValueError("the camera matrix must be 3×3, with focal lengths above 0")
        if self.distortion.shape not in [(n,) for n in (4, 5, 8, 12, 14)]:
            count = self.distortion.size
            raise ValueError(f"{count} distortion coefficients: OpenCV takes 4, 5, 8, 12 or 14")

    def expect_centre(self, width: int, height: int) -> None:
        """Check that the lens's centre is near that of a picture, as at the size of calibration."""
        if np.abs(self.matrix[:2, 2] / (width, height) - 0.5).max() > 1.0 / 6.0:  # as at 2/3 of it
            size = f"{width}×{height}, the pictures' size"
            raise ValueError(f"calibrate the lens at {size}: its centre is far from theirs")

    def undistort(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Positions of a picture's points without distortion [px]; NaN stays NaN.

        Raises:
            ValueError: the lens model maps a point to infinity.
        """
        # steps, and change of a position [px], at which the iteration ends
        until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)
        undistorted = np.full(points.shape, np.nan)
        finite = np.isfinite(points).all(axis=1)
        if finite.any():
            found = cv2.undistortPoints(
                points[finite, None], self.matrix, self.distortion, P=self.matrix, criteria=until
            )
            undistorted[finite] = found[:, 0]
            if not (np.abs(undistorted[finite]) < LARGEST_VALUE).all():
                raise ValueError(
                    "the lens model maps points of the picture to infinity: calibrate it again"
                )
        return undistorted

    def distort(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """The inverse of `undistort` [px]; NaN stays NaN."""
        distorted = np.full(points.shape, np.nan)
        finite = np.isfinite(points).all(axis=1)
        if finite.any():
            homogeneous = np.column_stack([points[finite], np.ones(finite.sum())])
            rays = homogeneous @ np.linalg.inv(self.matrix).T
            none = np.zeros(3)
            image, _ = cv2.projectPoints(rays, none, none, self.matrix, self.distortion)
            distorted[finite] = image[:, 0]
        return distorted


@dataclass(frozen=True)
class Sensor:
    """A sensor. Unknown values are None, and are detected from the recording where possible.

    Lengths are in mm if the scale is known, else in px.

    Attributes:
        mm_per_px: scale at the markers [mm/px].
        lens: of the camera; without it the picture counts as undistorted.
        size: width and height of the pictures to which scale and lens apply [px].
        marker: marker type, one of `MARKER_KINDS`; None to detect it.
        radius: of the dots [px].
        dark: whether the dots are darker than their surroundings.
        reference: unloaded positions of the markers.
        noise: of the marker positions.
        pad: the elastomer with the markers.

    Raises:
        ValueError: a length is not above 0, the marker type is unknown, or the reference does not
            hold two or three finite numbers for each marker.

    Examples:
        >>> import numpy as np
        >>> from contactmodel import Pad
        >>> from estimation import Sensor
        >>> sensor = Sensor(mm_per_px=0.05, marker="dots", pad=Pad(shear_modulus=0.2))
        >>> print(sensor.to_lengths(np.array([[320.0, 240.0]])), sensor.unit)
        [[16. 12.]] mm
    """

    mm_per_px: float | None = field(default=None, metadata=unit(above=0.0))
    lens: Lens | None = None
    size: tuple[int, int] | None = None
    marker: str | None = None
    radius: float | None = field(default=None, metadata=unit("px", above=0.0))
    dark: bool | None = None
    reference: Float[np.ndarray, "n d"] | None = None
    noise: Noise | None = None
    pad: Pad = field(default_factory=Pad)

    def __post_init__(self) -> None:
        """Check the values."""
        if self.marker not in (None, *MARKER_KINDS):
            raise ValueError(
                f"unknown marker type {self.marker!r}; choose from {', '.join(MARKER_KINDS)}"
            )
        check_limits(self)
        if self.reference is not None and (
            self.reference.ndim != 2
            or self.reference.shape[1] not in (2, 3)
            or not np.isfinite(self.reference).all()
        ):
            raise ValueError(
                "the reference must have two or three finite numbers for each marker; its shape is "
                f"{self.reference.shape}"
            )

    @property
    def unit(self) -> str:
        """Unit of lengths: mm, or px without a scale."""
        return "px" if self.mm_per_px is None else "mm"

    @property
    def scale(self) -> float:
        """Scale of the undistorted picture [mm/px], or 1 if lengths are in px."""
        return 1.0 if self.mm_per_px is None else self.mm_per_px

    def undistort(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Positions of a picture's points without the lens's distortion [px]."""
        return points if self.lens is None else self.lens.undistort(points)

    def of_part(self, part: Part) -> "Sensor":
        """The sensor for a part of its pictures, with positions counted from the part's origin."""
        shift, lens = part.origin, self.lens
        if lens is not None:
            matrix = lens.matrix.copy()
            matrix[:2, 2] -= shift
            lens = Lens(matrix, lens.distortion)
        reference = self.reference
        if reference is not None:
            reference = reference.copy()
            reference[:, :2] -= self.scale * shift
        return replace(self, lens=lens, reference=reference)

    def to_lengths(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Convert points of the picture [px] to lengths."""
        return self.scale * self.undistort(points)

    def to_pixels(self, lengths: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Convert lengths to points of the picture [px]; the inverse of `to_lengths`."""
        undistorted = lengths / self.scale
        return undistorted if self.lens is None else self.lens.distort(undistorted)

    def expect_size(self, width: int, height: int) -> None:
        """Check that a picture has the size to which the description applies.

        Raises:
            ValueError: the sizes differ, or by the scale the picture is no tactile sensor's.
        """
        narrowest, widest = 0.5, 1000.0  # pictures of tactile sensors [mm]
        if (size := self.size or (width, height)) != (width, height):
            raise ValueError(
                f"the pictures are {width}×{height}, the sensor description is for "
                f"{size[0]}×{size[1]}: calibrate at this size"
            )
        if self.lens is not None and self.size is None:
            self.lens.expect_centre(width, height)
        if self.mm_per_px is not None and not narrowest < width * self.mm_per_px < widest:
            raise ValueError(
                f"at {self.mm_per_px:g} mm/px a picture would be {width * self.mm_per_px:g} mm "
                f"wide; {narrowest:g} to {widest:g} mm are expected: give the scale where the "
                "markers are (--mm-per-px, or mm_per_px in the sensor's file)"
            )


@dataclass(frozen=True)
class _Camera:
    width: int | None = field(default=None, metadata=unit("px"))
    height: int | None = field(default=None, metadata=unit("px"))
    mm_per_px: float | None = None
    matrix: Float[np.ndarray, "rows columns"] | None = None
    distortion: Float[np.ndarray, " k"] | None = None

    def __post_init__(self) -> None:
        for pair in (("width", "height"), ("matrix", "distortion")):
            if (getattr(self, pair[0]) is None) != (getattr(self, pair[1]) is None):
                names = " and ".join(f"{name}_px" if "width" in pair else name for name in pair)
                raise ValueError(f"{names} belong together: give both or neither")


@dataclass(frozen=True)
class _Markers:
    kind: str | None = None
    radius: float | None = field(default=None, metadata=unit("px"))
    dark: bool | None = None
    reference_mm: Float[np.ndarray, "n d"] | None = None
    reference_px: Float[np.ndarray, "n d"] | None = None


@dataclass(frozen=True)
class _Noise:
    in_plane_mm: float | None = field(default=None, metadata=unit(above=0.0))
    in_plane_px: float | None = field(default=None, metadata=unit(above=0.0))
    normal_mm: float | None = None
    normal_px: float | None = None
    correlation: tuple[float, float] | None = None
    frames: int = 0

    def __post_init__(self) -> None:
        names = [key.name for key in fields(self)[:4] if getattr(self, key.name) is not None]
        if not names or "in_plane" not in names[0] or len({name[-2:] for name in names}) != 1:
            raise ValueError("give in_plane_mm, and normal_mm if it is known; or both in px")


@dataclass(frozen=True)
class _File:
    camera: _Camera = field(default_factory=_Camera)
    markers: _Markers = field(default_factory=_Markers)
    noise: _Noise | None = None
    pad: Pad = field(default_factory=Pad)


def write_sensor(sensor: Sensor, path: str | Path) -> None:
    """Write a description; a failed write leaves no partial file.

    Raises:
        OSError: the file cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from estimation import Sensor, write_sensor
        >>> write_sensor(Sensor(mm_per_px=0.05, marker="dots"), Path("sensor.toml"))
        >>> print(*filter(None, Path("sensor.toml").read_text().splitlines()), sep=", ")
        format_version = 1, [camera], mm_per_px = 0.05, [markers], kind = "dots"
    """
    lens, (width, height) = sensor.lens, sensor.size or (None, None)
    matrix, distortion = (None, None) if lens is None else (lens.matrix, lens.distortion)
    reference = {}
    if sensor.reference is not None:
        reference = {f"reference_{sensor.unit}": np.round(sensor.reference, 5)}
    file = _File(
        _Camera(width, height, sensor.mm_per_px, matrix, distortion),
        _Markers(sensor.marker, sensor.radius, sensor.dark, **reference),
        None if sensor.noise is None else _from_noise(sensor.noise),
        sensor.pad,
    )
    write_whole(Path(path), toml_text(file, SENSOR_VERSION))


def read_sensor(path: str | Path) -> Sensor:
    """Read a description.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a sensor description.

    Examples:
        >>> from estimation import Sensor, read_sensor, write_sensor
        >>> write_sensor(Sensor(mm_per_px=0.05), "sensor.toml")
        >>> print(read_sensor("sensor.toml").mm_per_px, "mm/px")
        0.05 mm/px
    """
    path = Path(path)
    content = read_toml(path, SENSOR_VERSION)
    camera = content.get("camera")
    scaled = "mm" if isinstance(camera, dict) and "mm_per_px" in camera else "px"
    lengths = ("markers.reference", "noise.in_plane", "noise.normal")
    renamed = {name: f"{name}_{scaled}" for name in lengths}
    renamed |= {f"camera.{side}": f"camera.{side}_px" for side in ("width", "height")}
    content = rename_keys(content, RENAMED | renamed, path)
    with naming(path):
        return _to_sensor(from_table(content, _File))


def _to_sensor(file: _File) -> Sensor:
    camera, markers = file.camera, file.markers
    lens, size, reference = None, None, markers.reference_mm
    if camera.matrix is not None and camera.distortion is not None:
        lens = Lens(camera.matrix, camera.distortion)
    if camera.width is not None and camera.height is not None:
        size = camera.width, camera.height
    scale = 1.0 if camera.mm_per_px is None else camera.mm_per_px
    if markers.reference_px is not None:
        if reference is not None:
            raise ValueError("markers: give either reference_mm or reference_px, not both")
        reference = scale * markers.reference_px
    elif reference is not None and camera.mm_per_px is None:
        raise ValueError("markers: reference_mm needs the scale: give mm_per_px in [camera]")
    return Sensor(
        mm_per_px=camera.mm_per_px,
        lens=lens,
        size=size,
        marker=markers.kind,
        radius=markers.radius,
        dark=markers.dark,
        reference=reference,
        noise=None if file.noise is None else _to_noise(file.noise, camera.mm_per_px),
        pad=file.pad,
    )


def _to_noise(table: _Noise, mm_per_px: float | None) -> Noise:
    """The noise: in mm if the file has the scale or gives mm, else in px."""
    in_plane, normal, factor, unknown = table.in_plane_mm, table.normal_mm, 1.0, float("nan")
    if in_plane is None:
        in_plane, normal, factor = table.in_plane_px, table.normal_px, mm_per_px or 1.0
    assert in_plane is not None
    return Noise(
        factor * in_plane,
        unknown if normal is None else factor * normal,
        table.correlation or (unknown, unknown),
        table.frames,
        "px" if table.in_plane_mm is None and mm_per_px is None else "mm",
    )


def _from_noise(noise: Noise) -> _Noise:
    lengths = {f"in_plane_{noise.unit}": noise.in_plane, f"normal_{noise.unit}": noise.normal}
    return _Noise(
        **{name: value for name, value in lengths.items() if np.isfinite(value)},
        correlation=noise.correlation if np.isfinite(noise.correlation).any() else None,
        frames=noise.frames,
    )
