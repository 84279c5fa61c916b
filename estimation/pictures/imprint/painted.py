"""Pictures without their dots and without the slow change of their light.

The lamps do not turn with the object: a slope that turns changes its colour. What is registered is
how far all colours together depart from what is around: how steep the print is.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped, UInt8


class Texture(NamedTuple):
    """The imprint's texture in one frame.

    Attributes:
        value: grey levels of 255, without dots and slow change of light.
        mask: 255 where there is contact and no dot.
    """

    value: Float32[np.ndarray, "h w"]
    mask: UInt8[np.ndarray, "h w"]


@dataclass(frozen=True, eq=False)
class Painted:
    """A picture without its dots and the slow change of its light, scaled down.

    What is made of it is made when it is first asked for: many pictures show no contact.

    Attributes:
        colours: its colours, grey levels of 255.
        shown: 1 where there is no dot, else 0.
        clear: the same, and 0 where there may be dots that the side cuts.
        dots: all dots in it [px].
        part: by how much it has been scaled down [-].
        radius: typical, of a dot in it [px].
    """

    colours: list[Float32[np.ndarray, "h w"]]
    shown: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]
    dots: Float[np.ndarray, "n 2"]
    part: int
    radius: float

    @cached_property
    def planes(self) -> list[Float32[np.ndarray, "h w"]]:
        """How far each colour departs from what is around, smoothed."""
        mean = self._mean_around(self.clear)
        return _smooth([one - mean(one) for one in self.colours], self.clear)

    @cached_property
    def texture(self) -> Float32[np.ndarray, "h w"]:
        """How far all together depart from what is around, worn dots left out; or grey levels."""
        if len(self.colours) == 1:
            return self.planes[0]
        bare, mean = self.bare, self._mean_around(self.bare)
        level = np.sqrt(_power(_smooth([one - mean(one) for one in self.colours], bare)))
        return (level - mean(level)) * bare

    @cached_property
    def bare(self) -> Float32[np.ndarray, "h w"]:
        """1 where it is clear and no worn dot or dirt is, which only colours show; else 0."""
        return self.clear if len(self.colours) == 1 else self.clear * ~self._find_worn()

    def level(self, points: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, " n"]:
        """Root mean square of the texture around each of some points, over all colours.

        Args:
            points: in the picture as it was [px]; NaN where there is none.
            reach: half the side of the square around each [px].
        """
        width = (2 * int(reach / self.part) + 1,) * 2
        power = self.shown * _power(_smooth(self._departing, self.shown))
        column, row = self._nearest(np.nan_to_num(points) / self.part)
        power, shown = (cv2.blur(one, width)[row, column] for one in (power, self.shown))
        return np.where(np.isfinite(points[:, 0]), np.sqrt(power / (shown + 1e-3)), np.nan)

    @cached_property
    def _departing(self) -> list[Float32[np.ndarray, "h w"]]:
        """How far each colour departs from what is around, up to the sides."""
        mean = self._mean_around(self.shown)
        return [one - mean(one) for one in self.colours]

    def _mean_around(
        self, clear: Float32[np.ndarray, "h w"]
    ) -> Callable[[np.ndarray], Float32[np.ndarray, "h w"]]:
        """What takes a plane to its mean, around each pixel, over where it is clear."""
        width = (2 * int(4.0 * self.radius) + 1,) * 2
        share = cv2.blur(clear, width) + np.float32(1e-3)
        return lambda plane: cv2.blur(plane * clear, width) / share

    def _nearest(self, points: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "2 n"]:
        """Column and row of the pixels next to some points."""
        limit = np.array(self.shown.shape[::-1]) - 1
        return np.clip(np.rint(points).astype(int), 0, limit).T

    def _find_worn(self) -> Bool[np.ndarray, "h w"]:
        """Where worn dots and dirt are, which go with the gel: spots like dots, not found as such.

        In every colour they are darker than what is around, if dots are, or brighter. A slope is
        not: of lamps of different colours it faces one.
        """
        share = 0.25  # of what a dot takes of the light or adds, from which a spot is like it [-]
        if not len(self.dots):
            return np.zeros(self.shown.shape, dtype=bool)
        column, row = self._nearest(self.dots)
        sides = np.sign(np.median([one[row, column] for one in self._departing], axis=1))
        alike = reduce(
            np.minimum, (side * one for side, one in zip(sides, self._departing, strict=True))
        )
        worn = (alike > share * np.median(alike[row, column])) & (self.shown > 0.0)
        reach = np.ones((2 * round(0.5 * self.radius) + 1,) * 2, np.uint8)
        return cv2.dilate(worn.astype(np.uint8), reach) > 0


def paint_out(
    picture: Shaped[np.ndarray, "h w *colour"],
    dots: Float[np.ndarray, "n 2"],
    radius: float,
    seen: Bool[np.ndarray, "h w"] | None = None,
) -> Painted:
    """The picture with the dots and the slow change of light taken off, scaled down.

    Args:
        picture: of the frame.
        dots: all dots in it [px].
        radius: typical, of a dot [px].
        seen: pixels that are read; all by default.
    """
    # rows, about, of the picture that is registered: larger ones are scaled down; and the radius
    # that this leaves a dot, a smaller one cannot be painted out [px]
    rows, smallest_dot = 120, 2.0
    part = max(min(round(picture.shape[0] / rows), int(radius / smallest_dot)), 1)
    size = (picture.shape[1] // part, picture.shape[0] // part)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    image = small.astype(np.float32) * np.float32(1.0 / 257.0 if small.dtype == np.uint16 else 1.0)
    dots, radius = dots / part, radius / part
    shown = np.ones(image.shape[:2], np.float32)
    for x, y in np.rint(dots * 16).astype(int).tolist():
        cv2.circle(shown, (x, y), int(16 * 1.6 * radius), 0.0, -1, shift=4)
    if seen is not None:
        shown[cv2.resize(seen.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 0] = 0.0
    rim = round(1.6 * radius)  # of dots that the side cuts, whose middle is not seen
    clear = np.zeros_like(shown)
    clear[rim:-rim, rim:-rim] = shown[rim:-rim, rim:-rim]
    colours = [image] if image.ndim == 2 else list(cv2.split(image[..., :3]))
    return Painted(colours, shown, clear, dots, part, radius)


def _smooth(
    departing: list[Float32[np.ndarray, "h w"]], clear: Float32[np.ndarray, "h w"]
) -> list[Float32[np.ndarray, "h w"]]:
    """What departs where it is clear, without its finest grain."""
    return [cv2.GaussianBlur(one * clear, (0, 0), 1.0) for one in departing]


def _power(planes: list[Float32[np.ndarray, "h w"]]) -> Float32[np.ndarray, "h w"]:
    """Sum of squares of all colours."""
    return reduce(np.add, (one * one for one in planes))


def cut_out(painted: Painted, region: Float[np.ndarray, "k 2"]) -> Texture:
    """The texture of the contact region.

    Args:
        painted: the picture.
        region: dots of the contact region [px of the picture as it was].
    """
    mask = np.zeros(painted.clear.shape, np.uint8)
    hull = cv2.convexHull((region / painted.part).astype(np.float32)).astype(np.int32)
    cv2.fillConvexPoly(mask, hull, 255)
    mask = cv2.dilate(mask, np.ones((2 * int(painted.radius) + 1,) * 2, np.uint8))
    return Texture(painted.texture, mask * (painted.bare > 0.0))
