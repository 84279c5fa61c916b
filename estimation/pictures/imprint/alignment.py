"""Rigid motion of highest correlation between two textures.

[Baker2004] S. Baker, I. Matthews, "Lucas-Kanade 20 years on: a unifying framework": the inverse
compositional algorithm, in which all alignments with a texture share its slopes.
[Evangelidis2008] G. D. Evangelidis, E. Z. Psarakis, "Parametric image alignment using enhanced
correlation coefficient maximization": the objective.
"""

import math
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped

from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture


class Aligned(NamedTuple):
    """Two aligned textures.

    Attributes:
        warp: rigid motion from the earlier texture to the later one.
        quality: correlation of the two [-].
    """

    warp: Float[np.ndarray, "2 3"]
    quality: float


class Template:
    """A texture, with what all registrations of later textures with it share.

    Attributes:
        texture: the texture.
        box: rows and columns of the part around the contact, which alone is registered.
        every: interval of the rows and columns that are read.
        thinned: these rows and columns of the box.
    """

    def __init__(self, texture: Texture) -> None:
        """Take the slopes of a texture.

        Args:
            texture: the earlier one.
        """
        rim = 6  # room for slopes [px]
        x, y, width, height = cv2.boundingRect(texture.mask)
        self.texture = texture
        self.box = (
            slice(max(y - rim, 0), y + height + rim),
            slice(max(x - rim, 0), x + width + rim),
        )
        value = texture.smooth[self.box]
        rows, columns = value.shape
        self._shape = rows, columns
        self._corner = x, y = self.box[1].start, self.box[0].start
        self._middle = x + 0.5 * (columns - 1.0), y + 0.5 * (rows - 1.0)
        self._arm = 0.25 * (columns + rows)  # converts rotations to px
        x, y = (
            (np.linspace(-0.5, 0.5, count) * (count - 1) / self._arm).astype(np.float32)
            for count in (columns, rows)
        )
        right, down = find_slopes(value)
        planes = [right, down, x * down - y[:, None] * right, value, np.ones_like(value)]
        enough = 4000  # pixels; of more, a quarter is read, since neighbours hardly differ
        self.every = 2 if value.size > 4 * enough else 1
        self.thinned = slice(None, None, self.every), slice(None, None, self.every)
        self._mask = np.ascontiguousarray(texture.mask[self.box][self.thinned])
        self._inner = np.ascontiguousarray(texture.inner[self.box][self.thinned])
        self._planes = np.stack([plane[self.thinned] for plane in planes]).reshape(5, -1)

    @cached_property
    def slopes(self) -> tuple[Float32[np.ndarray, "rows columns"], ...]:
        """Slopes of the box along x and y [1/px], not smoothed."""
        return find_slopes(self.texture.value[self.box])

    def align(
        self,
        now: Texture,
        start: Float[np.ndarray, "2 3"],
        settings: ImprintSettings,
        marks: Bool[np.ndarray, "rows columns"] | None = None,
    ) -> Aligned | None:
        """Estimate the rigid motion to a later texture; None where the two do not correlate.

        Args:
            now: the later texture.
            start: initial motion.
            settings: of the registration.
            marks: pixels of the box that are left out; none by default.
        """
        damping = 1e-3  # along uniform prints, over the sum of the curvatures [-]
        warp, every = start, self.every
        shown = self.bring(now.mask, warp, cv2.INTER_NEAREST, every)
        shared = every**2 * cv2.countNonZero(cv2.bitwise_and(self._mask, shown))
        if shared < settings.overlap * min(self.texture.size, now.size):
            return None
        inner = self.bring(now.inner, warp, cv2.INTER_NEAREST, every)
        seen = cv2.bitwise_and(self._inner, inner)
        if marks is not None:
            seen[marks[self.thinned]] = 0
        seen = seen.ravel() * np.float32(1.0 / 255.0)
        products = ((self._planes * seen) @ self._planes.T).astype(float)
        count, sums = products[4, 4], products[4, :4]
        if count < len(products):
            return None
        products = products[:4, :4] - np.outer(sums, sums) / count
        along, power = products[3, :3], products[3, 3]
        curvature = (products[:3, :3] - np.outer(along, along) / power) / power
        inverse = np.linalg.inv(curvature + damping * np.trace(curvature) * np.eye(3))
        quality = 0.0
        for step in range(settings.steps):
            level = self.bring(now.smooth, warp, cv2.INTER_LINEAR, every).ravel() * seen
            cross = (self._planes @ level).astype(float)
            mean, cross = cross[4] / count, cross[:4] - sums * (cross[4] / count)
            size = np.sqrt(power * max(float(level @ level) - mean**2 * count, 1e-9))
            quality = float(cross[3] / size)
            if quality < settings.hopeless * min(step / settings.trial, 1.0):
                return None
            pull = (cross[:3] - along * cross[3] / power) / size
            right, down, turn = (inverse @ pull / max(quality, settings.hopeless)).tolist()
            warp = warp @ undo((right, down), turn / self._arm, self._middle)
            if max(abs(right), abs(down), abs(turn)) < settings.smallest_px:
                break
        return Aligned(warp, quality)

    def compare_own(self, now: Texture, warp: Float[np.ndarray, "2 3"]) -> float:
        """Correlation with a later texture, both without worn dots [-]; 1 if there are none.

        Args:
            now: the later texture.
            warp: motion from this texture to the later one.
        """
        if self.texture.worn is None and now.worn is None:
            return 1.0
        shown = self.bring(now.own, warp, cv2.INTER_NEAREST, self.every)
        both = cv2.bitwise_and(self.texture.own[self.box][self.thinned], shown) > 0
        if not both.any():
            return 0.0
        level = self.bring(now.smooth, warp, cv2.INTER_LINEAR, self.every)[both]
        earlier = self.texture.smooth[self.box][self.thinned][both]
        level, earlier = level - level.mean(), earlier - earlier.mean()
        size = math.sqrt(float(level @ level) * float(earlier @ earlier))
        return float(level @ earlier) / max(size, 1e-6)

    def bring(
        self,
        plane: Shaped[np.ndarray, "h w"],
        warp: Float[np.ndarray, "2 3"],
        how: int,
        every: int = 1,
    ) -> Shaped[np.ndarray, "rows columns"]:
        """Warp the box around the contact out of a plane of a later texture.

        Args:
            plane: of the later texture.
            warp: motion from this texture to the later one.
            how: interpolation, as named by OpenCV.
            every: interval of the rows and columns that are read.
        """
        x, y = self._corner
        moved = warp @ np.array([[every, 0.0, x], [0.0, every, y], [0.0, 0.0, 1.0]])
        rows, columns = (-(-size // every) for size in self._shape)
        return cv2.warpAffine(plane, moved, (columns, rows), flags=how | cv2.WARP_INVERSE_MAP)


def find_slopes(
    plane: Float32[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Slopes along x and y [1/px]."""
    right = cv2.Sobel(plane, cv2.CV_32F, 1, 0, scale=0.125)
    return right, cv2.Sobel(plane, cv2.CV_32F, 0, 1, scale=0.125)


def undo(
    shift: tuple[float, float], turn: float, middle: tuple[float, float]
) -> Float[np.ndarray, "3 3"]:
    """The inverse of a small motion.

    Args:
        shift: along x and y [px].
        turn: about the middle [rad].
        middle: x and y [px].
    """
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = middle[0] + shift[0], middle[1] + shift[1]
    right, down = middle[0] - cos * x - sin * y, middle[1] + sin * x - cos * y
    return np.array([[cos, sin, right], [-sin, cos, down], [0.0, 0.0, 1.0]])
