"""Whether the gel still holds the object, from the object's print in the gel's own coordinates.

Where the object sticks, its print moves with the dots around it. Where the object slips, its print
moves over the gel. Each picture is therefore warped back to the gel at rest (`Warp`) and correlated
with earlier pictures around every dot. The correlation is 1 where the print has stayed in place on
the gel, and near 0 where another part of the object has taken its place. The method assumes neither
a rigid object nor an axis of rotation.

A print that is uniform along the slip does not change. The gel is sheared the way that the object
would slip, so each dot counts by the structure of the print along the shear: of a smooth bar that
is drawn along itself, only the ends count.

The gel's own scratches move with the gel. Colours show a slope more clearly than them, and grey
pictures do not: a print whose texture hardly exceeds the gel's may have slipped while the picture
stays the same. There, only a print that has moved is evidence. In colours, the same holds while
such a print does not give the object's position.

Noise and compression may leave a faint print in a few places only, where worn dots decide that are
detected in some pictures and not in others. Such a print shows neither slip nor hold.

A video renews the errors of its coding in each picture that is coded by itself. A faint print then
seems to have changed all over, until the picture that it is compared with is as young. Partial slip
is what the print has lost in addition to this noise.
"""

from collections import deque
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32

from estimation.frames.stretches import Span
from estimation.pictures.imprint.painted import Painted
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.warp import Print, Warp, find_structure
from estimation.pictures.lattice import Reference


@dataclass(frozen=True)
class HoldSettings:
    """Settings for the comparison of prints.

    Attributes:
        window: side of the square that is compared around a dot [pitches].
        age: interval at which an earlier picture is stored. The picture compared with is between
            one and two intervals old [frames].
        lately: age of the recent picture that is also compared with, for partial slip [frames].
        shortly: age of a still more recent one, for the end of a slip [frames].
        alike: correlation with the former from which the latter is not needed [-].
        contrast: texture from which an object counts as printed, over the texture of the barest
            dots [-].
        bare: share of the dots that count as the barest [-].
        printed: share of the dots that is always compared: the dots with the most texture [-].
        clean: power over the noise's from which a print is compared: less may be noise alone [-].
        coded: power of the noise in a print, over that around the dots that change least:
            compression leaves more of it where there is texture. In the pictures coded by
            themselves of three published clips, of three objects, it was 2.3 to 3.5 [-].
        faint: texture up to which nothing is compared: compression leaves as much on a bare gel
            [grey levels of 255, over all colours].
        seen: share of a window that must be visible, without dots, in both pictures [-].
        spacing: distance between the points at which the displacement is interpolated [px of the
            scaled picture].
        sheared: mean displacement of the gel under the print from which the gel counts as sheared,
            in that direction [pitches].
        uniform: structure of the print along the shear, as a share of its structure along the
            direction with most, below which the print does not show a slip [-].
        several: number of dots with a print below which none counts more than the third: with few
            dots, the median would else be that of one or two. If noise alone leaves fewer, the
            print shows nothing.
        weak: share of the dots with the weakest correlation, whose best is `Hold.weakest` [-].
        distinct: texture of the dots with the most, over that of the barest, from which a print
            differs from scratches. It is 1.7 to 2.5 in published lifts turned grey, in which 5 of
            17 slips do not change the picture, and up to 4.7 in their green light alone. In colours
            it is 1.4 to 2.0 for an object whose slips do not change the correlation [-].
        sought: frames in a row without the object's position, from which a print in colours does
            not give it: a lost print has then been searched twice [frames].
    """

    window: float = 1.0
    age: int = 16
    lately: int = 6
    shortly: int = 4
    alike: float = 0.95
    contrast: float = 2.0
    bare: float = 0.15
    printed: float = 0.15
    clean: float = 10.0
    coded: float = 3.0
    faint: float = 2.0
    seen: float = 0.2
    spacing: int = 8
    sheared: float = 0.02
    uniform: float = ImprintSettings.alike
    several: int = 6
    weak: float = 0.1
    distinct: float = 2.6
    sought: int = ImprintSettings.searched_every


class Hold(NamedTuple):
    """Correlation of the print on the gel with earlier prints.

    Attributes:
        since: median correlation with the print half a second to a second before, or some frames
            before if it is younger [-]; NaN where unknown. It alone is NaN if the print is uniform
            along the gel's shear, or hidden by noise.
        lately: median correlation with the print some frames before [-].
        weakest: tenth percentile of the correlation with the print slightly earlier, without the
            noise [-]. It alone is NaN if the print may be scratches of the gel.
    """

    since: float
    lately: float
    weakest: float


NO_HOLD = Hold(np.nan, np.nan, np.nan)


class Comparison(NamedTuple):
    """Two prints around dots.

    Attributes:
        cross: mean product of both [squared grey levels, over all colours].
        first: power of the earlier one [squared grey levels, over all colours].
        second: power of the later one.
        weight: of each dot, by the texture of the print.
    """

    cross: Float[np.ndarray, " m"]
    first: Float[np.ndarray, " m"]
    second: Float[np.ndarray, " m"]
    weight: Float[np.ndarray, " m"]

    def correlate(self, noise: float = 0.0, most: float = 1.0) -> Float[np.ndarray, " m"]:
        """Correlation of the prints around each dot, without the noise of either [-].

        Args:
            noise: power of the noise in each print that the other has not.
            most: largest share of the noise in a print [-].
        """
        left_out = np.minimum(noise, np.minimum(self.first, self.second) * most)
        own = np.sqrt((self.first - left_out) * (self.second - left_out) + 1e-6)
        return np.minimum(self.cross / own, 1.0)


class HoldFollower:
    """Compares the print on the gel with the prints of earlier frames."""

    def __init__(self, reference: Reference) -> None:
        """Start at the next frame, with the dots at rest."""
        self._reference, self._settings = reference, HoldSettings()
        self._warp: Warp | None = None
        self.restart()

    def __getstate__(self) -> dict[str, Any]:
        """The attributes without the warp, which is made again."""
        return vars(self) | {"_warp": None}

    def restart(self) -> None:
        """Forget earlier frames: the comparison starts at the next one."""
        self._earlier: list[tuple[Print, Float[np.ndarray, "m 2 2"]]] = []
        self._recent: deque[Print] = deque(maxlen=self._settings.lately + 1)
        self._noise: deque[float] = deque(maxlen=self._settings.age)
        self._span = Span()
        self._stored = self._unlocated = 0
        self._printed = False  # whether a print has exceeded the noise

    def update(
        self,
        painted: Painted,
        position: Float[np.ndarray, "m 2"],
        displacement: Float[np.ndarray, "m 2"],
        located: bool = True,
        time: float = np.nan,
    ) -> Hold:
        """Compare the print of the next frame with earlier prints.

        Args:
            painted: the picture without its dots.
            position: dots in the picture [px]; NaN where not visible.
            displacement: of the dots from rest, without the lens's distortion [px].
            located: whether the print gives the object's position.
            time: time stamp [s]; NaN if unknown.
        """
        settings, frames = self._settings, self._span.update(time)
        self._unlocated = 0 if located else self._unlocated + 1
        seen = np.isfinite(position[:, 0])
        if seen.sum() < 3:
            return NO_HOLD
        if self._warp is None:
            self._warp = Warp(self._reference, painted, settings.window, settings.spacing)
        now = self._warp.take_back(painted, position)
        self._stored += 1
        if not self._earlier or self._stored >= frames(settings.age):
            self._earlier = [*self._earlier[-1:], (now, find_structure(now))]
            self._stored = 0
        self._recent.append(now)
        before, structure = self._earlier[0]
        self._noise.append(self._find_noise(seen))
        noise = max(self._noise)  # compressed video shows the noise in some frames only
        compared = self.compare(before, now, seen, noise)
        lately_shown = self._find_recent(frames(settings.lately))
        recent = self.compare(lately_shown, now, seen, noise)
        if recent.weight.any() and not compared.weight.any():  # the print is younger than that
            compared, structure = recent, find_structure(lately_shown)
        agreement, weight = compared.correlate(), compared.weight
        self._printed |= bool(noise > 0.0 and weight.any())
        if self._is_few(weight) and self._printed:
            shown = self.compare(before, now, seen, 0.0)
            if not self._is_few(shown.weight):  # by noise
                shares = (0.5, settings.weak)
                return Hold(np.nan, *_take_quantiles(shown.correlate(), shown.weight, *shares))
        weight = weight * self._share_along(structure, displacement, weight)
        (since,) = _take_quantiles(agreement, weight, 0.5)
        (lately,) = _take_quantiles(recent.correlate(), recent.weight, 0.5)
        between = settings.coded * max(list(self._noise)[-frames(settings.lately) :])
        noiseless = recent.correlate(between, 1.0 / settings.clean)
        (weakest,) = _take_quantiles(noiseless, recent.weight, settings.weak)
        if not self._is_distinct(now, seen):
            weakest = np.nan
        if lately < self._settings.alike:
            shortly = self._find_recent(frames(settings.shortly))
            shown = self.compare(shortly, now, seen, noise)
            (lately,) = _take_quantiles(shown.correlate(), shown.weight, 0.5)
        return Hold(since, lately, weakest)

    def _find_recent(self, age: int) -> Print:
        """The print of some frames ago, or the oldest one."""
        return self._recent[-1 - min(age, len(self._recent) - 1)]

    def _is_few(self, weight: Float[np.ndarray, " m"]) -> bool:
        """Whether only few dots have a print."""
        return bool(np.count_nonzero(weight) < self._settings.several)

    def _is_distinct(self, shown: Print, seen: Bool[np.ndarray, " m"]) -> bool:
        """Whether the texture around some dots is stronger than scratches of the gel may be.

        In colours, a print that gives the object's position is distinct in any case.
        """
        settings = self._settings
        if len(shown.planes) > 1 and self._unlocated < settings.sought:
            return True
        power = shown.power.sum(axis=1) / np.maximum(shown.clear.sum(axis=1), 1.0)
        bare, printed = _rank(power[seen], settings.bare, 1.0 - settings.printed)
        return bool(printed > settings.distinct**2 * bare)

    def _find_noise(self, seen: Bool[np.ndarray, " m"]) -> float:
        """Power of the noise, from the change since the last picture where that changes least.

        It is 0 in the first picture [squared grey levels, over all colours].
        """
        if len(self._recent) < 2:
            return 0.0
        cross, first, second, shown = _multiply(self._recent[-2], self._recent[-1])
        known = seen & (shown > self._settings.seen * self._recent[-1].clear.shape[1])
        if not known.any():
            return 0.0
        change = np.maximum(first + second - 2.0 * cross, 0.0)
        (noise,) = _rank(change[known] / shown[known], self._settings.bare)
        return 0.5 * float(noise)

    def compare(
        self, before: Print, now: Print, seen: Bool[np.ndarray, " m"], noise: float
    ) -> Comparison:
        """Compare two prints around dots, of which each has a weight by the texture there.

        Where the object slips, as much of the print is lost as is new. New print in excess of that
        has no weight: the contact has grown as the object was pressed on. A bare gel has no print
        to lose.

        Args:
            before: the earlier print.
            now: the later one.
            seen: dots that are visible.
            noise: power of the noise that a print must exceed [squared grey levels, all colours].
        """
        settings = self._settings
        pixels = np.float32(before.clear.shape[1])
        *products, shown = _multiply(before, now)
        cross, first, second = np.stack(products) / (shown + 1e-3 * pixels)
        seen = seen & (shown > settings.seen * pixels)
        if not seen.any():
            return Comparison(cross, first, second, np.zeros_like(cross))
        new, lost = np.maximum(second - first, 0.0), np.maximum(first - second, 0.0)
        lost[first < settings.faint**2] = 0.0
        power = first + min(lost[seen].sum() / max(new[seen].sum(), 1e-6), 1.0) * new
        bare, printed = _rank(power[seen], settings.bare, 1.0 - settings.printed)
        least = max(settings.clean * noise, settings.faint**2)
        least = max(min(settings.contrast**2 * bare + 1.0, printed), least)
        weight = np.sqrt(np.maximum(power - least, 0.0)) * seen
        third = np.sort(weight)[-3:][0]
        if third > 0.0 and self._is_few(weight):  # no single dot decides
            weight = np.minimum(weight, third)
        return Comparison(cross, first, second, weight)

    def _share_along(
        self,
        structure: Float32[np.ndarray, "m 2 2"],
        displacement: Float[np.ndarray, "m 2"],
        weight: Float[np.ndarray, " m"],
    ) -> Float[np.ndarray, " m"]:
        """Share of the print's structure along the gel's shear, around each dot [-].

        It is 1 everywhere if the gel is not sheared or the structure is unknown, and 0 if the print
        is uniform along the shear. Around a dot without a structure it is that of the whole print.

        Args:
            structure: as from `find_structure`.
            displacement: of the dots from rest [px].
            weight: of each dot.
        """
        settings, ones = self._settings, np.ones(len(weight))
        known = (weight > 0.0) & np.isfinite(structure[:, 0, 0])
        shear = weight @ np.nan_to_num(displacement) / max(float(weight.sum()), 1e-9)
        far = float(np.linalg.norm(shear))
        if far < settings.sheared * self._reference.pitch or not known.any():
            return ones
        way, total = shear / far, structure[known].sum(axis=0)
        if way @ total @ way <= settings.uniform * np.linalg.eigvalsh(total)[-1]:
            return 0.0 * ones
        structure = np.where(known[:, None, None], structure, total)
        return way @ structure @ way / np.maximum(np.trace(structure, axis1=1, axis2=2), 1e-9)


def _rank(values: Float[np.ndarray, " n"], *shares: float) -> Float[np.ndarray, " k"]:
    """Quantiles; `np.quantile` of so few values takes as long as a comparison of prints."""
    places = np.multiply(shares, len(values) - 1)
    return np.interp(places, np.arange(len(values)), np.sort(values))


def _take_quantiles(
    agreement: Float[np.ndarray, " m"], weight: Float[np.ndarray, " m"], *shares: float
) -> list[float]:
    """Weighted quantiles of the correlation around dots [-]; NaN without weight."""
    if not weight.any():
        return [np.nan] * len(shares)
    order = np.argsort(agreement)
    sums = np.cumsum(weight[order])
    places = np.searchsorted(sums, np.multiply(shares, sums[-1]))
    return agreement[order[places]].tolist()


def _multiply(before: Print, now: Print) -> tuple[Float32[np.ndarray, " m"], ...]:
    """Sums over the pixels of each window that both prints show.

    Returns:
        The product of the two prints over all colours, the power of each, and the number of pixels.
    """
    pairs = zip(before.planes, now.planes, strict=True)  # 0 where hidden
    return (
        reduce(np.add, (np.vecdot(*pair) for pair in pairs)),
        np.vecdot(before.power, now.clear),
        np.vecdot(before.clear, now.power),
        np.vecdot(before.clear, now.clear),
    )
