"""What surrounds the pad in the pictures of dots: dark frames, and mirrors along their sides."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

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
        strip = _find_strip(turned, radius, pitch)
        np.rot90(hidden, quarter)[strip] = True
        turned = np.ascontiguousarray(np.rot90(turned))
    return hidden


def _find_strip(
    grey: Float32[np.ndarray, "h w"], radius: float, pitch: float
) -> Bool[np.ndarray, "h w"]:
    """Find the mirror along the upper side of a picture, whose edge may be oblique.

    Args:
        grey: as for `find_mirrors`.
        radius: as for `find_mirrors`.
        pitch: as for `find_mirrors`.
    """
    largest, step = 6.0, 0.5  # tilts of the edge that are tried [deg]
    height, width = grey.shape
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    hidden = np.zeros(grey.shape, dtype=bool)
    hidden[: _Side(grey, radius, pitch).find_width()[0]] = True
    best, highest = None, 0.0
    for tilt in np.arange(-largest, largest + 0.5 * step, step):
        turn = cv2.getRotationMatrix2D(middle, tilt, 1.0)
        upright = cv2.warpAffine(grey, turn, (width, height), borderMode=cv2.BORDER_REPLICATE)
        rows, alike = _Side(upright, radius, pitch).find_width(oblique=True)
        if alike > highest:
            best, highest = turn[1] - (0.0, 0.0, rows), alike
    if best is not None:
        y, x = np.indices(grey.shape)
        hidden[best[0] * x + best[1] * y + best[2] < 0.0] = True
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

    def find_width(self, oblique: bool = False) -> tuple[int, float]:
        """Rows of the mirror along the upper edge, and its correlation with what it reflects.

        Both are 0 if there is none.

        A lattice is symmetric about each of its rows and about the lines between them. Symmetry
        shows a mirror if it is absent one to two pitches further in, where a lattice would have it
        as well, or if the brightness has a step along the line.

        In some 600 frames of published clips and lifts, symmetry that is absent further in has a
        correlation of 0.94 at most. About lines with a step, straight or oblique, it is 0.62 at
        most.

        Args:
            oblique: whether only mirrors with a step count: about lines of other tilts, a lattice
                may be symmetric by chance.
        """
        # correlation of a strip with its reflection, with a step and without; the reflection in a
        # mirror that is not upright on the gel is skewed [-]
        least, least_alone = 0.8, 0.95
        most_beside = 0.5  # correlation of symmetry further in that is absent [-]
        grain = 0.5  # of a strip that shows dots, over that of the whole picture [-]
        widest = 0.3  # width of a mirror, over that of the picture [-]
        narrowest = 2 * round(2.0 * self.radius)
        lines = np.arange(narrowest, round(2.0 * widest * len(self.grey)), 2 if oblique else 1)
        steps = self._find_steps(lines)
        if oblique and not steps.any():
            return 0, 0.0
        grained = self.grey - cv2.blur(self.grey, (2 * round(4.0 * self.radius) + 1, 1))
        grained = cv2.GaussianBlur(grained, (0, 0), 1.0)
        rows = np.sqrt((grained * grained).mean(axis=1))
        best, highest = 0, least
        for line, step in zip(lines.tolist(), steps.tolist(), strict=True):
            if oblique and not step:
                continue
            alike = self._reflect(grained, line)
            if alike <= highest:
                continue
            if step or (
                alike > least_alone
                and rows[: line // 2].mean() > grain * rows.mean()
                and self._reflect_further(grained, line) < most_beside
            ):
                best, highest = line, alike
        blurred = round(self.radius)  # width of the line itself [px]
        return (best // 2 + 1 + blurred, highest) if best else (0, 0.0)

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

    def _find_steps(self, lines: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        """Whether the brightness changes along all of each line, from one side to the other."""
        # changes of the brightness, and the share of the columns that must show half of each; dots
        # may hide the line in some [-]
        faint, nearly_all, clear, most = 0.05, 0.9, 0.1, 0.6
        level = cv2.blur(self.grey, (1, 3))  # of three rows
        above, below = level[lines // 2 - 2], level[(lines + 1) // 2 + 1]
        step = (above - below) / np.maximum(below, 1.0)
        typical = np.median(step, axis=1)
        half = step * np.sign(typical)[:, None] > 0.5 * np.abs(typical)[:, None]
        needed = np.where(np.abs(typical) > clear, most, nearly_all)
        return (np.abs(typical) > faint) & (half.mean(axis=1) >= needed)
