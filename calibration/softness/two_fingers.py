"""Fit k with two fingers of different stiffness, without another reference.

Both fingers hold one object that does not twist between them: θ = (1 + k₁) φ₁ = (1 + k₂) φ₂ by Eq.
(13) of [Li2024] (see `softness`) without load terms. k₁/k₂ is known, because the object is the same
and both elastomers are known. The two rotations then determine k₂, and with it k₁ and θ.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.softness.checks import left_out
from calibration.softness.fit import SoftnessFit, fit_softness
from calibration.softness.references import Reference
from calibration.softness.trials import FEWEST_POINTS, Trial
from estimation.estimators.measurement import Z95
from estimation.frames.names import counted
from estimation.softness import ScalarSoftness

LEAST_DIFFERENCE = 0.05
"""Difference of k₁/k₂ from 1 below which the fingers count as equal."""


class TwoFingers(NamedTuple):
    """Softness of one object on two fingers.

    Attributes:
        first: softness on the first finger.
        second: softness on the second finger.
        low: lower ends of the 95 % intervals of k₁ and k₂ [-].
        high: upper ends of the 95 % intervals of k₁ and k₂; infinite without a bound [-].
        ratio: lower end, estimate and upper end of φ₂/φ₁, the ratio of the fingers' rotations [-].
        fit: fit of the softer finger's rotation over the stiffer finger's.

    Examples:
        >>> from calibration import Reference, fit_two_fingers, make_trials
        >>> from estimation import PivotModel, simulate_pivot
        >>> def grasp(k, turn):  # as a finger sees it
        ...     soft = PivotModel(stiffness_ratio=k, friction_ratio=0.3)
        ...     recording, truth = simulate_pivot(soft, angles_deg=(0.0, turn), frames=(30,))
        ...     unused = Reference(recording.time, truth.angle, truth.angle, True, True, "")
        ...     return make_trials(recording, unused)
        >>> both = fit_two_fingers(grasp(0.8, 10.0), grasp(0.2, -10.0), stiffness=4.0)
        >>> low, ratio, high = both.ratio
        >>> print(f"the second finger turns {ratio:.2f} times as far as the first")
        the second finger turns 1.50 times as far as the first
        >>> print(f"first k between {both.low[0]:.2f} and {both.high[0]:.2f}")
        first k between 0.80 and 0.81
    """

    first: ScalarSoftness
    second: ScalarSoftness
    low: tuple[float, float]
    high: tuple[float, float]
    ratio: tuple[float, float, float]
    fit: SoftnessFit


def fit_two_fingers(
    first: Sequence[Trial], second: Sequence[Trial], stiffness: float, clock_search: float = 1.0
) -> TwoFingers:
    """Fit k on both fingers to the ratio of their rotations.

    Args:
        first: trials on the first finger; their references are not used.
        second: the same grasps on the second finger, in the same order.
        stiffness: k₁/k₂, which is G₁/G₂ for thick elastomers [-].
        clock_search: largest offset between the fingers' clocks [s].

    Raises:
        ValueError: the fingers are equally stiff, no pair of k explains the rotations, or a
            finger has too few usable frames.

    Examples:
        >>> from calibration import Reference, fit_two_fingers, make_trials
        >>> from estimation import PivotModel, simulate_pivot
        >>> def grasp(k, turn):  # as a finger sees it
        ...     soft = PivotModel(stiffness_ratio=k, friction_ratio=0.3)
        ...     recording, truth = simulate_pivot(soft, angles_deg=(0.0, turn), frames=(30,))
        ...     unused = Reference(recording.time, truth.angle, truth.angle, True, True, "")
        ...     return make_trials(recording, unused)
        >>> both = fit_two_fingers(grasp(0.8, 10.0), grasp(0.2, -10.0), stiffness=4.0)
        >>> print(f"k = {both.first.stiffness_ratio:.2f} and {both.second.stiffness_ratio:.2f}")
        k = 0.80 and 0.20
    """
    if not (np.isfinite(stiffness) and stiffness > 0.0):
        raise ValueError(f"k₁/k₂ is {stiffness}; it must be a finite number above 0")
    if abs(stiffness - 1.0) < LEAST_DIFFERENCE:
        raise ValueError(
            f"k₁/k₂ is {stiffness:g}: equal fingers turn alike on every object, so k cannot be "
            "determined; use a second pad of another stiffness or thickness, or a reference angle"
        )
    if stiffness < 1.0:  # let the first be the stiffer one, which turns less
        return _swap(fit_two_fingers(second, first, 1.0 / stiffness, clock_search))
    _check_usable([*first, *second])
    fit = _fit_beside(first, second, clock_search)
    slope = 1.0 + fit.stiffness_ratio
    if not slope < stiffness:
        raise ValueError(
            f"the second finger turns {slope:.3g} times as far as the first, but with k₁/k₂ = "
            f"{stiffness:g} the ratio must be below {stiffness:g} for every object: check k₁/k₂, "
            "the order of the fingers, and that the object does not twist between them"
        )
    ends = [max(_second_k(end, stiffness), 0.0) for end in (1.0 + fit.low, slope, 1.0 + fit.high)]
    error = 0.5 * (fit.high - fit.low) / Z95 * (stiffness - 1.0) / (stiffness - slope) ** 2
    provenance = dict(fit.softness.provenance) | {"stiffness_of_fingers": stiffness}
    first_k, second_k = (
        ScalarSoftness(scale * ends[1], covariance=_of_k(scale * error), provenance=provenance)
        for scale in (stiffness, 1.0)
    )
    return TwoFingers(
        first=first_k,
        second=second_k,
        low=(stiffness * ends[0], ends[0]),
        high=(stiffness * ends[2], ends[2]),
        ratio=(1.0 + fit.low, slope, 1.0 + fit.high),
        fit=fit,
    )


def _check_usable(trials: Sequence[Trial]) -> None:
    """Check that every trial has enough usable frames, because each finger's are readings."""
    for trial in trials:
        if len(trial.time) < FEWEST_POINTS:
            frames = counted(len(trial.time), "usable frame", "usable frames")
            raise ValueError(
                f"{trial.name}: {frames} with a known rotation of the gel{left_out(trial)}, and "
                f"{FEWEST_POINTS} are needed on each finger: press harder, and turn the object one "
                "way by 10° or more without slip"
            )


def _of_k(error: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The covariance of (k, L) if only k has an error."""
    return (float(error**2), 0.0), (0.0, 0.0)


def _fit_beside(
    first: Sequence[Trial], second: Sequence[Trial], clock_search: float
) -> SoftnessFit:
    """Fit the second finger's rotation over the first's."""
    pairs = [_beside(*pair) for pair in zip(first, second, strict=True)]
    try:
        return fit_softness(pairs, clock_search=clock_search)
    except ValueError as error:
        raise ValueError(
            f"the second finger is the reference of the first, which should turn less: {error}"
        ) from error


def _swap(fingers: TwoFingers) -> TwoFingers:
    """Swap the fingers of a result."""
    low, centre, high = fingers.ratio
    return TwoFingers(
        first=fingers.second,
        second=fingers.first,
        low=(fingers.low[1], fingers.low[0]),
        high=(fingers.high[1], fingers.high[0]),
        ratio=(1.0 / high, 1.0 / centre, 1.0 / low),
        fit=fingers.fit,
    )


def _second_k(ratio: float, stiffness: float) -> float:
    """k₂ from φ₂/φ₁ = (1 + c k₂)/(1 + k₂), c = k₁/k₂; infinite if the ratio is c or more."""
    return (ratio - 1.0) / (stiffness - ratio) if ratio < stiffness else float("inf")


def _beside(first: Trial, second: Trial) -> Trial:
    """A trial of the first finger with the opposite rotation of the second as its reference."""
    reference = Reference(
        time=second.time,
        angle=-second.rotation,
        error=second.error,
        zeroed=False,
        same_clock=False,
        source=f"second finger {second.name}",
        finger=True,
    )
    return replace(first, reference=reference)
