"""The object's print through the gel: its relief, and its light under three coloured lamps."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32

from estimation.pictures.render import Camera


class Relief(NamedTuple):
    """Small heights of the object's face, in addition to its shape.

    Attributes:
        height: towards the elastomer, on a square grid with the object's axis in its middle [mm].
        step: side of a cell [mm].
    """

    height: Float32[np.ndarray, "n n"]
    step: float

    def at(
        self, camera: Camera, centre: Float[np.ndarray, "2"], angle: float
    ) -> Float32[np.ndarray, "height width"]:
        """Height of the moved relief at each pixel of a picture [mm].

        Args:
            camera: the camera, without distortion.
            centre: position of the object's axis in the view [mm].
            angle: rotation of the object [rad, from x to y of the picture].
        """
        y, x = np.mgrid[: camera.height, : camera.width].astype(float)
        x = (x - 0.5 * (camera.width - 1)) * camera.mm_per_px - centre[0]
        y = (y - 0.5 * (camera.height - 1)) * camera.mm_per_px - centre[1]
        c, s, middle = np.cos(angle), np.sin(angle), 0.5 * (len(self.height) - 1)
        own_x = ((c * x + s * y) / self.step + middle).astype(np.float32)
        own_y = ((c * y - s * x) / self.step + middle).astype(np.float32)
        # OpenCV rounds fractions of a cell to 1/32, and a cell is a quarter of a pixel
        return cv2.remap(self.height, own_x, own_y, cv2.INTER_CUBIC)


def make_relief(
    kind: str, slope: float, size: float, step: float, rng: np.random.Generator
) -> Relief:
    """Draw a random relief.

    Args:
        kind: texture (random roughness), edges (straight ridges), stripes (parallel repeated
            ridges) or smooth.
        slope: root mean square of the slope where the relief is steep [-].
        size: side of the square that the relief covers [mm].
        step: side of a cell [mm].
        rng: random generator for the relief.

    Raises:
        ValueError: there is no such kind.
    """
    coarse_step = 0.1  # step in which reliefs are drawn before they are refined [mm]
    makers = {"texture": _roughen, "edges": _add_edges, "stripes": _repeat}
    kinds = (*makers, "smooth")
    if kind not in kinds:
        raise ValueError(f"unknown relief {kind!r}; choose from {', '.join(kinds)}")
    count = round(size / step)
    place = coarse_step * (np.arange(round(size / coarse_step)) + 0.5) - 0.5 * size
    if kind == "smooth":
        return Relief(np.zeros((count, count), np.float32), step)
    drawn = makers[kind](place, rng).astype(np.float32)
    height = cv2.resize(drawn, (count, count), interpolation=cv2.INTER_CUBIC)
    across, along = np.gradient(height, step)
    steepness = np.hypot(across, along)
    steep = steepness > 0.3 * steepness.max()
    return Relief(height * np.float32(slope / np.sqrt(np.mean(steepness[steep] ** 2))), step)


def _roughen(place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Roughness with wavelengths from 0.5 to 3 mm; the gel does not show finer ones."""
    count = len(place) + len(place) % 2
    frequency = np.fft.fftfreq(count, place[1] - place[0])
    wave = np.hypot(frequency[:, None], frequency[None, : count // 2 + 1])  # [1/mm]
    band = np.exp(-((wave / 1.4) ** 4)) * (1.0 - np.exp(-((wave / 0.5) ** 4)))
    rough = np.fft.irfft2(band * np.fft.rfft2(rng.normal(size=(count, count))), (count, count))
    return rough[: len(place), : len(place)]


def _add_edges(place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Six straight ridges of 2 to 7 mm in two directions, 0.2 to 0.4 mm wide."""
    height = np.zeros((len(place), len(place)))
    first = rng.uniform(0.0, np.pi)
    for i in range(6):
        turn = first + (i % 2) * rng.uniform(0.9, 1.5)
        x, y = place[None, :] - rng.uniform(-2.5, 2.5), place[:, None] - rng.uniform(-2.5, 2.5)
        across, along = (np.cos(turn) * y - np.sin(turn) * x), (np.cos(turn) * x + np.sin(turn) * y)
        half, width = 0.5 * rng.uniform(2.0, 7.0), rng.uniform(0.2, 0.4)
        ends = 1.0 / (1.0 + np.exp((np.abs(along) - half) / 0.2))
        height += rng.choice([-1.0, 1.0]) * ends * np.exp(-((across / width) ** 2))
    return height


def _repeat(place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Ridges along y, 1.2 to 2 mm apart."""
    waves = np.cos(2.0 * np.pi * (place / rng.uniform(1.2, 2.0) + rng.uniform()))
    return np.tile(np.exp(3.0 * (waves - 1.0)), (len(place), 1))


class Lamps(NamedTuple):
    """Three lamps around the view, blue, green and red.

    Attributes:
        azimuth: direction of the first lamp; the others follow at thirds of a turn [rad].
        elevation: of the light above the pad [rad].
        tint: brightness of each colour [-].
        fall: share of its light that each lamp loses from its side of the view to the middle [-].
    """

    azimuth: float = 0.5 * np.pi
    elevation: float = np.radians(30.0)
    tint: tuple[float, float, float] = (1.1, 1.0, 0.8)
    fall: float = 0.3

    def light(
        self, camera: Camera, height: Float[np.ndarray, "height width"]
    ) -> Float[np.ndarray, "height width 3"]:
        """Grey levels of a matt surface without dots.

        Args:
            camera: the camera; its background is the level of a flat surface in mid-view.
            height: of the surface above the pad's plane, either towards the camera or away [mm].
        """
        down, right = np.gradient(height, camera.mm_per_px)
        facing = 1.0 / np.sqrt(1.0 + right**2 + down**2)
        y, x = np.mgrid[: camera.height, : camera.width]
        half = 0.5 * np.hypot(camera.width, camera.height)
        x, y = (x - 0.5 * (camera.width - 1)) / half, (y - 0.5 * (camera.height - 1)) / half
        vignette = camera.background * (1.0 - camera.shading * (x**2 + y**2))
        planes = []
        for i, tint in enumerate(self.tint):
            c, s = (f(self.azimuth + 2.0 * np.pi * i / 3.0) for f in (np.cos, np.sin))
            shade = facing * (1.0 - (c * right + s * down) / np.tan(self.elevation))
            uneven = 1.0 + self.fall * (c * x + s * y)
            planes.append(tint * vignette * uneven * np.maximum(shade, 0.0))
        return np.stack(planes, axis=-1)
