"""Pictures without their dots and without the slow change of their light.

The lamps do not turn with the object: a slope that turns changes its colour. What is registered is
how far all colours together depart from what is around: how steep the print is.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped, UInt8


class Texture(NamedTuple):
    """The imprint's texture in one frame.

    Attributes:
        value: grey levels of 255, without dots and slow change of light.
        mask: 255 where there is contact and no dot.
    """

    value: Float32[np.ndarray, "h w"]
    mask: UInt8[np.ndarray, "h w"]


class Painted(NamedTuple):
    """A picture without its dots and the slow change of its light, scaled down.

    Attributes:
        planes: its colours, grey levels of 255, smoothed.
        texture: how far all together depart from what is around, worn dots left out; without
            colours grey levels.
        clear: 1 where there is no dot, nor one that the side may cut; else 0.
        bare: the same, and 0 where there is a worn dot or dirt.
        power: squares of all colours' departure and 1 where there is no dot, up to the sides.
        part: by how much it has been scaled down [-].
        radius: typical, of a dot in it [px].
    """

    planes: list[Float32[np.ndarray, "h w"]]
    texture: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]
    bare: Float32[np.ndarray, "h w"]
    power: Float32[np.ndarray, "2 h w"]
    part: int
    radius: float

    def level(self, points: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, " n"]:
        """Root mean square of the texture around each of some points, over all colours.

        Args:
            points: in the picture as it was [px]; NaN where there is none.
            reach: half the side of the square around each [px].
        """
        width = (2 * int(reach / self.part) + 1,) * 2
        power, shown = (cv2.blur(one, width) for one in self.power)
        level = np.sqrt(power / (shown + 1e-3))
        place = np.rint(np.nan_to_num(points) / self.part).astype(int)
        column, row = np.clip(place, 0, np.array(level.shape[::-1]) - 1).T
        return np.where(np.isfinite(points[:, 0]), level[row, column], np.nan)


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

    def without_around(plane: np.ndarray, clear: np.ndarray) -> np.ndarray:
        width = (2 * int(4.0 * radius) + 1,) * 2
        around = cv2.blur(plane * clear, width) / (cv2.blur(clear, width) + np.float32(1e-3))
        return (plane - around) * clear

    def smooth(clear: np.ndarray) -> list[np.ndarray]:
        return [cv2.GaussianBlur(without_around(one, clear), (0, 0), 1.0) for one in colours]

    planes, power = smooth(clear), shown * np.sum(np.square(smooth(shown)), axis=0)
    texture, bare = planes[0], clear
    if len(planes) > 1:
        bare = clear * ~_find_worn(colours, shown, dots, radius)
        texture = without_around(np.sqrt(np.sum(np.square(smooth(bare)), axis=0)), bare)
    return Painted(planes, texture, clear, bare, np.stack([power, shown]), part, radius)


def _find_worn(
    colours: list[Float32[np.ndarray, "h w"]],
    shown: Float32[np.ndarray, "h w"],
    dots: Float[np.ndarray, "n 2"],
    radius: float,
) -> Bool[np.ndarray, "h w"]:
    """Where worn dots and dirt are, which go with the gel: spots like dots, which are not found.

    In every colour they are darker than what is around, if dots are, or brighter. A slope is not:
    of lamps of different colours it faces one.
    """
    share = 0.25  # of what a dot takes of the light or adds, from which a spot is like it [-]
    width = (2 * int(4.0 * radius) + 1,) * 2
    around = cv2.blur(shown, width) + np.float32(1e-3)
    departure = np.stack([one - cv2.blur(one * shown, width) / around for one in colours])
    column, row = np.clip(np.rint(dots).astype(int), 0, np.array(shown.shape[::-1]) - 1).T
    if not len(row):
        return np.zeros(shown.shape, dtype=bool)
    alike = np.min(departure * np.sign(np.median(departure[:, row, column])), axis=0)
    worn = (alike > share * np.median(alike[row, column])) & (shown > 0.0)
    reach = np.ones((2 * round(0.5 * radius) + 1,) * 2, np.uint8)
    return cv2.dilate(worn.astype(np.uint8), reach) > 0


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
    mask[painted.bare == 0.0] = 0
    return Texture(painted.texture, mask)
