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

    def __init__(self, settings: SlipSettings = SlipSettings()) -> None:
        """Begin before any slip."""
        self._settings = settings
        self._slid = 0  # frames in a row with too few sticking markers
        self._gripped = False  # whether the contact has held again after a slip
        self._rested = False  # whether the gel rested just before
        self._opened = 0  # frames for which the last disc with room for markers still counts
        self._angles: deque[float] = deque(maxlen=settings.latest + 1)

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
        rests, self._rested = sight.still or sight.paused or self._rested, sight.still
        self._see_disc(sight)
        if not slides:
            return state, reason
        if self._gripped and not known and (sight.grips or self._opened) and not sight.closed:
            return State.UNKNOWN, UNSEEN_TURN
        turned = abs(self._angles[-1] - self._angles[0]) > 0.5 * (gel.high - gel.low)
        if not slid or not rests or turned:
            return state, reason
        return State.UNKNOWN, RESTS_OR_SLIDES

    def _see_disc(self, sight: Sight) -> None:
        """Note whether the disc is open; a few frames without a disc do not show it closed."""
        if sight.disc is None:
            self._opened = max(self._opened - 1, 0)
        else:
            opened = sight.disc.margin > self._settings.regained
            self._opened = self._settings.latest if opened else 0
