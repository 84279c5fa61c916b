"""Virtual images of dots and speckle with known positions.

Every dot is an ellipse with a sharp rim, drawn on a grid `OVERSAMPLING_FACTOR` times finer than the
picture, blurred there and averaged over the pixels. The images do not use the model of the fit.
"""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

OVERSAMPLING_FACTOR = 4
"""Cells of the fine grid along each side of a pixel."""


class Camera(NamedTuple):
    """The virtual camera.

    Attributes:
        width: of the picture [px].
        height: of the picture [px].
        mm_per_px: scale in the middle of the picture [mm/px].
        distortion: radial lens distortion [-]: an image point at distance r from the middle lies
            at r (1 + distortion (r/R)²), R half the picture's diagonal.
        blur: standard deviation of the point spread [px].
        background: grey level between the dots, in the middle of the picture.
        contrast: grey level of the background minus that of a dot; below 0 for bright dots.
        shading: loss of light in the corners, as a share of the light in the middle [-].
        noise: standard deviation of each pixel [grey levels].
    """

    width: int = 640
    height: int = 480
    mm_per_px: float = 0.04
    distortion: float = 0.0
    blur: float = 1.0
    background: float = 180.0
    contrast: float = 120.0
    shading: float = 0.0
    noise: float = 2.0

    @property
    def margin(self) -> int:
        """Width of the border around the picture that the blur needs [px]."""
        return 2 * int(np.ceil(4.0 * self.blur))

    @property
    def fine_shape(self) -> tuple[int, int]:
        """Height and width of the fine grid on which markers are drawn, including its border."""
        height, width = self.height + 2 * self.margin, self.width + 2 * self.margin
        return OVERSAMPLING_FACTOR * height, OVERSAMPLING_FACTOR * width

    def project(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Picture positions [px], x right and y down, of points in the contact plane [mm]."""
        ideal = points / self.mm_per_px
        corner = 0.5 * np.hypot(self.width, self.height)
        stretch = 1.0 + self.distortion * np.sum((ideal / corner) ** 2, axis=1, keepdims=True)
        return ideal * stretch + 0.5 * np.array([self.width - 1, self.height - 1])


def project_discs(
    camera: Camera,
    move: Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 2"]],
    reference: Float[np.ndarray, "n 2"],
    radius: float,
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"]]:
    """Project discs that deform with the surface.

    Args:
        camera: the camera.
        move: maps points of the unloaded surface to their current positions [mm].
        reference: unloaded centres [mm].
        radius: of the discs [mm].

    Returns:
        Centres [px], and matrices that map the unit circle to each disc's rim [px].
    """
    step = np.array([radius, 0.0])
    sides = [camera.project(move(reference + s * step[::o])) for o in (1, -1) for s in (1, -1)]
    axes = 0.5 * np.stack([sides[0] - sides[1], sides[2] - sides[3]], axis=-1)
    return camera.project(move(reference)), axes


def scatter_speckle(
    size: tuple[float, float], radius: float, share: float, rng: np.random.Generator
) -> Float[np.ndarray, "n 2"]:
    """Random centres [mm] of the small discs of a speckle pattern.

    Args:
        size: width and height of the pattern, its middle at the origin [mm].
        radius: of the discs [mm].
        share: of the pattern that the discs cover [-].
        rng: random generator for the positions.
    """
    count = round(-np.log1p(-share) * size[0] * size[1] / (np.pi * radius**2))
    return (rng.random((count, 2)) - 0.5) * np.array(size)


def render_dots(
    camera: Camera,
    centres: Float[np.ndarray, "n 2"],
    axes: Float[np.ndarray, "n 2 2"],
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "height width"]:
    """Render a picture of dots.

    Args:
        camera: the camera.
        centres: of the dots [px].
        axes: matrices that map the unit circle to each dot's rim [px].
        rng: random generator for the noise.
    """
    return expose(camera, _print_dots(camera, centres, axes), rng)


def cover_with_dots(
    camera: Camera, centres: Float[np.ndarray, "n 2"], axes: Float[np.ndarray, "n 2 2"]
) -> Float32[np.ndarray, "height width"]:
    """Share of each pixel that dots cover, blurred by the camera.

    Args:
        camera: the camera.
        centres: of the dots [px].
        axes: matrices that map the unit circle to each dot's rim [px].
    """
    return _blur(camera, _print_dots(camera, centres, axes))


def expose(
    camera: Camera, cover: Float32[np.ndarray, "fine_height fine_width"], rng: np.random.Generator
) -> UInt8[np.ndarray, "height width"]:
    """Expose a picture of the print, with blur, light, noise and rounding.

    Args:
        camera: the camera.
        cover: share of print, on the grid of `Camera.fine_shape`.
        rng: random generator for the noise.
    """
    cover = _blur(camera, cover)
    y, x = np.mgrid[: camera.height, : camera.width]
    from_middle = np.hypot(x - 0.5 * (camera.width - 1), y - 0.5 * (camera.height - 1))
    from_middle /= 0.5 * np.hypot(camera.width, camera.height)
    light = 1.0 - camera.shading * from_middle**2
    return digitise(camera, light * (camera.background - camera.contrast * cover), rng)


def digitise(
    camera: Camera, level: Float[np.ndarray, "*shape"], rng: np.random.Generator
) -> UInt8[np.ndarray, "*shape"]:
    """Add the camera's noise and round to 8 bit.

    Args:
        camera: the camera.
        level: of each pixel and colour [grey levels].
        rng: random generator for the noise.
    """
    noisy = level + rng.normal(0.0, camera.noise, level.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _print_dots(camera: Camera, centres: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Share of each cell of the fine grid that dots cover."""
    n, margin = OVERSAMPLING_FACTOR, camera.margin
    cover = np.zeros(camera.fine_shape, dtype=np.float32)
    for centre, axis in zip(centres, axes, strict=True):
        _draw(cover, n * (centre + margin) + 0.5 * (n - 1), n * axis)
    return cover


def _blur(camera: Camera, cover: np.ndarray) -> np.ndarray:
    """Average the cover of the fine grid over the pixels, after the blur."""
    n, margin = OVERSAMPLING_FACTOR, camera.margin
    if camera.blur > 0.0:
        cover = cv2.GaussianBlur(cover, (0, 0), n * camera.blur)
    rows, columns = (size // n for size in camera.fine_shape)
    cover = cover.reshape(rows, n, columns, n).mean(axis=(1, 3))
    return cover[margin:-margin, margin:-margin] if margin else cover


def _draw(cover: np.ndarray, centre: np.ndarray, axis: np.ndarray) -> None:
    """Add an ellipse to the cover: to each cell its share inside the ellipse."""
    reach = np.linalg.norm(axis, axis=1) + 2.0
    low = np.maximum(np.floor(centre - reach).astype(int), 0)
    high = np.minimum(np.ceil(centre + reach).astype(int) + 1, cover.shape[::-1])
    if (low >= high).any():
        return
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    inverse = np.linalg.inv(axis)
    unit = inverse @ np.stack([x.ravel() - centre[0], y.ravel() - centre[1]])
    size = np.hypot(*unit)
    slope = np.linalg.norm(inverse.T @ unit, axis=0) / np.maximum(size, 1e-9)
    inside = np.clip(0.5 - (size - 1.0) / np.maximum(slope, 1e-9), 0.0, 1.0)
    part = cover[low[1] : high[1], low[0] : high[0]]
    np.maximum(part, inside.reshape(x.shape), out=part)
