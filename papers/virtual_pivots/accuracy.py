"""Error and interval of each method at each integer angle, on virtual pivots.

A sphere presses on a flat elastomer: contact radius 5 mm, 20×20 markers at 1 mm, with the grid
placed and turned at random under the object. Each draw is a single frame, loaded and twisted once,
without window or history. A missing answer counts as an error of the full angle.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators import METHODS
from estimation.frames.noise import Noise
from estimation.tracking.trackers import Trackers
from estimation.virtual.recording import PivotModel, simulate_frame
from papers.items import Track
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.tables import cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.solved import place_at_random


class Accuracy(NamedTuple):
    """Results of the draws.

    Attributes:
        methods: names of the methods.
        angle: true angles [deg].
        error: estimate minus truth; minus the truth without an answer [deg].
        answered: mask of the answered draws.
        inside: mask of the intervals that hold the truth.
        counts: mask of the draws in which enough markers truly stick.
        limit: mean absolute error at the Cramér–Rao bound of the true stick region [deg].
    """

    methods: tuple[str, ...]
    angle: Float[np.ndarray, " angles"]
    error: Float[np.ndarray, "noises ratios angles draws methods"]
    answered: Bool[np.ndarray, "noises ratios angles draws methods"]
    inside: Bool[np.ndarray, "noises ratios angles draws methods"]
    counts: Bool[np.ndarray, "noises ratios angles draws"]
    limit: Float[np.ndarray, "noises ratios angles draws"]


def compute(quick: bool = False, track: Track = iter) -> Accuracy:
    """Simulate the frames, and estimate their angles."""
    rng = np.random.default_rng(0)
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["accuracy"]
    axes = (settings.NOISES_UM, settings.FRICTION_RATIOS, settings.ANGLES_DEG, range(draws))
    shape = tuple(map(len, axes))
    error = np.zeros((*shape, len(METHODS)))
    answered, inside = np.zeros(error.shape, dtype=bool), np.zeros(error.shape, dtype=bool)
    counts, limit = np.zeros(shape, dtype=bool), np.zeros(shape)
    for case in track(list(np.ndindex(shape))):
        noise_um, ratio = settings.NOISES_UM[case[0]], settings.FRICTION_RATIOS[case[1]]
        truth = float(settings.ANGLES_DEG[case[2]])
        model = PivotModel(
            friction_ratio=ratio, noise=1e-3 * noise_um, normal_noise=3.5e-3 * noise_um
        )
        model = place_at_random(model, rng)
        layout, frame, stick = simulate_frame(model, float(np.radians(truth)), rng)
        counts[case] = stick.sum() >= settings.FIRM_MARKERS
        if not counts[case]:
            continue
        points = layout.reference[:, :2]
        limit[case] = MEAN_ABSOLUTE * np.degrees(angle_limit(points, stick, model.noise))
        trackers = Trackers(
            layout, {method: {} for method in METHODS}, noise=Noise.from_std(1e-3 * noise_um)
        )
        for i, estimate in enumerate(trackers.update(frame).values()):
            answered[(*case, i)] = np.isfinite(estimate.angle)
            error[(*case, i)] = np.degrees(np.nan_to_num(estimate.angle)) - truth
            low, high = np.degrees([estimate.low, estimate.high])
            inside[(*case, i)] = low <= truth <= high
    angle = np.array(settings.ANGLES_DEG, dtype=float)
    return Accuracy(tuple(METHODS), angle, error, answered, inside, counts, limit)


def tables(result: Accuracy) -> dict[str, list[dict[str, object]]]:
    """Tables by noise and method, and by angle."""
    return {"": tabulate(result), "_angles": tabulate_angles(result)}


def tabulate(result: Accuracy) -> list[dict[str, object]]:
    """One row per noise and method: pooled error, answers and intervals."""
    rows = []
    for n, noise_um in enumerate(settings.NOISES_UM):
        counts = result.counts[n]
        for i, method in enumerate(result.methods):
            error = np.abs(result.error[n][counts][:, i])
            rows.append(
                {
                    "noise [µm]": noise_um,
                    "method": method,
                    "draws": int(counts.sum()),
                    "answered [%]": cell(100 * result.answered[n][counts][:, i], 2),
                    "mean absolute error [°]": cell(error, 4),
                    "95th percentile [°]": cell(np.percentile(error, 95), 4),
                    **{
                        f"interval holds, μp0/2G*={ratio} [%]": cell(
                            100 * result.inside[n, r][counts[r]][:, i], 1
                        )
                        for r, ratio in enumerate(settings.FRICTION_RATIOS)
                    },
                }
            )
    return rows


def tabulate_angles(result: Accuracy) -> list[dict[str, object]]:
    """One row per angle: mean absolute error of each method at each noise [deg]."""
    rows = []
    for a, angle in enumerate(result.angle):
        row: dict[str, object] = {"angle [°]": int(angle)}
        for n, noise_um in enumerate(settings.NOISES_UM):
            counts = result.counts[n, :, a]
            for i, method in enumerate(result.methods):
                error = np.abs(result.error[n, :, a][counts][:, i])
                row[f"{method}, {noise_um:g} µm"] = cell(error, 4)
        rows.append(row)
    return rows


def plot(result: Accuracy) -> Figure:
    """Mean absolute error over the angle, a panel for each noise, with the paper's number.

    Lines become narrower from method to method, so that equal results stay visible.
    """
    figure, axes = plt.subplots(
        1, len(settings.NOISES_UM), figsize=(10, 4.6), sharey=True, layout="constrained"
    )
    for n, (axis, noise_um) in enumerate(zip(axes, settings.NOISES_UM, strict=True)):
        for i, method in enumerate(result.methods):
            error = [
                np.abs(result.error[n, :, a][result.counts[n, :, a]][:, i]).mean()
                for a in range(len(result.angle))
            ]
            axis.semilogy(result.angle, error, "o-", ms=7 - 1.5 * i, lw=3 - 0.5 * i, label=method)
        bound = [
            result.limit[n, :, a][result.counts[n, :, a]].mean() for a in range(len(result.angle))
        ]
        axis.semilogy(result.angle, bound, "k--", lw=1, label="Cramér–Rao bound")
        axis.axhline(
            settings.PAPER_ERROR_DEG, color="0.5", ls="--", lw=1, label="paper, hardware: 0.17°"
        )
        axis.set_xticks(settings.ANGLES_DEG[::3])
        finish(axis, minor=True, title=f"noise {noise_um:g} µm", xlabel="object's angle [°]")
    axes[0].set_ylabel("mean absolute error [°]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4,
                  fontsize=8)  # fmt: skip
    return figure
