"""How far an object may have slid on, where the gel that it turned comes to rest.

Gel rests under an object that rests, and under one that slides. While many markers stick they show
which: an object does not let go of all of them at once. Once few do, and the gel slows down, an
object that goes on as it went must be reckoned with until markers in number turn along with it
again.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class UnseenSlideSettings:
    """When an object may slide unseen.

    Attributes:
        few_share: share of the contact's markers below which those that stick are few [-].
        memory: frames whose fastest turn is how fast the object may go on [frames].
        over: frames over which the gel is seen to slow down [frames].
        slow: turn per frame, over the fastest, from which it has slowed down [-].
        faster: how much faster than it went the object may go on [-].
        grip_deg: how far markers in number must turn together to show that the object holds [°].
        doubt_deg: how far the object may have slid from which on its state is unknown [°].
    """

    few_share: float = 1.0 / 3.0
    memory: int = 5
    over: int = 3
    slow: float = 0.5
    faster: float = 1.2
    grip_deg: float = 0.5
    doubt_deg: float = 2.0


class UnseenSlide:
    """Follows how far the object may be ahead of the gel."""

    def __init__(
        self, few_markers: int, settings: UnseenSlideSettings = UnseenSlideSettings()
    ) -> None:
        """Begin with an object that holds.

        Args:
            few_markers: markers that stick below which they are few.
            settings: when an object may slide.
        """
        self._few_markers, self._settings = few_markers, settings
        self.restart()

    def restart(self) -> None:
        """Begin with an object that holds."""
        self._steps: deque[float] = deque(maxlen=self._settings.over)
        self._few: deque[bool] = deque(maxlen=self._settings.over)
        self._rates: deque[float] = deque(maxlen=self._settings.memory)
        self._last = np.nan
        self._behind = self._ahead = 0.0
        self._hold()

    def _hold(self) -> None:
        """The object holds; what it has slid before stays in doubt."""
        self._rate = 0.0  # at which it may slide
        self._slid = self._pending = 0.0  # and how far it may have, for sure and if it rests
        self._from = np.nan  # angle from which on markers in number move together

    def update(self, angle: float, stick: int, contact: int) -> None:
        """Take the next frame.

        Args:
            angle: of the gel that sticks [rad].
            stick: markers that do.
            contact: markers in contact.
        """
        step, self._last = angle - self._last, angle
        if np.isnan(step):
            return
        few = stick < min(self._few_markers, self._settings.few_share * contact)
        self._steps.append(step)
        self._few.append(few)
        if self._rate == 0.0:
            rate = float(np.mean(self._steps))
            fastest = max(self._rates, key=abs, default=step)
            along = rate * np.sign(fastest)
            if not any(self._few) or along >= self._settings.slow * abs(fastest):
                self._rates.append(rate)
                return
            self._rate = self._settings.faster * fastest
            missed = sum(fastest - one for one in list(self._steps)[:-1])
            self._slid = missed if missed * fastest > 0.0 else 0.0
        if few:
            self._slid += self._pending + self._rate - step
            self._pending, self._from = 0.0, np.nan
        else:
            self._see_grip(angle, step)

    def _see_grip(self, angle: float, step: float) -> None:
        """Markers in number stick: the object holds if they turn, and may still slide if not."""
        if np.isnan(self._from):
            self._from, self._pending = angle, self._rate - step
        elif abs(angle - self._from) > np.radians(self._settings.grip_deg):
            self._pending = 0.0
            self._behind, self._ahead = self.extent
            self._rates.clear()
            self._hold()
        elif abs(step) < self._settings.slow * abs(self._rate):
            self._slid += self._pending + self._rate - step
            self._pending = 0.0
        else:
            self._pending += self._rate - step

    @property
    def doubtful(self) -> bool:
        """Whether it may slide now, and have slid far."""
        return bool(self._rate and sum(self.extent) > np.radians(self._settings.doubt_deg))

    @property
    def extent(self) -> tuple[float, float]:
        """How far the object may be behind the gel, and ahead of it [rad]; neither is below 0."""
        slid = self._slid + self._pending
        if slid * self._rate < 0.0:  # the gel has gone further
            slid = 0.0
        return self._behind + max(-slid, 0.0), self._ahead + max(slid, 0.0)
