"""What the pictures show beside the pad: a dark frame, and walls that reflect the dots."""

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
    """The part of the pictures that shows the pad, and a note on each surrounding left out.

    Args:
        image: a picture, cut to the part.
        style: of its dots.
        part: that the user has chosen.
    """
    notes = list[str]()
    dark = find_dark_frame(image, style.radius)
    if dark.any() and not dark.all():
        part = part.without(dark)
        notes.append(f"A dark frame is not read: {dark.mean():.1%} of the picture's area.")
    grey = to_grey(image, style.dark)
    dots = find_dots(grey, style).centre
    pitch = index_lattice(dots[part.shows(dots, style.radius)]).pitch
    grey = grey if style.dark else -grey
    mirrors = find_mirrors(grey, pitch, style.radius) if pitch > 0.0 else np.zeros_like(dark)
    if mirrors.any():
        part = part.without(mirrors)
        notes.append(
            "Strips along the sides that reflect the dots are not read: "
            f"{mirrors.mean():.1%} of the picture's area."
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
    grey: Float[np.ndarray, "h w"], pitch: float, radius: float
) -> Bool[np.ndarray, "h w"]:
    """Find strips along the picture's sides that reflect the dots beside them.

    Rows of dots look alike on both sides of a line through them or between them. A strip therefore
    counts as a reflection only if the light changes abruptly along its whole edge.

    Args:
        grey: a picture, in which dots are darker than the pad [grey levels of 255].
        pitch: distance between neighbouring dots [px].
        radius: typical radius of a dot [px].
    """
    rows = 240  # approximate rows of the picture that is searched
    part = max(round(min(grey.shape) / rows), 1)
    small = cv2.resize(
        grey.astype(np.float32), None, fx=1 / part, fy=1 / part, interpolation=cv2.INTER_AREA
    )
    hidden = np.zeros(grey.shape, dtype=bool)
    beside = round(2.0 * radius)  # reach of dots that touch their own reflection [px]
    for side in range(4):
        width = part * _find_width(np.ascontiguousarray(np.rot90(small, side)), pitch / part)
        if width:
            np.rot90(hidden, side)[: width + beside] = True
    return hidden


def _find_width(grey: Float32[np.ndarray, "h w"], pitch: float) -> int:
    """Width of the mirror at the top of a picture [px]; 0 if there is none."""
    reflects = 0.7  # least correlation of a mirror with the pad beside it [-]
    narrow, wide = 0.5, 0.3  # least and largest width [pitches, picture's height]
    dots = grey - cv2.blur(grey, (2 * round(pitch) + 1, 1))  # without changes across the side
    widths = np.arange(round(narrow * pitch), int(wide * len(grey)))
    widths = widths[_find_steps(grey)[widths]]
    alike = [_correlate(dots, int(width)) for width in widths]
    return int(widths[np.argmax(alike)]) if max(alike, default=0.0) > reflects else 0


def _correlate(dots: Float32[np.ndarray, "h w"], width: int) -> float:
    """Correlation of a strip at the top with the reflection of the one below; 0 without dots."""
    least = 0.25  # power in each strip, over that of the whole picture [-]
    strip, pad = dots[:width][::-1], dots[width : 2 * width]
    power = float((strip**2).mean()), float((pad**2).mean())
    if min(power) <= least * float((dots**2).mean()):
        return 0.0
    return float((strip * pad).mean() / np.sqrt(power[0] * power[1]))


def _find_steps(grey: Float32[np.ndarray, "h w"]) -> Bool[np.ndarray, " h"]:
    """Whether the light changes abruptly along the whole row, above each row of a picture."""
    # parts of a row that must all show the change; least change [grey levels of 255], and over
    # the typical one [-]
    parts, least, more = 6, 5.0, 4.0
    reach = 3  # distance over which a change counts as abrupt, and rows of each mean [px]
    beside_dots = 0.75  # of each row's pixels by their light [-]
    columns = np.array_split(grey, parts, axis=1)
    light = np.stack([np.quantile(part, beside_dots, axis=1) for part in columns], axis=1)
    mean = cv2.blur(light, (1, reach))
    change = np.zeros_like(mean)
    change[reach:-reach] = mean[2 * reach :] - mean[: -2 * reach]
    change = cv2.blur(change, (1, 2))  # of the rows on both sides
    typical = float(np.median(np.abs(change)))
    one_sign = np.abs(np.sign(change).sum(axis=1)) == parts
    return one_sign & (np.abs(change).min(axis=1) > max(least, more * typical))
