"""A common slope for several grasps that may disagree.

[DerSimonian1986] R. DerSimonian, N. Laird, "Meta-analysis in clinical trials", for the scatter
between grasps; [Hartung2001] J. Hartung, G. Knapp, Statistics in Medicine 20, for its interval.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from calibration.softness.regression import Line
from calibration.softness.trials import Trial

SCATTER_LEVEL = 0.02
"""p-value of the disagreement below which grasps count as unequal."""


class Slope(NamedTuple):
    """Common slope of trials."""

    value: float  # slope [-]
    variance: float  # variance of the slope [-]
    freedom: float  # degrees of freedom
    scatter: float  # standard deviation between trials beyond their errors [-]
    p_value: float  # p-value of the disagreement between trials [-]


def combine_slopes(trials: Sequence[Trial], single: Sequence[Line], line: Line) -> Slope:
    """The common slope; if trials or objects disagree, the mean of their scattered slopes."""
    common = Slope(line.slope, float(line.covariance[0, 0]), line.freedom, 0.0, float("nan"))
    names = sorted({trial.object_name for trial in trials})
    pairs = list(zip(single, trials, strict=True))
    parts = [
        _average([alone for alone, trial in pairs if trial.object_name == name]) for name in names
    ]
    whole = parts[0] if len(parts) == 1 else _average(parts)
    if any(part.scatter for part in (*parts, whole)):
        return whole
    return common._replace(p_value=whole.p_value)


def _average(parts: Sequence[Line | Slope]) -> Slope:
    """Mean of slopes, with random effects if they disagree ([DerSimonian1986], [Hartung2001])."""
    slopes = np.array([part.slope if isinstance(part, Line) else part.value for part in parts])
    variances = np.array(
        [part.covariance[0, 0] if isinstance(part, Line) else part.variance for part in parts]
    )
    count = len(slopes)
    freedom = float(np.sum([part.freedom for part in parts]))
    weight = 1.0 / variances
    mean = float(weight @ slopes / weight.sum())
    if count == 1:
        return Slope(mean, float(variances[0]), freedom, 0.0, float("nan"))
    disagreement = float(weight @ (slopes - mean) ** 2)
    p_value = float(scipy.stats.chi2.sf(disagreement, count - 1))
    if p_value >= SCATTER_LEVEL:
        return Slope(mean, float(1.0 / weight.sum()), freedom, 0.0, p_value)
    excess = disagreement - (count - 1)
    between = excess / float(weight.sum() - (weight**2).sum() / weight.sum())
    weight = 1.0 / (variances + between)
    mean = float(weight @ slopes / weight.sum())
    variance = float(weight @ (slopes - mean) ** 2 / ((count - 1) * weight.sum()))
    return Slope(mean, variance, count - 1.0, float(np.sqrt(max(between, 0.0))), p_value)
