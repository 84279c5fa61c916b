"""The object's turn from what it prints and from the gel that sticks to it, put together.

The imprint is the object's own: its error grows from keyframe to keyframe of the registration, not
with time. It is read with noise, and may be lost. The gel follows the object from one frame to the
next to some hundredths of a degree, and stays behind over longer times: it relaxes, and the object
creeps over it by degrees within seconds, though every marker seems to stick. A filter of one state
([Kalman1960] R. E. Kalman, "A New Approach to Linear Filtering and Prediction Problems") takes the
steps from the gel and the place from the imprint.
"""

from typing import NamedTuple

import numpy as np

from estimation.estimators.measurement import Z95

READING = np.radians(0.04)
"""Noise of a registration from one frame to the next, beside the error that it reports [rad]: 0.03°
in the median of nineteen published clips, 0.01 to 0.13°."""
CREEP, MOST_CREEP = np.radians(0.06), np.radians(2.0)
"""How far an object turns over gel that it seems to stick to, in a frame and in all [rad].

In half of thirty published clips the root mean square was 0.2° and did not grow with time; in a
fifth it was beyond 0.5° after 8 frames, 1.1° after 32 and 2° after 64."""


class Turn(NamedTuple):
    """How far the object has turned.

    Attributes:
        angle: since the angle is counted [rad].
        error: its standard error, of the imprint's drift and of the frame counted from too [rad].
        apart: how far gel and imprint have parted over this frame where more than their errors
            explain [rad]; else 0.
    """

    angle: float
    error: float
    apart: float = 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval, which holds imprint and gel where they have just parted."""
        low, high = self.angle - Z95 * self.error, self.angle + Z95 * self.error
        return min(low, self.angle - self.apart), max(high, self.angle - self.apart)


class ImprintedTurn:
    """Follows the turn of one object while it touches, from the first frame that shows its imprint.

    Attributes:
        known: whether the turn is known, from the imprint or from the gel since it was last seen.
    """

    def __init__(self) -> None:
        """Start before the first imprint."""
        self.known = False
        self._angle = self._variance = self._gel = np.nan
        self._zero = self._common = self._drift = 0.0
        self._unseen = 0

    def update(
        self, gel: float, gel_error: float, imprint: tuple[float, float], lasting: bool
    ) -> Turn:
        """The turn in the next frame.

        Args:
            gel: rotation of the object if it sticks to the gel [rad]; NaN where nothing sticks.
            gel_error: its standard error [rad].
            imprint: angle and standard error of the imprint [rad]; NaN where it is not seen. An
                angle of exactly 0 is that of a frame in which it is counted anew.
            lasting: whether the gel is counted from where it was in the last frame.
        """
        self._predict(gel, lasting)
        angle, error = imprint
        apart = 0.0
        if np.isfinite(angle):
            if not self.known or angle == 0.0:
                self._anchor(angle, error, gel, gel_error)
            else:
                apart = self._correct(angle + self._zero)
            self._drift, self._unseen = error, 0
        self._gel = gel
        self.known = bool(np.isfinite(self._angle))
        spread = np.sqrt(self._common + self._drift**2 + self._variance)
        return Turn(self._angle, float(spread), apart)

    def shift(self, ahead: float) -> Turn:
        """Go on from where the gel is, in doubt by as much, where it has gone beyond the imprint.

        Args:
            ahead: how far the gel is beyond it [rad].
        """
        self._angle += ahead
        self._zero += ahead
        self._common += (ahead / Z95) ** 2
        spread = np.sqrt(self._common + self._drift**2 + self._variance)
        return Turn(self._angle, float(spread))

    def _predict(self, gel: float, lasting: bool) -> None:
        """Turn with the gel; where that is lost anything may have happened."""
        step = gel - self._gel if lasting else np.nan
        self._unseen += 1
        if np.isfinite(step):
            self._angle += step
            crept = np.minimum(CREEP * np.array([self._unseen - 1, self._unseen]), MOST_CREEP)
            self._variance += float(crept[1] ** 2 - crept[0] ** 2)
        else:
            self._variance = np.inf

    def _anchor(self, angle: float, error: float, gel: float, gel_error: float) -> None:
        """Count the imprint from the angle that is known without it."""
        if not (self.known and np.isfinite(self._variance)):
            self._angle = float(np.nan_to_num(gel))
            self._common = float(np.nan_to_num(gel_error)) ** 2
        else:
            self._common += self._drift**2 + self._variance
        self._zero = self._angle - angle
        self._variance = READING**2

    def _correct(self, angle: float) -> float:
        """Move to the imprint's angle, by how well it and the gel are known."""
        # standard errors by which gel and imprint may differ over one frame before either is
        # doubted
        jump = 4.0
        apart = angle - self._angle
        if np.isinf(self._variance):
            self._angle, self._variance = angle, READING**2
            return 0.0
        expected = float(np.sqrt(self._variance + READING**2))
        parted = abs(apart) > jump * expected
        if parted:
            self._variance += apart**2
        share = self._variance / (self._variance + READING**2)
        self._angle += share * apart
        self._variance *= 1.0 - share
        return apart if parted else 0.0
