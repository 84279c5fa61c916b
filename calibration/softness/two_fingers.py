"""k and the object's angle from two fingers of different stiffness, without any other reference.

Both fingers hold one object that does not twist in between: θ = (1 + k₁) φ₁ = (1 + k₂) φ₂ by Eq.
(13) of [Li2024] (see `softness`) without load terms. If k₁/k₂ is known, because the object is the
same and the elastomers are, their rotations tell k₂, and with it k₁ and θ.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.softness.fit import SoftnessFit, fit_softness
from calibration.softness.references import Reference
from calibration.softness.trials import Trial
from estimation.estimators.measurement import Z95
from estimation.softness import ScalarSoftness

LEAST_DIFFERENCE = 0.05
"""Difference of k₁/k₂ from 1 below which the fingers count as alike."""


class TwoFingers(NamedTuple):
    """Softness of one object on two sensors.

    Attributes:
        first: on the first finger.
        second: on the second.
        low: lower ends of the 95 % intervals of both k [-].
        high: upper ends; infinite where the data put no bound [-].
        ratio: of the fingers' rotations, φ₂/φ₁, and its 95 % interval [-].
        fit: of the second finger's rotation over the first's.

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
        first k between 0.79 and 0.81
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
    """Fit k on both fingers to how far they turn beside each other.

    Args:
        first: trials on the first finger; their references are not used.
        second: the same grasps on the second finger, in the same order.
        stiffness: k₁/k₂, which is G₁/G₂ for thick elastomers [-].
        clock_search: how far the fingers' clocks may be apart at most [s].

    Raises:
        ValueError: fingers alike, or rotations that no such pair of k explains.

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
        raise ValueError(f"k₁/k₂ is {stiffness}; it must be above 0")
    if abs(stiffness - 1.0) < LEAST_DIFFERENCE:
        raise ValueError(
            f"k₁/k₂ is {stiffness:g}: equal fingers turn alike whatever the object is, so k cannot "
            "be determined; take a second pad of another stiffness or thickness, or a reference "
            "angle"
        )
    if stiffness < 1.0:  # let the first be the stiffer one, which turns less
        return _swap(fit_two_fingers(second, first, 1.0 / stiffness, clock_search))
    fit = _fit_beside(first, second, clock_search)
    slope = 1.0 + fit.stiffness_ratio
    if not slope < stiffness:
        raise ValueError(
            f"the second finger turns {slope:.3g} times as far as the first, and with k₁/k₂ = "
            f"{stiffness:g} no object explains more than {stiffness:g}: check k₁/k₂, which finger "
            "is which, and that the object does not twist between them"
        )
    ends = [max(_second_k(end, stiffness), 0.0) for end in (1.0 + fit.low, slope, 1.0 + fit.high)]
    error = 0.5 * (fit.high - fit.low) / Z95 * (stiffness - 1.0) / (stiffness - slope) ** 2
    given = dict(fit.softness.provenance) | {"stiffness_of_fingers": stiffness}
    first_k, second_k = (
        ScalarSoftness(scale * ends[1], covariance=_of_k(scale * error), provenance=given)
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


def _of_k(error: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The covariance of (k, L) where only k has an error."""
    return (float(error**2), 0.0), (0.0, 0.0)


def _fit_beside(
    first: Sequence[Trial], second: Sequence[Trial], clock_search: float
) -> SoftnessFit:
    """The second finger's rotation over the first's."""
    pairs = [_beside(one, two) for one, two in zip(first, second, strict=True)]
    try:
        return fit_softness(pairs, clock_search=clock_search)
    except ValueError as error:
        raise ValueError(
            f"the second finger as reference of the first, which should turn less: {error}"
        ) from error


def _swap(found: TwoFingers) -> TwoFingers:
    """The first finger as the second."""
    low, centre, high = found.ratio
    return TwoFingers(
        first=found.second,
        second=found.first,
        low=(found.low[1], found.low[0]),
        high=(found.high[1], found.high[0]),
        ratio=(1.0 / high, 1.0 / centre, 1.0 / low),
        fit=found.fit,
    )


def _second_k(ratio: float, stiffness: float) -> float:
    """k₂ from φ₂/φ₁ = (1 + c k₂)/(1 + k₂), c = k₁/k₂; infinite from c on."""
    return (ratio - 1.0) / (stiffness - ratio) if ratio < stiffness else float("inf")


def _beside(one: Trial, two: Trial) -> Trial:
    """A trial of the first finger with the second's rotation, seen from the other side."""
    reference = Reference(
        time=two.time,
        angle=-two.rotation,
        error=two.error,
        zeroed=False,
        same_clock=False,
        source=f"second finger {two.name}",
    )
    return replace(one, reference=reference)
