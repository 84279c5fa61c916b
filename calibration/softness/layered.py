"""k of an object on an elastomer of finite thickness, from angles known from elsewhere."""

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
from estimation.softness import LayeredSoftness

SELECTION = Selection(least_stick=6, least_turn_deg=0.5)
"""Few markers have wide intervals and count little; hard objects that slip early have no more."""

_GUESSES = (0.1, 0.5, 1.5)  # k for which frames are lifted at first


class Grasp(NamedTuple):
    """A recording of an object that turns in the grasp, and its angle.

    Attributes:
        recording: from the unloaded state on.
        reference: the object's angle.
        noise: of the markers; estimated from the recording unless given.
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

    What sticks is sought in frames lifted for several k; then, after a first fit with the k that
    holds most markers together, in frames lifted for what was found.

    Args:
        grasps: of one object, several at once.
        layer: the elastomer.
        clock_search: how far two clocks may be apart at most [s].

    Raises:
        ValueError: the grasps cannot determine k; the message says what to measure instead.

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
        k = 0.51
    """
    if not grasps:
        raise ValueError(f"0 grasps: {NO_REFERENCE}")
    finite = np.isfinite([layer.thickness, layer.object_radius]).any()
    lifts = finite or layer.depth > 0.0  # else frames are the same for all k
    rigid = LayeredSoftness(0.0, layer.thickness, layer.depth, object_radius=layer.object_radius)
    guesses = [replace(rigid, stiffness_ratio=k) for k in _GUESSES]
    found = [_gather(grasps, guess) for guess in (guesses if lifts else guesses[:1])]
    trials = max(found, key=lambda each: sum(trial.held for trial in each))
    fit = _fit(trials, layer, clock_search)
    if lifts:
        made = fit.softness
        assert isinstance(made, LayeredSoftness)
        sizes = {name: getattr(made, name) for name in ("stiffness_ratio", "thickness", "depth")}
        again = _gather(grasps, replace(rigid, **sizes))
        fit = _fit(again, layer, clock_search)
    return fit


def _fit(trials: Sequence[Trial], layer: Layer, clock_search: float) -> SoftnessFit:
    """The fit of all trials but those that say little; of all of them where there are no others."""
    kept = [
        one
        for one in trials
        if len(one.time) >= FEWEST_POINTS
        or (len(one.time) >= FEWEST_ZEROED and np.ptp(one.rotation) >= LEAST_TURN)
    ]
    fit = fit_softness(kept or trials, clock_search=clock_search, layer=layer)
    used = {id(one) for one in kept}
    lost = [
        f"{t.name}: left out, {counted(len(t.time), 'reading', 'readings')}"
        for t in trials
        if id(t) not in used
    ]
    return replace(fit, notes=(*fit.notes, *lost)) if kept else fit


def _gather(grasps: Sequence[Grasp], guess: LayeredSoftness) -> list[Trial]:
    """The trials of all grasps, their frames lifted for a guess."""
    return [
        trial
        for one in grasps
        for trial in make_trials(
            one.recording,
            one.reference,
            object_name=one.object_name,
            noise=one.noise,
            lifted_for=guess,
            selection=SELECTION,
        )
    ]
