"""Pictures without their dots and without slow changes of light.

The lamps do not turn with the object, so a slope of the object changes its colour as it turns. The
registered texture is therefore the deviation of all colours together from their surroundings, which
measures the steepness of the print.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from estimation.pictures.imprint.around import Level, mean_around, slope_around


@dataclass(frozen=True, eq=False)
class Painted:
    """A picture without its dots and slow changes of light, scaled down.

    Derived pictures are computed on first use, because many frames show no contact.

    Attributes:
        colours: its colours, grey levels of 255; one colour, √3 times as strong, if it is grey.
        shown: 1 where there is no dot, detected or not, else 0.
        clear: 1 where there is no detected dot, and 0 along the picture's edge, which may cut dots.
        dots: all dots in the scaled picture [px].
        part: factor by which the picture was scaled down [-].
        radius: typical radius of a dot in the scaled picture [px].
        inner: `clear`, and 0 along the part of the picture that is read, whose edge cuts dots.
        framed: whether a part of the picture is not read.
    """

    colours: list[Float32[np.ndarray, "h w"]]
    shown: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]
    dots: Float[np.ndarray, "n 2"]
    part: int
    radius: float
    inner: Float32[np.ndarray, "h w"]
    framed: bool = False

    @cached_property
    def planes(self) -> list[Float32[np.ndarray, "h w"]]:
        """Smoothed deviation of each colour from its surroundings."""
        level = self._level_around(self.inner)
        return _smooth([colour - level(colour) for colour in self.colours], self.inner)

    @cached_property
    def texture(self) -> Float32[np.ndarray, "h w"]:
        """Deviation of all colours together, without worn dots; of grey levels if there is one.

        A mean over the pixels between the dots alone would depend on the places of the dots, and
        the gel would drag broad shading along. The dots are therefore filled in first.
        """
        filled = _fill_in(self.colours, self.bare, self.radius)
        departing = [self._remove_mean(colour) for colour in filled]
        smooth = [cv2.GaussianBlur(plane, (0, 0), 1.0) for plane in departing]
        if len(smooth) == 1:
            return smooth[0] * self.bare
        return self._remove_mean(np.sqrt(add_squares(smooth))) * self.bare

    @cached_property
    def bare(self) -> Float32[np.ndarray, "h w"]:
        """1 where `clear` without worn dots and dirt, else 0; only colours show these."""
        return self.clear * ~self._dirt

    def level(self, points: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, " n"]:
        """Root mean square of the texture around points, over all colours [grey levels].

        A hair on the gel, and other dirt that looks like dots, does not count.

        Args:
            points: in the original picture [px]; NaN where missing.
            reach: half the side of the square around each point [px].
        """
        clean = self.without(self._dirt) if self._dirt.any() else self
        width = (2 * int(reach / self.part) + 1,) * 2
        power = clean.shown * add_squares(_smooth(clean.departing, clean.shown))
        column, row = self._nearest(np.where(np.isnan(points), 0.0, points) / self.part)
        power, shown = (cv2.blur(plane, width)[row, column] for plane in (power, clean.shown))
        power = np.maximum(power, 0.0)  # a blur's running sum may end just below
        return np.where(np.isfinite(points[:, 0]), np.sqrt(power / (shown + 1e-3)), np.nan)

    def light(self, points: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, "n k"]:
        """Mean of each colour around points, beside the dots [grey levels]; as `level`."""
        width = (2 * int(reach / self.part) + 1,) * 2
        column, row = self._nearest(np.where(np.isnan(points), 0.0, points) / self.part)
        share = cv2.blur(self.shown, width)[row, column] + 1e-3
        means = [cv2.blur(self.shown * plane, width)[row, column] for plane in self.colours]
        return np.where(
            np.isfinite(points[:, :1]), np.stack(means, axis=1) / share[:, None], np.nan
        )

    def without(self, hidden: Bool[np.ndarray, "h w"]) -> "Painted":
        """The picture without some pixels of the scaled picture."""
        left = (~hidden).astype(np.float32)
        clear, inner = self.clear * left, self.inner * left
        return replace(self, shown=self.shown * left, clear=clear, inner=inner)

    def without_overlays(self, strokes: Bool[np.ndarray, "h w"] | None = None) -> "Painted":
        """The picture without text and other spots that stand out as no print does.

        They deviate in every colour, unlike dots, or further than dots. Dots that they hide in
        part, and that are therefore not detected, are left out with them.

        Args:
            strokes: text that the original picture shows; None if there is none.
        """
        spots = self._find_spots(-1.0, self.clear) | self._find_strong()
        if strokes is not None:
            light, size = strokes.astype(np.float32), spots.shape[::-1]
            spots |= cv2.resize(light, size, interpolation=cv2.INTER_AREA) > 0.0
        if not spots.any():
            return self
        count, discs = cv2.connectedComponents((self.clear > self.shown).astype(np.uint8))
        missed = discs.astype(np.intp)
        covered = np.zeros(count, dtype=bool)
        covered[missed[spots]] = True
        covered[0] = False  # pixels beside all missed dots
        return self.without(spots | covered[missed])

    @cached_property
    def departing(self) -> list[Float32[np.ndarray, "h w"]]:
        """Deviation of each colour from its surroundings, up to the picture's edges."""
        level = self._level_around(self.shown)
        return [colour - level(colour) for colour in self.colours]

    def _level_around(self, clear: Float32[np.ndarray, "h w"]) -> Level:
        """A function that gives the slow light around each pixel, from clear pixels only."""
        around = slope_around if self.framed else mean_around
        return around(clear, int(4.0 * self.radius))

    def _remove_mean(self, plane: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Deviation of a plane without gaps from its surroundings."""
        return plane - cv2.blur(plane, (2 * int(4.0 * self.radius) + 1,) * 2)

    def _nearest(self, points: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "2 n"]:
        """Column and row of the pixels nearest to points."""
        limit = np.array(self.shown.shape[::-1]) - 1
        return np.clip(np.rint(points).astype(int), 0, limit).T

    def _find_strong(self) -> Bool[np.ndarray, "h w"]:
        """Find spots that deviate from their surroundings further than dots do, in any colour.

        A print deviates less, unless the dots are faint, so the light's level counts as well.
        Spots that together are smaller than a dot are no text.
        """
        # least deviation of a spot, over that of dots that are not worn and over the mean light [-]
        beyond, share = 1.1, 0.5
        if not len(self.dots):
            return np.zeros(self.shown.shape, dtype=bool)
        squared, smallest = add_squares(self.departing), np.pi * self.radius**2
        of_dots = np.sort(squared[self._at_dots])[9 * len(self.dots) // 10]
        spots = (squared > beyond**2 * of_dots) & (self.clear > 0.0)
        if np.count_nonzero(spots) >= smallest:
            light = sum(cv2.mean(colour)[0] ** 2 for colour in self.colours)
            spots &= squared > share**2 * light
        if np.count_nonzero(spots) < smallest:
            return np.zeros_like(spots)
        return self._widen(spots, 1)

    def _widen(self, spots: Bool[np.ndarray, "h w"], blurred: int = 0) -> Bool[np.ndarray, "h w"]:
        """The spots and their surroundings; `blurred` is the width of their edges [px]."""
        if not spots.any():
            return spots
        reach = np.ones((2 * (round(0.5 * self.radius) + blurred) + 1,) * 2, np.uint8)
        return cv2.dilate(spots.astype(np.uint8), reach) > 0

    @cached_property
    def worn(self) -> Bool[np.ndarray, "h w"]:
        """Worn dots where dots were expected but not detected, with their blurred edges."""
        return self._find_spots(1.0, self.clear - self.shown, 2)

    @cached_property
    def _dirt(self) -> Bool[np.ndarray, "h w"]:
        """Dirt that looks like dots, and worn dots elsewhere."""
        return self._find_spots(1.0, self.shown)

    def _find_spots(
        self, like: float, among: Float32[np.ndarray, "h w"], blurred: int = 0
    ) -> Bool[np.ndarray, "h w"]:
        """Find spots that deviate from their surroundings in every colour; only colours show them.

        A slope does not deviate so, since it faces only one of the coloured lamps.

        Args:
            like: 1.0 for spots like dots that are not detected, as worn dots and dirt, which move
                with the gel; -1.0 for the opposite, as bright text among dark dots.
            among: above 0 at the pixels that are searched.
            blurred: as for `_widen`.
        """
        share = 0.25  # least deviation of a spot, as a share of a dot's [-]
        if not len(self.dots) or len(self.colours) == 1:
            return np.zeros(self.shown.shape, dtype=bool)
        least, typical = self._least
        if like < 0.0:
            least = -reduce(np.maximum, self._like_dots)
        return self._widen((least > share * typical) & (among > 0.0), blurred)

    @cached_property
    def _least(self) -> tuple[Float32[np.ndarray, "h w"], float]:
        """Least deviation of the colours from their surroundings, as dots do; a dot's median."""
        least = reduce(np.minimum, self._like_dots)
        middle = len(self.dots) // 2  # `np.median` of so few takes as long as a blur
        return least, float(np.sort(least[self._at_dots])[middle])

    @cached_property
    def _like_dots(self) -> list[Float32[np.ndarray, "h w"]]:
        """Deviation of each colour from its surroundings, positive where dots deviate so."""
        at_dots = np.sort([plane[self._at_dots] for plane in self.departing])
        signs = np.sign(at_dots[:, len(self.dots) // 2])
        return [sign * plane for sign, plane in zip(signs, self.departing, strict=True)]

    @cached_property
    def _at_dots(self) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Row and column of the pixels nearest to the dots."""
        column, row = self._nearest(self.dots)
        return row, column


def paint_out(
    picture: Shaped[np.ndarray, "h w *colour"],
    dots: Float[np.ndarray, "n 2"],
    radius: float,
    seen: Bool[np.ndarray, "h w"] | None = None,
    missed: Float[np.ndarray, "m 2"] | None = None,
    gain: float = 1.0,
) -> Painted:
    """Remove dots and slow changes of light from a picture, and scale it down.

    Args:
        picture: of the frame.
        dots: all dots in the picture [px].
        radius: typical radius of a dot [px].
        seen: pixels that are read; all by default.
        missed: places where a dot may be that was not detected, because the picture's edge cuts
            it, or by noise [px].
        gain: factor by which the picture is brightened [-].
    """
    # approximate rows of the scaled picture, and least radius of a dot in it: smaller dots cannot
    # be painted out [px]
    rows, smallest_dot = 120, 2.0
    part = max(min(round(picture.shape[0] / rows), int(radius / smallest_dot)), 1)
    size = (picture.shape[1] // part, picture.shape[0] // part)
    whole = picture[: part * size[1], : part * size[0]]  # other factors would shift its far side
    if part % 2:  # the same averages as `INTER_AREA`, in half the time
        around = cv2.blur(whole, (part, part), anchor=(0, 0))
        small = cv2.resize(around, size, interpolation=cv2.INTER_NEAREST)
    else:
        small = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    planes = cv2.split(small)[:3]
    unit = gain / 257.0 if small.dtype == np.uint16 else gain
    unit *= math.sqrt(3.0 / len(planes))  # grey counts as three equal colours
    colours = [plane * np.float32(unit) for plane in planes]
    dots, radius = dots / part, radius / part
    shown = np.ones(small.shape[:2], np.float32)
    _hide(shown, dots, radius)
    reach = 1.6  # of a dot and its surroundings [radii]
    rim = round(reach * radius)  # width of the edge, where dots may be cut and so not detected
    inner = None
    if seen is not None:
        read = seen[: part * size[1] : part, : part * size[0] : part]
        shown[~read] = 0.0
        # dots that this edge cuts are left out, with their middle up to a radius inside it
        wide = np.ones((2 * round((1.0 + reach) * radius) + 1,) * 2, np.uint8)
        inner = cv2.erode(read.astype(np.float32), wide)
    clear = np.zeros_like(shown)
    clear[rim:-rim, rim:-rim] = shown[rim:-rim, rim:-rim]
    inner = clear if inner is None else clear * inner
    if missed is not None:
        _hide(shown, missed / part, radius)
    return Painted(colours, shown, clear, dots, part, radius, inner, framed=seen is not None)


def _hide(shown: Float32[np.ndarray, "h w"], dots: Float[np.ndarray, "n 2"], radius: float) -> None:
    """Mark dots and their surroundings as hidden, in a scaled picture."""
    for x, y in np.rint(dots * 16).astype(int).tolist():
        cv2.circle(shown, (x, y), int(16 * 1.6 * radius), 0.0, -1, shift=4)


def _smooth(
    departing: list[Float32[np.ndarray, "h w"]], clear: Float32[np.ndarray, "h w"]
) -> list[Float32[np.ndarray, "h w"]]:
    """Deviations at clear pixels, without their finest grain."""
    return [cv2.GaussianBlur(plane * clear, (0, 0), 1.0) for plane in departing]


def _fill_in(
    colours: list[Float32[np.ndarray, "h w"]], clear: Float32[np.ndarray, "h w"], radius: float
) -> list[Float32[np.ndarray, "h w"]]:
    """Colours with values at the pixels that are not clear, from the clear ones around them.

    A mean over pixels on one side of a gap misses the slope of the light. The mean deviation from a
    first, coarse level therefore gives a second level, and that one the values.
    """
    least = np.float32(1e-3)  # share of clear pixels below which the coarser level counts [-]
    near, far = ((2 * int(reach * radius) + 1,) * 2 for reach in (1.6, 4.0))
    gap = (1.0 - clear) / (cv2.blur(clear, near) + least)
    share = cv2.blur(clear, far) + least

    def fill(colour: np.ndarray, level: np.ndarray) -> Float32[np.ndarray, "h w"]:
        departing = (colour - level) * clear
        return level + departing + gap * cv2.blur(departing, near)

    coarse = [fill(colour, cv2.blur(colour * clear, far) / share) for colour in colours]
    return [
        fill(colour, cv2.blur(level, near)) for colour, level in zip(colours, coarse, strict=True)
    ]


def add_squares(planes: list[Float32[np.ndarray, "h w"]]) -> Float32[np.ndarray, "h w"]:
    """Sum of squares over all colours."""
    return reduce(np.add, (plane * plane for plane in planes))
