"""The object's angle by the contact's outline, which turns with it also in macro slip.

The outline shows turns; where the markers stuck, the gel's angle shows what to count them from.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from estimation.estimators.measurement import Z95
from estimation.fields.outline import Axis, turn_error, unwrap


class _Sight(NamedTuple):
    """Readings of outline and gel in one frame.

    Attributes:
        axis: long axis of the outline, unwrapped.
        angle: rotation of the sticking elastomer [rad]; NaN if no marker sticks.
        error: standard error of the angle [rad].
    """

    axis: Axis
    angle: float
    error: float


class OutlinedTurn:
    """Follows the outline of one contact beside the gel."""

    def __init__(
        self, mature_age: int, memory: int, slip: float, shape_change: float, gain: float
    ) -> None:
        """Begin without a reading.

        Args:
            mature_age: frames over which gel and outline are compared [frames].
            memory: frames in memory [frames].
            slip: difference between their turns that shows macro slip [rad].
            shape_change: relative change of the curvature from which the outline is of another face
                [-].
            gain: rotation of the object over that of the sticking elastomer [-].
        """
        self._mature_age, self._slip = mature_age, slip
        self._shape_change, self._gain = shape_change, gain
        self._sights: deque[_Sight] = deque(maxlen=memory)
        self._last = self._curvature = np.nan
        # where the gel counts on from the outline's angle: how far the outline is ahead of it in
        # the first frames, with the variances of these readings
        self._since: list[tuple[float, float]] | None = None
        self._offset = self._variance = np.nan  # of the outline there

    def follow(self, axis: Axis) -> Axis:
        """The axis without jumps of half a turn; NaN if the contact has changed its shape."""
        if not np.isfinite(axis.angle):
            return axis
        if not np.isfinite(self._curvature):
            self._curvature, self._last = axis.curvature, axis.angle
        if abs(axis.curvature / self._curvature - 1.0) > self._shape_change:
            return axis._replace(angle=np.nan)
        self._last = unwrap(axis.angle, self._last)
        return axis._replace(angle=self._last)

    def add(self, axis: Axis, angle: float, error: float) -> None:
        """Remember a frame: the outline's axis, and angle and standard error by the gel [rad]."""
        self._sights.append(_Sight(axis, angle, error))
        if np.isnan(angle):
            self._since = None

    def clear(self) -> None:
        """Forget the frames so far."""
        self._sights.clear()
        self._since = None

    def overtakes(self, axis: Axis, angle: float) -> bool:
        """Whether the outline has recently turned away from markers that seem to stick.

        It must show this in two frames in a row, because a single reading may be wrong.

        Args:
            axis: the outline's axis now.
            angle: rotation of the gel now [rad].
        """
        sights = [*self._sights, _Sight(axis, angle, np.nan)]
        return self._is_ahead(sights) and self._is_ahead(sights[:-1])

    def _is_ahead(self, sights: Sequence[_Sight]) -> bool:
        """Whether the last outline is ahead of the gel."""
        if len(sights) < self._mature_age + 3:
            return False
        return bool(abs(self._measure_lead(sights[-self._mature_age - 3 :])) > self._slip)

    def _measure_lead(self, sights: Sequence[_Sight]) -> float:
        """How far the outline has turned ahead of the gel since the first frames, at most [rad].

        It is no further ahead than it has turned; 0 if the errors explain it.
        """
        # mostly in a contact's first frames, a single outline may be wrong: the median of three
        before, now = sights[:3], sights[-1]
        turned = now.axis.angle - np.median([s.axis.angle for s in before])
        apart = now.axis.angle - np.median([s.axis.angle - self._gain * s.angle for s in before])
        apart -= self._gain * now.angle
        doubt = 3.0 * turn_error(before[1].axis, now.axis)
        # friction drags the gel along: an outline that turns less than the gel is not the object's
        least = min(abs(apart), abs(turned))
        return float(np.copysign(least, apart)) if apart * turned > 0.0 and least > doubt else 0.0

    def reach(self, axis: Axis, angle: float) -> float:
        """How far the object may be ahead of the gel in frames too few for `overtakes` [rad].

        An object that slides from a contact's first frame on turns over gel at rest. It is as far
        ahead as the outline shows, and by the error of that (95 %); 0 if the errors explain it.

        Args:
            axis: the outline's axis now.
            angle: rotation of the gel now [rad].
        """
        if not 3 <= len(self._sights) < self._mature_age + 3:  # it takes two frames in a row
            return 0.0
        lead = self._measure_lead([*self._sights, _Sight(axis, angle, np.nan)])
        if not lead:
            return 0.0
        error = Z95 * turn_error(self._sights[1].axis, axis)
        return (lead + float(np.copysign(error, lead))) / self._gain

    def count(self, axis: Axis) -> tuple[float, float] | None:
        """The gel's angle if it had turned with the outline, and its standard error [rad].

        None if the angle is unknown. Several readings give the angle, but the standard error is
        that of two: the errors that the shape has where the markers lie, and the outline's lag in a
        slide, are not averaged.
        """
        sights, now = self._compared, self._smooth(axis)
        if not sights or np.isnan(now):
            return None
        reading = turn_error(sights[-1].axis, axis) / self._gain
        error = float(np.hypot(reading, np.median([s.error for s in sights])))
        return (now + self._find_offset()) / self._gain, error

    @property
    def _compared(self) -> list[_Sight]:
        """The last frames before the slip in which both gel and outline are known."""
        sights = [s for s in self._sights if np.isfinite(s.angle + s.axis.angle)]
        # slip may have gone undetected in the last of them
        return sights[-3 * self._mature_age : -self._mature_age] or sights

    def _find_offset(self) -> float:
        """Angle of the gel less that of the outline in these frames [rad].

        The outline of a light touch is far less certain than that of the full contact.
        """
        sights = self._compared
        weights = [1.0 / max(s.axis.standard_error, 1e-9) ** 2 for s in sights]
        return float(
            np.average([self._gain * s.angle - s.axis.angle for s in sights], weights=weights)
        )

    def _smooth(self, axis: Axis) -> float:
        """The outline's angle now, by a line through its last readings [rad]; NaN if unknown.

        Noise makes each reading err by itself, so one or two readings are no evidence. Those of a
        light touch are far less certain than those of the full contact. If the line does not
        explain the readings within their errors, the object has changed its rate, and the last
        reading counts.
        """
        unlikely = 0.05  # probability of a larger misfit, down to which the line explains them
        axes = [*(s.axis for s in self._sights if s.axis is not axis), axis][-self._mature_age :]
        angles, errors = np.array([(a.angle, a.standard_error) for a in axes]).T
        frames, known = np.arange(1.0 - len(axes), 1.0), np.isfinite(angles)
        free = int(known.sum()) - 2
        if free < 1 or not known[-1]:
            return np.nan
        weights = 1.0 / np.maximum(errors[known], 1e-9)
        design = weights[:, None] * np.stack([np.ones(free + 2), frames[known]], axis=1)
        (now, _), misfit, *_ = np.linalg.lstsq(design, weights * angles[known])
        return float(now) if misfit.sum() < chdtri(free, unlikely) else axis.angle

    def resume(self, axis: Axis) -> None:
        """From now on, the gel's angle counts on from that of the outline."""
        self._since, self._offset = [], self._find_offset()
        # the object often stops as it grips, so that a line is no better than one reading
        self._variance = axis.standard_error**2

    def lead(self, axis: Axis, angle: float) -> float:
        """How far the object is ahead of gel that counts on from the outline's angle [rad].

        The gel keeps the error of that angle. The next readings have other errors by noise, so
        their mean is more exact, unless the outline's lag in the slide, which they do not share, is
        larger than the noise. As many are taken as for the offset. 0 if the angle is not from the
        outline.

        Args:
            axis: the outline's axis now.
            angle: rotation of the gel now [rad].
        """
        lag = np.radians(0.5)  # the largest in simulation; most are 0.1 to 0.3°
        if self._since is None:
            return 0.0
        if np.isfinite(axis.angle) and len(self._since) < 2 * self._mature_age:
            ahead = axis.angle + self._offset - self._gain * angle
            self._since.append((ahead, axis.standard_error**2))
        if not self._since:
            return 0.0
        ahead, variance = np.mean(self._since, axis=0)
        share = self._variance / (self._variance + variance / len(self._since) + lag**2)
        return float(share * ahead) / self._gain

    def turns_along(self, axis: Axis, turned: float, frames: int) -> bool:
        """Whether the outline proves that the object has turned with the gel.

        Gel at rest agrees with a sliding object too where the outline's error hides the slide. So
        the error must be below the slide that shows macro slip, or below the gel's own turn.

        Args:
            axis: the outline's axis now.
            turned: rotation of the gel [rad].
            frames: number of frames in which it turned.
        """
        if frames >= len(self._sights):
            return False
        before = self._sights[-1 - frames].axis
        apart = (axis.angle - before.angle) - self._gain * turned
        doubt = 2.0 * turn_error(before, axis)
        clear = doubt < max(self._slip, self._gain * abs(turned))
        return bool(clear and abs(apart) < max(0.5 * self._slip, doubt))
