"""Accuracy of the margin's prediction of macro slip, by the angle ahead.

Reversals of round pivots with random friction and marker grid; the moment has 0.05 N·mm of noise.
The true end is the frame in which fewer than three markers stick. At several angles ahead of it,
the predicted end is compared with the true one, and its interval is checked. The true end changes
in steps, since markers slip one by one.
"""

from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.slip.margin import follow_margin
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import simulate_pivot
from papers.items import Track
from papers.virtual_pivots import settings
from papers.virtual_pivots.reversal import draw_model

AHEAD_DEG = (20.0, 15.0, 10.0, 5.0, 2.0)
MOMENT_NOISE_NMM = 0.05


class Foretold(NamedTuple):
    """Predictions by draw and angle ahead; NaN without a prediction.

    Attributes:
        error: predicted minus true remaining angle [deg].
        low: lower end of the interval minus the true remaining angle [deg].
        high: upper end of the interval minus the true remaining angle [deg].
    """

    error: Float[np.ndarray, "draws aheads"]
    low: Float[np.ndarray, "draws aheads"]
    high: Float[np.ndarray, "draws aheads"]


def compute(quick: bool = False, track: Track = iter) -> Foretold:
    """Simulate the recordings, and predict macro slip in each."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["margin"]
    columns = np.array([_foretell(draw) for draw in track(range(draws))])
    return Foretold(*np.moveaxis(columns, 1, 0))


def _foretell(draw: int) -> Float[np.ndarray, "3 aheads"]:
    rng = np.random.default_rng((1, draw))
    recording, truth = simulate_pivot(draw_model(rng), seed=draw)
    result = estimate_angles(recording)
    noise = MOMENT_NOISE_NMM * rng.standard_normal(len(recording))
    margins = follow_margin(replace(result, moment=result.moment + noise))
    remaining = np.degrees(truth.angle - truth.angle[np.argmax(truth.macro_slip)])
    foretold = np.full((3, len(AHEAD_DEG)), np.nan)
    for i, ahead in enumerate(AHEAD_DEG):
        turning = np.flatnonzero((recording.source_index >= 80) & (remaining <= ahead))
        if truth.macro_slip.any() and len(turning):
            frame = turning[0]
            foretold[:, i] = (
                np.degrees([values[frame] for values in margins[:3]]) - remaining[frame]
            )
    return foretold


def tables(result: Foretold) -> dict[str, list[dict[str, object]]]:
    """A row for each angle ahead."""
    rows = []
    for i, ahead in enumerate(AHEAD_DEG):
        predicted = np.isfinite(result.error[:, i])
        error, low, high = (column[predicted, i] for column in result)
        rows.append(
            {
                "ahead [°]": ahead,
                "draws": len(predicted),
                "foretold [%]": round(100 * float(predicted.mean()), 1),
                "bias [°]": round(float(error.mean()), 2) if predicted.any() else None,
                "mean absolute error [°]": round(float(np.abs(error).mean()), 2)
                if predicted.any()
                else None,
                "interval holds [%]": round(100 * float(np.mean((low <= 0) & (high >= 0))), 1)
                if predicted.any()
                else None,
            }
        )
    return {"": rows}


def plot(result: Foretold) -> Figure:
    """Errors of the predicted end, with intervals, over the true remaining angle."""
    figure, axis = plt.subplots(figsize=(7, 3.8), layout="constrained")
    for i, ahead in enumerate(AHEAD_DEG):
        width = np.linspace(-0.5, 0.5, len(result.error))
        bars = np.stack([result.error - result.low, result.high - result.error])[:, :, i]
        axis.errorbar(ahead + width, result.error[:, i], bars, fmt=".", lw=0.5, color="C0")
    axis.axhline(0.0, color="0.6", lw=1)
    axis.invert_xaxis()
    axis.set_xlabel("true remaining angle [°]")
    axis.set_ylabel("predicted less true [°]")
    axis.grid(alpha=0.3)
    return figure
