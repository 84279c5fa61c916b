"""The angle of an object that has turned back, averaged over the frames since its turn.

The law of friction gives the angle of one frame, whose noise is that of the few markers that have
never slipped. After the turn many more markers stick again. They give precisely how far the object
has turned since, so that all frames together give the angle at the turn. Their noise is averaged,
and so is that of the markers' places on the object. The error of what was known of the contact at
the turn is not, since all frames share it. The markers that have never slipped give the angle
without the law too, and show by how much the law is wrong.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex

from estimation.estimators.plane import fit_turn


class Angle(NamedTuple):
    """An angle and its standard error [rad]; NaN and infinite if unknown."""

    value: float
    error: float

    def widen(self, error: float) -> "Angle":
        """The angle with one more standard error, which is independent of its own."""
        return self._replace(error=float(np.hypot(self.error, error)))


class Mean:
    """Mean of angles, weighted by their errors."""

    def __init__(self, correlated: float) -> None:
        """Begin without angles; noise is correlated over so many frames (`Noise.correlated`)."""
        self.correlated = correlated
        self._weight = self._sum = self._own = self._known = 0.0

    def add(self, angle: Angle, known: float = 0.0) -> Angle:
        """The mean with one more angle, which is left out if it is unknown.

        Args:
            angle: the angle.
            known: share of its variance that is common to all angles, and is not averaged [-].
        """
        if np.isfinite(angle.value):
            weight = angle.error**-2
            self._weight += weight
            self._sum += weight * angle.value
            self._own += weight * (1.0 - known)
            self._known += np.sqrt(weight * known)
        if not self._weight:
            return angle
        error = np.sqrt(self.correlated * self._own + self._known**2) / self._weight
        return Angle(self._sum / self._weight, float(min(error, angle.error)))


class TurnBack:
    """Follows an object since its turn."""

    def __init__(self, positions: Complex[np.ndarray, " n"], correlated: float) -> None:
        """Begin at the turn, with the positions of the markers then [mm] (see `Mean`)."""
        self._places, self._frames = positions.copy(), np.ones(len(positions))
        self._correlated = correlated
        self._law, self._disc, self._shared = (Mean(correlated) for _ in range(3))
        self._last = self._common = 0.0  # variances of the step in the last frame, and by places

    def update(
        self,
        after: Complex[np.ndarray, " n"],
        stick: Bool[np.ndarray, " n"],
        law: Angle,
        disc: Angle,
        noise: float,
        known: float,
    ) -> tuple[Angle, Angle]:
        """The angles of the next frame by the law and by the disc, averaged.

        Args:
            after: positions now [mm].
            stick: markers that have stuck since the turn.
            law: angle by the law, from this frame.
            disc: angle by markers that have never slipped, from this frame.
            noise: noise per coordinate [mm].
            known: share of the law's variance that is common to all frames (`LawFit.known`) [-].
        """
        stick = stick & np.isfinite(self._places + after)
        places, now, frames = self._places[stick], after[stick], self._frames[stick]
        step, error = fit_turn(places, now, noise)
        if not np.sqrt(2.0) * error < law.error:
            return law, disc
        # noise of the places is common to all frames, and differs as fewer markers stick
        share = min(self._correlated / frames.mean(), 1.0)
        self._common += share * max(error**2 - self._last, 0.0)
        self._last = error**2
        shared = self._shared.add(Angle(self._common, law.error)).value
        step_error = np.sqrt(error**2 + max(self._common - shared, 0.0))
        self._frames[stick] += 1.0
        turned_back = places.mean() + (now - now.mean()) * np.exp(-1j * step)
        self._places[stick] += (turned_back - places) / self._frames[stick]
        law, disc = (
            Angle(mean.value + step, mean.error).widen(step_error)
            for mean in (
                self._law.add(Angle(law.value - step, law.error), known),
                self._disc.add(Angle(disc.value - step, disc.error)),
            )
        )
        return law, disc


def correct_law(law: Angle, fitted: float, discrepancy: float, disc: Angle) -> tuple[Angle, float]:
    """The law's angle, corrected by the markers that have never slipped, and its own share in it.

    The difference of both angles shows what the law leaves out. Its noise has the difference of
    both variances, since the law is fitted to these markers too.

    Args:
        law: angle by the law.
        fitted: its standard error by the noise of the fit [rad].
        discrepancy: its standard error by what it leaves out [rad].
        disc: angle by these markers.
    """
    share = 1.0
    if np.isfinite(disc.value):
        more = max(disc.error**2 - fitted**2, 0.0)
        share = more / (more + discrepancy**2)
        law = law._replace(value=share * law.value + (1.0 - share) * disc.value)
    return law.widen(discrepancy * np.sqrt(share)), share
