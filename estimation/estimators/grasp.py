"""Two fingers that hold one object: their clocks, their difference, their joint angle.

Seen from its own sensor each finger turns the other way, so the second finger's angle is taken with
the opposite sign. Each counts from its own first frame, by its own clock. The clock offset is found
from short motions, which slow creep and slip of one finger hardly change; the angle offset is what
the angles then differ by. Before either is fitted, the fingers are compared as they are.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.estimators.measurement import Z95
from estimation.estimators.result import State, Track


class Fit(NamedTuple):
    """How the second finger's angle lies to the first's, by least squares.

    Attributes:
        slope: second over first angle [-].
        clock_offset: added to the second's time since its first frame it gives the first's [s].
        angle_offset: first angle minus slope-corrected second, mean [rad].
        rms: of the angles' remaining difference [rad].
        errors: standard errors of slope, clock offset and angle offset; 0 where held fixed. From
            the scatter of tenths of the recording, so that correlated residuals count.
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


class Disagreement(NamedTuple):
    """How the fingers differ since their common start, on their own clocks and without offsets.

    Attributes:
        largest: difference that exceeds its interval the most, second minus first [rad].
        interval: half-width of the 95 % interval of that difference [rad].
        time: of that frame, since the first finger's first frame [s].
        share: of the compared frames whose difference exceeds its interval [-].
        rms: of the difference over all compared frames [rad].
        clear: whether it matters: the rms is above the least difference, and more frames exceed
            their intervals, or one by more, than by chance.
    """

    largest: float
    interval: float
    time: float
    share: float
    rms: float
    clear: bool

    def describe(self) -> str:
        """The difference in a sentence."""
        return (
            f"the fingers disagree: on the recordings' own clocks their turns since the common "
            f"start differ by {np.degrees(self.rms):.2f}° rms and by up to "
            f"{abs(np.degrees(self.largest)):.2f}° at {self.time:.2f} s (95 % interval "
            f"±{np.degrees(self.interval):.2f}°), beyond the interval in {self.share:.0%} of the "
            "frames"
        )


class Grasp(NamedTuple):
    """Both fingers on the first one's clock.

    Attributes:
        time: since the first finger's first frame [s].
        first: its angle [rad].
        second: the other's, sign and offsets taken off, slope 1 [rad]; NaN where it saw nothing.
        joint: mean of both, weighted by their intervals; of one where only one knows [rad].
        low: lower end of its 95 % interval [rad], which holds both fingers, with the fitted angle
            offset as well as counted from their common start.
        high: upper end of its 95 % interval [rad].
        holds: frames in which markers stick on both fingers.
        fixed: the fit with slope 1.
        free: the fit with the slope free.
        own_clocks: the clock offset is 0 because the angles give no reason for another one.
        raw: the fingers' difference before offsets are fitted; None without a common frame.

    Examples:
        >>> import numpy as np
        >>> from estimation import compare_fingers, estimate_angles, simulate_pivot
        >>> tracks = [
        ...     estimate_angles(simulate_pivot(angles_deg=(0.0, turn), frames=(20,), seed=seed)[0])
        ...     for seed, turn in ((0, 10.0), (1, -10.0))  # the fingers face each other
        ... ]
        >>> grasp = compare_fingers(*tracks)
        >>> half = np.degrees(grasp.high[-1] - grasp.low[-1]) / 2
        >>> print(f"{np.degrees(grasp.joint[-1]):.1f}° ± {half:.2f}° by both fingers")
        10.0° ± 0.02° by both fingers
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
    own_clocks: bool
    raw: Disagreement | None


def compare_fingers(
    first: Track,
    second: Track,
    short_s: float = 0.4,
    least_difference: float = float(np.radians(0.3)),
) -> Grasp:
    """Bring two fingers' angles together; fitted where neither is in macro slip.

    Args:
        first: the finger whose clock is taken.
        second: the other one.
        short_s: time over which motions are compared to find the clock offset [s].
        least_difference: rms difference above which the fingers can count as disagreeing before
            offsets are fitted. Intervals of single frames leave out errors of the time stamps,
            0.2° rms at 75°/s and 2 ms. Larger values hide small slips [rad].

    Raises:
        ValueError: the two have too little time in common without macro slip.

    Examples:
        >>> import numpy as np
        >>> from estimation import compare_fingers, estimate_angles, simulate_pivot
        >>> tracks = [
        ...     estimate_angles(simulate_pivot(angles_deg=(0.0, turn), frames=(20,), seed=seed)[0])
        ...     for seed, turn in ((0, 10.0), (1, -10.0))  # the fingers face each other
        ... ]
        >>> grasp = compare_fingers(*tracks)
        >>> apart = np.degrees(np.nanmax(np.abs(grasp.first - grasp.second)))
        >>> print(f"the fingers differ by {apart:.1f}° at most")
        the fingers differ by 0.1° at most
    """
    pair = _Pair(first, second, short_s)
    clock, own_clocks, doubt = pair.find_clock()
    fixed = pair.fit(clock, doubt, free_slope=False)
    free = pair.fit(clock, doubt, free_slope=True)
    time = pair.time
    there = time - fixed.clock_offset
    raw_second = -_at(second, second.angle, there)
    other = raw_second + fixed.angle_offset
    half = np.stack([_half_width(first), _at(second, _half_width(second), there)])
    half[1] = np.hypot(half[1], Z95 * fixed.errors[2])
    angles = np.stack([first.angle, other])
    holds = _sticks(first) & (_at(second, _sticks(second).astype(float), there) == 1.0)
    start = np.argmax(holds)
    # an angle offset that one finger gained since both held is doubt
    gained = raw_second + first.angle[start] - raw_second[start] if holds.any() else other
    joint, width = _join(angles, half, gained)
    return Grasp(
        time=time,
        first=first.angle,
        second=other,
        joint=joint,
        low=joint - width,
        high=joint + width,
        holds=holds,
        fixed=fixed,
        free=free,
        own_clocks=own_clocks,
        raw=_compare_raw(first, second, least_difference),
    )


def _join(
    angles: Float[np.ndarray, "2 frames"],
    half: Float[np.ndarray, "2 frames"],
    gained: Float[np.ndarray, " frames"],
) -> tuple[Float[np.ndarray, " frames"], Float[np.ndarray, " frames"]]:
    """The fingers' mean by their half-widths, and its half-width; it covers both, and a third."""
    weight = np.where(np.isfinite(angles), 1.0 / np.maximum(half, 1e-6) ** 2, 0.0)
    total = weight.sum(axis=0)
    known = total > 0
    joint, width = np.full((2, len(total)), np.nan)
    joint[known] = np.nansum(weight * np.nan_to_num(angles), axis=0)[known] / total[known]
    spread = np.abs(np.nan_to_num(np.vstack([angles, gained]) - joint)).max(axis=0)
    width[known] = np.hypot(1.0 / np.sqrt(total[known]), spread[known])
    return joint, width


def _compare_raw(first: Track, second: Track, least: float) -> Disagreement | None:
    """The fingers' difference since both hold, where both have an angle."""
    time = first.time - first.time[0]
    left = -_at(second, second.angle, time) - first.angle
    interval = np.hypot(_half_width(first), _at(second, _half_width(second), time))
    holds = _sticks(first) & (_at(second, _sticks(second).astype(float), time) == 1.0)
    known = np.isfinite(left) & np.isfinite(interval)
    if not (holds & known).any():
        return None
    start = np.argmax(holds & known)
    left, known[:start] = left - left[start], False
    excess = np.where(known, np.abs(left) - interval, -np.inf)
    worst = np.argmax(excess)
    share = float(np.mean(excess[known] > 0))
    rms = float(np.sqrt(np.mean(left[known] ** 2)))
    return Disagreement(
        largest=float(left[worst]),
        interval=float(interval[worst]),
        time=float(time[worst]),
        share=share,
        rms=rms,
        clear=rms > least and (share > 0.05 or abs(left[worst]) > 2.0 * interval[worst]),
    )


class _Pair:
    """Two fingers' angles where they hold, and the short motions of both at a clock offset."""

    def __init__(self, first: Track, second: Track, short_s: float) -> None:
        self.time = first.time - first.time[0]
        self.second = second
        self.mine = np.where(_sticks(first), first.angle, np.nan)
        self.theirs = -np.where(_sticks(second), second.angle, np.nan)
        self.span = min(np.ptp(self.time), np.ptp(second.time))
        step = np.median(np.diff(self.time)) if len(self.time) > 1 else short_s
        self.lag = max(1, round(short_s / max(step, 1e-6)))
        self.step = max(float(step), 0.25 * short_s)
        # what happens between two frames is not timed any better by either finger
        steps = np.array([step, np.median(np.diff(second.time)) if len(second.time) > 1 else step])
        self.sampling = float(np.sqrt(np.sum(steps**2) / 12.0))

    def angles(self, clock: float) -> Float[np.ndarray, " frames"]:
        """The second finger's at the first one's frames; NaN where it does not hold."""
        return _at(self.second, self.theirs, self.time - clock)

    def motions(self, clock: float) -> Float[np.ndarray, "2 pairs"]:
        """How far both turn from a frame to that `lag` later; NaN unless both hold all the time."""
        both = np.stack([self.mine, self.angles(clock)])
        missing = np.cumsum(~np.isfinite(both).all(axis=0))
        moved = both[:, self.lag :] - both[:, : -self.lag]
        held = (missing[self.lag :] == missing[: -self.lag]) & np.isfinite(moved).all(axis=0)
        return np.where(held, moved, np.nan)

    def find_clock(self) -> tuple[float, bool, float]:
        """The clock offset, whether it is 0 for want of evidence, and the error from that [s].

        The share of the motions that the fingers do not have in common, over clock offsets up to
        half the time. An offset is taken where it is likelier than 0 by more than the best of as
        many tried by chance, with one independent residual for each time of `lag` frames.
        """
        least_frames = 10
        alone = np.convolve(np.isfinite(self.mine), np.ones(self.lag + 1), "valid") > self.lag
        least = max(least_frames, 0.4 * alone.sum())

        def cost(clock: float) -> tuple[float, int]:
            moved = self.motions(clock)
            moved = moved[:, np.isfinite(moved[1])]
            total, count = np.sum(moved**2), moved.shape[1]
            if count < least or total == 0.0:
                return np.inf, count
            return float(np.sum((moved[1] - moved[0]) ** 2) / total), count

        reach = int(0.5 * self.span / self.step)
        tried = self.step * np.arange(-reach, reach + 1)
        costs = np.array([cost(clock)[0] for clock in tried])
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            raise ValueError(
                f"the two recordings share fewer than {least_frames} frames without macro slip: "
                "their clocks cannot be aligned"
            )
        finer = tried[best] + self.step * np.linspace(-1.0, 1.0, 41)
        clock = float(finer[np.argmin([cost(one)[0] for one in finer])])
        least_cost, frames = cost(clock)
        gain = Z95**2 + 2.0 * np.log(len(tried))
        allowed = costs <= max(least_cost, 1e-12) * np.exp(gain * self.lag / frames)
        if not allowed[reach]:
            return clock, False, 0.0
        return 0.0, True, float(np.abs(tried[allowed]).max() / Z95)

    def fit(self, clock: float, doubt: float, *, free_slope: bool) -> Fit:
        """Angle offset and, if asked, slope by least squares on the angles at a clock offset."""
        clock_error = float(np.hypot(self.clock_error(clock), doubt))
        (slope, offset), covariance, left = self._fit_angles(clock, free_slope)
        shifted = [self._fit_angles(clock + side, free_slope)[0] for side in (-1e-3, 1e-3)]
        by_clock = (np.array(shifted[1]) - shifted[0]) / 2e-3 * clock_error
        errors = np.sqrt(np.diag(covariance) + by_clock**2)
        return Fit(
            slope=slope,
            clock_offset=clock,
            angle_offset=offset,
            rms=float(np.sqrt(np.mean(left**2))),
            errors=(float(errors[0]), clock_error, float(errors[1])),
            correlation=float(by_clock[0] / errors[0]) if errors[0] > 0 else 0.0,
            frames=len(left),
        )

    def clock_error(self, clock: float) -> float:
        """Standard error of the clock offset: of the short motions' fit, and of sampling."""
        near = [self.motions(clock + side * self.step) for side in (-0.25, 0.0, 0.25)]
        there = np.isfinite(near).all(axis=(0, 1))
        by_clock = (near[2][1, there] - near[0][1, there]) / (0.5 * self.step)
        left = near[1][1, there] - near[1][0, there]
        variance = _clustered(by_clock[:, None], left, self.lag)[0, 0]
        return float(np.hypot(np.sqrt(variance), self.sampling))

    def _fit_angles(
        self, clock: float, free_slope: bool
    ) -> tuple[tuple[float, float], Float[np.ndarray, "2 2"], Float[np.ndarray, " frames"]]:
        """Slope and angle offset, their covariance at this clock offset, and the residuals."""
        theirs = self.angles(clock)
        both = np.isfinite(theirs) & np.isfinite(self.mine)
        mine, theirs = self.mine[both], theirs[both]
        slope = 1.0
        if free_slope:
            around = mine - mine.mean()
            slope = float(around @ theirs / max(around @ around, 1e-30)) or 1e-30
        offset = float(np.mean(mine) - np.mean(theirs) / slope)
        left = theirs - slope * (mine - offset)
        jacobian = np.stack([offset - mine, np.full(len(mine), slope)], axis=1)
        kept = slice(0 if free_slope else 1, 2)
        covariance = np.zeros((2, 2))
        covariance[kept, kept] = _clustered(jacobian[:, kept], left, self.lag)
        return (slope, offset), covariance, left


def _clustered(
    jacobian: Float[np.ndarray, "values parameters"],
    residual: Float[np.ndarray, " values"],
    lag: int,
) -> Float[np.ndarray, "parameters parameters"]:
    """Covariance of least squares with correlated residuals.

    From the scatter of tenths of the values, and not below that of residuals that are the same over
    `lag` values: a tenth with most of the motion would hide it.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    tenths = np.array_split(jacobian * residual[:, None], 10)
    scores = np.stack([tenth.sum(axis=0) for tenth in tenths])
    covariance = inverse @ (scores.T @ scores * 10 / 9) @ inverse
    least = lag * np.mean(residual**2) * np.diag(inverse)
    return covariance * np.max(least / np.maximum(np.diag(covariance), 1e-30), initial=1.0)


def _sticks(result: Track) -> Bool[np.ndarray, " frames"]:
    held = [state in (State.STICK, State.INCIPIENT) for state in result.state]
    return np.array(held) & result.answered & (result.stick_markers > 0)


def _half_width(result: Track) -> Float[np.ndarray, " frames"]:
    return 0.5 * (result.high - result.low)


def _at(
    result: Track, values: Float[np.ndarray, " frames"], time: Float[np.ndarray, " times"]
) -> Float[np.ndarray, " times"]:
    """Values of a finger at times since its first frame; NaN outside and next to a NaN."""
    return np.interp(time, result.time - result.time[0], values, left=np.nan, right=np.nan)
