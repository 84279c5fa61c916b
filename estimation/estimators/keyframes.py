"""Keyframes, from which rotations are counted, and the points where the object turns back."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from estimation.estimators.measurement import Z95
from estimation.estimators.rotation import RigidFit
from estimation.fields.measure import Fields


class Keyframe(NamedTuple):
    """A frame from which rotations are counted.

    Attributes:
        fields: fields of the frame; None for the unloaded shape.
        number: number of the frame since the tracker began.
        angle: rotation of the elastomer up to this frame [rad].
        error: standard error of the angle [rad].
        lag_low: how far undetected slip may have kept the angle above the truth [rad].
        lag_high: how far undetected slip may have kept the angle below the truth [rad].
        body: markers that have stuck since the frame, as far as known; None for all.
        turning: whether the object turned back at this frame, or had by the law of friction.
    """

    fields: Fields | None
    number: int
    angle: float = 0.0
    error: float = 0.0
    lag_low: float = 0.0
    lag_high: float = 0.0
    body: Bool[np.ndarray, " n"] | None = None
    turning: bool = False

    def advance(self, fields: Fields, number: int, fit: RigidFit) -> "Keyframe":
        """A keyframe at the present frame, counted from this one."""
        return Keyframe(
            fields=fields,
            number=number,
            angle=self.angle + fit.angle,
            error=float(np.hypot(self.error, fit.standard_error)),
            lag_low=self.lag_low + max(-fit.lag, 0.0),
            lag_high=self.lag_high + max(fit.lag, 0.0),
        )

    def agrees(self, other: "Keyframe") -> bool:
        """Whether the intervals of two angles of the same frame overlap."""
        return not (self.high < other.low or other.high < self.low)

    def lags(self, other: "Keyframe", noise: float) -> bool:
        """Whether the angle differs from another one of the same frame, which its interval holds.

        The intervals reach to the side to which slip that was not noticed would shift the truth.

        Args:
            other: the other angle.
            noise: standard error of the difference [rad].
        """
        inside = self.low < other.angle < self.high
        return inside and abs(self.angle - other.angle) > Z95 * noise

    def correct(self, older: "Keyframe", now: "Keyframe", body: np.ndarray) -> "Keyframe":
        """The keyframe with the angle that it must have had for an older one's angle of now.

        The interval of now is then the older one's, since both counts bound the same slip; it
        covers the uncorrected angle too.

        Args:
            older: the older keyframe, counted on to now.
            now: this keyframe, counted on to now.
            body: the markers with which it was counted on; others need another correction.
        """
        apart = older.angle - now.angle
        return self._replace(
            angle=self.angle + apart,
            error=older.error,
            lag_low=max(older.lag_low - (now.lag_low - self.lag_low), apart, 0.0),
            lag_high=max(older.lag_high - (now.lag_high - self.lag_high), -apart, 0.0),
            body=body,
        )

    def doubt(self, apart: float) -> "Keyframe":
        """The keyframe with its lags widened to the difference from another keyframe's angle."""
        return self._replace(lag_low=max(self.lag_low, -apart), lag_high=max(self.lag_high, apart))

    def see_slip(self, later: "Keyframe", turned: float, error: float) -> "Keyframe":
        """The keyframe with its lags widened if a body has not turned with the object since.

        Gel at rest moves as one body, too. If it had stuck since this keyframe, it would have
        turned by as much as the object up to a later one.

        Args:
            later: the later keyframe.
            turned: turn of the body up to then [rad].
            error: its standard error [rad].
        """
        reached, margin = self.angle + turned, Z95 * error
        slipped = reached + margin < later.low or reached - margin > later.high
        return self.doubt(later.angle - reached) if slipped else self

    def move(self, angle: float) -> "Keyframe":
        """The keyframe with another angle, as far as its interval reaches, which still holds it.

        Its lags then reach to the ends of the interval, unless the error alone reaches further.
        """
        angle, noise = float(np.clip(angle, self.low, self.high)), (Z95 * self.error) ** 2
        return self._replace(
            angle=angle,
            lag_low=float(np.sqrt(max((angle - self.low) ** 2 - noise, 0.0))),
            lag_high=float(np.sqrt(max((self.high - angle) ** 2 - noise, 0.0))),
        )

    @property
    def low(self) -> float:
        """Lower end of the angle's 95 % interval [rad]."""
        return self.angle - float(np.hypot(Z95 * self.error, self.lag_low))

    @property
    def high(self) -> float:
        """Upper end of the angle's 95 % interval [rad]."""
        return self.angle + float(np.hypot(Z95 * self.error, self.lag_high))


Counted = tuple[Keyframe, RigidFit] | None
"""An angle counted from a keyframe, and the fit of the markers that stick; None without any."""


class Leg:
    """A motion one way, up to the point where the object turns back."""

    certain = 4.0  # errors by which the angle must have come back
    least = np.radians(0.3)  # angle by which it must have [rad]

    def __init__(self) -> None:
        """Begin at rest."""
        self._way = 0.0
        self._furthest = np.nan
        self._last: Keyframe | None = None

    def update(self, now: Keyframe, noise: float) -> Keyframe | None:
        """Take the next frame.

        Args:
            now: the frame.
            noise: standard error of its angle against those of the frames before [rad].

        Returns:
            The last frame at the turning point, once the object has clearly turned back.
        """
        if np.isnan(now.angle):
            return None
        if self._last is None:
            self._furthest, self._last = now.angle, now
            return None
        margin = max(self.certain * np.sqrt(2.0) * noise, self.least)
        beyond = now.angle - self._furthest
        if self._way == 0.0:
            if abs(beyond) > margin:
                self._way, self._furthest, self._last = np.sign(beyond), now.angle, now
            return None
        if beyond * self._way > 0.0:
            self._furthest, self._last = now.angle, now
        elif abs(beyond) <= margin:
            self._last = now
        else:
            turning = self._last
            self._way, self._furthest, self._last = -self._way, now.angle, now
            return turning
        return None


def thin_out(keyframes: list[Keyframe], number: int, most: int) -> None:
    """Remove keyframes whose neighbours are closest for their age.

    Args:
        keyframes: the oldest first.
        number: of the present frame.
        most: number of keyframes to keep, at least 2.
    """
    while len(keyframes) > most:
        ages = [number - keyframe.number for keyframe in keyframes]
        crowding = [(ages[i - 1] - ages[i + 1]) / (ages[i] + 1.0) for i in range(1, len(ages) - 1)]
        last = max((i for i, k in enumerate(keyframes) if k.turning), default=0)
        if 0 < last <= len(crowding) and len(crowding) > 1:
            crowding[last - 1] = np.inf
        del keyframes[1 + int(np.argmin(crowding))]
