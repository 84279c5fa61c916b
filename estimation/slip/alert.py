"""When a contact will slip at the present rate, and a word that a gripper can act on."""

from collections import deque
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.choices import DEFAULT_ALERT, AlertSettings
from estimation.estimators.measurement import Z95
from estimation.estimators.result import State
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin


class Level(StrEnum):
    """What a gripper should do, as a string.

    - `none`: nothing.
    - `watch`: part of the contact slips, or a slip is near. Do not move faster, and press more if
      the object allows it.
    - `act`: a slip is imminent. Press more now.
    - `slips`: all of the contact slips.
    - `unknown`: there is no contact, or the frame cannot be used.

    Examples:
        >>> from estimation import Level
        >>> print(*Level)
        none watch act slips unknown
    """

    NONE = "none"
    WATCH = "watch"
    ACT = "act"
    SLIPS = "slips"
    UNKNOWN = "unknown"


class Alert(NamedTuple):
    """The warning of a macro slip after a frame.

    Attributes:
        level: what a gripper should do.
        time_to_slip: time to macro slip at the present rate [s]; NaN if the contact is not moving
            towards it, or if its limit is unknown.
        low: lower end of the 95 % interval of that time [s].
        high: upper end [s]; infinite if the rate may be 0.

    Examples:
        >>> from estimation import Alert, Noise, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings(noise=Noise.given(1e-3))).answers()
        >>> alert: Alert = last.alert
        >>> print(f"{alert.level}: slips in {alert.time_to_slip:.1f} s")
        act: slips in 0.5 s
    """

    level: Level = Level.UNKNOWN
    time_to_slip: float = np.nan
    low: float = np.nan
    high: float = np.nan


class AlertWatch:
    """Follows angle and friction in use, and says when they reach their limits."""

    def __init__(self, settings: AlertSettings = DEFAULT_ALERT) -> None:
        """Begin with nothing known.

        Args:
            settings: when a gripper is warned.
        """
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Begin with nothing known: the object has left."""
        self._past: deque[tuple[float, float, float]] = deque(maxlen=self._settings.rate_frames)

    def update(
        self,
        time: float,
        state: State,
        angle: float,
        margin: Margin,
        friction: Friction,
        slipped: float,
    ) -> Alert:
        """What comes after a frame.

        Args:
            time: time stamp [s].
            state: of the contact.
            angle: of the object [rad].
            margin: angle and moment that remain.
            friction: in use, and its coefficient.
            slipped: probability that all of the contact has slipped lately [-]; NaN if unknown.
        """
        if state == State.NO_CONTACT:
            self.restart()
        if state in (State.NO_CONTACT, State.UNKNOWN):
            return Alert()
        self._past.append((time, angle, friction.used))
        if state == State.MACRO_SLIP:
            return Alert(Level.SLIPS, 0.0, 0.0, 0.0)
        # a load levels off towards its limit, and comes there later than its rate says
        grip = np.array([friction.coefficient, friction.low, np.inf]) - friction.used
        times = self._time_to(1, (margin.angle, margin.angle_low, margin.angle_high))
        if np.isnan(times[0]):
            times = self._time_to(2, tuple(np.maximum(grip, 0.0)))
        return Alert(self._judge(times[0], friction.share, slipped, state), *times)

    def _time_to(self, of: int, left: tuple[float, ...]) -> tuple[float, float, float]:
        """Time until nothing is left, and its 95 % interval [s]; NaN at rest, or the other way.

        Args:
            of: which of the numbers that are kept goes there.
            left: how much of it is still there, and the ends of its 95 % interval.
        """
        known = np.array([(one[0], one[of]) for one in self._past if np.isfinite(one[of])])
        fewest = 5
        if np.isnan(left[0]) or len(known) < fewest:
            return np.nan, np.nan, np.nan
        (slope, _), covariance = np.polyfit(known[:, 0] - known[-1, 0], known[:, 1], 1, cov=True)
        # the branch of an angle goes the way that the object turns
        rate, half = abs(slope) if of == 1 else slope, Z95 * float(np.sqrt(covariance[0, 0]))
        if not rate > half:
            return np.nan, np.nan, np.nan
        middle, low, high = left
        return float(middle / rate), float(low / (rate + half)), float(high / (rate - half))

    def _judge(self, time: float, share: float, slipped: float, state: State) -> Level:
        told = self._settings
        if time <= told.act_s or share >= told.act_used or slipped >= told.act_probability:
            return Level.ACT
        near = time <= told.watch_s or share >= told.watch_used
        return Level.WATCH if near or state == State.INCIPIENT else Level.NONE


class GripPath(NamedTuple):
    """What is kept of friction and alerts over a recording; as in `Friction` and `Alert`."""

    friction_used: Float[np.ndarray, " frames"]
    friction: Float[np.ndarray, " frames"]
    friction_low: Float[np.ndarray, " frames"]
    friction_high: Float[np.ndarray, " frames"]
    time_to_slip: Float[np.ndarray, " frames"]
    time_to_slip_low: Float[np.ndarray, " frames"]
    time_to_slip_high: Float[np.ndarray, " frames"]
    level: tuple[Level, ...]

    @classmethod
    def of(cls, *frames: tuple[Friction, Alert]) -> "GripPath":
        """That of some frames."""
        numbers = np.array([(*friction, *alert[1:]) for friction, alert in frames]).reshape(-1, 7)
        return cls(*numbers.T, level=tuple(alert.level for _, alert in frames))

    def take(self, rows: slice) -> "GripPath":
        """That of some of the frames."""
        *numbers, levels = self
        return GripPath(*(values[rows] for values in numbers), level=levels[rows])
