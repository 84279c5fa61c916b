"""How far the compression of a video may hold back a print.

A video drops changes that are weak against its quantizer's step. Its pictures then show an earlier
print, though none from before the last picture that was coded by itself. Some coders drop more than
others at the same step, which the video does not tell. The next picture that is coded by itself
does: a late print jumps there.
"""

from collections import deque

import numpy as np

from estimation.estimators.measurement import Z95
from estimation.pictures.imprint.settings import ImprintSettings


class Lateness:
    """Follows the error that compression leaves in the angles of a print."""

    def __init__(self, settings: ImprintSettings) -> None:
        """Begin without a print."""
        self._settings = settings
        self._dropped = settings.dropped  # what the coder drops, as far as jumps have shown [-]
        self._jumps: deque[float] = deque(maxlen=settings.jumps)
        """Jumps of prints at pictures that are coded by themselves, over `_unit` [-]."""
        self.begin()

    def begin(self, quantizer: float = 0.0) -> None:
        """Begin with another print of the same video.

        Args:
            quantizer: as in `update`, of the picture from which the angles count.
        """
        self._whole = [] if quantizer else [0.0]
        """Angles in the last two pictures that were coded by themselves [rad]."""
        self._unit = 0.0  # of the last picture that was not, as in `_measure_unit` [rad]
        self._first = quantizer  # step of the first picture; 0 once its error is known
        self._start = 0.0  # error of the first picture, common to all angles [rad]
        self.lose()
        self._last = [0.0]

    def lose(self) -> None:
        """Leave out a frame without a print."""
        self._last: list[float] = []  # angles in the last frames, four at most [rad]
        self._turned = 0.0  # which way the print has turned, if the last frame may show a jump

    def update(self, angle: float, slope: float, quantizer: float) -> float:
        """Rotation that compression may hide in the next frame, a standard error [rad].

        Args:
            angle: of the print [rad].
            slope: root mean square change of the print's levels by a rotation [grey levels/rad].
            quantizer: step of the quantizer [grey levels]; 0 in pictures that are coded by
                themselves, and if unknown.
        """
        self._last = [*self._last[-3:], angle]
        if self._turned:
            self._measure_jump()
        self._turned = 0.0
        if self._first:
            self._start = self._find_dropped(self._measure_unit(slope, self._first))
            self._first = 0.0
        if not quantizer:
            turned = angle - self._whole[-1] if self._whole else 0.0
            if len(self._last) > 2 and abs(turned) > self._usual * self._unit > 0.0:
                self._turned = float(np.sign(turned))
            self._whole = [*self._whole[-1:], angle]
            return self._start
        self._unit = self._measure_unit(slope, quantizer)
        late = self._find_dropped(self._unit)
        if len(self._whole) > 1:
            before, last = self._whole
            late = min(late, abs(last - before) + abs(angle - last))
        return float(np.hypot(self._start, late))

    def _measure_unit(self, slope: float, quantizer: float) -> float:
        """Rotation that changes a print by the excess of the step over the harmless one [rad]."""
        return max(quantizer - self._settings.harmless, 0.0) / slope

    @property
    def _usual(self) -> float:
        """The jump that most coders cause, as in `_jumps` [-]."""
        return Z95 * self._settings.dropped

    def _find_dropped(self, unit: float) -> float:
        """Rotation that the coder drops, from that by the excess of its step [rad]."""
        return min(self._dropped * unit, float(np.radians(self._settings.most_late_deg)))

    def _measure_jump(self) -> None:
        """Add the jump in the last frame but one: its step less those before and after it.

        Without lateness, it is not above both, unless the object turns in this frame alone. Jumps
        may show that the coder drops more than most do. That it drops less at one step and pace of
        the object proves nothing for others.
        """
        before, jump, after = self._turned * np.diff(self._last)
        self._jumps.append(max(jump - max(before, after, 0.0), 0.0) / self._unit)
        self._dropped = max(float(np.median([self._usual, *self._jumps])), self._usual) / Z95
