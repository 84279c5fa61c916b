"""What surrounds the pad in the pictures of dots: dark frames, and mirrors along their sides."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped

from estimation.pictures.dots.find import DotStyle
from estimation.pictures.dots.style import find_dots
from estimation.pictures.lattice import index_lattice
from estimation.pictures.light import to_grey
from estimation.pictures.part import Part


def leave_out_surroundings(
    image: Shaped[np.ndarray, "h w *colour"], style: DotStyle, part: Part
) -> tuple[Part, tuple[str, ...]]:
    """The part of the pictures that is read without dark frames and mirrors, and notes on them.

    Args:
        image: a picture.
        style: the dots' typical appearance.
        part: that is read.
    """
    grey, notes = to_grey(image, style.dark), list[str]()
    dots = find_dots(grey, style).centre
    pitch = index_lattice(dots[part.shows(dots, style.radius)]).pitch
    for what, found in (
        ("a dark frame", find_dark_frame(image, style.radius)),
        ("mirrors", find_mirrors(grey, style.radius, pitch)),
    ):
        if found.any() and not found.all():
            part = part.without(found)
            notes.append(
                f"{found.mean():.1%} of the picture's area is not read, since it seems to show "
                f"{what} around the pad."
            )
    return part, tuple(notes)


def find_dark_frame(
    image: Shaped[np.ndarray, "h w *colour"], radius: float
) -> Bool[np.ndarray, "h w"]:
    """Find a dark frame around the pad: areas along the picture's edge that hardly shine.

    Args:
        image: a picture.
        radius: typical radius of a dot, which may be as dark [px].
    """
    darkest = 0.15  # brightness over the picture's median, up to which a frame counts as dark [-]
    beside = round(3.0 * radius)  # width of the blurred edge of such a frame [px]
    brightest = image if image.ndim == 2 else image[..., :3].max(axis=-1)
    light = cv2.medianBlur(brightest, 5)
    dark = (light <= darkest * np.median(light)).astype(np.uint8)
    wider = np.ones((2 * int(2.0 * radius) + 1,) * 2, np.uint8)  # than a dot
    areas = cv2.connectedComponents(cv2.morphologyEx(dark, cv2.MORPH_OPEN, wider))[1]
    sides = np.concatenate([areas[0], areas[-1], areas[:, 0], areas[:, -1]])
    frame = np.isin(areas, sides[sides > 0]).astype(np.uint8)
    return cv2.dilate(frame, np.ones((2 * beside + 1,) * 2, np.uint8)) > 0


def find_mirrors(
    grey: Float[np.ndarray, "h w"], radius: float, pitch: float
) -> Bool[np.ndarray, "h w"]:
    """Find strips along the picture's sides that show the dots beside them reflected.

    Args:
        grey: levels of a picture.
        radius: typical radius of a dot [px].
        pitch: distance between neighbouring dots [px]; NaN if the dots form no rows.
    """
    hidden = np.zeros(grey.shape, dtype=bool)
    if np.isnan(pitch):
        return hidden
    turned = grey.astype(np.float32)
    for quarter in range(4):  # each side in turn is the upper one
        width = _Side(turned, radius, pitch).find_width()
        np.rot90(hidden, quarter)[:width] = True
        turned = np.ascontiguousarray(np.rot90(turned))
    return hidden


class _Side(NamedTuple):
    """The upper side of a picture, searched for a mirror.

    Lines are given by twice their distance from the upper edge, since they lie on a row or between
    two rows.

    Attributes:
        grey: levels of the picture.
        radius: typical radius of a dot [px].
        pitch: distance between neighbouring dots [px].
    """

    grey: Float32[np.ndarray, "h w"]
    radius: float
    pitch: float

    def find_width(self) -> int:
        """Rows of the mirror along the upper edge; 0 if there is none.

        A lattice is symmetric about each of its rows and about the lines between them. Symmetry
        shows a mirror if it is absent one to two pitches further in, where a lattice would have it
        as well, or if the brightness has a step along the line.

        In some 600 frames of published clips and lifts, symmetry that is absent further in has a
        correlation of 0.94 at most. About lines with a correlation of 0.85 or more, steps are 0.05
        at most, and 0.02 where nine columns in ten show them.
        """
        # correlation of a strip with its reflection [-], with a step and without
        least, least_alone = 0.9, 0.95
        most_beside = 0.5  # correlation of symmetry further in that is absent [-]
        grain = 0.5  # of a strip that shows dots, over that of the whole picture [-]
        widest = 0.3  # width of a mirror, over that of the picture [-]
        grained = self.grey - cv2.blur(self.grey, (2 * round(4.0 * self.radius) + 1, 1))
        grained = cv2.GaussianBlur(grained, (0, 0), 1.0)
        rows = np.sqrt((grained * grained).mean(axis=1))
        narrowest = 2 * round(2.0 * self.radius)
        lines = range(narrowest, round(2.0 * widest * len(self.grey)))
        best, highest = 0, least
        for line in lines:
            alike = self._reflect(grained, line)
            if alike <= highest:
                continue
            if self._has_step(line) or (
                alike > least_alone
                and rows[: line // 2].mean() > grain * rows.mean()
                and self._reflect_further(grained, line) < most_beside
            ):
                best, highest = line, alike
        blurred = round(self.radius)  # width of the line itself [px]
        return best // 2 + 1 + blurred if best else 0

    def _reflect(self, grained: Float32[np.ndarray, "h w"], line: int) -> float:
        """Correlation of the rows above a line with those below it, in reverse order [-]."""
        count = min(round(1.5 * self.pitch), line // 2, len(grained) - (line + 1) // 2)
        above = grained[line // 2 - count : line // 2][::-1]
        below = grained[(line + 1) // 2 : (line + 1) // 2 + count]
        size = float((above * above).sum() * (below * below).sum())
        return float((above * below).sum()) / max(np.sqrt(size), 1e-6)

    def _reflect_further(self, grained: Float32[np.ndarray, "h w"], line: int) -> float:
        """The highest correlation about lines that a lattice would make symmetric as well [-]."""
        halves, offs = (2, 3, 4), (-2, -1, 0, 1, 2)  # further in [half pitches, half px]
        return max(
            self._reflect(grained, line + round(half * self.pitch) + off)
            for half in halves
            for off in offs
        )

    def _has_step(self, line: int) -> bool:
        """Whether the brightness changes along all of a line, from one side of it to the other."""
        rows = 3  # on each side that are compared
        # changes of the brightness, and the share of the columns that must show half of each; dots
        # may hide the line in some [-]
        faint, nearly_all, clear, most = 0.05, 0.9, 0.1, 0.6
        above = self.grey[line // 2 - rows : line // 2].mean(axis=0)
        below = self.grey[(line + 1) // 2 : (line + 1) // 2 + rows].mean(axis=0)
        step = (above - below) / np.maximum(below, 1.0)
        typical = float(np.median(step))
        columns = float(np.mean(step * np.sign(typical) > 0.5 * abs(typical)))
        needed = most if abs(typical) > clear else nearly_all
        return abs(typical) > faint and columns >= needed
