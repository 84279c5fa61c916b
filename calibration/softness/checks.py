"""Checks of a softness fit: errors and remarks, with advice on what to measure instead."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy
from jaxtyping import Float

from calibration.softness.readings import Layer, Series, gather_points
from calibration.softness.references import median_of_three
from calibration.softness.regression import Line
from calibration.softness.scatter import Slope
from calibration.softness.trials import FEWEST_POINTS, FEWEST_ZEROED, Trial
from estimation.frames.names import counted

LEAST_TURN = np.radians(1.0)
MOST_OUTLIERS = 0.35
MOST_COVERED = 0.5
"""Share of the frames that a reference must cover to count as complete."""

LEAST_FAR = 0.02
"""Share of the reference's range; readings closer to the line count as readings of the object."""

FAR_ERRORS = 3.0
"""Ratio of scatter to stated errors to remark on; six readings differ by it in 1 of 1000 grasps."""

LEAST_NOISE = 1e-4
"""Share of 1 + k by which noise must lower it to be remarked on."""

LEAST_RATIO = -0.02
"""Smallest k that counts as 0 rather than impossible, given the errors of scales and tilts."""


def check_trials(trials: Sequence[Trial]) -> None:
    """Check that all trials are different grasps with one kind of sensor, because k depends on it.

    Raises:
        ValueError: the trials' numbers or distances of markers differ, or a trial is given twice.
    """
    for one, other in combinations(trials, 2):
        angles = one.reference.angle, other.reference.angle
        if np.array_equal(one.rotation, other.rotation) and np.array_equal(*angles):
            raise ValueError(
                f"{one.name} and {other.name} are the same grasp, which counts once: give each "
                "recording once"
            )
    first = trials[0]
    for trial in trials:
        count = trial.markers != first.markers
        pitch = abs(trial.pitch - first.pitch) > 0.1 * first.pitch
        if count or pitch:
            raise ValueError(
                f"{first.name} and {trial.name} are of different sensors ({first.markers} markers "
                f"{first.pitch:.2f} apart, {trial.markers} markers {trial.pitch:.2f} apart): k "
                "depends on sensor and object, so fit each sensor separately"
            )


def check_frames(trials: Sequence[Trial]) -> None:
    """Check that every trial has at least two frames, because readings are taken between frames.

    Raises:
        ValueError: a trial has fewer.
    """
    for trial in trials:
        if len(trial.time) < 2:
            raise ValueError(
                f"{trial.name}: {counted(len(trial.time), 'frame', 'frames')} with a rotation of "
                f"the elastomer{left_out(trial)}: record more frames before macro slip"
            )


def check_points(
    trials: Sequence[Trial],
    series: Sequence[Series],
    offsets: Float[np.ndarray, " trials"],
    layer: Layer,
    *,
    zeroed: bool,
) -> None:
    """Check that every trial has enough readings, over enough angle, at clock offsets [s].

    If `zeroed`, references that count from the contact have no load term.

    Raises:
        ValueError: a trial has too few readings, turns too little, its reference has another unit,
            or its clocks do not match.
    """
    for trial, readings, offset in zip(trials, series, offsets, strict=True):
        points = gather_points([readings], np.array([offset]), layer)
        fewest = FEWEST_ZEROED if zeroed and trial.reference.zeroed else FEWEST_POINTS
        if len(points.rotation) < fewest:
            raise ValueError(_too_few(trial, readings, len(points.rotation), fewest))
        turned = float(np.ptp(points.rotation))
        error = float(np.median(points.rotation_error))
        least = max(LEAST_TURN, 8.0 * error)
        if turned < least:
            away = float(np.abs(np.median(points.rotation)))
            state = "the object does not turn while markers stick"
            if turned >= LEAST_TURN:
                state = "the rotation of the elastomer is too uncertain to fit k"
            elif away >= LEAST_TURN:
                state = f"all its readings are at one angle, {np.degrees(away):.1f}°"
            raise ValueError(
                f"{trial.name}: {state}: the elastomer turned by {np.degrees(turned):.2g}°, with a "
                f"standard error of {np.degrees(error):.2g}°, where {np.degrees(least):.2g}° is "
                "needed, in the usable frames, "
                f"{readings.frame_time[0]:.2f} to {readings.frame_time[-1]:.2f} s after the first "
                f"frame{left_out(trial)}. Turn the object one way by 10° or more without slip, "
                "and read the angle meanwhile, or leave this recording out"
            )
        # before the fit, which may not converge in a wrong unit
        turns = [median_of_three(points.reference), points.rotation]
        low, high = np.percentile(turns, [5.0, 95.0], axis=1)
        if high[1] > low[1]:
            ratio = float((high[0] - low[0]) / (high[1] - low[1]))
            if ratio < 1e-3:  # below a mistaken unit of a stiff object
                raise ValueError(
                    f"{trial.name}: the reference stays at one angle while the elastomer turns by "
                    f"{np.degrees(turned):.2g}°: check that it is mounted on the object, and that "
                    "the column holds its angle"
                )
            _check_unit(trial, ratio, f"{ratio:.2g}")
        if readings.search > 0.0 and abs(offset) > 0.97 * readings.search:
            raise ValueError(
                f"{trial.name}: the clocks of sensor and reference are further apart than the "
                f"{readings.search:g} s that were searched, or the reference does not follow the "
                "object: start both together, or increase --clock-search"
            )


def _too_few(trial: Trial, readings: Series, count: int, fewest: int) -> str:
    """Message about too few readings, with the reason."""
    time = readings.time[np.isfinite(readings.reference)]
    first, last = readings.frame_time[0], readings.frame_time[-1]
    middle = 0.5 * (first + last)
    ms = len(time) and first < 1e-3 * time.mean() < last and np.ptp(time) > 10.0 * (last - first)
    if len(time) and (ms or time[-1] < middle or time[0] > middle):
        clocks = "leave out --same-clock if their clocks differ"
        if not trial.reference.same_clock:
            clocks = "use --same-clock if both share a clock"
        in_ms = " (its times seem to be in ms: give them in s)" if ms else ""
        return (
            f"{trial.name}: the reference runs from {time[0]:.2f} to {time[-1]:.2f} s{in_ms}, the "
            f"usable frames from {first:.2f} to {last:.2f} s: "
            f"{counted(count, 'reading falls', 'readings fall')} between frames. "
            f"Record the reference over the whole recording, and {clocks}"
        )
    return (
        f"{trial.name}: {counted(count, 'reading has', 'readings have')} a rotation of the "
        f"elastomer; {fewest} are required{left_out(trial)}: record more frames before macro "
        "slip, or read the reference more often"
    )


def left_out(trial: Trial) -> str:
    """Unused frames by reason, in brackets."""
    excluded = ", ".join(_count_excluded(trial.excluded))
    return f" (left out: {excluded})" if excluded else ""


def _count_excluded(excluded: Mapping[str, int]) -> list[str]:
    return [f"{counted(count, 'frame', 'frames')} {reason}" for reason, count in excluded.items()]


def check_line(trial: Trial, line: Line) -> None:
    """Check that the reference follows the elastomer like an object's angle.

    Raises:
        ValueError: the reference has another sign or unit, does not follow the object, or turns
            less than the elastomer.
    """
    slope, error = line.slope, float(np.sqrt(line.covariance[0, 0]))
    half = float(scipy.stats.t.ppf(0.975, line.freedom)) * error
    points = len(line.weight)
    far = np.abs(line.residual) > LEAST_FAR * np.ptp(line.points.reference)
    outliers = int(((line.weight == 0) & far).sum())
    shown = f"{slope:.3g} ± {half:.2g}"
    if not np.isfinite(slope + half):
        raise ValueError(f"{trial.name}: the fit is singular; turn the object further, both ways")
    _check_unit(trial, slope, shown)
    if slope + half < 0.0:
        advice = (
            "both fingers turn the same way, but fingers that face each other turn opposite ways: "
            "check that the two recordings are of one grasp, and that neither is mirrored"
            if trial.reference.finger
            else "change the sign with --flip"
        )
        raise ValueError(
            f"{trial.name}: the reference turns the other way (by {shown} times the elastomer's "
            "rotation). Angles are counter-clockwise positive, seen from the object looking at the "
            f"pad: {advice}"
        )
    if outliers > MOST_OUTLIERS * points + 0.5:  # three of eight are allowed
        raise ValueError(
            f"{trial.name}: {outliers} of {points} readings lie far off any line: the reference "
            "does not follow this object, or most of the recording is slip. Check that recording "
            "and reference belong to one grasp, and check their clocks"
        )
    if slope + half < 1.0 and slope - 1.0 < LEAST_RATIO:
        why = (
            "but the finger with the smaller k turns further. Check k₁/k₂, the order of the "
            "fingers, and that both recordings are of one grasp"
            if trial.reference.finger
            else "but no object turns less than the elastomer that sticks to it. Check the unit, "
            "the axis (a tilt α reduces the angle by cos α), the marker scale, and that the "
            "reference is mounted firmly"
        )
        raise ValueError(
            f"{trial.name}: the reference turns only {shown} times as far as the elastomer, {why}"
        )


def _check_unit(trial: Trial, ratio: float, shown: str) -> None:
    """Check that a reference in the wrong unit does not explain how far it turns.

    `ratio` is the reference's turn over the elastomer's; `shown` is the same in words. Another
    finger's has the elastomer's unit.
    """
    if trial.reference.finger:
        return
    for factor, stated, meant in ((180.0 / np.pi, "rad", "degrees"), (np.pi / 180.0, "deg", "rad")):
        if 0.85 < abs(ratio) / factor < 6.0 and abs(np.log(abs(ratio))) > 2.0:
            raise ValueError(
                f"{trial.name}: the reference turns {shown} times as far as the elastomer: its "
                f"column seems to be in {meant}, but its name says {stated}; rename the column"
            )


def report_findings(
    trials: Sequence[Trial],
    slope: Slope,
    half: float,
    line: Line,
    loads: int,
    shifts: Float[np.ndarray, " shifts"],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Quantities that the data cannot determine, and remarks for readers, in sentences.

    The slope has a 95 % interval of ± `half` [-]; `loads` coefficients of the line are L. `shifts`
    are the values of L that do not depend on the force [rad].

    Returns:
        Undetermined quantities; remarks.
    """
    return _undetermined(trials, slope, half, line, loads), (
        *_note_scatter(trials, slope),
        *_note_zero(shifts),
        *_note_coverage(trials, line),
        *_note_readings(line),
    )


def _undetermined(
    trials: Sequence[Trial], slope: Slope, half: float, line: Line, loads: int
) -> tuple[str, ...]:
    """Quantities that the data cannot determine."""
    undetermined = []
    if half > 0.5 * slope.value:
        undetermined.append(
            f"k is only known to ±{half:.2g}: turn further without slip, or record more grasps"
        )
    if not any(trial.reference.zeroed for trial in trials):
        undetermined.append(
            "L: the references do not count from the onset of contact, so only changes of the "
            "angle were used (Eq. 12); to fit L, use references that do (--zeroed)"
        )
    errors = np.sqrt(np.diag(line.covariance))
    correlation = np.abs(line.covariance[0, 1:] / (errors[0] * np.maximum(errors[1:], 1e-300)))
    if loads and (correlation[:loads] > 0.99).any():
        undetermined.append(
            "k and L separately: the correlation of their errors is above 0.99; turn the object "
            "both ways from the zero, and further"
        )
    if loads == 1 and len(line.covariance) > 1 + len(line.coefficients):
        clocks = slice(1 + len(line.coefficients), None)
        mixed = np.abs(line.covariance[1, clocks]) / (errors[1] * errors[clocks])
        if (mixed > 0.99).any():
            undetermined.append(
                "L and the clock offset separately: at a constant rate they have the same effect; "
                "hold the object still for a moment, or turn it back"
            )
    return tuple(undetermined)


def _note_scatter(trials: Sequence[Trial], slope: Slope) -> Iterator[str]:
    """Remarks on the scatter of k between grasps, and on a negative k."""
    if len(trials) == 1:
        yield (
            "one grasp only: the interval covers the noise of the readings, but not the scatter of "
            "k between grasps; record three or more grasps"
        )
    elif slope.scatter > 0.0:
        yield (
            f"the grasps disagree (p = {slope.p_value:.2g} for equal k): k scatters by "
            f"{slope.scatter:.3g} between them, and the interval covers their mean"
        )
    else:
        yield f"the grasps agree within their errors (p = {slope.p_value:.2g} for equal k)"
    if slope.value < 1.0:
        yield (
            f"the fitted k is {slope.value - 1.0:.3g}, which is impossible; its interval includes "
            "0, so k = 0 is used"
        )


def _note_zero(shifts: Float[np.ndarray, " shifts"]) -> Iterator[str]:
    """A remark on an L that may be an error of the references' zero instead."""
    worth = np.radians(0.2)  # half of it is as large as errors of stages and sensors
    if len(shifts) and np.abs(shifts).max() > worth:
        yield (
            f"L is {'up to ' if len(shifts) > 1 else ''}{np.degrees(np.abs(shifts).max()):.2f}°, "
            "and shifts angles by half of it. On a gel much thicker than the contact it should be "
            "0. A reference that did not read 0 when the object touched looks the same, and its "
            "error would be in every corrected angle: check the zero, or leave out --zeroed"
        )


def _note_coverage(trials: Sequence[Trial], line: Line) -> Iterator[str]:
    """Remarks on references shorter than their frames, and on unused frames."""
    excluded = Counter[str]()
    for number, trial in enumerate(trials):
        excluded.update(trial.excluded)
        read = line.points.time[line.points.trial == number]
        frames = trial.time - trial.start
        covered = np.mean((frames >= read.min()) & (frames <= read.max()))
        if covered < MOST_COVERED:
            yield (
                f"{trial.name}: the reference covers {100.0 * covered:.0f} % of the frames with "
                "sticking markers: record it over the whole recording"
            )
    yield from (f"left out: {frames}" for frames in _count_excluded(excluded))


def _note_readings(line: Line) -> Iterator[str]:
    """Remarks on readings without weight, and on the effect of the rotation's errors."""
    if outliers := int((line.weight == 0).sum()):
        verbs = ("lies", "has") if outliers == 1 else ("lie", "have")
        yield (
            f"{outliers} of {len(line.weight)} readings {verbs[0]} far off the line and {verbs[1]} "
            "no weight"
        )
    if np.isnan(line.found_error) and not 1.0 / FAR_ERRORS < line.scale < FAR_ERRORS:
        less = line.scale < 1.0
        yield (
            f"the readings scatter {(1.0 / line.scale if less else line.scale):.2g} times "
            f"{'less' if less else 'more'} than their stated errors (error_deg): the interval "
            "follows from the scatter, without errors that all readings share"
        )
    noise = float(np.median(line.points.rotation_error**2) / np.var(line.points.rotation))
    if noise > LEAST_NOISE:
        yield (
            "the fit corrects for the noise of the elastomer's rotation, which would make 1 + k "
            f"{100.0 * noise:.2g} % too small"
        )
