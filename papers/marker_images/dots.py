"""Dots: both fits beside what no estimator can do better.

Pictures of 300 dots of radius 4.3 px, shifted at random within their pixels, drawn on a finer grid
without the fit's own model. The radius told to the fits is not the true one.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from estimation.images.dots import DotStyle, find_seeds, fit_dots, to_grey
from estimation.images.render import Camera, render_dots
from estimation.images.templates import fit_alike
from papers.items import Track
from papers.marker_images import settings

FITS = {"in full": fit_dots, "by the table": fit_alike}
RADIUS, TOLD = 4.3, 4.0
"""Radius of the dots, and what the fits start from [px]."""


class DotErrors(NamedTuple):
    """Measured minus true positions [px], and what the fits claim of a coordinate [px]."""

    position: Float[np.ndarray, "noises fits dots 2"]
    claimed: Float[np.ndarray, "noises fits dots"]


def position_limit(noise: float, radius: float, contrast: float, blur: float) -> float:
    """Cramér–Rao bound of a coordinate [px].

    Amplitude, background, radius and blur are orthogonal to the position by symmetry. Information
    on x is ∫ (∂I/∂x)² dA / noise², with the profile of an edge under the blur.

    Args:
        noise: of each pixel, white [grey levels].
        radius: of the dot [px].
        contrast: of dot and background [grey levels].
        blur: standard deviation of the point spread [px].
    """
    step = 0.02
    r = np.arange(step, radius + 8.0 * blur, step)
    slope = contrast * np.exp(-0.5 * ((r - radius) / blur) ** 2) / (blur * np.sqrt(2.0 * np.pi))
    return float((np.pi * np.sum(slope**2 * r) * step / noise**2) ** -0.5)


def compute(quick: bool = False, track: Track = iter) -> DotErrors:
    """Render and measure."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(20) * 30 + 35, np.arange(15) * 30 + 30), -1)
    grid = grid.reshape(-1, 2)
    style, errors, claimed = DotStyle(dark=True, radius=TOLD), [], []
    for noise in track(settings.NOISES):
        camera = Camera(noise=noise, blur=settings.BLUR, contrast=settings.CONTRAST)
        parts = []
        for _ in range(3 if quick else 20):
            truth = grid + rng.uniform(-0.5, 0.5, grid.shape)
            axes = np.broadcast_to(RADIUS * np.eye(2), (len(grid), 2, 2))
            grey = to_grey(render_dots(camera, truth, axes, rng), dark=True)
            seeds = find_seeds(grey, style)
            for fit in FITS.values():
                dots = fit(grey, seeds, style)
                nearest = KDTree(dots.centre).query(truth)[1]
                deviation = np.sqrt(dots.covariance[nearest, 0, 0])
                parts.append((dots.centre[nearest] - truth, deviation))
        of_fit = [parts[i :: len(FITS)] for i in range(len(FITS))]
        errors.append([np.concatenate([one[0] for one in some]) for some in of_fit])
        claimed.append([np.concatenate([one[1] for one in some]) for some in of_fit])
    return DotErrors(np.array(errors), np.array(claimed))


def tables(result: DotErrors) -> dict[str, list[dict[str, object]]]:
    """One row per noise and fit."""
    rows = []
    for n, noise in enumerate(settings.NOISES):
        limit = position_limit(noise, RADIUS, settings.CONTRAST, settings.BLUR)
        for f, fit in enumerate(FITS):
            error = result.position[n, f]
            bias = float(np.abs(error.mean(axis=0)).max())
            rows.append(
                {
                    "noise": noise,
                    "fit": fit,
                    "dots": len(error),
                    "position [px]": round(float(error.std()), 5),
                    "bound [px]": round(limit, 5),
                    "over the bound": round(float(error.std()) / limit, 3),
                    "bias [px]": round(bias, 5),
                    "bias over the bound": round(bias / limit, 3),
                    "claimed [px]": round(float(np.sqrt(np.mean(result.claimed[n, f] ** 2))), 5),
                }
            )
    return {"": rows}


def plot(result: DotErrors) -> Figure:
    """Distribution of the errors of each fit at each noise."""
    figure, axes = plt.subplots(1, len(settings.NOISES), figsize=(9, 3), layout="constrained")
    for n, (axis, noise) in enumerate(zip(axes, settings.NOISES, strict=True)):
        for f, fit in enumerate(FITS):
            axis.hist(result.position[n, f].ravel(), 60, histtype="step", density=True, label=fit)
        axis.set(title=f"noise {noise:g} levels", xlabel="position error [px]")
    axes[0].legend()
    return figure
