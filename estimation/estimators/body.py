"""A body of markers that move alike: a robust fit of its motion.

[Beaton1974] A. E. Beaton, J. W. Tukey, "The fitting of power series, meaning polynomials,
illustrated on band-spectroscopic data", for the weights.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.special import chdtri

from estimation.fields.plane import Motion, fit_motion

CORE_MARKERS = 9
"""Number of markers about the stick centre from which a fit starts: three rows of three."""
BIWEIGHT_CUT = 5.0
"""Residual from which a marker has no weight [noise or misfit per coordinate]."""
BIWEIGHT_ERROR = 0.950
"""Standard error over that of an unweighted fit, times the square root of the mean weight [-].

For two normal coordinates and a cut at 5 standard deviations, by quadrature; a test repeats it."""


class Body(NamedTuple):
    """Markers that move as one body: their weights, 0 for all others, and their motion."""

    weights: Float[np.ndarray, " m"]
    motion: Motion

    def information(self, x: Complex[np.ndarray, " m"]) -> float:
        """Weighted sum of the squared distances from their centre [mm²]."""
        return float(self.weights @ np.abs(x - self.motion.origin) ** 2)

    def influence(
        self, x: Complex[np.ndarray, " m"], segment: Bool[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Change of the angle by a slip of each marker of the layout [rad/mm]."""
        influence = np.zeros(len(segment))
        influence[segment] = self.weights * np.abs(x - self.motion.origin) / self.information(x)
        return influence

    def take_inner_half(self, x: Complex[np.ndarray, " m"], y: Complex[np.ndarray, " m"]) -> "Body":
        """The half of the markers nearest to their centre, with a motion of its own."""
        distance = np.abs(x - self.motion.origin)
        weights = self.weights * (distance <= np.median(distance[self.weights > 0]))
        return Body(weights, fit_motion(x, y, weights))


def fit_body(
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    segment: Bool[np.ndarray, " n"],
    centre: int,
    noise_mm: float,
) -> tuple[Body, float]:
    """The body of a segment around a marker, and its noise or misfit [mm]."""
    x, y = before[segment], after[segment]
    core, scale = _fit_core(x, y, np.abs(x - before[centre]), noise_mm)
    return _reweight(x, y, core, scale), scale


def _fit_core(
    x: Complex[np.ndarray, " m"],
    y: Complex[np.ndarray, " m"],
    distance: Float[np.ndarray, " m"],
    noise_mm: float,
) -> tuple[Body, float]:
    """The body of the markers nearest the stick centre, and its noise or misfit [mm].

    It is the largest of several cores whose misfit the noise explains, since the stick region may
    be smaller than nine markers. Where the noise explains none, the nine nearest give the misfit.

    Args:
        x: positions before [mm].
        y: positions now [mm].
        distance: distance of each marker from the stick centre [mm].
        noise_mm: noise per coordinate of the motion [mm]; 0 if unknown.
    """
    sizes = (CORE_MARKERS, 7, 5, 4)  # numbers of markers of the cores that are tried
    ranked, cores = np.sort(distance), list[tuple[Body, float]]()
    for size in sizes:
        weights = (distance <= ranked[:size][-1]).astype(float)
        body = Body(weights, fit_motion(x, y, weights))
        cores.append((body, noise_or_misfit(body.motion.residual(x, y)[weights > 0], noise_mm)))
        if cores[-1][1] <= noise_mm:
            return cores[-1]
    return cores[0]


def noise_or_misfit(residual: Complex[np.ndarray, " m"], noise_mm: float) -> float:
    """The noise, or the markers' misfit per coordinate if that is clearly larger [mm]."""
    freedom = max(2 * len(residual) - 4, 1)
    misfit = float(np.sum(np.abs(residual) ** 2))
    limit = largest_misfit(freedom) * noise_mm**2
    scale = noise_mm if misfit <= limit else float(np.sqrt(misfit / freedom))
    return max(scale, 1e-9)


def largest_misfit(freedom: int) -> float:
    """Sum of squared residuals over their variance that noise exceeds in 1 % of cases [-].

    It is χ² with these degrees of freedom, one or more.
    """
    return float(chdtri(freedom, 0.01))


def is_noise(deviations: Float[np.ndarray, " n"]) -> bool:
    """Whether noise explains how far markers deviate from one body's motion.

    Args:
        deviations: distance from the motion fitted to them over the noise per coordinate [-].
    """
    return bool(deviations @ deviations <= largest_misfit(2 * len(deviations) - 4))


def leave_out_slipping(
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    markers: Bool[np.ndarray, " n"],
    noise_mm: float,
    least: int,
) -> Bool[np.ndarray, " n"]:
    """Markers whose motion as one body the noise explains, without those that fit it worst.

    Args:
        before: positions before [mm].
        after: positions now [mm].
        markers: the markers to choose from.
        noise_mm: noise per coordinate of the motion [mm].
        least: number of markers below which the search ends, above two.
    """
    body = markers.copy()
    while body.sum() >= least:
        x, y = before[body], after[body]
        residual = np.abs(fit_motion(x, y).residual(x, y))
        if is_noise(residual / noise_mm):
            break
        body[np.flatnonzero(body)[np.argmax(residual)]] = False
    return body


def _reweight(
    x: Complex[np.ndarray, " m"], y: Complex[np.ndarray, " m"], core: Body, scale: float
) -> Body:
    """The body after iteratively reweighted least squares, which start from the core; in mm."""
    # change of the weights below which a fit has converged [-]: a thousandth of the standard error
    settled, body = 1e-4, core
    for _ in range(50):  # a few suffice
        residual = body.motion.residual(x, y)
        weights = np.maximum(1.0 - (np.abs(residual) / (BIWEIGHT_CUT * scale)) ** 2, 0.0) ** 2
        previous, body = body, Body(weights, fit_motion(x, y, weights))
        if np.abs(weights - previous.weights).max() < settled:
            break
    return body
