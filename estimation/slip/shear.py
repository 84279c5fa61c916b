"""Whether the object slips along the gel, by the gel's shear and by what the object prints on it.

While the object holds, the gel's shear follows the load: it rises to a plateau. Once all of the
contact slips, friction can carry no more: the shear falls where friction falls with the slip, and
stays where it does not. What the object prints goes over the gel then (`estimation.pictures.hold`),
unless the object is the same along the way it slips; and where the print is followed, it is beyond
all of the gel under it (`estimation.slip.slide`). Each of these signs is enough, and none is
certain: the probability is that at least one of them is right.

Shear that falls may also be a load that is taken off: where the print has stayed on the gel, it is,
and where no print can be compared nothing is said.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import expit

from estimation.estimators.plane import fit_motion
from estimation.estimators.result import RESTS_OR_SLIDES, State, Track
from estimation.fields.stencils import marker_pitch
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import MarkerLayout
from estimation.slip.slide import Slide


@dataclass(frozen=True)
class ShearSettings:
    """How a slip in shear is recognised.

    The numbers of `fallen` and `kept` are rounded from fits to 36 labelled lifts of four
    objects ([Li2018] R. Li, R. Dong, E. Adelson, "Slip detection with combined tactile and visual
    information", ICRA 2018); `python -m papers run slip_lifts` fits them anew without each object.

    Attributes:
        markers: how many of those that moved furthest give the shear.
        memory: how long a peak of the shear is remembered [frames].
        least: shear that a fall is measured against at least [pitches].
        fallen: share of its peak that the shear has lost in an even bet [-].
        fallen_spread: change of that for odds of e [-].
        kept: correlation with the earlier print in an even bet [-].
        kept_spread: change of that for odds of e [-].
        slid: slip over the half-width of its 95 % interval in an even bet [-].
        slid_spread: change of that for odds of e [-].
        unloaded: correlation from which a fall is a load taken off; later ones count from
            there [-].
        resting: correlation with the print of some frames before from which the object does not
            slide [-].
        sticking: the same of what agrees least, from which all of the contact sticks [-].
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
    unloaded: float = 0.96
    resting: float = 0.95
    sticking: float = 0.9


class Shear(NamedTuple):
    """Shear of the gel under the object, and whether the object has slipped over the gel.

    Lengths are in px for pictures without a scale.

    Attributes:
        shear: how far the gel under the object has moved since touch [mm].
        fallen: share of its peak by which the shear has fallen since [-].
        hold: correlation of the object's print on the gel with an earlier one [-]; NaN if unknown.
        slid: sliding distance within the memory over the half-width of its 95 % interval [-]; NaN
            if unknown.
        slipped: probability that all of the contact has slipped lately [-]; NaN without contact or
            without a print.
        slides: whether the print shows that the object slides.
        holds: whether the print shows that the object has not slid lately.
        sticks: whether the print shows that all of the contact sticks.
        slip: how far the object has slid over the gel [mm]; NaN if unknown.
        slip_error: half-width of the 95 % interval of that distance [mm].
        slip_since: time stamp of the frame from which that distance counts [s].

    Examples:
        >>> from estimation import Noise, Settings, Shear, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings(noise=Noise.given(1e-3))).answers()
        >>> shear: Shear = last.shear
        >>> print(f"{shear.shear:.2f} mm, probability of a slip {shear.slipped}")  # no print
        0.08 mm, probability of a slip nan
    """

    shear: float = float("nan")
    fallen: float = float("nan")
    hold: float = float("nan")
    slid: float = float("nan")
    slipped: float = float("nan")
    slides: bool = False
    holds: bool = False
    sticks: bool = False
    slip: float = float("nan")
    slip_error: float = float("nan")
    slip_since: float = float("nan")

    @property
    def state(self) -> State:
        """State of a contact of which nothing is known but what the object prints on the gel."""
        if self.slides:
            return State.MACRO_SLIP
        if self.sticks:
            return State.STICK
        return State.INCIPIENT if np.isfinite(self.slipped) else State.UNKNOWN


class ShearPath(NamedTuple):
    """What is kept of the shear over a recording; as in `Shear`, an array each."""

    shear: Float[np.ndarray, " frames"]
    hold: Float[np.ndarray, " frames"]
    slipped: Float[np.ndarray, " frames"]
    slip: Float[np.ndarray, " frames"]
    slip_error: Float[np.ndarray, " frames"]
    slip_since: Float[np.ndarray, " frames"]

    @classmethod
    def of(cls, *shears: Shear) -> "ShearPath":
        """That of some frames."""
        return cls(*(np.array([getattr(one, name) for one in shears]) for name in cls._fields))

    def take(self, rows: slice) -> "ShearPath":
        """That of some of the frames."""
        return ShearPath(*(values[rows] for values in self))


class Outcome(NamedTuple):
    """What became of a grasp.

    Attributes:
        word: `held` or `slipped`; `unknown` without contact, and where the object may have slid
            over gel at rest.
        probability: that it slipped [-]: a half where nothing is known, and NaN where only the
            states of the contact tell.
        onset: when that became more likely than not, or macro slip was first seen [s]; NaN if it
            was held.
        slips: stretches of frames in which it slipped.
    """

    word: str
    probability: float
    onset: float
    slips: int = 0


class ShearWatch:
    """Follows the gel's shear from frame to frame."""

    def __init__(self, layout: MarkerLayout, settings: ShearSettings | None = None) -> None:
        """Begin before the object touches.

        Args:
            layout: markers and reference.
            settings: how a slip is recognised.
        """
        self._settings = settings or ShearSettings()
        self._least = float(np.fmax(self._settings.least * marker_pitch(layout), 1e-12))
        self._restart()

    def _restart(self) -> None:
        settings = self._settings
        self._start: Float[np.ndarray, "n 2"] | None = None
        self._moved: deque[np.ndarray] = deque(maxlen=settings.memory)
        self._shears: deque[tuple[float, float]] = deque(maxlen=settings.memory)
        self._raw: deque[tuple[float, float, float]] = deque(maxlen=3)
        self._beyond: deque[float] = deque(maxlen=settings.memory)

    def update(
        self,
        positions: Float[np.ndarray, "n d"],
        contact: Bool[np.ndarray, " n"],
        hold: tuple[float, float, float],
        slide: Slide,
    ) -> Shear:
        """What is known after the next frame.

        Args:
            positions: of the markers [mm]; NaN where not seen.
            contact: markers of the contact region.
            hold: agreement of the print with earlier ones [-]; NaN where unknown.
            slide: how far the object has slid over the gel.
        """
        if not contact.any():
            self._restart()
            return Shear()
        points = positions[:, :2]
        if not np.isfinite(points).any():
            return Shear()
        if self._start is None:
            self._start = points.copy()
        unseen = np.isnan(self._start[:, 0])
        self._start[unseen] = points[unseen]
        since, *now = hold
        self._raw.append((*self._measure(points, contact), since))
        # one frame may be wrong: the middle of three
        shear, shifted, since = (_middle(values) for values in zip(*self._raw, strict=True))
        self._shears.append((shear, shifted))
        if np.isfinite(slide.beyond):
            self._beyond.append(slide.beyond)
        slid = slide.beyond - min(self._beyond, default=0.0)
        slips = {name: getattr(slide, name) for name in ("slip", "slip_error", "slip_since")}
        return self._judge((since, slid), *now)._replace(**slips)

    def _measure(
        self, points: Float[np.ndarray, "n 2"], contact: Bool[np.ndarray, " n"]
    ) -> tuple[float, float]:
        """How far the markers that went furthest within memory have gone, as one [mm].

        And how far the middle of the contact has gone with them: where they turn about it, each
        goes another way.
        """
        assert self._start is not None
        moved = points - self._start
        self._moved.append(np.nan_to_num(np.linalg.norm(moved, axis=1)))
        furthest = np.max(self._moved, axis=0)
        furthest[np.isnan(moved[:, 0])] = -1.0
        top = np.argsort(-furthest)[: self._settings.markers]
        top = top[np.isfinite(moved[top, 0])]
        if not len(top):
            return np.nan, np.nan
        shear = float(np.linalg.norm(np.median(moved[top], axis=0)))
        before, now = (one @ np.array([1.0, 1.0j]) for one in (self._start, points))
        under = before[contact & np.isfinite(self._start[:, 0])]
        if len(top) < MIN_STICK_MARKERS or not len(under):
            return shear, shear
        motion = fit_motion(before[top], now[top], np.ones(len(top)))
        middle = complex(under.mean())
        return shear, abs(motion.image + motion.turn * (middle - motion.origin) - middle)

    def _judge(self, signs: tuple[float, float], lately: float, weakest: float) -> Shear:
        settings, (since, slid) = self._settings, signs
        peaks, (shear, shifted) = np.fmax.reduce(self._shears), self._shears[-1]
        # a fall shows in both: markers that turn need not go back for theirs to fall
        fallen = float(min(peaks - (shear, shifted)) / max(peaks[0], self._least))
        if not np.isfinite(since):
            return Shear(shear, fallen, slid=slid)
        if since > settings.unloaded:  # by now the load is the less: later falls are from here
            self._shears.clear()
            self._shears.append((shear, shifted))
        slipped = float(find_slip_probability(np.array([fallen, since, slid]), settings))
        slides = slipped > 0.5 and not lately > settings.resting
        holds = slipped < 0.5
        sticks = holds and weakest > settings.sticking
        return Shear(shear, fallen, since, slid, slipped, slides, holds, sticks)


def find_slip_probability(
    signs: Float[np.ndarray, "3 ..."], settings: ShearSettings
) -> Float[np.ndarray, "..."]:
    """Probability that all of the contact has slipped lately, by each of three signs [-].

    Args:
        signs: share of its peak that the shear has lost again; correlation of the print on the gel
            with an earlier one; how far the object has slid lately, over the half-width of the
            interval [-]. NaN where unknown, and for all without the second.
        settings: how a slip is recognised.
    """
    fallen, hold, slid = signs
    by_print = expit((settings.kept - hold) / settings.kept_spread)
    by_fall = expit((fallen - settings.fallen) / settings.fallen_spread)
    by_fall = np.where(hold > settings.unloaded, 0.0, by_fall)
    by_slip = np.nan_to_num(expit((slid - settings.slid) / settings.slid_spread))
    return np.asarray(1.0 - (1.0 - by_fall) * (1.0 - by_print) * (1.0 - by_slip))


def conclude(slipped: Float[np.ndarray, " frames"], track: Track) -> Outcome:
    """What became of the grasp of a recording; without any print the states of the contact tell.

    Args:
        slipped: probability of a slip in each frame [-].
        track: of the chosen method.
    """
    if np.isfinite(slipped).any():
        probability, over = float(np.nanmax(slipped)), slipped > 0.5
    else:
        probability = np.nan
        over = np.array([state == State.MACRO_SLIP for state in track.state])
        known = track.contact_markers.any() and RESTS_OR_SLIDES not in track.reason
        if not (over.any() or known):
            return Outcome("unknown", 0.5, np.nan)
    if not over.any():
        return Outcome("held", probability, np.nan)
    slips = int((np.diff(over.astype(int), prepend=0) > 0).sum())
    return Outcome("slipped", probability, float(track.time[over.argmax()]), slips)


def _middle(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan
