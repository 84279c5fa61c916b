"""A keyframe, from which rotations are counted, and the point where the object turns back."""

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
        error = float(np.hypot(self.error, fit.standard_error))
        lags = self.lag_low + max(-fit.lag, 0.0), self.lag_high + max(fit.lag, 0.0)
        return Keyframe(fields, number, self.angle + fit.angle, error, *lags)

    def reconcile(
        self, now: "Keyframe", older: "Keyframe", noise: float, body: Bool[np.ndarray, " n"]
    ) -> "Keyframe":
        """The keyframe, changed where its count of a frame contradicts an older keyframe's.

        A keyframe made while most markers slipped unnoticed lags: its interval covers the older
        count, which differs by more than the noise. It then takes the angle that leads there. The
        interval of now is the older one's, since both counts bound the same slip; it covers the
        uncorrected angle too. If the intervals do not even overlap, the object has rested since,
        and the keyframe's is widened to the older count.

        Args:
            now: the frame, counted from this keyframe.
            older: the frame, counted from the older one.
            noise: standard error of their difference [rad].
            body: the markers that stick since this keyframe; others need another correction.
        """
        apart = older.angle - now.angle
        if now.high < older.low or older.high < now.low:
            return self.doubt(apart)
        if not now.low < older.angle < now.high or abs(apart) <= Z95 * noise:
            return self
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
        turned by as much as the object up to a later one, and not by `turned` ± `error` [rad].
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
        """Take the next frame; the last one at the turning point, once it is clearly passed.

        The noise is the standard error of the angle against those of the frames before [rad].
        """
        if np.isnan(now.angle):
            return None
        margin = max(self.certain * np.sqrt(2.0) * noise, self.least)
        beyond, turning = now.angle - self._furthest, None
        if self._last is None or beyond * self._way > 0.0:
            self._furthest, self._last = now.angle, now
        elif abs(beyond) > margin:  # it sets off, or has turned back
            turning = self._last if self._way else None
            self._way, self._furthest, self._last = np.sign(beyond), now.angle, now
        elif self._way:
            self._last = now
        return turning
