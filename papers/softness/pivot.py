"""The real pivot `tac3d-pivot`: k fitted to the outline on one finger, tested on the other.

`make_trials` selects the readings: nine markers stick, and there is no macro slip. The outline has
no zero, so the median residual on each finger is subtracted before the errors are computed.
"""

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
from papers.items import Track
from papers.tables import cell, finish


class Pivot(NamedTuple):
    """Fits and residuals of both fingers."""

    trials: dict[str, Trial]  # readings by finger
    fits: dict[str, SoftnessFit]  # fitted k by finger
    # residual, outline minus (1 + k) φ, by the tested finger and the finger of k; `none` for k = 0
    # [rad]
    residual: dict[tuple[str, str], Float[np.ndarray, " readings"]]


def compute(quick: bool = False, track: Track = iter) -> Pivot:
    """Fit k on each finger, and test each k on both; the quick size is the full one."""
    del quick
    trials = {}
    for path in track(find_recordings(datasets.fetch("tac3d-pivot"))):
        recording = read_recording(path)
        (trials[recording.name],) = make_trials(recording, outline_reference(recording))
    fits = {name: fit_softness([trial]) for name, trial in trials.items()}
    residuals = {}
    for name, fit in fits.items():
        points = fit.line.points
        for source in ("none", *fits):
            k = 0.0 if source == "none" else fits[source].softness.stiffness_ratio
            residual = points.reference - (1.0 + k) * points.rotation
            residuals[name, source] = residual - np.median(residual)
    return Pivot(trials, fits, residuals)


def tables(result: Pivot) -> dict[str, list[dict[str, object]]]:
    """k of each finger, and the errors with each k on each finger."""
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
            "rms error [°]": cell(np.degrees(np.sqrt(np.mean(residual**2))), 3),
            "median absolute error [°]": cell(np.degrees(np.abs(residual)), 3, np.median),
            "largest [°]": cell(np.degrees(np.abs(residual)), 2, np.max),
        }
        for (name, source), residual in result.residual.items()
    ]
    return {"": fitted, "_tested": tested}


def plot(result: Pivot) -> Figure:
    """Residuals on each finger over φ, by the finger of k."""
    figure, axes = plt.subplots(
        1, len(result.fits), figsize=(10, 3.8), layout="constrained", squeeze=False
    )
    for axis, (name, fit) in zip(axes[0], result.fits.items(), strict=True):
        for source in ("none", *result.fits):
            label = "rigid" if source == "none" else f"k from {source}"
            residual = np.degrees(result.residual[name, source])
            axis.plot(np.degrees(fit.line.points.rotation), residual, ".", ms=4, label=label)
        phi, residual = "rotation φ of the elastomer [°]", "outline − (1 + k) φ [°]"
        finish(axis, legend=8, title=name, xlabel=phi, ylabel=residual)
    return figure
