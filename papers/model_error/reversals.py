"""Total and incremental angles where the twist reverses.

A total angle assumes that its markers have stuck since the elastomer was unloaded. After a reversal
some sticking markers have slipped before and keep their old displacement. Increments between frames
in which the same markers stick, Eq. (12), are not affected. Virtual pivots: to 10°, held, back to
−20°.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot
from papers.items import Track
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.model_error import settings
from papers.tables import cell, finish

METHODS = ("paper", "rigid", "incremental")
FRICTION_RATIOS = (0.12, 0.15, 0.2, 0.3, 0.5)
PATH_DEG, FRAMES = (0.0, 10.0, 10.0, -20.0), (40, 10, 120)
NOISE_MM = 1e-3
DRAWS, QUICK_DRAWS = 10, 1


class Reversals(NamedTuple):
    """Errors along the path; NaN without an answer.

    Attributes:
        step: frames since the twist began.
        truth: the object's true angle [deg].
        error: error of the first draw, by friction and method [deg].
        mean: mean absolute error after the reversal, by friction, draw and method [deg].
        answered: share of answered frames after the reversal [-].
        limit: mean absolute error at the Cramér–Rao bound of the markers that have always stuck,
            median after the reversal, by friction [deg].
    """

    step: Float[np.ndarray, " frames"]
    truth: Float[np.ndarray, " frames"]
    error: Float[np.ndarray, "ratios methods frames"]
    mean: Float[np.ndarray, "ratios draws methods"]
    answered: Float[np.ndarray, "ratios draws methods"]
    limit: Float[np.ndarray, " ratios"]


def compute(quick: bool = False, track: Track = iter) -> Reversals:
    """Simulate the pivots, and estimate their angles."""
    draws = QUICK_DRAWS if quick else DRAWS
    first, mean, answered, limit = [], [], [], []
    step = truth_deg = np.zeros(0)
    for ratio in track(FRICTION_RATIOS):
        model = PivotModel(friction_ratio=ratio, noise=NOISE_MM)
        of_draws, shares = [], []
        for draw in range(draws):
            recording, truth = simulate_pivot(
                model,
                angles_deg=PATH_DEG,
                frames=FRAMES,
                timing=Timing(dropped=0.0),
                seed=settings.SEED + draw,
            )
            error = np.array(
                [np.degrees(estimate_angles(recording, m).angle - truth.angle) for m in METHODS]
            )
            turned = np.arange(len(recording)) >= len(recording) - FRAMES[-1]
            has_answer = np.isfinite(error[:, turned])
            total = np.where(has_answer, np.abs(error[:, turned]), 0.0).sum(axis=1)
            of_draws.append(total / np.maximum(has_answer.sum(axis=1), 1))
            shares.append(has_answer.mean(axis=1))
            if draw == 0:
                first.append(error)
                points = recording.layout.reference[:, :2]
                bounds = [angle_limit(points, stick, NOISE_MM) for stick in truth.stick[turned]]
                limit.append(MEAN_ABSOLUTE * np.median(bounds))
                step = np.arange(len(recording)) - (len(recording) - sum(FRAMES)) + 0.0
                truth_deg = np.degrees(truth.angle)
        mean.append(of_draws)
        answered.append(shares)
    return Reversals(
        step, truth_deg, np.array(first), np.array(mean), np.array(answered), np.degrees(limit)
    )


def tables(result: Reversals) -> dict[str, list[dict[str, object]]]:
    """A row for each friction and method: errors after the reversal."""
    return {
        "": [
            {
                "μp0/2G*": ratio,
                "method": method,
                "mean absolute error [°]": cell(result.mean[i, :, j], 4),
                "answered [%]": cell(100 * result.answered[i, :, j], 1),
                "Cramér–Rao, always stuck [°]": cell(result.limit[i], 4),
            }
            for i, ratio in enumerate(FRICTION_RATIOS)
            for j, method in enumerate(METHODS)
        ]
    }


def plot(result: Reversals) -> Figure:
    """Error over the frames for two frictions, and the mean after the reversal over friction."""
    figure, axes = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    for axis, i in zip(axes[:2], (1, 3), strict=True):
        for j, method in enumerate(METHODS):
            axis.plot(result.step, result.error[i, j], color=f"C{j}", lw=1.2, label=method)
        axis.axvline(FRAMES[0] + FRAMES[1], color="0.5", ls=":", lw=1)
        title = f"μp₀/2G* = {FRICTION_RATIOS[i]:g}; dotted: turns back"
        axis.set(ylabel="error [°]", xlim=(0, result.step[-1]))
        finish(axis, title=title, xlabel="frame since the twist began")
    axes[0].legend(fontsize=8)
    for j, method in enumerate(METHODS):
        axes[2].semilogy(FRICTION_RATIOS, result.mean[:, :, j].mean(axis=1), "o-", color=f"C{j}",
                         label=method)  # fmt: skip
    axes[2].semilogy(FRICTION_RATIOS, result.limit, "k--", label="Cramér–Rao, always stuck")
    error = "mean absolute error after the turn [°]"
    finish(axes[2], legend=8, minor=True, xlabel="μp₀/2G* [-]", ylabel=error)
    return figure
