"""Error of each method on rendered pictures of virtual pivots: from grey levels to the angle.

640×480 pixels, 400 dots 22 px apart, radius 4.3 px, blur 1 px, 120 grey levels of contrast and
noise of 2; contact radius 5 mm, μp0/2G* = 0.3. Each draw places the grid at random under the
object, and renders the pad at rest and the pad pressed and twisted. Dots, their identities, contact
region and angle are estimated from these two pictures alone.
"""

from collections.abc import Callable
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators import METHODS
from estimation.frames.noise import Noise
from estimation.frames.recording import Frame, MarkerLayout
from estimation.pictures.dots.reader import DotReader
from estimation.pictures.reader import ImageSettings
from estimation.pictures.render import Camera, project_discs, render_dots
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture
from estimation.tracking.trackers import Trackers
from estimation.virtual.recording import PivotModel, deform, lay_out_markers
from papers.items import Track
from papers.tables import cell, finish
from papers.virtual_pivots import settings

CAMERA = Camera(mm_per_px=1.0 / 22.0)
RADIUS = 4.3 * CAMERA.mm_per_px
SENSOR = ImageSettings(
    Sensor(mm_per_px=CAMERA.mm_per_px, radius=RADIUS / CAMERA.mm_per_px, dark=True)
)
POSITION_NOISE = 0.0085 * CAMERA.mm_per_px
"""Cramér–Rao bound of a dot's position at this noise [mm]."""


class Rendered(NamedTuple):
    """Results of the draws.

    Attributes:
        angle: true angles [deg].
        error: estimate minus truth; minus the truth without an answer [deg].
        answered: mask of the answered draws.
        counts: mask of the draws in which enough markers truly stick.
        seen: number of recognised dots.
    """

    angle: Float[np.ndarray, " angles"]
    error: Float[np.ndarray, "angles draws methods"]
    answered: Bool[np.ndarray, "angles draws methods"]
    counts: Bool[np.ndarray, "angles draws"]
    seen: Float[np.ndarray, "angles draws"]


def compute(quick: bool = False, track: Track = iter) -> Rendered:
    """Render the pictures, and estimate the angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["rendered"]
    middle = len(settings.ANGLES_DEG) // 2
    angles = settings.ANGLES_DEG[middle : middle + 1] if quick else settings.ANGLES_DEG
    shape = (len(angles), draws)
    error = np.zeros((*shape, len(METHODS)))
    answered, counts, seen = np.zeros(error.shape, bool), np.zeros(shape, bool), np.zeros(shape)
    for case in track(list(np.ndindex(shape))):
        truth = float(angles[case[0]])
        rng = np.random.default_rng((angles[case[0]], case[1]))
        model = PivotModel(friction_ratio=0.3, offset=tuple(rng.uniform(-0.5, 0.5, 2)))
        layout, frame, stick = photograph(model, float(np.radians(truth)), rng)
        counts[case] = stick >= settings.FIRM_MARKERS
        seen[case] = frame.valid.sum()
        trackers = Trackers(
            layout, {method: {} for method in METHODS}, noise=Noise.from_std(POSITION_NOISE)
        )
        for i, estimate in enumerate(trackers.update(frame).values()):
            answered[(*case, i)] = np.isfinite(estimate.angle)
            error[(*case, i)] = np.degrees(np.nan_to_num(estimate.angle)) - truth
    return Rendered(np.array(angles, dtype=float), error, answered, counts, seen)


def photograph(
    model: PivotModel, angle: float, rng: np.random.Generator
) -> tuple[MarkerLayout, Frame, int]:
    """Read a rendered pivot: layout, frame, and the true number of sticking markers."""
    layout = lay_out_markers(model)
    stick = deform(model, layout, np.ones(1), np.array([angle]))[1].stick[0]

    def move(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        flat = np.column_stack([points, np.zeros(len(points))])
        surface = MarkerLayout(flat, np.full((len(flat), 1), -1))
        return deform(model, surface, np.ones(1), np.array([angle]))[0][0][:, :2]

    def render(path: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        centres, axes = project_discs(CAMERA, path, layout.reference[:, :2], RADIUS)
        return render_dots(CAMERA, centres, axes, rng)

    rest = Picture(render(lambda points: points), 0.0, 0)
    now = Picture(render(move), 1.0, 1)
    reader = DotReader(rest, SENSOR)
    reader.read(rest)
    frame = reader.frame(reader.read(now))
    return reader.layout, frame, int(stick.sum())


def tables(result: Rendered) -> dict[str, list[dict[str, object]]]:
    """A table by method over all angles, and a table by angle."""
    counted, error = result.counts, np.abs(result.error)
    methods: list[dict[str, object]] = [
        {
            "method": method,
            "draws": int(counted.sum()),
            "answered [%]": cell(100 * result.answered[counted][:, i], 1),
            "mean absolute error [°]": cell(error[counted][:, i], 4),
            "largest [°]": cell(error[counted][:, i], 3, np.max),
        }
        for i, method in enumerate(METHODS)
    ]
    angles: list[dict[str, object]] = [
        {
            "angle [°]": int(angle),
            "draws": int(counted[a].sum()),
            "fewest dots": int(result.seen[a].min()),
            **{method: cell(error[a][counted[a]][:, i], 4) for i, method in enumerate(METHODS)},
        }
        for a, angle in enumerate(result.angle)
        if counted[a].any()
    ]
    return {"": methods, "_angles": angles}


def plot(result: Rendered) -> Figure:
    """Mean absolute error over the angle."""
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    firm = result.counts.any(axis=1)
    for i, method in enumerate(METHODS):
        error = [
            np.abs(result.error[a][result.counts[a]][:, i]).mean() for a in np.flatnonzero(firm)
        ]
        axis.semilogy(result.angle[firm], error, "o-", label=method)
    error = "mean absolute error [°]"
    finish(axis, legend=8, minor=True, xlabel="object's angle [°]", ylabel=error)
    return figure
