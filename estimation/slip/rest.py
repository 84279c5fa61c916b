"""Rest and grip after macro slip, live.

Round contacts leave the gel at rest while they slide, and so does an object that rests. Macro slip
is therefore reported for a few frames, and for as long as the gel moves or an outline turns. Gel
that then turns as one body shows that the object holds again.
"""

from collections import deque

import numpy as np

from estimation.estimators.measurement import Measurement
from estimation.estimators.result import RESTS_OR_SLIDES, UNSEEN_TURN, State
from estimation.slip.disc import SlipSettings
from estimation.slip.onset import Sight


class RestWatch:
    """Judges the frames of one method in which too few markers stick."""

    def __init__(self) -> None:
        """Begin before any slip."""
        self._settings = settings = SlipSettings()
        self._slid = 0  # frames in a row with too few sticking markers
        self._gripped = False  # whether the contact has held again after a slip
        self._rested = False  # whether the gel rested just before
        self._angles: deque[float] = deque(maxlen=settings.latest + 1)
        self._margins: deque[float] = deque(maxlen=settings.window)  # of the disc

    def judge(self, state: State, reason: str, gel: Measurement, sight: Sight) -> tuple[State, str]:
        """State and reason of a frame, given those by its sticking markers."""
        slides, slid = state == State.MACRO_SLIP, self._slid >= self._settings.latest
        self._slid = self._slid + 1 if slides else 0
        # gel under an elongated object that slides turns too, and the outline shows the slide
        known = bool(np.isfinite(gel.angle))
        self._gripped = state != State.NO_CONTACT and (
            self._gripped or (slides and slid and not known and sight.grips)
        )
        self._angles.append(gel.angle)
        stops = sight.paused and not (self._gripped or known)
        rests, self._rested = sight.still or stops or self._rested, sight.still
        self._margins.append(np.nan if sight.disc is None else sight.disc.margin)
        if not slides:
            return state, reason
        if self._gripped and not known and (sight.grips or self._is_open()) and not sight.closed:
            return State.UNKNOWN, UNSEEN_TURN
        turned = abs(self._angles[-1] - self._angles[0]) > 0.5 * (gel.high - gel.low)
        if not slid or not rests or turned:
            return state, reason
        return State.UNKNOWN, RESTS_OR_SLIDES

    def _is_open(self) -> bool:
        """Whether markers stick in the disc, whose closing is continued where none fits."""
        margins = np.array(self._margins)
        frames = np.flatnonzero(np.isfinite(margins))
        ages = len(margins) - 1 - frames
        if not len(ages) or ages[-1] >= self._settings.latest:
            return False
        last, before = margins[frames[-1]], margins[frames[-2:][0]]
        closing = min(last - before, 0.0) / max(ages[-2:][0] - ages[-1], 1)
        return bool(last + closing * ages[-1] > self._settings.regained)
