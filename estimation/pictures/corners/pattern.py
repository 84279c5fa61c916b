"""The continuous marker pattern: a checkerboard whose cells may carry a code of dots.

A plain checkerboard repeats, so a piece of it can be placed only by gel at rest. With dots in
randomly chosen cells, every piece of a few cells is unique and can be placed on its own. [Li2024]
takes the pattern and its rigid matching from earlier work of its authors; this code is our own.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Section IV-A.
"""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from estimation.pictures.render import OVERSAMPLING_FACTOR, Camera, expose

Project = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 2"]]
"""Maps points of the unloaded pattern [mm] to positions in the picture [px]."""


class Pattern(NamedTuple):
    """A checkerboard in the plane of the unloaded gel, with its middle at the origin.

    Attributes:
        shape: rows and columns of its inner corners.
        pitch: side of a cell [mm].
        code: cells with a dot, one more row and column than corners; None for a plain
            checkerboard.
    """

    shape: tuple[int, int]
    pitch: float
    code: Bool[np.ndarray, "rows columns"] | None = None

    @classmethod
    def coded(cls, shape: tuple[int, int], pitch: float, seed: int = 0) -> "Pattern":
        """Make a pattern with dots in a random half of its cells."""
        cells = (shape[0] + 1, shape[1] + 1)
        return cls(shape, pitch, np.random.default_rng(seed).random(cells) < 0.5)

    def corners(self) -> Float[np.ndarray, "n 2"]:
        """Positions of the inner corners, row by row [mm]."""
        rows, columns = self.shape
        y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        middle = 0.5 * np.array([columns - 1, rows - 1])
        return self.pitch * (np.stack([x.ravel(), y.ravel()], axis=1) - middle)


class CornerTruth(NamedTuple):
    """True corners of a picture.

    Attributes:
        position: of each corner [px].
        angles: of the edges that lie along x and y in the unloaded pattern [rad, from x to y].
    """

    position: Float[np.ndarray, "n 2"]
    angles: Float[np.ndarray, "n 2"]


def project_corners(project: Project, pattern: Pattern) -> CornerTruth:
    """Positions of the corners and angles of their edges in the picture."""
    corners, step = pattern.corners(), 1e-4 * pattern.pitch
    along = [project(corners + step * axis) - project(corners - step * axis) for axis in np.eye(2)]
    angles = np.stack([np.arctan2(edge[:, 1], edge[:, 0]) for edge in along], axis=1)
    return CornerTruth(project(corners), angles)


def render_pattern(
    camera: Camera, project: Project, pattern: Pattern, rng: np.random.Generator
) -> UInt8[np.ndarray, "height width"]:
    """Render a picture of the pattern, dark cells on bright gel.

    Args:
        camera: size, light, blur and noise of the picture.
        project: maps points of the unloaded pattern to the picture.
        pattern: the pattern.
        rng: random generator for the noise.
    """
    strip = 64  # fine rows printed at a time, so that they stay in the processor's cache
    margin, shape = camera.margin, camera.fine_shape
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    cells = _unproject_all(project, pattern, (height, width), margin) / pattern.pitch
    cells += 0.5 * (np.array(pattern.shape[::-1]) + 1)  # 0 at the outer side of the first cell
    slopes = [np.gradient(cells[..., i]) for i in (0, 1)]
    per_px = np.stack([np.hypot(down, right) for down, right in slopes], axis=-1)
    fine, wide = (
        [cv2.resize(values[..., i].astype(np.float32), shape[::-1]) for i in (0, 1)]
        for values in (cells, per_px / OVERSAMPLING_FACTOR)
    )
    strips = [slice(start, start + strip) for start in range(0, shape[0], strip)]
    printed = [_print(pattern, [a[s] for a in fine], [w[s] for w in wide]) for s in strips]
    return expose(camera, np.concatenate(printed), rng)


def _print(pattern: Pattern, at: list[np.ndarray], width: list[np.ndarray]) -> np.ndarray:
    """Share of dark print at points (in cells), averaged over the width of a fine cell."""
    dot_radius = 0.14  # radius of a cell's dot, in cells
    rows, columns = pattern.shape
    sign, inside = np.ones_like(at[0]), np.ones_like(at[0])
    for place, wide, count in zip(at, width, (columns + 1, rows + 1), strict=True):
        nearest = np.rint(place)
        edge = np.clip((place - nearest) / wide, -0.5, 0.5) * 2.0
        sign *= np.where(nearest % 2 == 0, edge, -edge)
        inside *= np.clip(place / wide + 0.5, 0.0, 1.0)
        inside *= np.clip((count - place) / wide + 0.5, 0.0, 1.0)
    cover = 0.5 + 0.5 * sign
    if pattern.code is not None:
        x, y = (np.clip(np.floor(a), 0, n) for a, n in zip(at, (columns, rows), strict=True))
        off = np.hypot(at[0] - x - 0.5, at[1] - y - 0.5)
        dot = np.clip((dot_radius - off) / (0.5 * (width[0] + width[1])) + 0.5, 0.0, 1.0)
        dot *= pattern.code[y.astype(int), x.astype(int)]
        cover = cover + dot * (1.0 - 2.0 * cover)
    return (cover * inside).astype(np.float32)


def _unproject_all(
    project: Project, pattern: Pattern, shape: tuple[int, int], margin: int
) -> Float[np.ndarray, "height width 2"]:
    """Points of the unloaded pattern [mm] at all pixels of a picture with a margin.

    Raises:
        ValueError: the displacement folds, or a pixel lies outside the range of the projection.
    """
    coarse = 8  # spacing of the pixels whose place in the pattern is searched first [px]
    corners = pattern.corners()
    projected = np.column_stack([project(corners), np.ones(len(corners))])
    affine = np.linalg.lstsq(projected, corners, rcond=None)[0]
    y, x = (coarse * np.arange(-(-size // coarse) + 1.0) - margin for size in shape)
    sparse = np.stack(np.meshgrid(x, y), axis=-1)
    pixels = sparse.reshape(-1, 2)
    start = np.column_stack([pixels, np.ones(len(pixels))]) @ affine
    points = _unproject(project, pattern, pixels, start).reshape(sparse.shape)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    start = cv2.remap(points, x / coarse, y / coarse, cv2.INTER_LINEAR).reshape(-1, 2)
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(float) - margin
    return _unproject(project, pattern, pixels, start).reshape(*shape, 2)


def _unproject(
    project: Project,
    pattern: Pattern,
    pixels: Float[np.ndarray, "n 2"],
    start: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "n 2"]:
    """Points of the unloaded pattern [mm] at given pixels, by Newton's method.

    Raises:
        ValueError: Newton's method does not converge.
    """
    steps = 30
    points = start.copy()
    step, longest = 1e-4 * pattern.pitch, 2.0 * pattern.pitch
    active = np.arange(len(pixels))
    for _ in range(steps):
        here = points[active]
        off = pixels[active] - project(here)
        far = np.abs(off).max(axis=1) > 1e-4
        if not far.any():
            return points
        active, here, off = active[far], here[far], off[far]
        columns = [
            (project(here + step * axis) - project(here - step * axis)) / (2.0 * step)
            for axis in np.eye(2)
        ]
        change = np.linalg.solve(np.stack(columns, axis=-1), off[..., None])[..., 0]
        size = np.linalg.norm(change, axis=1, keepdims=True)
        points[active] = here + change * np.minimum(1.0, longest / np.maximum(size, 1e-12))
    raise ValueError(
        "no point of the pattern was found for some pixels: the displacement field folds, or the "
        "view reaches beyond the camera's range"
    )
