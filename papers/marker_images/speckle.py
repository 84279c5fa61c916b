"""Speckle of known twist: errors of the subset fit over the Cramér–Rao bound, and share found.

Each case has two noisy pictures of a pattern, at rest and turned as a whole. For the bound, the
slopes of the grey levels are from a picture without noise; unknown are the six parameters of an
affine motion, contrast and level. The tracker finds the motion from the picture at rest alone.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.pictures.render import Camera, project_discs, render_dots, scatter_speckle
from estimation.pictures.speckle.subsets import make_subsets, polar_angle
from estimation.pictures.speckle.tracking import SpeckleTracker
from papers.items import Track
from papers.marker_images import settings
from papers.tables import cell

CAMERA = Camera(width=320, height=240)
RADIUS = 2.0 * CAMERA.mm_per_px
MARGIN = 80
"""Difference in size between the pattern and the picture [px]."""


class SpeckleErrors(NamedTuple):
    """Errors of the points found, over their bounds, by noise and twist.

    Attributes:
        found: share of the points in view that were found [-].
        position: root mean square of the position errors over their bounds [-].
        rotation: root mean square of the rotation errors over their bounds [-].
        limit: root mean square of the bounds of a coordinate [px] and of the rotation [rad].
    """

    found: Float[np.ndarray, "noises twists"]
    position: Float[np.ndarray, "noises twists"]
    rotation: Float[np.ndarray, "noises twists"]
    limit: Float[np.ndarray, "noises 2"]


def compute(quick: bool = False, track: Track = iter) -> SpeckleErrors:
    """Render the pictures, and track the speckle."""
    size = (CAMERA.width + MARGIN) * CAMERA.mm_per_px, (CAMERA.height + MARGIN) * CAMERA.mm_per_px
    centres = scatter_speckle(size, RADIUS, 0.45, np.random.default_rng(0))
    twists = settings.TWISTS_DEG[1:2] if quick else settings.TWISTS_DEG
    noises = settings.NOISES[:1] if quick else settings.NOISES
    shape = (len(noises), len(twists))
    found, position, rotation = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    limit = np.zeros((len(noises), 2))
    clean = _picture(centres, 0.0, CAMERA._replace(noise=0.0), 0)
    for n, t in track(list(np.ndindex(shape))):
        camera = CAMERA._replace(noise=noises[n])
        tracker = SpeckleTracker(_picture(centres, 0.0, camera, 1))
        at = tracker.lattice.centre
        unit = make_subsets(clean, at.astype(int), tracker.style.radius).unit
        bound = 2.0 * (noises[n] ** 2 + 1.0 / 12.0) * unit  # two pictures, rounded
        spin = np.array([0.0, -0.5, 0.5, 0.0])
        limits = (
            np.sqrt(bound[:, :2, :2].trace(axis1=1, axis2=2)),
            np.sqrt(np.einsum("i,nij,j->n", spin, bound[:, 2:, 2:], spin)),
        )
        match, _ = tracker.find(_picture(centres, twists[t], camera, 2 + t))
        middle = 0.5 * np.array([CAMERA.width - 1, CAMERA.height - 1])
        turned = ((at - middle) @ np.array([1.0, 1.0j])) * np.exp(1j * np.radians(twists[t]))
        truth = middle + np.stack([turned.real, turned.imag], axis=1)
        rim = 1.5 * tracker.style.radius
        inside = ((truth > rim) & (truth < 2.0 * middle - rim)).all(axis=1)
        good = match.good
        off = np.linalg.norm(match.position - truth, axis=1)[good] / limits[0][good]
        spun = (polar_angle(match.deformation) - np.radians(twists[t]))[good] / limits[1][good]
        found[n, t] = good[inside].mean()
        position[n, t], rotation[n, t] = (np.sqrt(np.mean(error**2)) for error in (off, spun))
        limit[n] = np.sqrt([np.mean(limits[0] ** 2) / 2.0, np.mean(limits[1] ** 2)])
    return SpeckleErrors(found, position, rotation, limit)


def _picture(
    centres: Float[np.ndarray, "n 2"], degrees: float, camera: Camera, seed: int
) -> Float[np.ndarray, "h w"]:
    """A picture of the pattern turned about the picture's centre."""
    turn = np.exp(1j * np.radians(degrees))

    def move(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        turned = (points @ np.array([1.0, 1.0j])) * turn
        return np.stack([turned.real, turned.imag], axis=1)

    discs = project_discs(camera, move, centres, RADIUS)
    return render_dots(camera, *discs, np.random.default_rng(seed)).astype(np.float32)


def tables(result: SpeckleErrors) -> dict[str, list[dict[str, object]]]:
    """One row per noise and twist."""
    twists = settings.TWISTS_DEG if result.found.shape[1] > 1 else settings.TWISTS_DEG[1:2]
    return {
        "": [
            {
                "noise": settings.NOISES[n],
                "twist [°]": twist,
                "found in view [%]": cell(100.0 * result.found[n, t], 1),
                "bound [px]": cell(result.limit[n, 0], 5),
                "position over the bound": cell(result.position[n, t], 3),
                "bound [°]": cell(np.degrees(result.limit[n, 1]), 4),
                "rotation over the bound": cell(result.rotation[n, t], 3),
            }
            for n in range(len(result.found))
            for t, twist in enumerate(twists)
        ]
    }


def plot(result: SpeckleErrors) -> Figure:
    """Errors over their bounds, as a function of the twist."""
    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    twists = settings.TWISTS_DEG if result.found.shape[1] > 1 else settings.TWISTS_DEG[1:2]
    for n, (position, rotation) in enumerate(zip(result.position, result.rotation, strict=True)):
        axis.plot(twists, position, "o-", label=f"position, noise {settings.NOISES[n]:g}")
        axis.plot(twists, rotation, "s--", label=f"rotation, noise {settings.NOISES[n]:g}")
    axis.axhline(1.0, color="0.5", lw=0.8)
    axis.set(xlabel="twist [°]", ylabel="error over its bound [-]")
    axis.legend(fontsize=8)
    return figure
