"""Two fingers that hold one object: their clocks, their difference and their joint angle.

The fingers face each other, so the second finger's angle is taken with the opposite sign. Each
finger counts from its own first frame, by its own clock. The clock offset is fitted to short
motions, which slow creep and slip of one finger hardly change; the angle offset is the mean
difference that remains. The fingers are also compared before any offset is fitted.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.estimators.measurement import Z95, clustered_covariance
from estimation.estimators.result import State, Track


class Fit(NamedTuple):
    """Least-squares fit of the second finger's angle to the first's.

    Attributes:
        slope: second angle over first angle [-].
        clock_offset: first finger's time less the second's, each since its first frame [s].
        angle_offset: mean of the first angle less the slope-corrected second angle [rad].
        rms: root mean square of the remaining difference [rad].
        errors: standard errors of slope [-], clock offset [s] and angle offset [rad]; 0 for a fixed
            value. They come from the scatter of tenths of the recording, to allow for correlated
            residuals.
        correlation: correlation of slope and clock offset [-]; 0 for a fixed slope.
        frames: number of the first finger's frames in the fit.
    """

    slope: float
    clock_offset: float
    angle_offset: float
    rms: float
    errors: tuple[float, float, float]
    correlation: float
    frames: int


class Disagreement(NamedTuple):
    """Difference of the fingers since their common start, on their own clocks and without offsets.

    Attributes:
        largest: difference that exceeds its interval the most, second minus first [rad].
        interval: half-width of the 95 % interval of that difference [rad].
        time: time of that frame since the first finger's first frame [s].
        share: share of the compared frames whose difference exceeds its interval [-].
        rms: root mean square of the difference over all compared frames [rad].
        clear: whether the difference is significant: its rms is above the least difference, and
            more frames exceed their intervals, or one exceeds it by more, than by chance.
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
            f"the fingers disagree: on the recordings' own clocks, their turns since both first "
            f"held differ by {np.degrees(self.rms):.2f}° rms, and most {self.time:.2f} s after the "
            f"first finger's first frame: by {abs(np.degrees(self.largest)):.2f}°, where the 95 % "
            f"interval of the difference is ±{np.degrees(self.interval):.2f}°; "
            f"in {100 * self.share:.0f} % of the frames the difference exceeds its interval"
        )


class Grasp(NamedTuple):
    """Angles of two fingers on the first finger's clock.

    Attributes:
        time: time since the first finger's first frame [s].
        first: angle of the first finger [rad].
        second: angle of the second finger, corrected for sign and offsets, slope 1 [rad]; NaN where
            it has none.
        joint: mean of both angles, weighted by their intervals, or the only one [rad].
        low: lower end of its 95 % interval [rad]. The interval covers both fingers, both with the
            fitted angle offset and counted from their common start.
        high: upper end of its 95 % interval [rad].
        holds: frames in which markers stick on both fingers.
        fixed: the fit with slope 1.
        free: the fit with free slope.
        own_clocks: whether the clock offset is 0 because the angles give no evidence of another.
        raw: the fingers' difference before offsets are fitted; None without a common frame.
        left_out: numbers of frames of either finger whose angle is left out, since it counts from
            another start than most angles of the contact.

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
        10.0° ± 0.04° by both fingers
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
    left_out: tuple[int, int] = (0, 0)

    @property
    def disagrees(self) -> bool:
        """Whether the fingers disagree, and no clock offset explains it."""
        clear = self.raw is not None and self.raw.clear
        return clear and (self.own_clocks or not self.explains_half)

    @property
    def explains_half(self) -> bool:
        """Whether offsets remove at least half of the fingers' difference."""
        return self.raw is None or self.fixed.rms <= 0.5 * self.raw.rms


def compare_fingers(
    first: Track,
    second: Track,
    short_s: float = 0.4,
    least_difference: float = float(np.radians(0.3)),
) -> Grasp:
    """Compare and join two fingers' angles, fitted to frames in which neither is in macro slip.

    Where a finger's angle was lost and restarted within a contact, the start that most angles count
    from is used, and the others are left out, since their zeros differ by an unknown rotation.

    Args:
        first: track of the finger whose clock is used.
        second: track of the other finger.
        short_s: time over which motions are compared to fit the clock offset [s].
        least_difference: rms difference before offsets are fitted, above which the fingers can
            count as disagreeing. Intervals of single frames omit errors of the time stamps, 0.2°
            rms at 75°/s and 2 ms. Larger values hide small slips [rad].

    Raises:
        ValueError: the fingers hold the object together in too few frames, or their motions match
            best in the same sense.

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
    first, first_left = first.with_one_start(_answers(second, first))
    second, second_left = second.with_one_start(_answers(first, second))
    pair = _Pair(first, second, short_s)
    clock, own_clocks, doubt = pair.find_clock()
    fixed = pair.fit(clock, doubt, free_slope=False)
    free = pair.fit(clock, doubt, free_slope=True)
    time = pair.time
    there = time - fixed.clock_offset
    raw_second = -_at(second, second.angle, there)
    holds = _sticks(first) & (_at(second, _sticks(second).astype(float), there) == 1.0)
    joint, width = _join(first, raw_second, _at(second, _half_width(second), there), fixed, holds)
    return Grasp(
        time=time,
        first=first.angle,
        second=raw_second + fixed.angle_offset,
        joint=joint,
        low=joint - width,
        high=joint + width,
        holds=holds,
        fixed=fixed,
        free=free,
        own_clocks=own_clocks,
        raw=_compare_raw(first, second, least_difference),
        left_out=(first_left, second_left),
    )


def _join(
    first: Track,
    second: Float[np.ndarray, " frames"],
    second_half: Float[np.ndarray, " frames"],
    fit: Fit,
    holds: Bool[np.ndarray, " frames"],
) -> tuple[Float[np.ndarray, " frames"], Float[np.ndarray, " frames"]]:
    """The weighted mean of the fingers' angles, and its half-width.

    Args:
        first: track of the first finger.
        second: angle of the second finger in its frames, before offsets [rad].
        second_half: half-widths of its intervals [rad].
        fit: the fit that gives the angle offset.
        holds: frames in which markers stick on both fingers.
    """
    angles = np.stack([first.angle, second + fit.angle_offset])
    half = np.stack([_half_width(first), np.hypot(second_half, Z95 * fit.errors[2])])
    # an angle offset that a finger gained since both held widens the interval
    start = np.argmax(holds)
    gained = first.angle[start] - second[start] if holds.any() else fit.angle_offset
    from_start = second + gained
    weight = np.where(np.isfinite(angles), 1.0 / np.maximum(half, 1e-6) ** 2, 0.0)
    total = weight.sum(axis=0)
    answered = total > 0
    joint, width = np.full((2, len(total)), np.nan)
    joint[answered] = np.nansum(weight * np.nan_to_num(angles), axis=0)[answered] / total[answered]
    spread = np.abs(np.nan_to_num(np.vstack([angles, from_start]) - joint)).max(axis=0)
    width[answered] = np.hypot(1.0 / np.sqrt(total[answered]), spread[answered])
    return joint, width


def _compare_raw(first: Track, second: Track, least: float) -> Disagreement | None:
    """The fingers' difference since both hold, over frames in which both have an angle."""
    time = first.time - first.time[0]
    difference = -_at(second, second.angle, time) - first.angle
    interval = np.hypot(_half_width(first), _at(second, _half_width(second), time))
    holds = _sticks(first) & (_at(second, _sticks(second).astype(float), time) == 1.0)
    compared = np.isfinite(difference) & np.isfinite(interval)
    if not (holds & compared).any():
        return None
    start = np.argmax(holds & compared)
    difference, compared[:start] = difference - difference[start], False
    excess = np.where(compared, np.abs(difference) - interval, -np.inf)
    worst = np.argmax(excess)
    share = float(np.mean(excess[compared] > 0))
    rms = float(np.sqrt(np.mean(difference[compared] ** 2)))
    return Disagreement(
        largest=float(difference[worst]),
        interval=float(interval[worst]),
        time=float(time[worst]),
        share=share,
        rms=rms,
        clear=bool(
            rms > least and (share > 0.05 or abs(difference[worst]) > 2.0 * interval[worst])
        ),
    )


class _Pair:
    """Two fingers' angles while they hold, and their short motions at a clock offset."""

    def __init__(self, first: Track, second: Track, short_s: float) -> None:
        self.time = first.time - first.time[0]
        self.second = second
        self.first_angle = np.where(_sticks(first), first.angle, np.nan)
        self.second_angle = -np.where(_sticks(second), second.angle, np.nan)
        self.span = min(np.ptp(self.time), np.ptp(second.time))
        step = np.median(np.diff(self.time)) if len(self.time) > 1 else short_s
        self.lag = max(1, round(short_s / max(step, 1e-6)))
        self.step = max(float(step), 0.25 * short_s)
        # the frame intervals of both fingers limit the accuracy of the clock offset
        steps = np.array([step, np.median(np.diff(second.time)) if len(second.time) > 1 else step])
        self.sampling = float(np.sqrt(np.sum(steps**2) / 12.0))

    def angles(self, clock: float) -> Float[np.ndarray, " frames"]:
        """The second finger's angle at the first finger's frames; NaN while it does not hold."""
        return _at(self.second, self.second_angle, self.time - clock)

    def motions(self, clock: float) -> Float[np.ndarray, "2 pairs"]:
        """Turns of both fingers over `lag` frames [rad]; NaN unless both hold all the time."""
        angles = np.stack([self.first_angle, self.angles(clock)])
        missing = np.cumsum(~np.isfinite(angles).all(axis=0))
        moved = angles[:, self.lag :] - angles[:, : -self.lag]
        held = (missing[self.lag :] == missing[: -self.lag]) & np.isfinite(moved).all(axis=0)
        return np.where(held, moved, np.nan)

    def find_clock(self) -> tuple[float, bool, float]:
        """The clock offset, whether it is 0 for lack of evidence, and the error of that choice [s].

        The offset minimises the share of the motions that the fingers do not have in common, over
        offsets up to half the recording. It is used if it is likelier than 0 by more than the best
        of as many trials by chance, with one independent residual per `lag` frames.
        """
        least_frames = 10
        alone = np.convolve(np.isfinite(self.first_angle), np.ones(self.lag + 1), "valid")
        alone = float(np.sum(alone > self.lag))
        share = np.ptp(self.second.time) / max(np.ptp(self.time), 1e-6)  # of the first's length
        other = len(self.time) * share * np.isfinite(self.second_angle).mean()
        least = max(least_frames, 0.4 * min(alone, other))

        def cost(clock: float) -> tuple[float, float, int]:  # of opposite senses, and of the same
            moved = self.motions(clock)
            moved = moved[:, np.isfinite(moved[1])]
            total, count = np.sum(moved**2), moved.shape[1]
            if count < least or total == 0.0:
                return np.inf, np.inf, count
            opposite, same = (np.sum((moved[1] - way * moved[0]) ** 2) for way in (1.0, -1.0))
            return float(opposite / total), float(same / total), count

        reach = int(0.5 * self.span / self.step)
        offsets = self.step * np.arange(-reach, reach + 1)
        costs, mirrored, _ = np.array([cost(clock) for clock in offsets]).T
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            raise ValueError(
                f"both fingers hold the object in fewer than {least:.0f} common frames: their "
                "clocks cannot be aligned"
            )
        finer = offsets[best] + self.step * np.linspace(-1.0, 1.0, 41)
        clock = float(finer[np.argmin([cost(offset)[0] for offset in finer])])
        least_cost, _, frames = cost(clock)
        gain = Z95**2 + 2.0 * np.log(len(offsets))
        if mirrored.min() < min(0.5, least_cost * np.exp(-gain * self.lag / frames)):
            raise ValueError(
                "the fingers' motions match best in the same sense, but fingers that face each "
                "other turn in opposite senses: check whether both recordings are of one finger, "
                "the pictures or axes of one are mirrored, or they begin at different times"
            )
        allowed = costs <= max(least_cost, 1e-12) * np.exp(gain * self.lag / frames)
        if not allowed[reach]:
            return clock, False, 0.0
        return 0.0, True, float(np.abs(offsets[allowed]).max() / Z95)

    def fit(self, clock: float, doubt: float, *, free_slope: bool) -> Fit:
        """Angle offset and, if free, slope by least squares on the angles at a clock offset."""
        clock_error = float(np.hypot(self.clock_error(clock), doubt))
        (slope, offset), covariance, residual = self._fit_angles(clock, free_slope)
        shifted = [self._fit_angles(clock + side, free_slope)[0] for side in (-1e-3, 1e-3)]
        by_clock = (np.array(shifted[1]) - shifted[0]) / 2e-3 * clock_error
        errors = np.sqrt(np.diag(covariance) + by_clock**2)
        return Fit(
            slope=slope,
            clock_offset=clock,
            angle_offset=offset,
            rms=float(np.sqrt(np.mean(residual**2))),
            errors=(float(errors[0]), clock_error, float(errors[1])),
            correlation=float(by_clock[0] / errors[0]) if errors[0] > 0 else 0.0,
            frames=len(residual),
        )

    def clock_error(self, clock: float) -> float:
        """Standard error of the clock offset, from the short motions' fit and the sampling [s]."""
        near = [self.motions(clock + side * self.step) for side in (-0.25, 0.0, 0.25)]
        there = np.isfinite(near).all(axis=(0, 1))
        by_clock = (near[2][1, there] - near[0][1, there]) / (0.5 * self.step)
        residual = near[1][1, there] - near[1][0, there]
        variance = clustered_covariance(by_clock[:, None], residual, self.lag)[0, 0]
        return float(np.hypot(np.sqrt(variance), self.sampling))

    def _fit_angles(
        self, clock: float, free_slope: bool
    ) -> tuple[tuple[float, float], Float[np.ndarray, "2 2"], Float[np.ndarray, " frames"]]:
        """Slope and angle offset, their covariance at this clock offset, and the residuals."""
        second = self.angles(clock)
        compared = np.isfinite(second) & np.isfinite(self.first_angle)
        first, second = self.first_angle[compared], second[compared]
        slope = 1.0
        if free_slope:
            around = first - first.mean()
            slope = float(around @ second / max(around @ around, 1e-30)) or 1e-30
        offset = float(np.mean(first) - np.mean(second) / slope)
        residual = second - slope * (first - offset)
        jacobian = np.stack([offset - first, np.full(len(first), slope)], axis=1)
        fitted = slice(0 if free_slope else 1, 2)
        covariance = np.zeros((2, 2))
        covariance[fitted, fitted] = clustered_covariance(jacobian[:, fitted], residual, self.lag)
        return (slope, offset), covariance, residual


def _sticks(result: Track) -> Bool[np.ndarray, " frames"]:
    held = [state in (State.STICK, State.INCIPIENT) for state in result.state]
    return np.array(held) & result.answered & (result.stick_markers > 0)


def _half_width(result: Track) -> Float[np.ndarray, " frames"]:
    return 0.5 * (result.high - result.low)


def _at(
    result: Track, values: Float[np.ndarray, " frames"], time: Float[np.ndarray, " times"]
) -> Float[np.ndarray, " times"]:
    """Values of a finger at times since its first frame; NaN outside the recording and near NaN."""
    return np.interp(time, result.time - result.time[0], values, left=np.nan, right=np.nan)


def _answers(other: Track, track: Track) -> Bool[np.ndarray, " frames"]:
    """Whether the other finger has an angle in the frames of a finger."""
    return np.isfinite(_at(other, other.angle, track.time - track.time[0]))
