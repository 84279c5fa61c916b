"""Pivots seen in one view or in two views: from rendered pictures to the angle.

A sphere presses on a flat pad with a coded checkerboard of 400 corners, 640×480 px per view. Each
draw consists of two pictures: the pad at rest, and the pad loaded and twisted. A frame counts if at
least ten markers truly stick. A missing answer counts as an error of the full angle.
"""

from collections.abc import Callable
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.frames.noise import Noise
from estimation.pictures.corners.pattern import Pattern, render_pattern
from estimation.pictures.corners.reader import CornerReader
from estimation.pictures.reader import ImageSettings, MarkerReader
from estimation.pictures.render import Camera
from estimation.pictures.rig import Rig, View
from estimation.pictures.sensor import Sensor
from estimation.pictures.stereo import StereoReader
from estimation.pictures.stream import Picture
from estimation.tracking.tracker import Tracker
from estimation.virtual.recording import PivotModel
from estimation.virtual.surface import Motion, simulate_surface
from papers.items import Track
from papers.marker_images import settings
from papers.tables import cell, finish

METHODS = ("tracked", "paper", "paper_strict")
CAMERA = Camera()
CENTRE = (0.5 * (CAMERA.width - 1), 0.5 * (CAMERA.height - 1))
LEFT = View(True, 20.0, CENTRE, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
RIGHT = View(False, 1200.0, CENTRE, 0.0, (0.0, np.pi / 4, 0.0), (0.0, 0.0, 60.0))
RIG = Rig(LEFT, RIGHT, CAMERA.width, CAMERA.height, 0.0)


class Setup(NamedTuple):
    """A camera setup."""

    name: str  # name of the setup
    # projections of points [mm] to each view [px]
    views: tuple[Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 2"]], ...]
    reader: type[MarkerReader]  # reader of its pictures
    settings: ImageSettings  # settings of the reader
    noise: float  # noise given to the estimators [mm]


SETUPS = (
    Setup(
        "one view, 0.04 mm/px",
        (lambda points: CAMERA.project(points[:, :2]),),
        CornerReader,
        ImageSettings(Sensor(mm_per_px=CAMERA.mm_per_px)),
        4e-4,
    ),
    Setup(
        "two views, 0.05 mm/px",
        (LEFT.project, RIGHT.project),
        StereoReader,
        ImageSettings(rig=RIG),
        1e-3,
    ),
)


class PivotErrors(NamedTuple):
    """Errors of every draw.

    Attributes:
        angle: true angles [deg].
        error: estimate minus truth; minus the truth without an answer [deg].
        answered: mask of the answered draws.
        counts: mask of the draws in which enough markers truly stick.
    """

    angle: Float[np.ndarray, " angles"]
    error: Float[np.ndarray, "ratios draws angles setups methods"]
    answered: Bool[np.ndarray, "ratios draws angles setups methods"]
    counts: Bool[np.ndarray, "ratios draws angles"]


def compute(quick: bool = False, track: Track = iter) -> PivotErrors:
    """Render the pictures, and estimate the angles."""
    rng = np.random.default_rng(0)
    angles = np.array((6, 15) if quick else settings.ANGLES_DEG, dtype=float)
    ratios = settings.FRICTION_RATIOS[1:2] if quick else settings.FRICTION_RATIOS
    shape = (len(ratios), 1 if quick else settings.PIVOT_DRAWS, len(angles))
    error = np.zeros((*shape, len(SETUPS), len(METHODS)))
    answered, counts = np.zeros(error.shape, dtype=bool), np.zeros(shape, dtype=bool)
    cases = [(r, d) for r in range(shape[0]) for d in range(shape[1])]
    for r, d in track(cases):
        model = PivotModel(
            friction_ratio=ratios[r],
            offset=tuple(rng.uniform(-0.5, 0.5, 2)),
            pitch=settings.PIVOT_PITCH,
        )
        pattern = Pattern.coded((20, 20), model.pitch, seed=int(rng.integers(1000)))
        twist = np.radians(np.append(0.0, angles))
        motions, truth = simulate_surface(model, np.append(0.0, np.ones(len(angles))), twist)
        counts[r, d] = truth.stick[1:].sum(axis=1) >= settings.FIRM_MARKERS
        for v, setup in enumerate(SETUPS):
            reader = setup.reader(photograph(setup, motions[0], pattern, rng), setup.settings)
            for a in np.flatnonzero(counts[r, d]):
                picture = photograph(setup, motions[a + 1], pattern, rng)
                estimates = np.degrees(_estimate(setup, reader, picture))
                answered[r, d, a, v] = np.isfinite(estimates)
                error[r, d, a, v] = np.nan_to_num(estimates) - angles[a]
    return PivotErrors(angles, error, answered, counts)


def photograph(setup: Setup, move: Motion, pattern: Pattern, rng: np.random.Generator) -> Picture:
    """A picture of a moved pattern: all views of a setup side by side."""
    views = [
        render_pattern(CAMERA, lambda points, view=view: view(move(points)), pattern, rng)
        for view in setup.views
    ]
    return Picture(np.concatenate(views, axis=1), time=0.0, number=0)


def _estimate(setup: Setup, reader: MarkerReader, picture: Picture) -> list[float]:
    frame = reader.frame(reader.read(picture))
    noise = Noise.from_std(setup.noise)
    return [Tracker(reader.layout, method, noise=noise).update(frame).angle for method in METHODS]


def tables(result: PivotErrors) -> dict[str, list[dict[str, object]]]:
    """Errors of each method in each setup: pooled over the angles, and by angle."""
    rows, by_angle = [], []
    for v, setup in enumerate(SETUPS):
        for m, method in enumerate(METHODS):
            error = np.abs(result.error[result.counts][:, v, m])
            rows.append(
                {
                    "seen by": setup.name,
                    "method": method,
                    "frames": int(result.counts.sum()),
                    "answered [%]": cell(100.0 * result.answered[result.counts][:, v, m], 2),
                    "mean absolute error [°]": cell(error, 4),
                    "95th percentile [°]": cell(np.percentile(error, 95), 4),
                    "largest [°]": cell(error.max(), 4),
                }
            )
    for a, angle in enumerate(result.angle):
        error = np.abs(result.error[:, :, a][result.counts[:, :, a]])
        by_angle.append(
            {"angle [°]": int(angle), "frames": len(error)}
            | {
                f"{method}, {setup.name}": cell(error[:, v, m], 4)
                for v, setup in enumerate(SETUPS)
                for m, method in enumerate(METHODS)
                if len(error)
            }
        )
    return {"": rows, "_angles": by_angle}


def plot(result: PivotErrors) -> Figure:
    """Mean absolute error over the angle, a panel for each setup."""
    figure, axes = plt.subplots(1, len(SETUPS), figsize=(10, 4), sharey=True, layout="constrained")
    for v, (axis, setup) in enumerate(zip(axes, SETUPS, strict=True)):
        for m, method in enumerate(METHODS):
            counted = np.where(result.counts, np.abs(result.error[..., v, m]), np.nan)
            axis.semilogy(result.angle, np.nanmean(counted, axis=(0, 1)), "o-", ms=3, label=method)
        axis.axhline(0.03, color="0.5", ls="--", lw=1, label="0.03°")
        axis.set_title(setup.name)
        finish(axis, minor=True, xlabel="object's angle [°]")
    finish(axes[0], legend=8, minor=True, ylabel="mean absolute error [°]")
    return figure
