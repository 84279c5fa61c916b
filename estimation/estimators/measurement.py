"""What an estimator says of one frame, before softness is corrected for."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

Z95 = 1.959964
"""Half-width of a 95 % interval in standard errors."""


class Measurement(NamedTuple):
    """Rotation of the elastomer's surface where it sticks.

    Attributes:
        angle: φ [rad], NaN where nothing sticks.
        low: lower end of the 95 % interval [rad].
        high: upper end of the 95 % interval [rad].
        stick: the markers that stick.
        reason: why there is no angle, where that is not that too few markers stick.
        anew: how often the angle has been counted anew, from a frame in which it was unknown, since
            the object touched; 0 where it counts from the unloaded shape.
    """

    angle: float
    low: float
    high: float
    stick: Bool[np.ndarray, " n"]
    reason: str = ""
    anew: int = 0

    @classmethod
    def none(cls, stick: Bool[np.ndarray, " n"], reason: str = "", anew: int = 0) -> "Measurement":
        """No angle: too few markers stick, unless another reason is given."""
        return cls(np.nan, np.nan, np.nan, stick, reason, anew)
