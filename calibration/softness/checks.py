"""What speaks against fitting softness to trials, in words, with what to measure instead."""

from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float

from calibration.softness.regression import Line, Series, gather_points
from calibration.softness.trials import FEWEST_POINTS, Trial

LEAST_TURN = np.radians(1.0)
MOST_OUTLIERS = 0.35
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
                f"{trial.name}: {len(trial.time)} frames with a rotation of the elastomer"
                f"{_left_out(trial)}: record more frames before macro slip"
            )


def check_points(
    trials: Sequence[Trial], series: Sequence[Series], offsets: Float[np.ndarray, " trials"]
) -> None:
    """See that every trial has enough readings, over enough angle.

    Raises:
        ValueError: one has not.
    """
    for trial, one, offset in zip(trials, series, offsets, strict=True):
        points = gather_points([one], np.array([offset]))
        if len(points.rotation) < FEWEST_POINTS:
            raise ValueError(_too_few(trial, one, len(points.rotation)))
        turned = float(np.ptp(points.rotation))
        error = float(np.median(points.rotation_error))
        if turned < max(LEAST_TURN, 8.0 * error):
            away = float(np.abs(np.median(points.rotation)))
            state = (
                f"all its readings are at one angle (the elastomer at {np.degrees(away):.1f}°)"
                if away > LEAST_TURN
                else "the object does not turn"
            )
            raise ValueError(
                f"{trial.name}: {state}; the elastomer turns by {np.degrees(turned):.2f}°, known "
                f"to {np.degrees(error):.2f}°. Turn the object by 5° or more without slip, better "
                "both ways, and read the angle along the way"
            )
        if one.search > 0.0 and abs(offset) > 0.97 * one.search:
            raise ValueError(
                f"{trial.name}: the clocks of sensor and reference are further apart than the "
                f"{one.search:g} s that were searched, or the reference does not follow the "
                "object: start both together, or allow more (--clock-search)"
            )


def _too_few(trial: Trial, one: Series, found: int) -> str:
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
            f"{last:.2f} s: {found} readings fall between them. Record the reference over the "
            "whole recording, and give --same-clock where both share one"
        )
    return (
        f"{trial.name}: {found} readings with a rotation of the elastomer, "
        f"{FEWEST_POINTS} are needed{_left_out(trial)}: record more frames before macro slip, or "
        "read the reference more often"
    )


def _left_out(trial: Trial) -> str:
    """The frames that are not used, in brackets."""
    excluded = ", ".join(f"{count} frames {reason}" for reason, count in trial.excluded.items())
    return f" (left out: {excluded})" if excluded else ""


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
    if outliers > MOST_OUTLIERS * points:
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
