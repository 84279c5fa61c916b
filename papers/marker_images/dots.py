"""Dots: errors of both our fits and of other programs, with the Cramér–Rao bound.

The pictures show 300 dots of radius 4.3 px, drawn on a finer grid without the fit's own model, and
shifted at random within their pixels. The dots are round, or ellipses of the same area, as seen by
a camera from the side. The fits start from a wrong radius. A dot counts as missed if a program
finds none within a radius; missed dots are left out of the errors.
"""

from itertools import product
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from estimation.pictures.dots.find import DotStyle, find_seeds, fit_dots
from estimation.pictures.dots.templates import fit_alike
from estimation.pictures.light import to_grey
from estimation.pictures.render import Camera, render_dots
from papers.items import Track
from papers.marker_images import settings
from papers.marker_images.rivals import RIVALS
from papers.tables import cell

FITS = {"in full": fit_dots, "by the table": fit_alike, **RIVALS}
RADIUS, TOLD = 4.3, 4.0
"""True radius of the dots, and the radius from which the fits start [px]."""
SHAPES = {"round": np.eye(2), "1.3 to 1": np.array([[1.056, 0.126], [0.126, 0.962]])}
"""Matrices that map the unit circle to the dots' rims, over the radius; all areas are equal."""


class DotErrors(NamedTuple):
    """Errors of the fits.

    Attributes:
        position: measured minus true positions [px]; NaN for a missed dot.
        claimed: reported standard deviation of a coordinate [px]; NaN if missed or not reported.
    """

    position: Float[np.ndarray, "noises shapes fits dots 2"]
    claimed: Float[np.ndarray, "noises shapes fits dots"]


def position_limit(
    noise: float, axes: Float[np.ndarray, "2 2"], contrast: float, blur: float
) -> float:
    """Cramér–Rao bound of a coordinate, root mean square of x and y [px].

    By symmetry, amplitude, background, size and blur are orthogonal to the position. Information is
    ∫ ∇I ∇Iᵀ dA / noise², along the rim, with the profile of a blurred straight edge.

    Args:
        noise: white noise of each pixel [grey levels].
        axes: matrix that maps the unit circle to the dot's rim [px].
        contrast: difference of dot and background [grey levels].
        blur: standard deviation of the point spread [px].
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    along = axes @ np.array([-np.sin(turn), np.cos(turn)])  # of the rim, by turn
    length = np.hypot(*along)
    normal = np.array([along[1], -along[0]]) / length
    rim = (normal * length) @ normal.T * (turn[1] - turn[0])
    information = contrast**2 / (2.0 * np.sqrt(np.pi) * blur * noise**2) * rim
    return float(np.sqrt(0.5 * np.trace(np.linalg.inv(information))))


def compute(quick: bool = False, track: Track = iter) -> DotErrors:
    """Render the pictures, and measure their dots."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(20) * 30 + 35, np.arange(15) * 30 + 30), -1)
    grid = grid.reshape(-1, 2)
    cases = [(noise, shape) for noise in settings.NOISES for shape in SHAPES.values()]
    errors, claimed = [], []
    for noise, shape in track(cases):
        camera = Camera(noise=noise, blur=settings.BLUR, contrast=settings.CONTRAST)
        parts = []
        for _ in range(3 if quick else 20):
            truth = grid + rng.uniform(-0.5, 0.5, grid.shape)
            parts.append(_measure(camera, truth, RADIUS * shape, rng))
        errors.append(np.concatenate([error for error, _ in parts], axis=1))
        claimed.append(np.concatenate([deviation for _, deviation in parts], axis=1))
    size = (len(settings.NOISES), len(SHAPES), len(FITS), -1)
    return DotErrors(np.reshape(errors, (*size, 2)), np.reshape(claimed, size))


def _measure(
    camera: Camera,
    truth: Float[np.ndarray, "n 2"],
    axes: Float[np.ndarray, "2 2"],
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "fits n 2"], Float[np.ndarray, "fits n"]]:
    """Errors and reported deviations of all fits in one picture [px]; NaN for a missed dot."""
    style = DotStyle(dark=True, radius=TOLD)
    shapes = np.broadcast_to(axes, (len(truth), 2, 2))
    grey = to_grey(render_dots(camera, truth, shapes, rng), dark=True)
    seeds = find_seeds(grey, style)
    errors, claimed = [], []
    for fit in FITS.values():
        dots = fit(grey, seeds, style)
        distance, nearest = KDTree(dots.centre).query(truth)
        found = np.where(distance < RADIUS, 1.0, np.nan)
        errors.append(found[:, None] * (dots.centre[nearest] - truth))
        claimed.append(found * np.sqrt(0.5 * np.trace(dots.covariance[nearest], axis1=1, axis2=2)))
    return np.array(errors), np.array(claimed)


def tables(result: DotErrors) -> dict[str, list[dict[str, object]]]:
    """One row per noise, shape and fit."""
    rows = []
    for (n, noise), (s, shape) in product(enumerate(settings.NOISES), enumerate(SHAPES)):
        limit = position_limit(noise, RADIUS * SHAPES[shape], settings.CONTRAST, settings.BLUR)
        for f, fit in enumerate(FITS):
            error, claimed = result.position[n, s, f], result.claimed[n, s, f]
            found = np.isfinite(error[:, 0])
            error, bias = error[found], np.abs(error[found].mean(axis=0)).max()
            reported = cell(claimed, 5, lambda known: np.sqrt(np.mean(known**2)))
            rows.append(
                {
                    "noise": noise,
                    "shape": shape,
                    "fit": fit,
                    "dots": len(found),
                    "missed": int((~found).sum()),
                    "position [px]": cell(error, 5, np.std),
                    "bound [px]": cell(limit, 5),
                    "over the bound": cell(error.std() / limit, 3),
                    "bias [px]": cell(bias, 5),
                    "bias over the bound": cell(bias / limit, 3),
                    "claimed [px]": "" if reported is None else reported,
                }
            )
    return {"": rows}


def plot(result: DotErrors) -> Figure:
    """Distributions of the position errors of each fit, by noise and shape."""
    figure, axes = plt.subplots(
        len(SHAPES), len(settings.NOISES), figsize=(9, 5), sharex="col", layout="constrained"
    )
    for (s, shape), (n, noise) in product(enumerate(SHAPES), enumerate(settings.NOISES)):
        for f, fit in enumerate(FITS):
            error = result.position[n, s, f].ravel()
            error = error[np.isfinite(error)]
            axes[s, n].hist(error, 60, histtype="step", density=True, label=fit)
        axes[s, n].set(title=f"{shape}, noise {noise:g} levels")
        axes[-1, n].set_xlabel("position error [px]")
    axes[0, 0].legend(fontsize=8)
    return figure
