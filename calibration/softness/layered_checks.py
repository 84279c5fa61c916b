"""What speaks against fitting a softness to lifted frames, in the words of `softness_checks`."""

import numpy as np
from jaxtyping import Float

from calibration.softness.checks import LEAST_TURN, check_line
from calibration.softness.references import Reference
from calibration.softness.regression import Columns, Series, fit_line
from calibration.softness.trials import FEWEST_POINTS, Trial
from estimation.recording import Recording


def check_turns(
    recording: Recording,
    rotation: Float[np.ndarray, " turns"],
    error: Float[np.ndarray, " turns"],
    angle: Float[np.ndarray, " turns"],
) -> Trial:
    """The turns of one grasp as a trial, seen to follow the reference as an object's angle does.

    Args:
        recording: of the grasp.
        rotation: of what sticks, lifted [rad].
        error: its standard error [rad].
        angle: the object's, from the reference [rad].

    Raises:
        ValueError: they do not turn, or the reference has another sign or unit or follows
            something else.
    """
    count = len(rotation)
    number, unknown = np.arange(count, dtype=float), np.full(count, np.nan)
    first = recording.layout.neighbours[:, 0]
    points = recording.layout.reference
    trial = Trial(
        name=recording.name,
        thing="object",
        start=0.0,
        time=number,
        rotation=rotation,
        error=error,
        normal_force=unknown,
        radius=unknown,
        reference=Reference(number, angle, unknown, True, True, "reference"),
        excluded={},
        markers=len(points),
        pitch=float(np.median(np.linalg.norm(points[first] - points, axis=1)[first >= 0])),
    )
    if count < FEWEST_POINTS:  # of several grasps one may tell little
        return trial
    if np.ptp(rotation) < LEAST_TURN:
        raise ValueError(
            f"{trial.name}: all frames that stick are at one angle, the elastomer turns by "
            f"{np.degrees(np.ptp(rotation)):.2f}°: turn the object by 5° or more without slip, "
            "better both ways, and read the angle along the way"
        )
    series = Series(number, angle, unknown, number, rotation, np.maximum(error, 1e-9), 0.0)
    through_zero = Columns(np.array([-1]), np.ones(1))
    check_line(trial, series, fit_line([series], through_zero, np.zeros(1)))
    return trial
