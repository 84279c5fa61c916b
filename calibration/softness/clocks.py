"""The clocks of a reference and a recording: the search for their offset, and a check of it."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from calibration.softness.readings import HALF_SPACE, Layer, Points, Series, gather_points
from calibration.softness.references import OUTLINES
from calibration.softness.regression import BIWEIGHT_CUT, Line, Problem, fit_line, measure_spread
from calibration.softness.trials import Trial

SEARCH_STEPS = 61

BETTER = 0.3
"""Share of the residual at which another clock offset is reported. With eight readings chance does
as much in one of a thousand grasps (F-test of one number, five degrees of freedom)."""

CERTAIN = 3.0
"""Standard errors of a clock offset that is reported."""


def find_clock_offset(trial: Series, layer: Layer = HALF_SPACE) -> float:
    """Search for the clock offset at which a line fits a trial best [s].

    A residual counts at most as the largest that noise and the steps of the search explain, so that
    wrong readings do not decide, nor which readings fall between frames.
    """
    if trial.search == 0.0:
        return 0.0
    candidates = np.linspace(-trial.search, trial.search, SEARCH_STEPS)
    parts = [gather_points([trial], np.array([offset]), layer) for offset in candidates]
    least = 0.6 * max(len(points.rotation) for points in parts)
    fits = {
        float(offset): _fit_roughly(points)
        for offset, points in zip(candidates, parts, strict=True)
        if len(points.rotation) >= max(least, 1.0)
    }
    if not fits:
        return 0.0
    half_a_step = trial.search / (SEARCH_STEPS - 1)
    noise, rate = min((measure_spread(off), rate) for off, rate in fits.values())
    bound = BIWEIGHT_CUT * noise + half_a_step * rate
    return min(fits, key=lambda offset: np.minimum(fits[offset][0], bound).mean())


def _fit_roughly(points: Points) -> tuple[Float[np.ndarray, " points"], float]:
    """Residuals of a line of least absolute deviations [rad], and its largest rate [rad/s]."""
    design = np.stack([points.rotation, np.ones(len(points.rotation))], axis=1)
    turned = points.reference + points.load
    line, residual = np.zeros(2), np.ones(len(turned))
    for _ in range(5):
        weighted = design / np.maximum(np.abs(residual), 1e-6)[:, None]
        line = np.linalg.pinv(design.T @ weighted) @ (weighted.T @ turned)
        residual = turned - design @ line
    return np.abs(residual), float(np.abs(line[0] * points.rate).max())


def check_clocks(
    trials: Sequence[Trial], alone: Sequence[Problem], lines: Sequence[Line], search: float
) -> Iterator[str]:
    """Remarks on trials that fit much better with an offset between clocks that count as one.

    Args:
        trials: trials with their references.
        alone: each trial alone.
        lines: their fits.
        search: largest offset to try [s].
    """
    for trial, problem, line in zip(trials, alone, lines, strict=True):
        (series,) = problem.series
        if series.search > 0.0 or search == 0.0 or trial.reference.source in OUTLINES:
            continue
        free = problem._replace(series=[series._replace(search=search)])
        other = fit_line(free, np.array([find_clock_offset(free.series[0], problem.layer)]))
        offset, variance = float(other.clock_offsets[0]), float(other.covariance[-1, -1])
        error = np.sqrt(variance) if variance > 0.0 else np.inf  # too few readings for an offset
        before, after = (float(np.mean(np.abs(fit.residual))) for fit in (line, other))
        if after < BETTER * before and CERTAIN * error < abs(offset) < 0.97 * search:
            yield (
                f"{trial.name}: the reference fits better with times {abs(offset):.2g} s "
                f"{'earlier' if offset > 0.0 else 'later'}, with residuals of "
                f"{np.degrees(after):.2g}° in place of {np.degrees(before):.2g}°: leave out "
                "--same-clock if the clocks differ, or correct the times"
            )
