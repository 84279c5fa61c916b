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
    try:
        fit = fit_softness(
            [_beside(one, two) for one, two in zip(first, second, strict=True)],
            clock_search=clock_search,
        )
    except ValueError as error:
        raise ValueError(
            f"the second finger as reference of the first, which should turn less: {error}"
        ) from error
    slope = 1.0 + fit.stiffness_ratio
    if not slope < stiffness:
        raise ValueError(
            f"the second finger turns {slope:.3g} times as far as the first, and with k₁/k₂ = "
            f"{stiffness:g} no object explains more than {stiffness:g}: check k₁/k₂, which finger "
            "is which, and that the object does not twist between them"
        )
    ends = [max(_second_k(end, stiffness), 0.0) for end in (1.0 + fit.low, slope, 1.0 + fit.high)]
    rate = (stiffness - 1.0) / (stiffness - slope) ** 2
    error = 0.5 * (fit.high - fit.low) / Z95 * rate
    made = [
        ScalarSoftness(
            stiffness_ratio=scale * ends[1],
            covariance=((float((scale * error) ** 2), 0.0), (0.0, 0.0)),
            provenance=dict(fit.softness.provenance) | {"stiffness_of_fingers": stiffness},
        )
        for scale in (stiffness, 1.0)
    ]
    return TwoFingers(
        first=made[0],
        second=made[1],
        low=(stiffness * ends[0], ends[0]),
        high=(stiffness * ends[2], ends[2]),
        ratio=(1.0 + fit.low, slope, 1.0 + fit.high),
        fit=fit,
    )


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
