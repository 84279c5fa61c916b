"""A line through points with errors in both variables, robustly, with clocks that may be apart.

[York2004] D. York et al., "Unified equations for the slope, intercept, and standard errors of the
best straight line", Am. J. Phys. 72 (2004): the functional relation, which treats the true
rotations as unknown numbers. Least squares of the reference over the rotation would read the slope
low by the share that the rotation's error has in its variance.
[Huber1981] P. J. Huber, "Robust Statistics", Section 7.6: the covariance of an M-estimate.
[Beaton1974] A. E. Beaton, J. W. Tukey, Technometrics 16 (1974): the weights.

The line is reference = slope · rotation + columns · coefficients, in trials of their own clocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

BIWEIGHT_CUT = 4.685
"""95 % efficiency for normal errors ([Beaton1974])."""

MAX_STEPS = 60
HUBER_STEPS = 5
SEARCH_STEPS = 61
_CORRELATED = 1.645  # standard errors of a correlation that white noise exceeds in 5 %
_LEAST_POINTS = 8  # of a trial that tells a correlation


class Series(NamedTuple):
    """One trial's points, by the reference's readings.

    Attributes:
        time: of the readings, since the trial's first frame [s].
        reference: the object's angle [rad].
        reference_error: standard error of the reading [rad]; NaN where unknown.
        frame_time: of the frames, since the first [s].
        rotation: φ in the frames [rad].
        rotation_error: standard error of φ [rad].
        search: how far the clocks may be apart [s]; 0 where they are one.
    """

    time: Float[np.ndarray, " readings"]
    reference: Float[np.ndarray, " readings"]
    reference_error: Float[np.ndarray, " readings"]
    frame_time: Float[np.ndarray, " frames"]
    rotation: Float[np.ndarray, " frames"]
    rotation_error: Float[np.ndarray, " frames"]
    search: float


class Points(NamedTuple):
    """All readings that have a rotation, at given clock offsets.

    Attributes:
        rotation: φ [rad].
        rate: dφ/dt [rad/s].
        rotation_error: [rad].
        reference: [rad].
        reference_error: [rad]; NaN where unknown.
        trial: number of the trial.
        time: of the frames' clock [s].
    """

    rotation: Float[np.ndarray, " points"]
    rate: Float[np.ndarray, " points"]
    rotation_error: Float[np.ndarray, " points"]
    reference: Float[np.ndarray, " points"]
    reference_error: Float[np.ndarray, " points"]
    trial: Int[np.ndarray, " points"]
    time: Float[np.ndarray, " points"]


@dataclass(frozen=True)
class Line:
    """The line, and how well it is known.

    Attributes:
        slope: [-].
        coefficients: of the columns [rad].
        clock_offsets: reference's clock less the recording's, by trial [s].
        covariance: of slope, coefficients and the clock offsets that were free.
        freedom: independent points less parameters.
        scale: standard deviation of a residual over its expected error [-], or of the residual
            itself where no reference error is known [rad].
        found_error: error of readings whose own is not known [rad]; NaN if all are known.
        independent: number of independent points.
        points: what was fitted.
        residual: reference minus line [rad].
        weight: of each point, 0 for an outlier.
        length: points over which the residual is correlated [-].
    """

    slope: float
    coefficients: Float[np.ndarray, " columns"]
    clock_offsets: Float[np.ndarray, " trials"]
    covariance: Float[np.ndarray, "parameters parameters"]
    freedom: float
    scale: float
    found_error: float
    independent: float
    points: Points
    residual: Float[np.ndarray, " points"]
    weight: Float[np.ndarray, " points"]
    length: float


def gather_points(series: Sequence[Series], clock_offsets: Float[np.ndarray, " trials"]) -> Points:
    """The readings that fall between frames, with the rotation interpolated to them.

    The rotation is interpolated, not the reference: it is the less noisy of the two. Readings in
    gaps of more than three frame intervals have none.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    for number, (one, offset) in enumerate(zip(series, clock_offsets, strict=True)):
        at = one.time - offset
        step = np.diff(one.frame_time)
        left = np.clip(np.searchsorted(one.frame_time, at) - 1, 0, len(step) - 1)
        inside = (at >= one.frame_time[0]) & (at <= one.frame_time[-1])
        inside &= (step[left] <= 3.0 * np.median(step)) & np.isfinite(one.reference)
        rate = np.gradient(one.rotation, one.frame_time)
        found = (
            np.interp(at, one.frame_time, one.rotation),
            np.interp(at, one.frame_time, rate),
            np.interp(at, one.frame_time, one.rotation_error),
            one.reference,
            one.reference_error,
            np.full(len(at), number),
            at,
        )
        parts.append(tuple(value[inside] for value in found))
    return Points(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def fit_line(
    series: Sequence[Series],
    columns: "Columns",
    clock_offsets: Float[np.ndarray, " trials"],
) -> Line:
    """Fit the line by iteratively reweighted Gauss–Newton steps, from clock offsets near the truth.

    Args:
        series: the trials.
        columns: what stands beside the slope, at given points.
        clock_offsets: to start from; those with a search of 0 stay.
    """
    free = np.array([one.search > 0.0 for one in series])
    offsets = np.array(clock_offsets, dtype=float)
    points = gather_points(series, offsets)
    design = columns(points)
    slope, coefficients, found_error = 1.0, np.zeros(design.shape[1]), np.nan
    weight = np.ones(len(points.rotation))
    for step in range(MAX_STEPS):
        if step and free.any():
            points = gather_points(series, offsets)
            design = columns(points)
        error = total_error(points, slope, found_error)
        residual = points.reference - slope * points.rotation - design @ coefficients
        scaled = residual / error
        scale = _spread(scaled) if step else _spread(scaled, least=1e-12)
        weight = _weights(scaled / scale, huber=step < HUBER_STEPS)
        # [York2004]: the slope's column is the adjusted rotation
        adjusted = points.rotation + slope * points.rotation_error**2 * residual / error**2
        jacobian = _jacobian(points, adjusted, design, slope, free) / error[:, None]
        left = jacobian.T @ (weight[:, None] * jacobian)
        change = np.linalg.pinv(left, rcond=1e-13) @ (jacobian.T @ (weight * scaled))
        slope += float(change[0])
        coefficients = coefficients + change[1 : 1 + design.shape[1]]
        offsets[free] += change[1 + design.shape[1] :]
        found_error = _reference_error(points, residual, slope, weight)
        if step > HUBER_STEPS + 1 and np.abs(change).max() < 1e-7 * max(1.0, abs(slope)):
            break
    return _describe(series, columns, slope, coefficients, offsets, found_error)


class Columns:
    """What stands beside the slope: a column for each coefficient, at each point."""

    def __init__(
        self,
        group: Int[np.ndarray, " trials"],
        factor: Float[np.ndarray, " trials"],
    ) -> None:
        """Make the columns.

        Args:
            group: number of each trial's column; −1 for none.
            factor: by which the coefficient counts in each trial.
        """
        self.group, self.factor = group, factor
        self.count = int(self.group.max(initial=-1)) + 1

    def __call__(self, points: Points) -> Float[np.ndarray, "points columns"]:
        """The columns at the points."""
        group = self.group[points.trial]
        picked = group[:, None] == np.arange(self.count)
        return picked * self.factor[points.trial][:, None]


def find_clock_offset(one: Series) -> float:
    """The clock offset at which a line fits one trial best, by search [s]."""
    if one.search == 0.0:
        return 0.0
    candidates = np.linspace(-one.search, one.search, SEARCH_STEPS)
    most = max(len(gather_points([one], np.array([c])).rotation) for c in candidates)
    best, cost = 0.0, np.inf
    still = one._replace(search=0.0)
    for candidate in candidates:
        points = gather_points([still], np.array([candidate]))
        if len(points.rotation) < 0.6 * most:
            continue
        design = np.stack([points.rotation, np.ones(len(points.rotation))], axis=1)
        weight = np.ones(len(design))
        residual = weight
        for _ in range(5):  # least absolute deviations
            weighted = weight[:, None] * design
            found = np.linalg.pinv(design.T @ weighted) @ (weighted.T @ points.reference)
            residual = points.reference - design @ found
            weight = 1.0 / np.maximum(np.abs(residual), 1e-6)
        if (mean := float(np.abs(residual).mean())) < cost:
            best, cost = float(candidate), mean
    return best


def _describe(
    series: Sequence[Series],
    columns: Columns,
    slope: float,
    coefficients: np.ndarray,
    offsets: np.ndarray,
    found_error: float,
) -> Line:
    """The line at its solution, with the covariance of an M-estimate of correlated points."""
    free = np.array([one.search > 0.0 for one in series])
    points = gather_points(series, offsets)
    design = columns(points)
    error = total_error(points, slope, found_error)
    residual = points.reference - slope * points.rotation - design @ coefficients
    scaled = residual / error
    scale = _spread(scaled)
    weight = _weights(scaled / scale)
    adjusted = points.rotation + slope * points.rotation_error**2 * residual / error**2
    jacobian = _jacobian(points, adjusted, design, slope, free) / error[:, None]
    length = _correlated_length(np.where(weight > 0, scaled, 0.0), points.trial)
    parameters = jacobian.shape[1]
    independent = float((weight > 0).sum() / length)
    freedom = max(independent - parameters, 1.0)
    cut = scaled / (BIWEIGHT_CUT * scale)
    slope_of_psi = np.where(weight > 0, (1.0 - cut**2) * (1.0 - 5.0 * cut**2), 0.0)
    psi = scaled * weight
    # [Huber1981]: K² [Σψ²/(n−p)] / [mean ψ′]² (XᵀX)⁻¹, with the number of independent points
    gain = max(float(slope_of_psi.mean()), 0.05)
    bend = 1.0 + parameters / independent * float(slope_of_psi.var()) / gain**2
    inner = float(np.mean(psi**2)) * independent / freedom * (bend / gain) ** 2
    left = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    covariance = inner * length * left
    return Line(
        slope=slope,
        coefficients=coefficients,
        clock_offsets=offsets,
        covariance=covariance,
        freedom=freedom,
        scale=scale,
        found_error=found_error,
        independent=independent,
        points=points,
        residual=residual,
        weight=weight,
        length=length,
    )


def _jacobian(
    points: Points,
    adjusted: Float[np.ndarray, " points"],
    design: Float[np.ndarray, "points columns"],
    slope: float,
    free: Bool[np.ndarray, " trials"],
) -> Float[np.ndarray, "points parameters"]:
    """Derivative of the line by slope, coefficients and free clock offsets."""
    clocks = (points.trial[:, None] == np.flatnonzero(free)) * (-slope * points.rate)[:, None]
    return np.concatenate([adjusted[:, None], design, clocks], axis=1)


def total_error(points: Points, slope: float, found: float) -> Float[np.ndarray, " points"]:
    """Error of reference minus slope · rotation; 1 where the scatter has to tell it first."""
    mine = np.where(np.isfinite(points.reference_error), points.reference_error, found)
    total = np.hypot(mine, slope * points.rotation_error)
    return np.where(np.isfinite(total), total, 1.0)


def _reference_error(
    points: Points, residual: np.ndarray, slope: float, weight: np.ndarray
) -> float:
    """Error of the readings whose own is not known: what the rotation's error leaves of them."""
    unknown = ~np.isfinite(points.reference_error)
    if not unknown.any():
        return float("nan")
    spread = _spread(residual[unknown], least=1e-9)
    mine = slope * float(np.median(points.rotation_error[unknown]))
    return float(np.sqrt(max(spread**2 - mine**2, (0.1 * spread) ** 2)))


def _spread(values: Float[np.ndarray, " points"], least: float = 1e-9) -> float:
    """Standard deviation of normal values, from the median deviation."""
    return max(1.4826 * float(np.median(np.abs(values))), least)


def _weights(
    scaled: Float[np.ndarray, " points"], *, huber: bool = False
) -> Float[np.ndarray, " points"]:
    """Tukey's biweight; Huber's weights, which have one minimum only, to start with."""
    if huber:
        return 1.345 / np.maximum(np.abs(scaled), 1.345)
    return np.clip(1.0 - (scaled / BIWEIGHT_CUT) ** 2, 0.0, None) ** 2


def _correlated_length(
    residual: Float[np.ndarray, " points"], trial: Int[np.ndarray, " points"]
) -> float:
    """Points that count as one: 1 + 2Σρ over the first lags that are clearly correlated.

    Of all trials together: one of twenty points would take its noise for correlation.
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
        # the fit has taken some correlation off: 1/n for each parameter of a trial
        rho = float(shared) / power + len(parts) / count
        if rho < _CORRELATED / np.sqrt(count):
            break
        length += 2.0 * rho
    return min(length, shortest / 4.0)
