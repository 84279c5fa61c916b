"""Time to slip at the present rate, and alert levels for a gripper."""

from collections import deque
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import stdtrit

from estimation.choices import AlertSettings
from estimation.estimators.result import State, may_slip, take_rows
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin


class AlertLevel(StrEnum):
    """What a gripper should do, as a string.

    - `none`: nothing.
    - `watch`: part of the contact slips, or a slip is near. Do not move faster, and press more if
      the object allows it.
    - `act`: a slip is imminent, or has just ended: the slip probability covers about the last
      second. Or few markers stick, and the object may already slip. Press more now, and keep that
      force.
    - `slips`: all of the contact slips.
    - `unknown`: there is no contact, or the state is unknown for another reason.

    Examples:
        >>> from estimation import AlertLevel
        >>> print(*AlertLevel)
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
        >>> *_, last = Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers()
        >>> alert: Alert = last.alert
        >>> print(f"{alert.level}: slips in {alert.time_to_slip:.1f} s")
        act: slips in 0.5 s
    """

    level: AlertLevel = AlertLevel.UNKNOWN
    time_to_slip: float = np.nan
    low: float = np.nan
    high: float = np.nan


class AlertWatch:
    """Follows angle and friction in use, and predicts when they reach their limits."""

    def __init__(self, settings: AlertSettings = AlertSettings()) -> None:
        """Begin without any frame.

        Args:
            settings: thresholds of the alerts.
        """
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Discard all frames: the object has left."""
        self._past: deque[tuple[float, float, float]] = deque(maxlen=self._settings.rate_frames)

    def add(self, time: float, state: State, angle: float, used: float) -> None:
        """Add a frame.

        Args:
            time: time stamp [s].
            state: state of the contact.
            angle: angle of the object [rad].
            used: friction in use [-].
        """
        if state == State.NO_CONTACT:
            self.restart()
        elif state != State.UNKNOWN:
            self._past.append((time, angle, used))

    def predict(
        self, state: State, reason: str, margin: Margin, friction: Friction, slip_probability: float
    ) -> Alert:
        """The prediction after the frame added last.

        Args:
            state: state of the contact.
            reason: reason for an unknown state.
            margin: remaining angle and moment.
            friction: friction in use, and its coefficient.
            slip_probability: probability that all of the contact has slipped recently [-]; NaN if
                unknown.
        """
        if state in (State.NO_CONTACT, State.UNKNOWN):
            return Alert(AlertLevel.ACT if may_slip(reason) else AlertLevel.UNKNOWN)
        if state == State.MACRO_SLIP:
            return Alert(AlertLevel.SLIPS, 0.0, 0.0, 0.0)
        # a load levels off towards its limit and reaches it later than its rate suggests
        grip = np.array([friction.coefficient, friction.low, np.inf]) - friction.used
        times = self._time_to(1, (margin.angle, margin.angle_low, margin.angle_high))
        if np.isnan(times[0]):
            times = self._time_to(2, tuple(np.maximum(grip, 0.0)))
        return Alert(self._judge(times[0], friction.share, slip_probability, state), *times)

    def _time_to(self, column: int, margin: tuple[float, ...]) -> tuple[float, float, float]:
        """Time to the limit and its 95 % interval [s]; NaN at rest or away from the limit.

        Args:
            column: column of the past frames that approaches the limit: 1 angle, 2 friction.
            margin: distance to the limit, and the ends of its 95 % interval.
        """
        past = np.array([(row[0], row[column]) for row in self._past if np.isfinite(row[column])])
        fewest = 5
        if np.isnan(margin[0]) or len(past) < fewest:
            return np.nan, np.nan, np.nan
        # a motion that has just begun shows its rate in the last frames only; these are noisier
        rates, halves = np.transpose([_fit_rate(past[-count:]) for count in (fewest, len(past))])
        if column == 1:  # an angle approaches its limit whichever way the object turns
            rates = rates * (np.sign(rates[0]) if abs(rates[0]) > halves[0] else np.sign(rates[1]))
        moving = np.flatnonzero(rates > halves)
        if not len(moving):
            return np.nan, np.nan, np.nan
        middle, low, high = margin
        fastest, slowest = float(np.max(rates + halves)), float(np.min(rates - halves))
        latest = high / slowest if slowest > 0.0 else np.inf
        return float(middle / rates[moving[0]]), float(low / fastest), float(latest)

    def _judge(
        self, time: float, share: float, slip_probability: float, state: State
    ) -> AlertLevel:
        limits = self._settings
        if (
            time <= limits.act_s
            or share >= limits.act_friction_share
            or slip_probability >= limits.act_probability
        ):
            return AlertLevel.ACT
        near = time <= limits.watch_s or share >= limits.watch_friction_share
        return AlertLevel.WATCH if near or state == State.INCIPIENT else AlertLevel.NONE


def _fit_rate(past: Float[np.ndarray, "frames 2"]) -> tuple[float, float]:
    """Rate of a quantity [1/s], and half-width of its 95 % interval.

    Args:
        past: time stamps [s] and values, three or more.
    """
    time, value = (past - past[-1]).T  # a constant value has no rate, not even one by rounding
    (slope, _), covariance = np.polyfit(time, value, 1, cov=True)
    return float(slope), float(stdtrit(len(past) - 2, 0.975) * np.sqrt(covariance[0, 0]))


class GripPath(NamedTuple):
    """Friction and alerts of a recording; fields as in `Friction` and `Alert`, over frames."""

    friction_used: Float[np.ndarray, " frames"]
    friction: Float[np.ndarray, " frames"]
    friction_low: Float[np.ndarray, " frames"]
    friction_high: Float[np.ndarray, " frames"]
    time_to_slip: Float[np.ndarray, " frames"]
    time_to_slip_low: Float[np.ndarray, " frames"]
    time_to_slip_high: Float[np.ndarray, " frames"]
    level: tuple[AlertLevel, ...]

    @classmethod
    def of(cls, *frames: tuple[Friction, Alert]) -> "GripPath":
        """Gather the friction and alert of each frame."""
        numbers = np.array([(*friction, *alert[1:]) for friction, alert in frames]).reshape(-1, 7)
        return cls(*numbers.T, level=tuple(alert.level for _, alert in frames))

    def take(self, rows: slice | Int[np.ndarray, " rows"]) -> "GripPath":
        """The path for some of the frames, given as a slice or by their rows."""
        return GripPath(*(take_rows(values, rows) for values in self))
