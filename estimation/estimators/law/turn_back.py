"""The angle of an object that has turned back, from all frames since its turn.

The law of friction gives the angle of one frame, whose noise is that of the few markers that have
never slipped. After the turn many more markers stick again. They give precisely how far the object
has turned since, so that all frames together give the places of the markers at the turn. The turn
of those that have never slipped is the angle without the law, and shows by how much the law is
wrong. The law's angles at the turn are averaged. The error of what was known of the contact at the
turn is not, since all frames share it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.body import is_noise
from estimation.estimators.law.settings import LawSettings
from estimation.estimators.measurement import Z95
from estimation.fields.plane import fit_motion
from estimation.fields.stick import MIN_STICK_MARKERS


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


def fit_disc(
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    noise: Float[np.ndarray, " n"],
    places: Float[np.ndarray, " n"],
    settings: LawSettings = LawSettings(),
) -> tuple[Bool[np.ndarray, " n"], Angle]:
    """Rotation of the largest inner part of a disc that turns as one body.

    The outer markers of a disc slip first where it is not round, or smaller than the law has it.
    They count as long as noise explains their misfit and their turn against the inner ones.

    Args:
        before: positions before [mm].
        after: positions after [mm].
        noise: noise of each marker per coordinate [mm].
        places: distances from the centre, over the disc's radius [-].
        settings: how far the inner part reaches, and the error by hidden slip.

    Returns:
        The markers and their angle, which is unknown if the inner part has fewer than three.
    """
    known = np.isfinite(before + after)

    def fit(reach: float) -> tuple[Bool[np.ndarray, " n"], Angle, bool]:
        part = known & (places < reach)
        if part.sum() < MIN_STICK_MARKERS:
            return part, Angle(np.nan, np.inf), False
        x, y, weights = before[part], after[part], noise[part] ** -2.0
        motion = fit_motion(x, y, weights)
        error = float(weights @ np.abs(x - motion.origin) ** 2) ** -0.5
        alike = is_noise(np.abs(motion.residual(x, y)) / noise[part])
        return part, Angle(motion.angle, error), alike

    markers, inner, _ = fit(settings.firmly)
    angle = inner
    for reach in np.arange(settings.firmly + 0.05, 1.0, 0.05):
        wider, turned, alike = fit(float(reach))
        gained = np.sqrt(max(inner.error**2 - turned.error**2, 0.0))
        if not (alike and abs(turned.value - inner.value) <= Z95 * gained):
            break
        markers, angle = wider, turned.widen(settings.hidden * gained)
    return markers, angle


class TurnBack:
    """Follows an object since its turn."""

    def __init__(
        self,
        positions: Complex[np.ndarray, " n"],
        correlated: float,
        settings: LawSettings = LawSettings(),
    ) -> None:
        """Begin at the turn, with the positions of the markers then [mm] (see `Mean`)."""
        self._places, self._frames = positions.copy(), np.ones(len(positions))
        self._correlated, self._settings = correlated, settings
        self._law = Mean(correlated)

    def update(
        self,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        held: Float[np.ndarray, " n"],
        stick: Float[np.ndarray, " n"],
        law: Angle,
        noise: float,
        known: float,
    ) -> tuple[Angle, Angle]:
        """The angles of the next frame by the law, averaged, and by the disc that never slipped.

        Args:
            before: unloaded positions [mm].
            after: positions now [mm].
            held: distances from the centre over the radius of the disc that has never slipped [-].
            stick: the same for the disc that has stuck since the turn [-].
            law: angle by the law, from this frame.
            noise: noise per coordinate [mm].
            known: share of the law's variance that is common to all frames (`LawFit.known`) [-].
        """
        seen = np.full(len(after), noise)
        uncertain = np.hypot(seen, self._spread(noise))
        markers, step = fit_disc(self._places, after, uncertain, stick, self._settings)
        if not np.sqrt(2.0) * step.error < law.error:
            return law, fit_disc(before, after, seen, held, self._settings)[1]
        places, now = self._places[markers], after[markers]
        self._frames[markers] += 1.0
        turned_back = places.mean() + (now - now.mean()) * np.exp(-1j * step.value)
        self._places[markers] += (turned_back - places) / self._frames[markers]
        mean = self._law.add(Angle(law.value - step.value, law.error), known)
        spread = self._spread(noise)
        disc = fit_disc(before, self._places, spread, held, self._settings)[1]
        law, disc = (
            Angle(angle.value + step.value, angle.error).widen(step.error) for angle in (mean, disc)
        )
        return law, disc

    def _spread(self, noise: float) -> Float[np.ndarray, " n"]:
        """Noise of the markers' places on the object, from the noise of one frame [mm]."""
        return noise * np.sqrt(np.minimum(self._correlated / self._frames, 1.0))


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
    law = law.widen(discrepancy * np.sqrt(share))
    return (disc, 0.0) if disc.error < law.error else (law, share)
