"""The real pivot `tac3d-pivot`: k from one finger against the outline, tested on the other.

Readings are those that `make_trials` takes: nine markers stick, no macro slip. The outline has no
zero, so the median of what is left is taken off on each finger before the error is told.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from calibration.softness.fit import SoftnessFit, fit_softness
from calibration.softness.references import outline_reference
from calibration.softness.trials import Trial, make_trials
from estimation.frames import datasets
from estimation.sources import find_recordings, read_recording


class Pivot(NamedTuple):
    """Both fingers.

    Attributes:
        trials: by finger.
        fits: k of each.
        left: outline minus (1 + k) φ on a finger, by the finger that k is from; `none` for k = 0
            [rad].
    """

    trials: dict[str, Trial]
    fits: dict[str, SoftnessFit]
    left: dict[tuple[str, str], Float[np.ndarray, " readings"]]


def compute(quick: bool = False, track: Callable[[Iterable], Iterable] = iter) -> Pivot:
    """Fit each finger and test each k on both."""
    del quick
    trials = {}
    for path in track(find_recordings(datasets.fetch("tac3d-pivot"))):
        recording = read_recording(path)
        (trials[recording.name],) = make_trials(recording, outline_reference(recording))
    fits = {name: fit_softness([trial]) for name, trial in trials.items()}
    left = {}
    for name, fit in fits.items():
        points = fit.line.points
        for source in ("none", *fits):
            k = 0.0 if source == "none" else fits[source].softness.stiffness_ratio
            rest = points.reference - (1.0 + k) * points.rotation
            left[name, source] = rest - np.median(rest)
    return Pivot(trials, fits, left)


def tables(result: Pivot) -> dict[str, list[dict[str, object]]]:
    """k of each finger, and the errors of each k on each finger."""
    fitted: list[dict[str, object]] = [
        {
            "finger": name,
            "k": round(fit.stiffness_ratio, 4),
            "95 %": f"{fit.low:.3f} to {fit.high:.3f}",
            "readings": len(fit.line.weight),
            "without weight": int((fit.line.weight == 0).sum()),
            "left out": ", ".join(f"{n} {why}" for why, n in result.trials[name].excluded.items()),
        }
        for name, fit in result.fits.items()
    ]
    tested: list[dict[str, object]] = [
        {
            "tested on": name,
            "k from": source,
            "rms error [°]": round(float(np.degrees(np.sqrt(np.mean(rest**2)))), 3),
            "median absolute error [°]": round(float(np.degrees(np.median(np.abs(rest)))), 3),
            "largest [°]": round(float(np.degrees(np.abs(rest).max())), 2),
        }
        for (name, source), rest in result.left.items()
    ]
    return {"": fitted, "_tested": tested}


def plot(result: Pivot) -> Figure:
    """What is left on each finger, by where k is from."""
    figure, axes = plt.subplots(
        1, len(result.fits), figsize=(10, 3.8), layout="constrained", squeeze=False
    )
    for axis, (name, fit) in zip(axes[0], result.fits.items(), strict=True):
        for source in ("none", *result.fits):
            label = "rigid" if source == "none" else f"k from {source}"
            left = np.degrees(result.left[name, source])
            axis.plot(np.degrees(fit.line.points.rotation), left, ".", ms=4, label=label)
        axis.set_title(name, fontsize=10)
        axis.set_xlabel("rotation φ of the elastomer [°]")
        axis.set_ylabel("outline − (1 + k) φ [°]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, frameon=False)
    return figure
