"""Two fingers that hold one object: their clocks, their difference, their joint angle.

Seen from its own sensor each finger turns the other way, so the second finger's angle is taken with
the opposite sign. Each counts from its own first frame, by its own clock: the offsets of clock and
angle are estimated from the angles themselves.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from estimation.estimators.measurement import Z95
from estimation.estimators.result import State, Track

LEAST_FRAMES = 10


class Fit(NamedTuple):
    """How the second finger's angle lies to the first's, by least squares.

    Attributes:
        slope: second over first angle [-].
        clock_offset: added to the second's time since its first frame it gives the first's [s].
        angle_offset: first angle minus slope-corrected second [rad].
        rms: of what is left [rad].
        errors: standard errors of slope, clock offset and angle offset; 0 where held fixed. From
            the scatter of what is left, taken as independent over the noise's three frames.
        correlation: of slope and clock offset [-]; 0 where the slope is fixed.
        frames: frames of the first finger compared.
    """

    slope: float
    clock_offset: float
    angle_offset: float
    rms: float
    errors: tuple[float, float, float]
    correlation: float
    frames: int


class Grasp(NamedTuple):
    """Both fingers on the first one's clock.

    Attributes:
        time: since the first finger's first frame [s].
        first: its angle [rad].
        second: the other's, sign and offsets taken off, slope 1 [rad]; NaN where it saw nothing.
        joint: mean of both, weighted by their intervals; of one where only one knows [rad].
        low: lower end of its 95 % interval [rad].
        high: upper end of its 95 % interval [rad].
        holds: frames in which neither finger is in macro slip.
        fixed: the fit with slope 1.
        free: the fit with the slope free.
    """

    time: Float[np.ndarray, " frames"]
    first: Float[np.ndarray, " frames"]
    second: Float[np.ndarray, " frames"]
    joint: Float[np.ndarray, " frames"]
    low: Float[np.ndarray, " frames"]
    high: Float[np.ndarray, " frames"]
    holds: Bool[np.ndarray, " frames"]
    fixed: Fit
    free: Fit


def compare_fingers(first: Track, second: Track) -> Grasp:
    """Bring two fingers' angles together; fitted where neither is in macro slip.

    Raises:
        ValueError: the two have too little time in common without macro slip.
    """
    fixed = _fit(first, second, free_slope=False)
    free = _fit(first, second, free_slope=True)
    time = first.time - first.time[0]
    there = time - fixed.clock_offset
    other = -_at(second, second.angle, there) + fixed.angle_offset
    half = np.stack([_half_width(first), _at(second, _half_width(second), there)])
    angles = np.stack([first.angle, other])
    offset_error = Z95 * fixed.errors[2]
    half[1] = np.hypot(half[1], offset_error)
    weight = np.where(np.isfinite(angles), 1.0 / np.maximum(half, 1e-6) ** 2, 0.0)
    total = weight.sum(axis=0)
    known = total > 0
    joint = np.full(len(time), np.nan)
    joint[known] = np.nansum(weight * np.nan_to_num(angles), axis=0)[known] / total[known]
    # what the two disagree about is doubt in their mean too
    spread = np.where(np.isfinite(angles).all(axis=0), 0.5 * np.abs(angles[0] - angles[1]), 0.0)
    width = np.full(len(time), np.nan)
    width[known] = np.hypot(1.0 / np.sqrt(total[known]), spread[known])
    return Grasp(
        time=time,
        first=first.angle,
        second=other,
        joint=joint,
        low=joint - width,
        high=joint + width,
        holds=_sticks(first) & (_at(second, _sticks(second).astype(float), there) == 1.0),
        fixed=fixed,
        free=free,
    )


def _fit(first: Track, second: Track, *, free_slope: bool) -> Fit:
    """Least squares over clock offset, angle offset and, if asked, slope; from several starts."""
    time = first.time - first.time[0]
    mine = np.where(_sticks(first), first.angle, np.nan)
    theirs = -np.where(_sticks(second), second.angle, np.nan)
    span = min(np.ptp(time), np.ptp(second.time))

    def residual(parameters: np.ndarray) -> np.ndarray:
        clock, offset, slope = parameters[0], parameters[1], 1.0
        if free_slope:
            slope = parameters[2]
        left = _at(second, theirs, time - clock) - slope * (mine - offset)
        return left[np.isfinite(left)]

    def cost(parameters: np.ndarray) -> float:
        left = residual(parameters)
        enough = len(left) >= max(LEAST_FRAMES, 0.4 * np.isfinite(mine).sum())
        return float(np.mean(left**2)) if enough else np.inf

    best = None
    for clock in np.arange(-0.5, 0.51, 0.02) * span:
        left = _at(second, theirs, time - clock) - mine
        start = np.array([clock, -np.nanmean(left) if np.isfinite(left).any() else 0.0])
        start = np.append(start, 1.0) if free_slope else start
        if np.isfinite(cost(start)) and (best is None or cost(start) < cost(best)):
            best = start
    if best is None:
        raise ValueError(
            f"the two recordings share fewer than {LEAST_FRAMES} frames without macro slip: "
            "their clocks cannot be brought together"
        )
    count = len(residual(best))

    def padded(parameters: np.ndarray) -> np.ndarray:
        left = np.full(len(time), 0.0)
        now = residual(parameters)
        left[: len(now)] = now * np.sqrt(count / max(len(now), 1))
        return left

    solution = least_squares(padded, best, x_scale=[0.1, 0.1, 0.1][: len(best)], diff_step=1e-4)
    left = residual(solution.x)
    rms = float(np.sqrt(np.mean(left**2)))
    covariance = np.linalg.pinv(solution.jac.T @ solution.jac) * 3.0 * rms**2
    errors = np.sqrt(np.diag(covariance))
    correlation = covariance[0, 2] / (errors[0] * errors[2]) if free_slope else 0.0
    return Fit(
        slope=float(solution.x[2]) if free_slope else 1.0,
        clock_offset=float(solution.x[0]),
        angle_offset=float(solution.x[1]),
        rms=rms,
        errors=(float(errors[2]) if free_slope else 0.0, float(errors[0]), float(errors[1])),
        correlation=float(correlation),
        frames=len(left),
    )


def _sticks(result: Track) -> Bool[np.ndarray, " frames"]:
    held = [state in (State.STICK, State.INCIPIENT) for state in result.state]
    return np.array(held) & result.answered


def _half_width(result: Track) -> Float[np.ndarray, " frames"]:
    return 0.5 * (result.high - result.low)


def _at(
    result: Track, values: Float[np.ndarray, " frames"], time: Float[np.ndarray, " times"]
) -> Float[np.ndarray, " times"]:
    """Values of a finger at times since its first frame; NaN outside and next to a NaN."""
    return np.interp(time, result.time - result.time[0], values, left=np.nan, right=np.nan)
