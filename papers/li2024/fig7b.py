"""Fig. 7(b): static error at each integer angle, compared with Kolamuri's method.

A cube's face on a domed pad makes a round contact within the face with Hertz pressure: the virtual
pivot of `estimation.virtual`. Every repetition draws the marker grid and the friction at random. It
is a single frame, so the paper's window does not apply. A missing answer counts as an error of the
full angle.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.estimators import DEFAULT_METHOD
from estimation.frames.noise import Noise
from estimation.tracking.trackers import Trackers
from estimation.virtual.recording import PivotModel, simulate_frame
from papers.items import Track
from papers.li2024 import settings
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.tables import cell, finish
from papers.virtual_pivots.solved import place_at_random

METHODS = ("paper", "paper_strict", "kolamuri", DEFAULT_METHOD)


class Static(NamedTuple):
    """Results of the repetitions in which enough markers stick."""

    noise_um: Float[np.ndarray, " draws"]  # noise per in-plane coordinate [µm]
    angle: Float[np.ndarray, " draws"]  # true angle [deg]
    error: Float[np.ndarray, "draws methods"]  # error of each of `METHODS` [deg]
    limit: Float[np.ndarray, " draws"]  # Cramér–Rao bound, as a standard deviation [deg]


def compute(quick: bool = False, track: Track = iter) -> Static:
    """Simulate and measure all repetitions."""
    rng = np.random.default_rng(settings.SEED)
    low, high = settings.QUICK_REPETITIONS if quick else settings.REPETITIONS
    rows = []
    for angle in track(settings.ANGLES_DEG):
        for noise_um in settings.NOISES_UM:
            for _ in range(rng.integers(low, high + 1)):
                rows.append(_repeat(float(angle), noise_um, rng))
    noise_um, angles, error, limit = (np.array(column) for column in zip(*rows, strict=True))
    return Static(noise_um, angles, error, limit)


def _repeat(
    angle: float, noise_um: float, rng: np.random.Generator
) -> tuple[float, float, list[float], float]:
    """Noise [µm], angle, errors and bound [deg] of one frame in which enough markers stick."""
    while True:
        model = PivotModel(
            contact_radius=float(np.sqrt(settings.DOME_MM * settings.APPROACH_MM)),
            approach=settings.APPROACH_MM,
            friction_ratio=float(rng.uniform(*settings.FRICTION_RATIOS)),
            grid_shape=settings.MARKERS,
            pitch=settings.PITCH_MM,
            noise=1e-3 * noise_um,
            normal_noise=3.5e-3 * noise_um,
        )
        model = place_at_random(model, rng)
        layout, frame, stick = simulate_frame(model, float(np.radians(angle)), rng)
        if stick.sum() >= settings.FIRM_MARKERS:
            break
    noise = Noise.from_std(1e-3 * noise_um)
    trackers = Trackers(layout, {method: {} for method in METHODS}, noise=noise)
    answers = [estimate.angle for estimate in trackers.update(frame).values()]
    error = (np.degrees(np.nan_to_num(answers)) - angle).tolist()
    limit = angle_limit(layout.reference[:, :2], stick, noise.in_plane)
    return noise_um, angle, error, float(np.degrees(limit))


def numbers(result: Static) -> dict[str, float]:
    """Our numbers for `published.csv`: errors of the default method at 1 and 10 µm of noise."""
    ours = np.abs(result.error[:, METHODS.index(DEFAULT_METHOD)])
    error = ours[result.noise_um == 1.0]
    return {
        "mean_absolute_error_10um": float(ours[result.noise_um == 10.0].mean()),
        "mean_absolute_error": float(error.mean()),
        "standard_deviation": float(error.std()),
    }


def tables(result: Static) -> dict[str, list[dict[str, object]]]:
    """A row for each noise and method, pooled over the angles."""
    rows = []
    for noise_um in settings.NOISES_UM:
        at_noise = result.noise_um == noise_um
        for i, method in enumerate(METHODS):
            error = result.error[at_noise, i]
            small = result.angle[at_noise] < 10
            rows.append(
                {
                    "noise [µm]": noise_um,
                    "method": method,
                    "frames": int(at_noise.sum()),
                    "mean absolute error [°]": cell(np.abs(error), 4),
                    "standard deviation of it [°]": cell(np.abs(error), 4, np.std),
                    "mean error below 10° [°]": cell(error[small], 4),
                    "mean error from 10° [°]": cell(error[~small], 4),
                }
            )
        limit = cell(MEAN_ABSOLUTE * result.limit[at_noise].mean(), 4)
        bound = {"method": "Cramér–Rao bound", "mean absolute error [°]": limit}
        rows.append(dict.fromkeys(rows[-1]) | {"noise [µm]": noise_um} | bound)
    return {"": rows}


def plot(result: Static) -> Figure:
    """Box plots of the error by angle, and the mean absolute error with the bound."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 7), sharex=True, layout="constrained")
    at_noise = result.noise_um == 1.0
    for i, (axis, method) in enumerate(zip(axes[:, :2].flat, METHODS, strict=True)):
        boxes = [result.error[at_noise & (result.angle == a), i] for a in settings.ANGLES_DEG]
        axis.axhline(0.0, color="C3", lw=1)
        axis.boxplot(boxes, positions=settings.ANGLES_DEG, widths=0.6, flierprops={"ms": 2})
        error = np.abs(result.error[at_noise, i])
        title = f"{method}, 1 µm: {error.mean():.3f}° ± {error.std():.3f}°"
        finish(axis, title=title, ylabel="error [°]")
    for axis, noise_um in zip(axes[:, 2], settings.NOISES_UM, strict=True):
        _plot_means(axis, result, noise_um)
    for axis in axes[1]:
        axis.set_xlabel("object's angle [°]")
        axis.set_xticks(range(2, 21, 3), range(2, 21, 3))
    return figure


def _plot_means(axis, result: Static, noise_um: float) -> None:
    chosen = [
        (result.noise_um == noise_um) & (result.angle == angle) for angle in settings.ANGLES_DEG
    ]
    for i, method in enumerate(METHODS):
        mean = [np.abs(result.error[rows, i]).mean() for rows in chosen]
        axis.semilogy(settings.ANGLES_DEG, mean, "o-", ms=3, lw=1, label=method)
    bound = [MEAN_ABSOLUTE * result.limit[rows].mean() for rows in chosen]
    axis.semilogy(settings.ANGLES_DEG, bound, "k--", lw=1, label="Cramér–Rao bound")
    axis.axhline(0.17, color="0.5", ls=":", lw=1, label="paper, hardware: 0.17°")
    title = f"all methods, {noise_um:g} µm"
    finish(axis, minor=True, title=title, ylabel="mean absolute error [°]")
    if noise_um == settings.NOISES_UM[0]:
        axis.legend(fontsize=7, ncols=2)
