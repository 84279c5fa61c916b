"""Bound on the rotation of an object that may slide over gel at rest.

The gel rests under an object that rests, and also under an object that slides. While many markers
stick, they distinguish the two, since an object does not release all of them at once. Once few
markers stick and the gel slows down, the object may go on at its last rate, until most of the
contact turns with it again. As long as noise hides whether the gel has slowed down, both are
possible too. Noise also lets markers seem to stick that slip slowly: those that stick are few, too,
where most have let go lately, since an object that stops releases none.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimation.estimators.measurement import Z95


@dataclass(frozen=True)
class UnseenSlideSettings:
    """When an object may slide unseen.

    Attributes:
        few_share: share of the contact's markers below which the sticking markers are few [-].
        kept: share below which they are few of those that stuck in the last steps [-].
        memory: steps whose fastest turn bounds the rate of a sliding object [-]. A step lasts until
            the gel's turn, or half the turn at the fastest rate, is clear of the noise.
        over: steps over which a slowdown of the gel is measured [-].
        clear: turn over its standard error, from which it is clear of the noise [-].
        slow: turn per frame, over the fastest, below which the gel has slowed down [-].
        faster: rate of a sliding object over the fastest turn [-].
        grip_deg: turn of most of the contact together, also clear of the noise, that shows that the
            object holds [°]. A turn of which one frame brings half or more is a jump to other
            markers.
        doubt_deg: possible slide above which the state is unknown [°].
    """

    few_share: float = 1.0 / 3.0
    kept: float = 0.5
    memory: int = 5
    over: int = 3
    clear: float = 4.0
    slow: float = 0.5
    faster: float = 1.2
    grip_deg: float = 0.5
    doubt_deg: float = 2.0


class _Step(NamedTuple):
    """Frames over which the gel's turn is clear of the noise, or would be if it turned on.

    Attributes:
        turn: turn of the gel [rad].
        frames: number of frames.
        few: whether few markers stuck in any of them.
    """

    turn: float = 0.0
    frames: int = 0
    few: bool = False


class UnseenSlide:
    """Follows how far the object may be ahead of the gel or behind it."""

    def __init__(self, few_markers: int) -> None:
        """Begin with an object that holds; below `few_markers`, the sticking markers are few."""
        self._few_markers, self.settings = few_markers, UnseenSlideSettings()
        self.restart()

    def restart(self) -> None:
        """Begin with an object that holds."""
        self._step = _Step()
        self._steps: deque[_Step] = deque(maxlen=self.settings.over)
        # rates of the last steps, and the markers that stuck then
        self._turns: deque[tuple[float, int]] = deque(maxlen=self.settings.memory)
        # the object's possible angle after earlier frames
        self._reached: deque[float] = deque(maxlen=self.settings.over)
        self._last = np.nan
        self._behind = self._ahead = 0.0
        self._hold()

    def _hold(self) -> None:
        """The object holds; its earlier slide remains uncertain."""
        self._rate = 0.0  # rate at which the object may slide
        self._slid = self._pending = 0.0  # possible slide, and its part that a grip would cancel
        self._undecided = 0.0  # possible slide in a step that the noise does not yet let end
        self._from = np.nan  # angle since which many markers move together
        self._largest = 0.0  # largest turn in one frame since then
        self._since = 0  # frames since then

    def update(
        self,
        angle: float,
        stick: int,
        contact: int,
        error: float,
        turns_along: Callable[[], float] = float,
        slides: bool = False,
    ) -> bool:
        """Take the next frame.

        Args:
            angle: rotation of the sticking gel [rad].
            stick: number of markers that stick.
            contact: number of markers in contact.
            error: standard error of the angle by noise [rad].
            turns_along: by how much most of the contact has turned as one body since the frame
                `over` frames before [rad], 0 if it has not: with a turn as large as a grip's, the
                object has held since. Asked only while it may slide.
            slides: whether the motion of all markers shows that the object slides.

        Returns:
            Whether the contact has turned along.
        """
        step, self._last = angle - self._last, angle
        if np.isnan(step):
            return False
        self._follow(angle, step, stick, contact, error, slides)
        full = len(self._reached) == self.settings.over
        turned = turns_along() if self._rate and full else 0.0
        held = abs(turned) >= np.radians(self.settings.grip_deg)
        if held:  # the angle may have jumped to other markers since
            self._slid, self._pending = self._reached[0] + turned - angle, 0.0
            self._begin_hold()
        self._reached.append(angle + self._slid + self._pending + self._undecided)
        return bool(held)

    def _are_few(self, stick: int, contact: int) -> bool:
        few = min(self._few_markers, self.settings.few_share * contact)
        stuck = max((stuck for _, stuck in self._turns), default=0)
        return stick < max(few, self.settings.kept * stuck)

    def _begin_hold(self) -> None:
        """The object holds from now on; by how much it has slid stays in the interval."""
        self._behind, self._ahead = self.extent
        self._turns.clear()
        self._hold()

    def hold(self, angle: float, stick: int, contact: int, error: float) -> None:
        """Take a frame in which the object is known to hold, though few markers may stick.

        The angle is the object's; `update` describes the arguments.
        """
        step, self._last = angle - self._last, angle
        self._behind = self._ahead = 0.0
        self._hold()
        if np.isnan(step):
            return
        if self._take(step, self._are_few(stick, contact), error):
            self._turns.append((self._rate_of_steps, stick))
        self._reached.append(angle)

    def miss(self) -> None:
        """Take a frame in which no marker seems to stick: noise hides them, or all slip."""
        self._step = self._step._replace(frames=self._step.frames + 1, few=True)

    def _take(self, turn: float, few: bool, error: float, now: bool = False) -> bool:
        """Add a frame to the present step, and tell whether the step ends with it, or must now."""
        before, settings = self._step, self.settings
        self._step = _Step(before.turn + turn, before.frames + 1, before.few or few)
        expected = settings.slow * abs(self._fastest) * self._step.frames
        clear = settings.clear * np.sqrt(2.0) * error
        if not now and max(abs(self._step.turn), expected) < clear:
            return False
        self._steps.append(self._step)
        self._step = _Step()
        return True

    @property
    def _fastest(self) -> float:
        """The fastest of the last rates [rad per frame]; 0 without any."""
        return max((rate for rate, _ in self._turns), key=abs, default=0.0)

    @property
    def _rate_of_steps(self) -> float:
        """Mean rate of the last steps [rad per frame]."""
        return sum(step.turn for step in self._steps) / sum(step.frames for step in self._steps)

    def _follow(
        self, angle: float, turn: float, stick: int, contact: int, error: float, slides: bool
    ) -> None:
        """Extend the possible slide by a frame."""
        few = self._are_few(stick, contact)
        ended = self._take(turn, few, error, now=slides)
        if self._rate == 0.0:
            self._undecided = self._find_undecided(error)
            if not ended:
                return
            rate = self._rate_of_steps
            fastest = self._fastest or self._steps[-1].turn / self._steps[-1].frames
            along = rate * np.sign(fastest)
            holds = not any(step.few for step in self._steps)
            holds = holds or along >= self.settings.slow * abs(fastest)
            if holds and not slides:
                self._turns.append((rate, stick))
                return
            self._rate, self._undecided = self.settings.faster * fastest, 0.0
            *before, last = self._steps
            missed = sum(fastest * step.frames - step.turn for step in before)
            missed += self._rate * (last.frames - 1) - (last.turn - turn)
            self._slid = missed if missed * fastest > 0.0 else 0.0
        if few or 2 * stick < contact:
            self._slid += self._pending + self._rate - turn
            self._pending, self._from = 0.0, np.nan
        else:
            self._see_grip(angle, turn, error)

    def _find_undecided(self, error: float) -> float:
        """By how much the turn of the present step clearly falls short [rad]; 0 if it does not.

        So does the step before it, if it was slow, until more steps show a slowdown.
        """
        fastest, steps = self._fastest, [self._step]
        for step in list(self._steps)[-1:]:
            if step.turn * np.sign(fastest) < self.settings.slow * abs(fastest) * step.frames:
                steps.append(step)
        missed = sum(fastest * step.frames - step.turn for step in steps)
        clear = missed * np.sign(fastest) > Z95 * np.sqrt(2.0) * error
        return missed if clear and any(step.few for step in steps) else 0.0

    def _see_grip(self, angle: float, step: float, error: float) -> None:
        """Most markers stick: if they turn, the object holds; if not, it may still slide.

        Gel that is clearly slow, as gel that springs back under a sliding object, shows no grip.
        """
        turned = abs(angle - self._from)
        self._largest = max(self._largest, abs(step))
        self._since += 1
        clear = self.settings.clear * np.sqrt(2.0) * error
        slow = self.settings.slow * abs(self._rate) * self._since > turned + clear
        if np.isnan(self._from):
            self._pending = self._rate - step
            self._begin_turn(angle)
        elif turned > max(np.radians(self.settings.grip_deg), 2.0 * self._largest, clear):
            self._pending = 0.0
            self._begin_hold()
        elif abs(step) < self.settings.slow * abs(self._rate):
            self._slid += self._pending + self._rate - step
            self._pending = 0.0
        else:
            self._pending += self._rate - step
        if slow:
            self._begin_turn(angle)

    def _begin_turn(self, angle: float) -> None:
        """Many markers move together from this angle on."""
        self._from, self._largest, self._since = angle, 0.0, 0

    @property
    def doubtful(self) -> bool:
        """Whether the object may be sliding and may have slid by more than `doubt_deg`."""
        return bool(self._rate and sum(self.extent) > np.radians(self.settings.doubt_deg))

    @property
    def extent(self) -> tuple[float, float]:
        """How far the object may be behind the gel and ahead of it [rad], both 0 or more."""
        slid = self._slid + self._pending
        if slid * self._rate < 0.0:  # the gel has turned further
            slid = 0.0
        slid += self._undecided
        return self._behind + max(-slid, 0.0), self._ahead + max(slid, 0.0)
