"""Fit k of an object on an elastomer of finite thickness to reference angles."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.softness.checks import LEAST_TURN
from calibration.softness.fit import SoftnessFit, fit_softness
from calibration.softness.readings import Layer
from calibration.softness.references import NO_REFERENCE, Reference
from calibration.softness.trials import (
    FEWEST_POINTS,
    FEWEST_ZEROED,
    Selection,
    Trial,
    make_trials,
)
from estimation.frames.names import counted
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.softness import LayeredSoftness, expect_scale

SELECTION = Selection(least_stick=6, least_turn_deg=0.5)
"""Frames with few markers are used, because hard objects slip early; they count little."""

_GUESSES = (0.1, 0.5, 1.5)  # k for which frames are lifted at first


class Grasp(NamedTuple):
    """A recording of an object that turns in the grasp, with the object's reference angle.

    Attributes:
        recording: recording that starts in the unloaded state.
        reference: angle of the object.
        noise: noise of the markers; None to estimate it from the recording.
        object_name: name of the object.
    """

    recording: Recording
    reference: Reference
    noise: Noise | None = None
    object_name: str = "object"


def fit_layered_softness(
    grasps: Sequence[Grasp], layer: Layer, *, clock_search: float = 1.0
) -> SoftnessFit:
    """Fit k, and refine thickness and depth as far as the grasps determine them better.

    Sticking markers are first segmented in frames lifted for several k. The first fit uses the k
    with most sticking markers. They are then segmented again in frames lifted for the fitted
    values, and the fit is repeated.

    Args:
        grasps: all grasps of one object.
        layer: thickness and marker depth of the elastomer, and shape of the object.
        clock_search: largest offset between two clocks [s].

    Raises:
        ValueError: the grasps cannot determine k; the message states what to measure instead. Or
            lengths are in px, so that a length in mm cannot be used.

    Examples:
        >>> import numpy as np
        >>> from calibration import Reference, fit_layered_softness
        >>> from calibration.softness.layered import Grasp
        >>> from calibration.softness.readings import Layer
        >>> from estimation import PivotModel, simulate_pivot
        >>> few = {"grid_shape": (10, 10), "pitch": 2.0}
        >>> soft = PivotModel(stiffness_ratio=0.5, friction_ratio=0.3, **few)
        >>> recording, truth = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(30,))
        >>> error = np.full(len(recording), np.radians(0.05))
        >>> about = {"zeroed": True, "same_clock": True, "source": "stage"}
        >>> stage = Reference(recording.time, truth.angle, error, **about)
        >>> fit = fit_layered_softness([Grasp(recording, stage)], Layer(thickness=100.0))
        >>> print(f"k = {fit.stiffness_ratio:.2f}")  # 0.5 is true
        k = 0.50
    """
    if not grasps:
        raise ValueError(f"0 grasps: {NO_REFERENCE}")
    rigid = LayeredSoftness(0.0, **layer.lengths)
    for grasp in grasps:
        expect_scale(rigid, grasp.recording.unit, grasp.recording.name)
    lifts = rigid.in_mm  # otherwise frames are the same for all k
    guesses = [replace(rigid, stiffness_ratio=k) for k in _GUESSES]
    candidates = [_gather(grasps, guess) for guess in (guesses if lifts else guesses[:1])]
    trials = max(candidates, key=lambda each: sum(trial.stick_markers for trial in each))
    fit = _fit(trials, layer, clock_search)
    if lifts:
        fitted = fit.softness
        assert isinstance(fitted, LayeredSoftness)
        sizes = {name: getattr(fitted, name) for name in ("stiffness_ratio", "thickness", "depth")}
        again = _gather(grasps, replace(rigid, **sizes))
        fit = _fit(again, layer, clock_search)
    return fit


def _fit(trials: Sequence[Trial], layer: Layer, clock_search: float) -> SoftnessFit:
    """Fit the trials with enough readings; without any, fit all trials."""
    informative = [
        trial
        for trial in trials
        if len(trial.time) >= FEWEST_POINTS
        or (len(trial.time) >= FEWEST_ZEROED and np.ptp(trial.rotation) >= LEAST_TURN)
    ]
    fit = fit_softness(informative or trials, clock_search=clock_search, layer=layer)
    used = {id(trial) for trial in informative}
    lost = [
        f"{trial.name}: left out, only {counted(len(trial.time), 'reading', 'readings')}"
        for trial in trials
        if id(trial) not in used
    ]
    return replace(fit, notes=(*fit.notes, *lost)) if informative else fit


def _gather(grasps: Sequence[Grasp], guess: LayeredSoftness) -> list[Trial]:
    """The trials of all grasps, with frames lifted for a guess of the softness."""
    return [
        trial
        for grasp in grasps
        for trial in make_trials(
            grasp.recording,
            grasp.reference,
            object_name=grasp.object_name,
            noise=grasp.noise,
            lifted_for=guess,
            selection=SELECTION,
        )
    ]
