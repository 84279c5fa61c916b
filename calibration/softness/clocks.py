"""The clocks of a reference and a recording: the search for their offset, and a check of it."""

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.softness.readings import HALF_SPACE, Layer, Series, gather_points
from calibration.softness.references import OUTLINES, median_of_three
from calibration.softness.regression import Line, Problem, fit_line
from calibration.softness.trials import Trial

SEARCH_STEPS = 61

BETTER = 0.3
"""Share of the residual at which another clock offset is reported. With eight readings chance does
as much in one of a thousand grasps (F-test of one number, five degrees of freedom)."""

CERTAIN = 3.0
"""Standard errors of a clock offset that is reported."""


def find_clock_offset(trial: Series, layer: Layer = HALF_SPACE) -> float:
    """Search for the clock offset at which a line fits a trial best [s].

    A wrong reading counts at most as the range of the others, so that it does not decide which
    readings fall between frames.
    """
    if trial.search == 0.0:
        return 0.0
    candidates = np.linspace(-trial.search, trial.search, SEARCH_STEPS)
    most = max(len(gather_points([trial], np.array([c]), layer).rotation) for c in candidates)
    best, cost = 0.0, np.inf
    known = np.isfinite(trial.reference)
    reference = median_of_three(trial.reference[known])
    still = trial._replace(
        search=0.0,
        time=trial.time[known],
        reference=reference,
        reference_error=trial.reference_error[known],
    )
    most_off = float(np.ptp(np.percentile(reference, [5.0, 95.0])))
    for candidate in candidates:
        points = gather_points([still], np.array([candidate]), layer)
        if len(points.rotation) < 0.6 * most:
            continue
        design = np.stack([points.rotation, np.ones(len(points.rotation))], axis=1)
        turned = points.reference + points.load
        weight = np.ones(len(design))
        residual = weight
        for _ in range(5):  # least absolute deviations
            weighted = weight[:, None] * design
            coefficients = np.linalg.pinv(design.T @ weighted) @ (weighted.T @ turned)
            residual = turned - design @ coefficients
            weight = 1.0 / np.maximum(np.abs(residual), 1e-6)
        if (mean := float(np.minimum(np.abs(residual), most_off).mean())) < cost:
            best, cost = float(candidate), mean
    return best


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
        offset, error = float(other.clock_offsets[0]), float(np.sqrt(other.covariance[-1, -1]))
        before, after = (float(np.mean(np.abs(fit.residual))) for fit in (line, other))
        if after < BETTER * before and CERTAIN * error < abs(offset) < 0.97 * search:
            yield (
                f"{trial.name}: the reference fits better with times {abs(offset):.2g} s "
                f"{'earlier' if offset > 0.0 else 'later'}, with residuals of "
                f"{np.degrees(after):.2g}° in place of {np.degrees(before):.2g}°: leave out "
                "--same-clock if the clocks differ, or correct the times"
            )
