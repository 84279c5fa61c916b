"""The part of the pictures that is read, without mirrors, frames and covers around the pad."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped

from estimation.pictures.still import Still

SMALLEST_SIDE_PX = 16
"""Smallest width and height of a picture [px]."""


@dataclass(frozen=True)
class Part:
    """The part of the pictures that is read.

    Attributes:
        crop: left column, upper row, width and height of the part [px]; None for the whole picture.
        mask: picture of the same size, black where nothing is read; None to read everything.
        unread: pixels of the part that are found to show no pad, and are not read either.

    Raises:
        ValueError: the crop is too small or starts outside the picture, or the mask is black.
    """

    crop: tuple[int, int, int, int] | None = None
    mask: Still | None = None
    unread: Bool[np.ndarray, "h w"] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check the values."""
        if self.crop is not None and (
            min(self.crop[:2]) < 0 or min(self.crop[2:], default=0) < SMALLEST_SIDE_PX
        ):
            raise ValueError(
                f"the crop is {self._describe_crop()}: it must begin within the picture and be at "
                f"least {SMALLEST_SIDE_PX} px wide and high (--crop X Y WIDTH HEIGHT)"
            )
        if self.mask is not None and not _is_bright(self.mask).any():
            raise ValueError(
                f"the mask {self.mask.path} is completely black, and black parts are not read: "
                "make it white where the pad is (--mask)"
            )

    def _describe_crop(self) -> str:
        x, y, width, height = self.crop or (0, 0, 0, 0)
        return f"{width}×{height} px from column {x}, row {y} on"

    @property
    def origin(self) -> Float[np.ndarray, " 2"]:
        """Position of the part's first pixel in the whole picture [px]."""
        return np.zeros(2) if self.crop is None else np.array(self.crop[:2], dtype=float)

    @property
    def note(self) -> str:
        """A sentence on the part that is read; empty if it is the whole picture."""
        crop = "" if self.crop is None else f", {self._describe_crop()}"
        mask = "" if self.mask is None else f", without the black parts of {self.mask.path.name}"
        if not crop + mask:
            return ""
        return f"Only part of the pictures is read{crop}{mask}; positions are in the whole picture."

    def expect(self, width: int, height: int) -> None:
        """Check that pictures of a size contain this part.

        Raises:
            ValueError: they do not.
        """
        if self.crop is not None:
            x, y, wide, high = self.crop
            if x + wide > width or y + high > height:
                raise ValueError(
                    f"the crop, {self._describe_crop()}, reaches beyond the pictures, which are "
                    f"{width}×{height} px (--crop X Y WIDTH HEIGHT)"
                )
        if self.mask is not None and self.mask.image.shape[:2] != (height, width):
            high, wide = self.mask.image.shape[:2]
            raise ValueError(
                f"the mask {self.mask.path} is {wide}×{high}, the pictures are {width}×{height}: "
                "give a mask of the same size (--mask)"
            )
        if self.seen is not None and not self.seen.any():
            raise ValueError("the mask covers the whole crop (--mask, --crop)")

    @cached_property
    def _masked(self) -> Bool[np.ndarray, "h w"] | None:
        """Which pixels of the part the mask covers; None without a mask."""
        return None if self.mask is None else self._window(~_is_bright(self.mask))

    @cached_property
    def seen(self) -> Bool[np.ndarray, "h w"] | None:
        """Which pixels of the part are read; None if all are."""
        given = None if self._masked is None else ~self._masked
        if self.unread is None:
            return given
        return ~self.unread if given is None else given & ~self.unread

    @cached_property
    def _room(self) -> Float32[np.ndarray, "h w"] | None:
        """Distance of each pixel from the nearest masked pixel [px]."""
        if self.seen is None:
            return None
        return cv2.distanceTransform(self.seen.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)

    @cached_property
    def _weight(self) -> Float32[np.ndarray, "h w"]:
        assert self.seen is not None
        return _average(self.seen.astype(np.float32))

    def cut(self, image: Shaped[np.ndarray, "h w *colour"]) -> Shaped[np.ndarray, "k l *colour"]:
        """The part of a picture; masked pixels take the mean colour of the pixels around them."""
        image = self._window(image)
        if self.seen is None:
            return image
        seen, weight = self.seen, self._weight
        if image.ndim == 3:
            seen, weight = seen[..., None], weight[..., None]
        mean = image[self.seen].mean(axis=0)
        colour = _average(image.astype(np.float32) * seen)
        colour = np.where(weight > 1e-3, colour / np.maximum(weight, 1e-3), mean)
        filled = image.copy()
        filled[~self.seen] = np.rint(colour[~self.seen]).astype(image.dtype)
        return filled

    def shows(self, points: Float[np.ndarray, "n 2"], reach: float) -> Bool[np.ndarray, " n"]:
        """Whether all pixels around each point are read.

        Args:
            points: in the part [px]; NaN counts as not read.
            reach: radius around each point [px].
        """
        finite = np.isfinite(points[:, 0])
        if self._room is None:
            return finite
        place = np.rint(np.nan_to_num(points)).astype(int)
        column, row = np.clip(place, 0, np.array(self._room.shape[::-1]) - 1).T
        return finite & (self._room[row, column] > reach)

    def hides(self, points: Float[np.ndarray, "n 2"]) -> bool:
        """Whether the mask covers a third or more of the region that the points enclose.

        Args:
            points: in the part [px]; NaN for none.
        """
        most = 1 / 3  # share of the region
        if self._masked is None:
            return False
        points = points[np.isfinite(points[:, 0])]
        if not len(points):
            return False
        region = np.zeros(self._masked.shape, np.uint8)
        cv2.fillConvexPoly(region, cv2.convexHull(np.rint(points).astype(np.int32)), 1)
        return float(self._masked[region > 0].mean()) >= most

    def without(self, hidden: Bool[np.ndarray, "h w"]) -> "Part":
        """This part without some of its pixels, which show no pad."""
        return replace(self, unread=hidden if self.unread is None else self.unread | hidden)

    def darken(self, image: Shaped[np.ndarray, "h w *colour"]) -> Shaped[np.ndarray, "h w *colour"]:
        """A whole picture, with the pixels that are not read at half their brightness."""
        same_size = self.mask is None or self.mask.image.shape[:2] == image.shape[:2]
        if self == Part() or not same_size:
            return image
        read = np.zeros(image.shape[:2], dtype=bool)
        self._window(read)[:] = True if self.seen is None else self.seen
        shown = image.copy()
        shown[~read] //= 2
        return shown

    def _window(self, image: np.ndarray) -> np.ndarray:
        if self.crop is None:
            return image
        x, y, width, height = self.crop
        return image[y : y + height, x : x + width]


def _average(image: Float32[np.ndarray, "h w *colour"]) -> Float32[np.ndarray, "h w *colour"]:
    """The mean around each pixel, which replaces masked ones."""
    side = 31  # of the square over which it is taken [px]
    return cv2.blur(image, (side, side))


def _is_bright(mask: Still) -> Bool[np.ndarray, "h w"]:
    """Which pixels a mask allows to be read."""
    darkest = 127.0  # grey level of 255 up to which pixels are not read
    image = mask.image.astype(np.float32)
    image = image if image.ndim == 2 else image[..., :3].max(axis=-1)
    light = image * np.float32(1.0 / 257.0 if mask.image.dtype == np.uint16 else 1.0)
    return light > darkest
