"""X-corners: errors of the saddle fit and the two-ring detector, with Cramér–Rao bounds.

The pictures show 400 corners, with the pattern shifted and turned at random. The first bound is for
a square window of 19 px with unknown blur, contrast and grey level. The second is for the fit's own
window and nine unknowns, with a sloping background, the pixels' width and rounding.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy.spatial import KDTree
from scipy.special import erf

from estimation.pictures.corners.fit import CornerStyle, fit_corners, reach_of_window
from estimation.pictures.corners.pattern import (
    CornerTruth,
    Pattern,
    project_corners,
    render_pattern,
)
from estimation.pictures.corners.rings import find_saddles, read_rings
from estimation.pictures.render import Camera
from papers.items import Track
from papers.marker_images import settings
from papers.tables import cell

METHODS = ("saddle fit", "two rings")


class CornerErrors(NamedTuple):
    """Errors of each method at each noise; NaN for a corner that was not found.

    Attributes:
        position: measured minus true x and y [px].
        angle: error of the mean direction of both edges [rad].
        claimed: standard deviations that the fit reports, of a coordinate [px] and of the mean
            direction [rad].
    """

    position: Float[np.ndarray, "noises methods corners 2"]
    angle: Float[np.ndarray, "noises methods corners"]
    claimed: Float[np.ndarray, "noises corners 2"]


def compute(quick: bool = False, track: Track = iter) -> CornerErrors:
    """Render the pictures, and measure their corners."""
    rng = np.random.default_rng(0)
    pictures = settings.QUICK_CORNER_PICTURES if quick else settings.CORNER_PICTURES
    style = CornerStyle(settings.PITCH)
    parts = []
    for noise, _ in track([(n, p) for n in settings.NOISES for p in range(pictures)]):
        camera = Camera(noise=noise, blur=settings.BLUR, contrast=settings.CONTRAST)
        pattern = Pattern((20, 20), settings.PITCH * camera.mm_per_px)
        turn = np.exp(1j * rng.uniform(-0.1, 0.1))
        shift = camera.mm_per_px * rng.uniform(-0.5, 0.5, 2)

        def project(points, camera=camera, turn=turn, shift=shift):
            turned = points @ np.array([1.0, 1.0j]) * turn
            return camera.project(np.stack([turned.real, turned.imag], axis=1) + shift)

        truth = project_corners(project, pattern)
        grey = render_pattern(camera, project, pattern, rng).astype(np.float32)
        rings = read_rings(grey, find_saddles(grey, style.radius).astype(float), style.radius)
        rings = rings.take(rings.good)
        fitted = fit_corners(grey, rings, style)
        variance = np.stack(
            [fitted.covariance[:, 0, 0], 0.25 * fitted.covariance[:, 2:, 2:].sum(axis=(1, 2))]
        )
        nearest = KDTree(fitted.position).query(truth.position)[1]
        parts.append(
            (
                *_errors(truth, fitted.position, fitted.angles),
                *_errors(truth, rings.position, rings.angles),
                np.sqrt(variance.T)[nearest],
            )
        )
    saddle, angle, ring, ring_angle, claimed = (
        np.stack(part).reshape(len(settings.NOISES), pictures * 400, *part[0].shape[1:])
        for part in zip(*parts, strict=True)
    )
    return CornerErrors(
        np.stack([saddle, ring], axis=1), np.stack([angle, ring_angle], axis=1), claimed
    )


def _errors(
    truth: CornerTruth, position: Float[np.ndarray, "n 2"], angles: Float[np.ndarray, "n 2"]
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the corner nearest to each true one; NaN if none is within 1 px."""
    distance, nearest = KDTree(position).query(truth.position)
    off = position[nearest] - truth.position
    rising, falling = angles[nearest].T
    mean = rising + 0.5 * ((falling - rising) % np.pi)
    turned = (mean - truth.angles.mean(axis=1) + np.pi / 4) % (np.pi / 2) - np.pi / 4
    missing = np.asarray(distance) > 1.0
    return np.where(missing[:, None], np.nan, off), np.where(missing, np.nan, turned)


def corner_limit(
    noise: float,
    window: Bool[np.ndarray, "side side"],
    blur: float,
    contrast: float,
    sloping: bool,
) -> tuple[float, float]:
    """Cramér–Rao bound of a corner with edges along the pixels' rows and columns.

    The unknowns are position, both angles, blur, contrast, grey level and, if `sloping`, its slope.

    Args:
        noise: white noise of each pixel [grey levels].
        window: mask of the pixels used, with the corner at its centre.
        blur: standard deviation of the point spread [px].
        contrast: difference of bright and dark [grey levels].
        sloping: whether the background has an unknown slope.

    Returns:
        Standard deviations of a coordinate [px], and of the mean of both angles [rad].
    """
    half = len(window) // 2
    y, x = (grid[window] for grid in np.mgrid[-half : half + 1, -half : half + 1])

    def model(p: np.ndarray) -> np.ndarray:
        edges = [
            (np.cos(a) * (y - p[1]) - np.sin(a) * (x - p[0])) / (np.sqrt(2.0) * p[4])
            for a in p[2:4]
        ]
        return p[5] * erf(edges[0]) * erf(edges[1]) + p[6] + p[7] * x + p[8] * y

    at = np.array([0.0, 0.0, 0.0, np.pi / 2, blur, 0.5 * contrast, 0.0, 0.0, 0.0])
    step = 1e-5
    columns = [
        (model(at + step * unit) - model(at - step * unit)) / (2.0 * step)
        for unit in np.eye(9)[: 9 if sloping else 7]
    ]
    covariance = noise**2 * np.linalg.inv(np.array(columns) @ np.array(columns).T)
    return float(np.sqrt(covariance[0, 0])), float(np.sqrt(0.25 * covariance[2:4, 2:4].sum()))


def limits(noise: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Bounds of position [px] and angle [rad]: of the square window, and of the fit's own."""
    half = int(CornerStyle(settings.PITCH).radius)
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    own = np.hypot(x, y) <= reach_of_window(CornerStyle(settings.PITCH).radius)
    exact_blur, exact_noise = np.sqrt(settings.BLUR**2 + 1.0 / 12.0), np.sqrt(noise**2 + 1.0 / 12.0)
    return (
        corner_limit(noise, np.ones_like(own), settings.BLUR, settings.CONTRAST, sloping=False),
        corner_limit(exact_noise, own, exact_blur, settings.CONTRAST, sloping=True),
    )


def tables(result: CornerErrors) -> dict[str, list[dict[str, object]]]:
    """One row per noise and method."""
    rows = []
    for n, noise in enumerate(settings.NOISES):
        square, own = limits(noise)
        for m, method in enumerate(METHODS):
            off, turned = result.position[n, m], result.angle[n, m]
            found = np.isfinite(turned)
            claimed = np.sqrt(np.mean(result.claimed[n][found] ** 2, axis=0))
            rows.append(
                {
                    "noise": noise,
                    "method": method,
                    "found [%]": cell(100.0 * found, 2),
                    "position [px]": cell(off[found], 4, np.std),
                    "bias [px]": cell(np.abs(off[found].mean(axis=0)).max(), 5),
                    "claimed [px]": cell(claimed[0], 4) if m == 0 else None,
                    "square's bound [px]": cell(square[0], 4),
                    "own bound [px]": cell(own[0], 4),
                    "angle [°]": cell(np.degrees(turned[found].std()), 4),
                    "claimed [°]": cell(np.degrees(claimed[1]), 4) if m == 0 else None,
                    "square's bound [°]": cell(np.degrees(square[1]), 4),
                    "own bound [°]": cell(np.degrees(own[1]), 4),
                }
            )
    return {"": rows}


def plot(result: CornerErrors) -> Figure:
    """Distributions of the errors of position and angle, by method and noise."""
    figure, axes = plt.subplots(2, len(settings.NOISES), figsize=(9, 6), layout="constrained")
    for n, noise in enumerate(settings.NOISES):
        for m, method in enumerate(METHODS):
            off, turned = result.position[n, m].ravel(), np.degrees(result.angle[n, m])
            axes[0, n].hist(off[np.isfinite(off)], 80, histtype="step", density=True, label=method)
            turned = turned[np.isfinite(turned)]
            axes[1, n].hist(turned, 80, histtype="step", density=True, label=method)
        axes[0, n].set(title=f"noise {noise:g} levels", xlabel="position error [px]")
        axes[1, n].set_xlabel("angle error [°]")
    axes[0, 0].legend()
    return figure
