"""Fig. 8(b): a long object lifted three times, the last time into macro slip.

The virtual pivot of `estimation.virtual`: a round contact on a pad with markers, at 30 frames per
second with some frames lost. The paper's method uses the paper's filter: a window of 5 frames and
the removal of zero drift.
"""

import time
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.result import Result
from estimation.frames.recording import Recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, Truth, simulate_pivot
from papers.items import Track
from papers.li2024 import settings
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.tables import cell, finish

METHODS = ("paper", "paper_strict", "kolamuri", DEFAULT_METHOD)

FRICTION_RATIO = 0.15
"""μp0/2G* [-]: the last markers slip at about 20°."""

PATH_DEG = (0.0, 6.0, 6.0, 13.0, 13.0, 26.0, 26.0)
FRAMES = (30, 20, 30, 20, 45, 20)
"""Three lifts, each followed by a hold, and their frames."""


class Lifts(NamedTuple):
    """A recording with the results of each method."""

    recording: Recording  # the recording
    truth: Truth  # true angle, contact and slip
    results: dict[str, Result]  # result of each of `METHODS`
    # mean absolute error at the Cramér–Rao bound of one frame, from the markers that do not slip
    # [deg]
    limit: Float[np.ndarray, " frames"]
    speed: float  # frames per second of the default method, on this machine


def compute(quick: bool = False, track: Track = iter) -> Lifts:
    """Simulate three lifts and measure them, in seconds; the quick size is the full one."""
    model = PivotModel(friction_ratio=FRICTION_RATIO)
    recording, truth = simulate_pivot(
        model,
        angles_deg=PATH_DEG,
        frames=FRAMES,
        timing=Timing(settings.RATE_HZ),
        seed=settings.SEED,
    )
    results, taken = {}, {}
    for method in track(METHODS):
        start = time.perf_counter()
        results[method] = estimate_angles(recording, method)
        taken[method] = time.perf_counter() - start
    speed = len(recording) / taken[DEFAULT_METHOD]
    points = recording.layout.reference[:, :2]
    limit = [angle_limit(points, sticking, model.noise) for sticking in truth.sticking_now]
    return Lifts(recording, truth, results, MEAN_ABSOLUTE * np.degrees(limit), speed)


def numbers(result: Lifts) -> dict[str, float]:
    """Our numbers for `published.csv`: lifts that are followed up to macro slip, and the rate.

    A lift is followed if every frame has an answer and the mean absolute error is below a tenth of
    the lift.
    """
    slipped = np.maximum.accumulate(result.truth.macro_slip)
    truth = np.degrees(result.truth.angle)
    error = np.degrees(result.results[DEFAULT_METHOD].angle) - truth
    followed = 0
    for low, high in zip(PATH_DEG[0:-1:2], PATH_DEG[1::2], strict=True):
        lift = (truth > low) & (truth < high) & ~slipped
        followed += bool(np.abs(error[lift]).mean() < 0.1 * (high - low))  # False with any NaN
    return {"lifts": float(followed), "rate": result.speed}


def tables(result: Lifts) -> dict[str, list[dict[str, object]]]:
    """A row for each method: errors before and after macro slip, and its first missing answer."""
    slipped = np.maximum.accumulate(result.truth.macro_slip)
    touching, time = np.isfinite(result.truth.angle), result.recording.time
    rows = []
    for method, answers in result.results.items():
        error = np.abs(np.degrees(answers.angle - result.truth.angle))
        slips = answers.slipping
        rows.append(
            {
                "method": method,
                "mean absolute error before macro slip [°]": cell(error[touching & ~slipped], 3),
                "after it [°]": cell(error[touching & slipped], 3),
                "first without an answer [s]": cell(time[slips][:1], 2),
                "macro slip began at [s]": cell(time[np.argmax(slipped)], 2),
            }
        )
    return {"": rows}


def plot(result: Lifts) -> Figure:
    """Angle and error over time, and the markers in three frames."""
    figure = plt.figure(figsize=(12, 8), layout="constrained")
    axes = figure.subplot_mosaic([["angle"] * 3, ["error"] * 3, ["a", "b", "c"]],
                                 height_ratios=[1.2, 0.8, 1.2])  # fmt: skip
    seconds, truth = result.recording.time, np.degrees(result.truth.angle)
    for i, (method, answers) in enumerate(result.results.items()):
        angle = np.degrees(answers.angle)
        axes["angle"].plot(seconds, angle, lw=1.2, label=method, color=f"C{i}")
        axes["error"].semilogy(seconds, np.abs(angle - truth), lw=1.0, color=f"C{i}")
    axes["angle"].plot(seconds, truth, "k--", lw=1.0, label="truth")
    touching = np.isfinite(truth)
    axes["error"].semilogy(
        seconds[touching], result.limit[touching], "k:", label="Cramér–Rao bound"
    )
    slipped = np.maximum.accumulate(result.truth.macro_slip)
    for name in ("angle", "error"):
        axes[name].axvspan(seconds[np.argmax(slipped)], seconds[-1], color="0.9", zorder=0)
    finish(axes["angle"], ylabel="object's angle [°]")
    axes["angle"].legend(fontsize=8, title="grey: macro slip", title_fontsize=8)
    axes["error"].set(ylim=(1e-4, 20.0))
    finish(axes["error"], legend=8, xlabel="time [s]", ylabel="absolute error [°]")
    for name, angle in zip("abc", (3.0, 11.0, 18.0), strict=True):
        _plot_markers(axes[name], result, int(np.nanargmin(np.abs(truth - angle))))
    return figure


def _plot_markers(axis, result: Lifts, frame: int) -> None:
    answers = result.results[DEFAULT_METHOD]
    position = result.recording.positions[frame, :, :2]
    contact, stick = result.truth.contact[frame], result.truth.sticking_now[frame]
    axis.scatter(*position.T, s=4, color="0.8")
    axis.scatter(*position[contact & ~stick].T, s=14, color="C1", label="slips (truth)")
    axis.scatter(*position[stick].T, s=14, color="C0", label="sticks (truth)")
    seen = answers.stick[frame]
    axis.scatter(*position[seen].T, s=40, facecolors="none", edgecolors="k", lw=0.7,
                 label=f"sticks ({answers.method})")  # fmt: skip
    axis.set(aspect="equal", xlim=(-7, 7), ylim=(-7, 7), xlabel="x [mm]")
    moment = np.degrees(result.truth.angle[frame])
    axis.set_title(f"{moment:.1f}°, {result.recording.time[frame]:.2f} s", fontsize=10)
    if frame < len(result.recording) // 3:
        axis.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.02, 1.0))
        axis.set_ylabel("y [mm]")
