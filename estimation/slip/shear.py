"""Detection of slip along the gel, from the gel's shear and the object's print on it.

There are four signs of slip. While the object holds, the gel's shear follows the load. Once all of
the contact slips, the shear falls if friction falls with the slip, and stays constant otherwise.
The print then moves over the gel (`estimation.pictures.hold`), unless the object is uniform along
its path. And where the print is followed, it moves beyond all of the gel under it
(`estimation.slip.slide`), at once or slowly. Each sign is sufficient and none is certain: the
probability of slip is that of at least one sign being right.

Falling shear may also mean that the load is removed, or that the object is moved back. This is
assumed if the print has stayed on the gel. Without a print to compare, there is no verdict. A print
that is uniform along the gel's shear does not show a slip, and a print that is uniform around an
axis does not show a turn. The light of a smooth object stays with the lamps as it turns, so its
print is compared in vain: where the gel has mostly turned, only a print that gives the object's
position counts. The print may also be scratches of the gel, which stay on it. Without another sign
of slip, held and slipped are else equally likely.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import expit

from estimation.estimators.result import State
from estimation.fields.plane import fit_motion
from estimation.fields.stencils import marker_pitch
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import MarkerLayout
from estimation.slip.slide import Slide
from estimation.slip.slow import SlowSlip, SlowSlipWatch


@dataclass(frozen=True)
class ShearSettings:
    """How a slip in shear is recognised.

    The values of `fallen` and `kept` come from an early fit to 36 labelled lifts of four objects
    ([Li2018] R. Li, R. Dong, E. Adelson, "Slip detection with combined tactile and visual
    information", ICRA 2018); `python -m papers run slip_lifts` repeats the fits without each object
    in turn.

    Attributes:
        markers: number of markers, those that moved furthest, whose motion gives the shear [-].
        memory: frames for which a peak of the shear is remembered [frames].
        least: smallest shear against which a fall is measured [pitches].
        fallen: lost share of the shear's peak at which slip has even odds [-].
        fallen_spread: change of that share that multiplies the odds by e [-].
        kept: correlation with the earlier print at which slip has even odds [-].
        kept_spread: change of that correlation that multiplies the odds by e [-].
        slid: slip over the half-width of its 95 % interval at which slip has even odds [-].
        slid_spread: change of that ratio that multiplies the odds by e [-].
        turned: the gel's turn over its shift, from which a fall of the shear is no slip, because a
            turn back lowers it as well [-].
        stayed: that ratio below which a fall of the shear is no slip, if the print shows slips in
            all directions: the object has moved back [-].
        unloaded: correlation above which a fall counts as a removed load, and later falls are
            measured from it [-].
        resting: correlation with the print some frames earlier, above which the object does not
            slide [-].
        sticking: smallest correlation over the parts of the print without noise, above which all of
            the contact sticks [-]. Noise, of usually 2 % of the power of a published clip's print,
            leaves 0.9 of it.
        sought: frames without the object's position, from which the print does not show a turn.
    """

    markers: int = 10
    memory: int = 32
    least: float = 0.02
    fallen: float = 0.2
    fallen_spread: float = 0.04
    kept: float = 0.55
    kept_spread: float = 0.06
    slid: float = 1.25
    slid_spread: float = 0.08
    turned: float = 2.0
    stayed: float = 0.5
    unloaded: float = 0.96
    resting: float = 0.95
    sticking: float = 0.92
    sought: int = 8


class Shear(NamedTuple):
    """Shear of the gel under the object, and whether the object has slipped over the gel.

    Lengths are in px for pictures without a scale.

    Attributes:
        shear: how far the gel under the object has moved since touch [mm].
        fallen: share of its peak by which the shear has fallen since [-].
        print_correlation: correlation of the object's print on the gel with an earlier one [-]; NaN
            if unknown.
        slid: sliding distance within the memory over the half-width of its 95 % interval [-]; NaN
            if unknown.
        slip_probability: probability that all of the contact has slipped lately [-]; NaN without
            contact or without a print.
        slides: whether the print shows that the object slides.
        holds: whether the print shows that the object has not slid lately.
        sticks: whether the print shows that all of the contact sticks.
        strays: whether the object slips over a quarter of the markers or more.
        rests: whether the print has stayed in place on the gel over the last frames.
        slip: how far the object has slid over the gel [mm]; NaN if unknown.
        slip_error: half-width of the 95 % interval of that distance [mm].
        slip_since: time stamp of the frame from which that distance counts [s].

    Examples:
        >>> from estimation import Noise, Settings, Shear, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers()
        >>> shear: Shear = last.shear
        >>> print(f"{shear.shear:.2f} mm, slip probability {shear.slip_probability}")  # no print
        0.08 mm, slip probability nan
    """

    shear: float = float("nan")
    fallen: float = float("nan")
    print_correlation: float = float("nan")
    slid: float = float("nan")
    slip_probability: float = float("nan")
    slides: bool = False
    holds: bool = False
    sticks: bool = False
    strays: bool = False
    rests: bool = False
    slip: float = float("nan")
    slip_error: float = float("nan")
    slip_since: float = float("nan")

    @property
    def hidden(self) -> bool:
        """Whether the object may slide unseen: its print does not show it; the odds are even."""
        known = isfinite(self.print_correlation) and self.slip_probability != 0.5
        return isfinite(self.slip_probability) and not known

    @property
    def state(self) -> State:
        """State of the contact by the object's print alone."""
        if self.slides:
            return State.MACRO_SLIP
        if self.sticks:
            return State.STICK
        return State.INCIPIENT if np.isfinite(self.slip_probability) else State.UNKNOWN


class ShearPath(NamedTuple):
    """Shear of a recording; fields as in `Shear`, over frames."""

    shear: Float[np.ndarray, " frames"]
    print_correlation: Float[np.ndarray, " frames"]
    slip_probability: Float[np.ndarray, " frames"]
    slip: Float[np.ndarray, " frames"]
    slip_error: Float[np.ndarray, " frames"]
    slip_since: Float[np.ndarray, " frames"]

    @classmethod
    def of(cls, *shears: Shear) -> "ShearPath":
        """Gather the shears of frames."""
        return cls(*(np.array([getattr(shear, name) for shear in shears]) for name in cls._fields))

    def take(self, rows: slice) -> "ShearPath":
        """The path for a slice of the frames."""
        return ShearPath(*(values[rows] for values in self))


class ShearWatch:
    """Follows the gel's shear from frame to frame."""

    def __init__(self, layout: MarkerLayout) -> None:
        """Begin without contact."""
        self._settings = ShearSettings()
        self._least = float(np.fmax(self._settings.least * marker_pitch(layout), 1e-12))
        self._restart()

    def _restart(self) -> None:
        settings = self._settings
        self._start: Float[np.ndarray, "n 2"] | None = None
        self._moved: deque[np.ndarray] = deque(maxlen=settings.memory)
        self._shears: deque[tuple[float, float, float]] = deque(maxlen=settings.memory)
        self._raw: deque[tuple[float, float, float, float]] = deque(maxlen=3)
        self._located: deque[bool] = deque(maxlen=settings.memory)
        self._lately: deque[float] = deque(maxlen=2)
        self._beyond: deque[float] = deque(maxlen=settings.memory)
        self._determined = True  # whether the print showed slip in all directions when last located
        self._slow = SlowSlipWatch()
        self.strayed: Bool[np.ndarray, " n"] | None = None
        """Markers over which the object slips in the last frame; None if it slips nowhere."""

    def update(
        self,
        positions: Float[np.ndarray, "n d"],
        contact: Bool[np.ndarray, " n"],
        hold: tuple[float, float, float],
        slide: Slide | None,
    ) -> Shear:
        """The shear after the next frame.

        Args:
            positions: positions of the markers [mm]; NaN for markers that are not visible.
            contact: markers of the contact region.
            hold: correlations of the print with earlier ones [-]; NaN if unknown.
            slide: slip of the object over the gel; None if it was not measured.
        """
        self.strayed = None
        points = positions[:, :2]
        if not contact.any():
            self._restart()
            self._start = points.copy()
            return Shear()
        if not np.isfinite(points).any():
            return Shear()
        if self._start is None:
            self._start = points.copy()
        unseen = np.isnan(self._start[:, 0])
        self._start[unseen] = points[unseen]
        since, lately, weakest = hold
        self._raw.append((*self._measure(points, contact), since))
        # a single frame may be wrong: the median of three
        shear, shifted, turned, since = (_middle(values) for values in zip(*self._raw, strict=True))
        self._shears.append((shear, shifted, turned))
        self._lately.append(lately)
        # in two frames, since a single one may be wrong; NaN stays NaN
        if len(self._lately) == 2 and all(value < self._settings.kept for value in self._lately):
            since = min(since, *self._lately)
        if slide is not None:
            self._located.append(isfinite(slide.beyond))
        slide = slide or Slide()
        if isfinite(slide.beyond):
            determined = isfinite(slide.slip)
            if determined and not self._determined:
                self._beyond.clear()  # an old slip becomes known, no new one
            self._determined = determined
            self._beyond.append(slide.beyond)
        slid = slide.beyond - min(self._beyond, default=0.0)
        slips = {name: getattr(slide, name) for name in ("slip", "slip_error", "slip_since")}
        stayed = slide.recent is not None and slid < self._settings.stayed
        judged = self._judge((since, slid), lately, weakest, stayed)._replace(**slips)
        if turned > max(shifted, self._least) and self._is_lost:
            judged = _hide(judged)
        slow = self._slow.update(slide)
        if slow is not None:
            self.strayed = slow.strayed
            judged = _add_slow_slip(judged, slow)
        if isfinite(judged.slip_probability) and isfinite(lately) and not isfinite(weakest):
            judged = judged._replace(slip_probability=max(0.5, judged.slip_probability))
        return judged

    @property
    def _is_lost(self) -> bool:
        """Whether the print has not given the object's position in two frames in a row.

        In a single frame a change of light may look like a print.
        """
        located = list(self._located)
        known = any(before and now for before, now in pairwise(located))
        return len(located) >= self._settings.sought and not known

    def _measure(
        self, points: Float[np.ndarray, "n 2"], contact: Bool[np.ndarray, " n"]
    ) -> tuple[float, float, float]:
        """Displacements of the gel under the object [mm].

        Returns:
            The displacement of the markers that moved furthest, their median within memory. The
            motion of the contact's middle with them, which differs if they turn about it. And the
            root mean square motion of the contact about its middle by that turn.
        """
        assert self._start is not None
        moved = points - self._start
        self._moved.append(np.nan_to_num(np.linalg.norm(moved, axis=1)))
        furthest = np.max(self._moved, axis=0)
        furthest[np.isnan(moved[:, 0])] = -1.0
        top = np.argsort(-furthest)[: self._settings.markers]
        top = top[np.isfinite(moved[top, 0])]
        if not len(top):
            return np.nan, np.nan, np.nan
        shear = float(np.linalg.norm(np.median(moved[top], axis=0)))
        before, now = (positions @ np.array([1.0, 1.0j]) for positions in (self._start, points))
        under = before[contact & np.isfinite(self._start[:, 0])]
        if len(top) < MIN_STICK_MARKERS or not len(under):
            return shear, shear, 0.0
        motion = fit_motion(before[top], now[top])
        middle = complex(under.mean())
        shifted = abs(motion.image + motion.turn * (middle - motion.origin) - middle)
        return shear, shifted, abs(motion.angle) * float(np.std(under))

    def _judge(
        self, signs: tuple[float, float], recent: float, weakest: float, stayed: bool
    ) -> Shear:
        settings, (since, slid) = self._settings, signs
        peaks, (shear, shifted, _) = np.fmax.reduce(self._shears), self._shears[-1]
        # both must fall: markers that turn can lower theirs without moving back
        fallen = float(min(peaks[:2] - (shear, shifted)) / max(peaks[0], self._least))
        # a turn back lowers both, too
        fall = 0.0 if peaks[2] > settings.turned * peaks[1] else fallen
        if not np.isfinite(since):
            if not np.isfinite(weakest):
                return Shear(shear, fallen, slid=slid)
            # the print is uniform along the shear and does not show a slip: even odds at least
            others = np.array([fall, settings.unloaded, slid])
            odds = max(0.5, float(find_slip_probability(others, settings)))
            return Shear(shear, fallen, since, slid, odds, slides=odds > 0.5)
        if since > settings.unloaded:  # the load is smaller now: measure later falls from here
            self._shears = deque([self._shears[-1]], settings.memory)
        found = np.array([0.0 if stayed else fall, since, slid])
        probability = float(find_slip_probability(found, settings))
        stays = weakest > settings.sticking
        located = np.isfinite(slid)  # no slip leaves such a print in place
        slides = probability > 0.5 and not (recent > settings.resting or (stays and located))
        holds = probability < 0.5
        sticks = stays and (holds or located)
        # in two frames: an object that slips by jerks stops for one
        rests = len(self._lately) == 2 and min(self._lately) > settings.resting
        measured = shear, fallen, since, slid, probability
        return Shear(*measured, slides, holds, sticks, rests=rests)


def _add_slow_slip(shear: Shear, slow: SlowSlip) -> Shear:
    """The shear with the signs of a slow slip."""
    lost, probability = slow.lost > 0.5, shear.slip_probability
    if shear.hidden:  # even odds are no sign of a slip: two of them would add up to one
        probability = max(probability, slow.lost)
    elif lost or isfinite(probability):
        held = 1.0 - (probability if isfinite(probability) else 0.0)
        probability = 1.0 - held * (1.0 - slow.lost)
    return shear._replace(
        slip_probability=probability,
        slides=shear.slides or slow.slides,
        holds=shear.holds and not lost,
        sticks=shear.sticks and not slow.strays,
        strays=slow.strays,
    )


def _hide(shear: Shear) -> Shear:
    """The shear without the evidence of a print that may not show a turn: even odds at least."""
    if not isfinite(shear.slip_probability):
        return shear
    odds = max(0.5, shear.slip_probability)
    return shear._replace(
        print_correlation=np.nan, slip_probability=odds, holds=False, sticks=False
    )


def find_slip_probability(
    signs: Float[np.ndarray, "3 ..."], settings: ShearSettings
) -> Float[np.ndarray, "..."]:
    """Probability that all of the contact has slipped recently, from three of the signs [-].

    Args:
        signs: lost share of the shear's peak; correlation of the print on the gel with an earlier
            one; recent slip of the object over the half-width of its interval [-]. NaN if unknown;
            the probability is NaN without the second sign.
        settings: how a slip is recognised.
    """
    fallen, correlation, slid = signs
    by_print = expit((settings.kept - correlation) / settings.kept_spread)
    by_fall = expit((fallen - settings.fallen) / settings.fallen_spread)
    by_fall = np.where(correlation > settings.unloaded, 0.0, by_fall)
    by_slip = np.nan_to_num(expit((slid - settings.slid) / settings.slid_spread))
    return np.asarray(1.0 - (1.0 - by_fall) * (1.0 - by_print) * (1.0 - by_slip))


def _middle(values: Sequence[float]) -> float:
    finite = [value for value in values if isfinite(value)]
    return float(median(finite)) if finite else np.nan  # NumPy's takes ten times as long for three
