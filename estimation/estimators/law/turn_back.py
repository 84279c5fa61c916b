"""The angle of an object that has turned back, averaged over the frames since its turn.

The law of friction gives the angle of one frame, whose noise is that of the few markers that have
never slipped. After the turn many more markers stick again. They give precisely how far the object
has turned since, so that all frames together give the angle at the turn.
"""

import numpy as np
from jaxtyping import Bool, Complex

from estimation.estimators.plane import fit_turn


class TurnBack:
    """Follows an object since its turn."""

    correlated = 3.0  # frames over which errors of the law are correlated

    def __init__(self, positions: Complex[np.ndarray, " n"]) -> None:
        """Begin at the turn, with the positions of the markers then [mm]."""
        self._positions = positions
        self._weight = self._sum = 0.0

    def update(
        self,
        after: Complex[np.ndarray, " n"],
        stick: Bool[np.ndarray, " n"],
        angle: float,
        error: float,
        noise: float,
    ) -> tuple[float, float]:
        """The angle of the next frame and its standard error [rad].

        Args:
            after: positions now [mm].
            stick: markers that have stuck since the turn.
            angle: angle by the law, from this frame [rad].
            error: its standard error [rad].
            noise: noise per coordinate [mm].
        """
        stick = stick & np.isfinite(self._positions + after)
        step, step_error = fit_turn(self._positions[stick], after[stick], noise * np.sqrt(2.0))
        if not step_error < error:
            return angle, error
        weight = error**-2
        self._weight, self._sum = self._weight + weight, self._sum + weight * (angle - step)
        share = min(self.correlated * weight / self._weight, 1.0)
        return self._sum / self._weight + step, float(np.hypot(error * np.sqrt(share), step_error))
