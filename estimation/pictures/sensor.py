"""The sensor description: what is known of a sensor before it touches anything.

It is a TOML file, written by `python -m calibration sensor` or by hand; every table and key but
`format_version` may be left out:

    format_version = 1

    [camera]
    width = 640                  # of the pictures it holds for [px]
    height = 480
    mm_per_px = 0.04             # scale where the markers are [mm/px]
    matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]   # of the lens, as OpenCV has it [px]
    distortion = [k1, k2, p1, p2, k3]

    [markers]
    kind = "dots"
    radius_px = 4.3
    dark = true
    reference = [[0.5, 0.5], [1.5, 0.5]]    # unloaded [mm; px without a scale], two or three values

    [noise]                      # standard deviations [mm; px without a scale]
    in_plane = 0.001
    normal = 0.0035

    [elastomer]
    shear_modulus = 0.2          # [MPa]
    poisson_ratio = 0.48
    thickness = 3.0              # [mm]
    marker_depth = 0.3           # below the surface [mm]
    dome_radius = 30.0           # [mm]
    friction_coefficient = 0.6
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from contactmodel.common.inputs import (
    as_flag,
    as_matrix,
    as_number,
    as_numbers,
    as_table,
    as_text,
    as_whole,
    expect_keys,
    naming,
    read_toml,
)
from estimation.frames.files import toml_text, write_whole
from estimation.frames.noise import Noise
from estimation.frames.recording import LARGEST
from estimation.pictures.kinds import MARKER_KINDS

FORMAT_VERSION = 1
CONVERGED = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)


@dataclass(frozen=True)
class Lens:
    """A lens, as OpenCV models it.

    Attributes:
        matrix: of the camera [px].
        distortion: coefficients in OpenCV's order.

    Raises:
        ValueError: no matrix of a camera, or a number of coefficients that OpenCV does not have.
    """

    matrix: Float[np.ndarray, "rows columns"]
    distortion: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        """Check the shapes."""
        if self.matrix.shape != (3, 3) or not (np.diag(self.matrix) > 0).all():
            raise ValueError(
                "the camera matrix must have three rows of three numbers and focal lengths above 0"
            )
        if self.distortion.shape not in [(n,) for n in (4, 5, 8, 12, 14)]:
            raise ValueError(
                f"{self.distortion.size} distortion coefficients; OpenCV has 4, 5, 8, 12 or 14"
            )

    def straighten(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Where points of the picture would lie without distortion [px]; NaN stays NaN.

        Raises:
            ValueError: far from anywhere.
        """
        straight = np.full(points.shape, np.nan)
        known = np.isfinite(points).all(axis=1)
        if known.any():
            straight[known] = cv2.undistortPoints(
                points[known, None],
                self.matrix,
                self.distortion,
                None,
                None,
                self.matrix,
                CONVERGED,
            )[:, 0]
            if not (np.abs(straight[known]) < LARGEST).all():
                raise ValueError(
                    "the lens takes points of the picture to infinity: calibrate it again"
                )
        return straight

    def bend(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """The inverse of `straighten` [px]; NaN stays NaN."""
        bent = np.full(points.shape, np.nan)
        known = np.isfinite(points).all(axis=1)
        if known.any():
            homogeneous = np.column_stack([points[known], np.ones(known.sum())])
            rays = homogeneous @ np.linalg.inv(self.matrix).T
            none = np.zeros(3)
            bent[known] = cv2.projectPoints(rays, none, none, self.matrix, self.distortion)[0][:, 0]
        return bent


@dataclass(frozen=True)
class Elastomer:
    """Constants of the pad; None where unknown.

    Attributes:
        shear_modulus: G_S [MPa].
        poisson_ratio: ν_S [-].
        thickness: on its rigid base [mm].
        marker_depth: of the markers below the surface [mm].
        dome_radius: of the surface [mm]; None also where it is flat.
        friction_coefficient: μ [-].
    """

    shear_modulus: float | None = None
    poisson_ratio: float | None = None
    thickness: float | None = None
    marker_depth: float | None = None
    dome_radius: float | None = None
    friction_coefficient: float | None = None


@dataclass(frozen=True)
class Sensor:
    """A sensor; what is None is not known, and found out from the recording where it can be.

    Lengths are mm where the scale is known, else px.

    Attributes:
        mm_per_px: scale where the markers are [mm/px].
        lens: of the camera; without it the picture counts as undistorted.
        size: width and height of the pictures that the scale and the lens hold for [px].
        marker: kind of markers, one of `MARKER_KINDS`; None if it is to be found.
        radius: of the dots [px].
        dark: whether they are darker than what is around them.
        reference: unloaded positions of the markers.
        noise: of the marker positions.
        elastomer: constants of the pad.

    Raises:
        ValueError: a length that is not above 0, an unknown kind of markers, or a reference that is
            none.
    """

    mm_per_px: float | None = None
    lens: Lens | None = None
    size: tuple[int, int] | None = None
    marker: str | None = None
    radius: float | None = None
    dark: bool | None = None
    reference: Float[np.ndarray, "n d"] | None = None
    noise: Noise | None = None
    elastomer: Elastomer = Elastomer()

    def __post_init__(self) -> None:
        """Check the values."""
        if self.marker not in (None, *MARKER_KINDS):
            raise ValueError(
                f"no markers of kind {self.marker!r}; there are {', '.join(MARKER_KINDS)}"
            )
        for name, value in (("the scale", self.mm_per_px), ("the dots' radius", self.radius)):
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{name} is {value}; it must be a number above 0")
        if self.reference is not None and (
            self.reference.ndim != 2
            or self.reference.shape[1] not in (2, 3)
            or not np.isfinite(self.reference).all()
        ):
            raise ValueError("the reference must have two or three finite numbers for each marker")

    @property
    def unit(self) -> str:
        """Of lengths: mm, or px without a scale."""
        return "px" if self.mm_per_px is None else "mm"

    @property
    def scale(self) -> float:
        """Lengths per px of the picture without distortion."""
        return 1.0 if self.mm_per_px is None else self.mm_per_px

    def straighten(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Where points of the picture would lie without the lens's distortion [px]."""
        return points if self.lens is None else self.lens.straighten(points)

    def to_lengths(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points of the picture [px] as lengths."""
        return self.scale * self.straighten(points)

    def to_pixels(self, lengths: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Where in the picture lengths are [px], the inverse of `to_lengths`."""
        straight = lengths / self.scale
        return straight if self.lens is None else self.lens.bend(straight)

    def expect_size(self, width: int, height: int) -> None:
        """Check that a picture is of the size that the description is for.

        Raises:
            ValueError: it is not.
        """
        if self.size not in (None, (width, height)):
            assert self.size is not None
            raise ValueError(
                f"the pictures are {width}×{height}, the sensor description is for "
                f"{self.size[0]}×{self.size[1]}: calibrate at this size"
            )


def write_sensor(sensor: Sensor, path: Path) -> None:
    """Write a description, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    lens, size, noise = sensor.lens, sensor.size, sensor.noise
    tables = {
        "camera": {
            "width": size and size[0],
            "height": size and size[1],
            "mm_per_px": sensor.mm_per_px,
            "matrix": lens and lens.matrix.tolist(),
            "distortion": lens and lens.distortion.tolist(),
        },
        "markers": {
            "kind": sensor.marker,
            "radius_px": sensor.radius,
            "dark": sensor.dark,
            "reference": None
            if sensor.reference is None
            else np.round(sensor.reference, 5).tolist(),
        },
        "noise": {} if noise is None else asdict(noise),
        "elastomer": asdict(sensor.elastomer),
    }
    known = {
        table: {key: value for key, value in content.items() if value is not None}
        for table, content in tables.items()
    }
    write_whole(path, toml_text({"format_version": FORMAT_VERSION} | known))


def read_sensor(path: Path) -> Sensor:
    """Read a description.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    content = read_toml(path, FORMAT_VERSION)
    with naming(path):
        return _to_sensor(content)


def _to_sensor(content: dict[str, Any]) -> Sensor:
    expect_keys(content, "the file", tuple(_KEYS))
    tables = {name: as_table(content.get(name, {}), name) for name in _KEYS}
    for name, keys in _KEYS.items():
        expect_keys(tables[name], name, keys)
    camera, markers, noise = tables["camera"], tables["markers"], tables["noise"]
    for first, second in (("width", "height"), ("matrix", "distortion")):
        if (first in camera) != (second in camera):
            raise ValueError(f"camera: {first} and {second} come together")
    lens = size = None
    if "matrix" in camera:
        distortion = np.array(as_numbers(camera["distortion"], "distortion"))
        lens = Lens(as_matrix(camera["matrix"], "matrix"), distortion)
    if "width" in camera:
        size = as_whole(camera["width"], "width"), as_whole(camera["height"], "height")
    if noise and "in_plane" not in noise:
        raise ValueError("noise: in_plane is missing")
    return Sensor(
        mm_per_px=_optional(camera, "mm_per_px", as_number),
        lens=lens,
        size=size,
        marker=_optional(markers, "kind", as_text),
        radius=_optional(markers, "radius_px", as_number),
        dark=_optional(markers, "dark", as_flag),
        reference=_optional(markers, "reference", as_matrix),
        noise=_to_noise(noise) if noise else None,
        elastomer=Elastomer(
            **{key: _optional(tables["elastomer"], key, as_number) for key in _KEYS["elastomer"]}
        ),
    )


def _to_noise(table: dict[str, Any]) -> Noise:
    in_plane = Noise.given(as_number(table["in_plane"], "in_plane"))
    given = table.get("correlation", list(in_plane.correlation))
    one, two = as_numbers(given, "correlation", 2)
    return Noise(
        in_plane=in_plane.in_plane,
        normal=as_number(table.get("normal", np.nan), "normal"),
        correlation=(one, two),
        frames=as_whole(table.get("frames", 0), "frames"),
    )


_KEYS: dict[str, tuple[str, ...]] = {
    "camera": ("width", "height", "mm_per_px", "matrix", "distortion"),
    "markers": ("kind", "radius_px", "dark", "reference"),
    "noise": tuple(one.name for one in fields(Noise)),
    "elastomer": tuple(one.name for one in fields(Elastomer)),
}


def _optional(table: dict[str, Any], key: str, convert: Callable[[Any, str], Any]) -> Any:
    """A value of a table; None where it is not given."""
    return convert(table[key], key) if key in table else None
