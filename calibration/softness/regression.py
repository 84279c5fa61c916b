"""The regression of softness fits: a robust line through readings with errors in both variables.

[York2004] D. York et al., "Unified equations for the slope, intercept, and standard errors of the
best straight line", Am. J. Phys. 72 (2004): the functional relation, which treats the true
rotations as unknown numbers. Least squares of the reference over the rotation would underestimate
the slope by the share of the rotation's error in its variance.
[Huber1981] P. J. Huber, "Robust Statistics", Section 7.6: the covariance of an M-estimate.
[Beaton1974] A. E. Beaton, J. W. Tukey, Technometrics 16 (1974): the weights.

The line is reference = slope · rotation − load + columns · coefficients, where each trial may have
its own clock offset. The slope is 1 + k. `readings` gives the rotation and the load.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.softness.readings import HALF_SPACE, Layer, Points, Series, gather_points

BIWEIGHT_CUT = 4.685
"""95 % efficiency for normal errors ([Beaton1974])."""

MAX_STEPS = 60
HUBER_STEPS = 5
_CORRELATED = 1.645  # standard errors of a correlation that white noise exceeds in 5 % of cases
_LEAST_POINTS = 8  # smallest number of points of a trial for estimating a correlation


@dataclass(frozen=True)
class Line:
    """A fitted line and its uncertainty."""

    slope: float  # 1 + k [-]
    coefficients: Float[np.ndarray, " columns"]  # coefficients of the columns [rad]
    # the reference's clock minus the recording's, by trial [s]
    clock_offsets: Float[np.ndarray, " trials"]
    layer: Layer  # the elastomer with its fitted numbers
    # covariance of slope, coefficients, fitted clock offsets and fitted numbers of the layer
    covariance: Float[np.ndarray, "parameters parameters"]
    freedom: float  # number of independent points minus number of parameters
    # standard deviation of a residual over its expected error [-], or of the residual itself if no
    # reference error is known [rad]
    scale: float
    # estimated error of readings without a stated error [rad]; NaN if all have one
    found_error: float
    independent: float  # number of independent points
    points: Points  # fitted points
    residual: Float[np.ndarray, " points"]  # reference minus line [rad]
    weight: Float[np.ndarray, " points"]  # weight of each point, 0 for an outlier [-]
    length: float  # number of points over which the residual is correlated [-]


class Problem(NamedTuple):
    """Trials, columns in addition to the rotation, and prior knowledge of the elastomer."""

    series: Sequence[Series]
    columns: "Columns"
    layer: Layer = HALF_SPACE


class _State(NamedTuple):
    """The line during the iteration."""

    slope: float
    coefficients: Float[np.ndarray, " columns"]
    offsets: Float[np.ndarray, " trials"]
    layer: Layer

    def moved(self, change: np.ndarray, clocks: np.ndarray, numbers: np.ndarray) -> "_State":
        """The state after a step of slope, coefficients, free clock offsets and free numbers."""
        parts = np.split(change, np.cumsum([1, len(self.coefficients), clocks.sum()]))
        offsets, values = self.offsets.copy(), self.layer.values
        offsets[clocks] += parts[2]
        values[numbers] += parts[3]
        layer = self.layer.at(values) if numbers.any() else self.layer
        slope = self.slope + float(parts[0][0])
        return _State(slope, self.coefficients + parts[1], offsets, layer)


class _Residual(NamedTuple):
    """Residuals of a line, also scaled by their errors, and their derivatives by its parameters."""

    points: Points
    plain: Float[np.ndarray, " points"]
    scaled: Float[np.ndarray, " points"]
    jacobian: Float[np.ndarray, "points parameters"]


def _residual(problem: Problem, state: _State, found_error: float) -> _Residual:
    """Residuals and derivatives; [York2004]: the slope's column is the adjusted rotation.

    The column of a clock is adjusted in the same way, because the rotation's error depends on the
    clock: both are derivatives of residual²/(2 error²) that include the error's. Readings without
    weight adjust their rotation as those do that just have some.
    """
    points = gather_points(problem.series, state.offsets, state.layer)
    design = problem.columns(points)
    slope, clocks = state.slope, _free_clocks(problem)
    line = slope * points.rotation - points.load + design @ state.coefficients
    residual = points.reference - line
    error = total_error(points, slope, found_error)
    far = BIWEIGHT_CUT * measure_spread(residual / error)
    scaled = np.clip(residual / error, -far, far)
    columns = [points.rotation + slope * points.rotation_error**2 * scaled / error, *design.T]
    shift = -slope * (points.rate + 0.5 * slope * points.variance_rate * scaled / error)
    columns += [shift * (points.trial == trial) for trial in np.flatnonzero(clocks)]
    for number in np.flatnonzero(problem.layer.errors):
        step = 1e-3 * (1.0 + abs(state.layer.values[number])) * np.eye(2)[number]
        ends = [
            gather_points(problem.series, state.offsets, state.layer.at(state.layer.values + shift))
            for shift in (step, 0.0 * step)
        ]
        first, last = (slope * end.rotation - end.load for end in ends)
        columns.append((first - last) / step.sum())
    jacobian = np.stack(columns, axis=1) / error[:, None]
    return _Residual(points, residual, residual / error, jacobian)


def _free_clocks(problem: Problem) -> Bool[np.ndarray, " trials"]:
    """Trials whose clock offset is fitted."""
    return np.array([trial.search > 0.0 for trial in problem.series])


def _clock_columns(problem: Problem) -> slice:
    """Columns of the Jacobian that belong to fitted clock offsets."""
    first = 1 + problem.columns.count
    return slice(first, first + int(_free_clocks(problem).sum()))


def fit_line(problem: Problem, clock_offsets: Float[np.ndarray, " trials"]) -> Line:
    """Fit the line by iteratively reweighted Gauss–Newton steps, from clock offsets near the truth.

    Args:
        problem: trials, columns and prior knowledge of the elastomer.
        clock_offsets: initial clock offsets; those with a search of 0 are kept [s].
    """
    clocks, numbers = _free_clocks(problem), problem.layer.errors > 0.0
    offsets = np.array(clock_offsets, dtype=float)
    reach = np.where(clocks, [trial.search for trial in problem.series], np.inf)
    state = _State(
        _sense(problem, offsets), np.zeros(problem.columns.count), offsets, problem.layer
    )
    found_error = np.nan
    for step in range(MAX_STEPS):
        now = _residual(problem, state, found_error)
        if step < HUBER_STEPS:  # wrong readings would move the clocks before they lose their weight
            now.jacobian[:, _clock_columns(problem)] = 0.0
        scale = measure_spread(now.scaled) if step else measure_spread(now.scaled, least=1e-12)
        weight = _weights(now.scaled / scale, huber=step < HUBER_STEPS)
        prior, pull = _prior(problem.layer, state.layer, scale, now.jacobian.shape[1])
        information = now.jacobian.T @ (weight[:, None] * now.jacobian) + prior
        change = np.linalg.pinv(information, rcond=1e-13) @ (
            now.jacobian.T @ (weight * now.scaled) + pull
        )
        slope = state.slope + float(change[0])
        found_error = _reference_error(now.points, now.plain, slope)
        state = state.moved(change, clocks, numbers)
        state = state._replace(offsets=np.clip(state.offsets, -reach, reach))
        if step > HUBER_STEPS + 1 and np.abs(change).max() < 1e-7 * max(1.0, abs(state.slope)):
            break
    return _describe(problem, state, found_error)


def _sense(problem: Problem, clock_offsets: Float[np.ndarray, " trials"]) -> float:
    """1, or −1 if the reference turns against the rotation, by the sides of their medians.

    From a slope of the other sign the steps run to one without bounds, if errors are stated.
    """
    points = gather_points(problem.series, clock_offsets, problem.layer)
    same = 0.0
    for trial in np.unique(points.trial):
        pair = np.stack([points.rotation, points.reference])[:, points.trial == trial]
        same += np.prod(np.sign(pair - np.median(pair, axis=1, keepdims=True)), axis=0).sum()
    return -1.0 if same < 0.0 else 1.0


def _prior(
    before: Layer, now: Layer, scale: float, parameters: int
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Information of the prior and its pull on the parameters, for residuals of a scale."""
    free = before.errors > 0.0
    prior, pull = np.zeros((parameters, parameters)), np.zeros(parameters)
    if free.any():
        weight = (scale / before.errors[free]) ** 2
        prior[-len(weight) :, -len(weight) :] = np.diag(weight)
        pull[-len(weight) :] = weight * (before.values - now.values)[free]
    return prior, pull


class Columns:
    """Columns of the line in addition to the rotation, one for each coefficient."""

    def __init__(
        self,
        group: Int[np.ndarray, " trials"],
        factor: Float[np.ndarray, " trials"],
    ) -> None:
        """Make the columns.

        Args:
            group: number of each trial's column; −1 for none.
            factor: factor of the coefficient in each trial.
        """
        self.group, self.factor = group, factor
        self.count = int(self.group.max(initial=-1)) + 1

    def __call__(self, points: Points) -> Float[np.ndarray, "points columns"]:
        """The columns at the points."""
        group = self.group[points.trial]
        picked = group[:, None] == np.arange(self.count)
        return picked * self.factor[points.trial][:, None]


def _describe(problem: Problem, state: _State, found_error: float) -> Line:
    """The line at its solution, with the covariance of an M-estimate for correlated points."""
    now = _residual(problem, state, found_error)
    scaled, jacobian = now.scaled, now.jacobian
    scale = measure_spread(scaled)
    weight = _weights(scaled / scale)
    length = _correlated_length(np.where(weight > 0, scaled, 0.0), now.points.trial)
    prior, _ = _prior(problem.layer, state.layer, 1.0, jacobian.shape[1])
    parameters = jacobian.shape[1] - np.count_nonzero(np.diag(prior))
    independent = float((weight > 0).sum() / length)
    freedom = max(independent - parameters, 1.0)
    cut = scaled / (BIWEIGHT_CUT * scale)
    slope_of_psi = np.where(weight > 0, (1.0 - cut**2) * (1.0 - 5.0 * cut**2), 0.0)
    psi = np.hypot(scaled * weight, 1e-9)  # exact readings get a small error, too
    # [Huber1981]: K² [Σψ²/(n−p)] / [mean ψ′]² (XᵀX)⁻¹, with the number of independent points
    gain = max(float(slope_of_psi.mean()), 0.05)
    bend = 1.0 + parameters / independent * float(slope_of_psi.var()) / gain**2
    inner = float(np.mean(psi**2)) * independent / freedom * (bend / gain) ** 2
    each = inner * length
    return Line(
        slope=state.slope,
        coefficients=state.coefficients,
        clock_offsets=state.offsets,
        layer=state.layer,
        covariance=each * np.linalg.pinv(jacobian.T @ jacobian + each * prior, rcond=1e-14),
        freedom=freedom,
        scale=scale,
        found_error=found_error,
        independent=independent,
        points=now.points,
        residual=now.plain,
        weight=weight,
        length=length,
    )


def total_error(points: Points, slope: float, estimated: float) -> Float[np.ndarray, " points"]:
    """Error of reference minus slope · rotation; 1 until it is estimated from the scatter.

    Args:
        points: readings.
        slope: slope of the line [-].
        estimated: error of readings without a stated error; NaN before the first estimate [rad].
    """
    stated = np.where(np.isfinite(points.reference_error), points.reference_error, estimated)
    total = np.hypot(stated, slope * points.rotation_error)
    return np.where(np.isfinite(total), total, 1.0)


def _reference_error(points: Points, residual: np.ndarray, slope: float) -> float:
    """Error of readings without a stated error: their scatter without the rotation's error."""
    unknown = ~np.isfinite(points.reference_error)
    if not unknown.any():
        return float("nan")
    spread = measure_spread(residual[unknown], least=1e-9)
    by_rotation = slope * float(np.median(points.rotation_error[unknown]))
    return float(np.sqrt(max(spread**2 - by_rotation**2, (0.1 * spread) ** 2)))


def measure_spread(values: Float[np.ndarray, " points"], least: float = 1e-9) -> float:
    """Standard deviation of normally distributed values, from the median deviation."""
    return max(1.4826 * float(np.median(np.abs(values))), least)


def _weights(
    scaled: Float[np.ndarray, " points"], *, huber: bool = False
) -> Float[np.ndarray, " points"]:
    """Tukey's biweight; Huber's weights for the first steps, because they have a single minimum."""
    if huber:
        return 1.345 / np.maximum(np.abs(scaled), 1.345)
    return np.clip(1.0 - (scaled / BIWEIGHT_CUT) ** 2, 0.0, None) ** 2


def _correlated_length(
    residual: Float[np.ndarray, " points"], trial: Int[np.ndarray, " points"]
) -> float:
    """Correlation length in points: 1 + 2Σρ over the first lags with significant correlation.

    It is estimated from all trials together, because noise looks like correlation in a single trial
    of twenty points.
    """
    parts = [residual[trial == number] for number in np.unique(trial)]
    parts = [part for part in parts if len(part) >= _LEAST_POINTS]
    power = float(sum(part @ part for part in parts))
    if power == 0.0:
        return 1.0
    count, shortest = sum(map(len, parts)), min(map(len, parts))
    length = 1.0
    for lag in range(1, shortest // 3):
        shared = sum(part[lag:] @ part[:-lag] * len(part) / (len(part) - lag) for part in parts)
        # the fit has reduced the correlation by 1/n for each parameter of a trial
        rho = float(shared) / power + len(parts) / count
        if rho < _CORRELATED / np.sqrt(count):
            break
        length += 2.0 * rho
    return min(length, shortest / 4.0)
