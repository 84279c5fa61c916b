"""What speaks against a fit of softness, or for care with it, with what to measure instead."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Float

from calibration.softness.readings import Layer, Series, gather_points
from calibration.softness.regression import Line
from calibration.softness.scatter import Slope
from calibration.softness.trials import FEWEST_POINTS, FEWEST_ZEROED, Trial
from estimation.frames.names import counted

LEAST_TURN = np.radians(1.0)
MOST_OUTLIERS = 0.35
MOST_COVERED = 0.5
"""Share of the frames from which a reference counts as long as the recording."""

LEAST_FAR = 0.02
"""Of the reference's range: readings nearer to the line are not those of another object."""

LEAST_RATIO = -0.02
"""k that is called 0 rather than impossible: scales and tilts are not known better."""


def check_sensors(trials: Sequence[Trial]) -> None:
    """See that all trials are of one kind of sensor: k is a ratio of both bodies.

    Raises:
        ValueError: their markers differ.
    """
    first = trials[0]
    for trial in trials:
        count = trial.markers != first.markers
        pitch = abs(trial.pitch - first.pitch) > 0.1 * first.pitch
        if count or pitch:
            raise ValueError(
                f"{first.name} and {trial.name} are of different sensors ({first.markers} markers "
                f"{first.pitch:.2f} apart, {trial.markers} markers {trial.pitch:.2f} apart): k is "
                "the ratio of sensor and object, so fit each sensor by itself"
            )


def check_frames(trials: Sequence[Trial]) -> None:
    """See that every trial has more than one frame: readings are taken between frames.

    Raises:
        ValueError: one has not.
    """
    for trial in trials:
        if len(trial.time) < 2:
            raise ValueError(
                f"{trial.name}: {counted(len(trial.time), 'frame', 'frames')} with a rotation of "
                f"the elastomer{_left_out(trial)}: record more frames before macro slip"
            )


def check_points(
    trials: Sequence[Trial],
    series: Sequence[Series],
    offsets: Float[np.ndarray, " trials"],
    layer: Layer,
    *,
    zeroed: bool,
) -> None:
    """See that every trial has enough readings, over enough angle.

    Args:
        trials: the trials.
        series: their readings.
        offsets: of their clocks [s].
        layer: the elastomer.
        zeroed: whether a reference that counts from the contact has no load term besides.

    Raises:
        ValueError: one has not.
    """
    for trial, one, offset in zip(trials, series, offsets, strict=True):
        points = gather_points([one], np.array([offset]), layer)
        fewest = FEWEST_ZEROED if zeroed and trial.reference.zeroed else FEWEST_POINTS
        if len(points.rotation) < fewest:
            raise ValueError(_too_few(trial, one, len(points.rotation), fewest))
        turned = float(np.ptp(points.rotation))
        error = float(np.median(points.rotation_error))
        if turned < max(LEAST_TURN, 8.0 * error):
            away = float(np.abs(np.median(points.rotation)))
            state = "the object does not turn"
            if turned >= LEAST_TURN:
                state = "the rotation of the elastomer is too uncertain to fit k"
            elif away >= LEAST_TURN:
                state = f"all its readings are at one angle, {np.degrees(away):.1f}°"
            raise ValueError(
                f"{trial.name}: {state}: the elastomer turned by {np.degrees(turned):.2g}°, with a "
                f"standard error of {np.degrees(error):.2g}°. Turn the object one way by 10° or "
                "more without slip, and read the angle along the way"
            )
        if one.search > 0.0 and abs(offset) > 0.97 * one.search:
            raise ValueError(
                f"{trial.name}: the clocks of sensor and reference are further apart than the "
                f"{one.search:g} s that were searched, or the reference does not follow the "
                "object: start both together, or allow more (--clock-search)"
            )


def _too_few(trial: Trial, one: Series, found: int, fewest: int) -> str:
    """Why there are too few readings."""
    known = np.isfinite(one.reference)
    first, last = one.frame_time[0], one.frame_time[-1]
    if known.any() and (
        one.time[known][-1] < last - 0.5 * (last - first)
        or one.time[known][0] > first + 0.5 * (last - first)
    ):
        return (
            f"{trial.name}: the reference runs from {one.time[known][0]:.2f} to "
            f"{one.time[known][-1]:.2f} s, the frames that can be used from {first:.2f} to "
            f"{last:.2f} s: {counted(found, 'reading falls', 'readings fall')} between them. "
            "Record the reference over the whole recording, and give --same-clock if both share a "
            "clock"
        )
    return (
        f"{trial.name}: {counted(found, 'reading', 'readings')} with a rotation of the elastomer, "
        f"{fewest} are needed{_left_out(trial)}: record more frames before macro slip, or "
        "read the reference more often"
    )


def _left_out(trial: Trial) -> str:
    """The frames that are not used, in brackets."""
    excluded = ", ".join(_count_excluded(trial.excluded))
    return f" (left out: {excluded})" if excluded else ""


def _count_excluded(excluded: Mapping[str, int]) -> list[str]:
    return [f"{counted(n, 'frame', 'frames')} {reason}" for reason, n in excluded.items()]


def check_line(trial: Trial, one: Series, line: Line) -> None:
    """See that the reference follows the elastomer as an object's angle does.

    Raises:
        ValueError: it has another sign or unit, follows something else, or turns less than the
            elastomer.
    """
    slope, error = line.slope, float(np.sqrt(line.covariance[0, 0]))
    half = float(scipy.stats.t.ppf(0.975, line.freedom)) * error
    points = len(line.weight)
    far = np.abs(line.residual) > LEAST_FAR * np.ptp(line.points.reference)
    outliers = int(((line.weight == 0) & far).sum())
    shown = f"{slope:.3g} ± {half:.2g}"
    if not np.isfinite(slope + half):
        raise ValueError(f"{trial.name}: the fit is singular; turn the object further, both ways")
    for factor, found, meant in ((180.0 / np.pi, "rad", "degrees"), (np.pi / 180.0, "deg", "rad")):
        if 0.85 < abs(slope) / factor < 6.0 and abs(np.log(abs(slope))) > 2.0:
            raise ValueError(
                f"{trial.name}: the reference turns {shown} times as far as the elastomer: its "
                f"column seems to be in {meant}, though it is named as {found}"
            )
    if slope + half < 0.0:
        raise ValueError(
            f"{trial.name}: the reference turns the other way (by {shown} times the elastomer's "
            "rotation). Angles count counter-clockwise seen from the object looking at the pad: "
            "turn its sign (--flip)"
        )
    if outliers > MOST_OUTLIERS * points + 0.5:  # three of eight may be
        raise ValueError(
            f"{trial.name}: {outliers} of {points} readings lie far off any line: the reference "
            "does not follow this object, or most of the recording is slip. Check that both are "
            "of one grasp, and their clocks"
        )
    if slope + half < 1.0 and slope - 1.0 < LEAST_RATIO:
        raise ValueError(
            f"{trial.name}: the reference turns only {shown} times as far as the elastomer, and no "
            "object turns less than what sticks to it. Check the unit, the axis (a tilt α shows as "
            "cos α), the marker scale, and whether the reference is mounted firmly"
        )


def report_findings(
    trials: Sequence[Trial],
    slope: Slope,
    half: float,
    line: Line,
    loads: int,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the data cannot tell, and what a reader should know, in sentences.

    Args:
        trials: what was fitted.
        slope: the common slope.
        half: half-width of its 95 % interval [-].
        line: the fit.
        loads: number of its coefficients that are L.
    """
    return _undetermined(trials, slope, half, line, loads), (
        *_tell_scatter(trials, slope),
        *_tell_coverage(trials, line),
        *_tell_readings(line),
    )


def _undetermined(
    trials: Sequence[Trial], slope: Slope, half: float, line: Line, loads: int
) -> tuple[str, ...]:
    """What the data cannot tell."""
    found = []
    if half > 0.5 * slope.value:
        found.append(
            f"k is only known to ±{half:.2g}: turn further without slip, or take more grasps"
        )
    if not any(trial.reference.zeroed for trial in trials):
        found.append(
            "L: the references have zeros of their own, so only changes of the angle were used "
            "(Eq. 12); for L count the reference from the onset of contact"
        )
    errors = np.sqrt(np.diag(line.covariance))
    correlation = np.abs(line.covariance[0, 1:] / (errors[0] * np.maximum(errors[1:], 1e-300)))
    if loads and (correlation[:loads] > 0.99).any():
        found.append(
            "k and L separately: their errors are correlated by more than 0.99; turn both ways "
            "from the zero, and through more angle"
        )
    if loads == 1 and len(line.covariance) > 1 + len(line.coefficients):
        clocks = slice(1 + len(line.coefficients), None)
        mixed = np.abs(line.covariance[1, clocks]) / (errors[1] * errors[clocks])
        if (mixed > 0.99).any():
            found.append(
                "L and the clock offset separately: at a steady rate they have the same effect; "
                "hold the object still for a moment or turn it back"
            )
    return tuple(found)


def _tell_scatter(trials: Sequence[Trial], slope: Slope) -> Iterator[str]:
    """How k differs between the grasps, and that it is not below 0."""
    if len(trials) == 1:
        yield (
            "one grasp only: the interval covers the noise of the readings, not the scatter of k "
            "between grasps; record three or more"
        )
    elif slope.scatter > 0.0:
        yield (
            f"the grasps disagree (chance {slope.chance:.2g} were k the same): k scatters by "
            f"{slope.scatter:.3g} between them, and the interval is that of their mean"
        )
    else:
        yield f"the grasps agree within their errors (chance {slope.chance:.2g})"
    if slope.value < 1.0:
        yield (
            f"the fitted k is {slope.value - 1.0:.3g}, which is impossible; its interval includes "
            "0, which is used"
        )


def _tell_coverage(trials: Sequence[Trial], line: Line) -> Iterator[str]:
    """References that are short of their frames, and the frames that are left out."""
    excluded = Counter[str]()
    for number, trial in enumerate(trials):
        excluded.update(trial.excluded)
        read = line.points.time[line.points.trial == number]
        frames = trial.time - trial.start
        covered = np.mean((frames >= read.min()) & (frames <= read.max()))
        if covered < MOST_COVERED:
            yield (
                f"{trial.name}: the reference covers {100.0 * covered:.0f} % of the frames that "
                "stick: record it over the whole recording"
            )
    yield from (f"left out: {one}" for one in _count_excluded(excluded))


def _tell_readings(line: Line) -> Iterator[str]:
    """Readings without weight, and what the errors of the rotation amount to."""
    if outliers := int((line.weight == 0).sum()):
        yield f"no weight: {outliers} of {len(line.weight)} readings lie far off the line"
    noise = float(np.median(line.points.rotation_error**2) / np.var(line.points.rotation))
    yield (
        f"errors of the elastomer's rotation taken into account; least squares without them would "
        f"read 1 + k low by {100.0 * noise:.2g} %"
    )
