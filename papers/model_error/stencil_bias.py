"""Stencil bias: the mean of φ over the true stick region, compared with a rigid fit of its markers.

Even if Eq. (15) found the exact stick region, the mean would be low: φ uses differences between
neighbouring markers, and the stencils of the outermost sticking markers reach into the slip. The
rigid fit uses only the positions of the sticking markers. Virtual pivots are turned by 10°, with
the grid placed at random.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from contactmodel.analytic import lubkin_twist
from estimation.fields.measure import measure_fields
from estimation.fields.plane import fit_motion
from estimation.fields.stencils import make_stencils
from estimation.frames.recording import Frame, MarkerLayout
from estimation.virtual.recording import PivotModel, simulate_frame
from papers.items import Track
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.model_error import settings
from papers.tables import cell, finish
from papers.virtual_pivots.solved import place_at_random

STICK_RADII = tuple(np.linspace(0.25, 0.95, 15).tolist())
"""c/a."""

PITCHES_MM = (0.5, 1.0)
NOISE_MM = 1e-3
DRAWS, QUICK_DRAWS = 60, 4


class Bias(NamedTuple):
    """Errors of each draw, and the mean absolute error at the Cramér–Rao bound [deg]."""

    mean: Float[np.ndarray, "pitches radii draws"]  # error of the mean of φ [deg]
    rigid: Float[np.ndarray, "pitches radii draws"]  # error of the rigid fit [deg]
    limit: Float[np.ndarray, "pitches radii"]  # mean absolute error at the Cramér–Rao bound [deg]


def compute(quick: bool = False, track: Track = iter) -> Bias:
    """Draw the frames, and estimate from the true stick region."""
    rng = np.random.default_rng(settings.SEED)
    draws = QUICK_DRAWS if quick else DRAWS
    shape = (len(PITCHES_MM), len(STICK_RADII))
    mean, rigid, limit = np.zeros((*shape, draws)), np.zeros((*shape, draws)), np.zeros(shape)
    for at in track(list(np.ndindex(shape))):
        pitch, radius = PITCHES_MM[at[0]], STICK_RADII[at[1]]
        drawn = [_draw(pitch, radius, rng) for _ in range(draws)]
        mean[at], rigid[at], bounds = (np.array(part) for part in zip(*drawn, strict=True))
        limit[at] = bounds.mean()
    return Bias(mean, rigid, limit)


def draw_frame(
    pitch: float, stick_radius: float, noise: float, rng: np.random.Generator
) -> tuple[MarkerLayout, Frame, Bool[np.ndarray, " n"]]:
    """A pivot turned by the default angle, its markers placed at random, and the mask that sticks.

    Args:
        pitch: distance of the markers [mm].
        stick_radius: c/a [-].
        noise: noise of x and y; that of z is 3.5 times larger [mm].
        rng: random generator.
    """
    theta = float(np.radians(settings.ANGLE_DEG))
    across = int(np.ceil(2.8 * settings.CONTACT_RADIUS / pitch))
    model = PivotModel(
        contact_radius=settings.CONTACT_RADIUS,
        friction_ratio=theta / float(lubkin_twist(stick_radius, 1.0)),
        grid_shape=(across, across),
        pitch=pitch,
        noise=noise,
        normal_noise=3.5 * noise,
    )
    return simulate_frame(place_at_random(model, rng), theta, rng)


def _draw(pitch: float, stick_radius: float, rng: np.random.Generator) -> tuple[float, ...]:
    theta = float(np.radians(settings.ANGLE_DEG))
    layout, frame, stick = draw_frame(pitch, stick_radius, NOISE_MM, rng)
    phi = measure_fields(make_stencils(layout), frame).rotation[stick].mean()
    before, after = (
        points[stick, :2] @ [1.0, 1.0j] for points in (layout.reference, frame.positions)
    )
    turn = fit_motion(before, after).angle
    bound = MEAN_ABSOLUTE * angle_limit(layout.reference[:, :2], stick, NOISE_MM)
    return tuple(np.degrees([phi - theta, turn - theta, bound]).tolist())


def tables(result: Bias) -> dict[str, list[dict[str, object]]]:
    """A row for each pitch and radius: medians, and the mean absolute error of the fit."""
    return {
        "": [
            {
                "pitch [mm]": PITCHES_MM[i],
                "c/a": round(STICK_RADII[j], 2),
                "mean of φ, median error [°]": cell(result.mean[i, j], 3, np.median),
                "rigid fit, median error [°]": cell(result.rigid[i, j], 4, np.median),
                "rigid fit, mean absolute error [°]": cell(np.abs(result.rigid[i, j]), 4),
                "Cramér–Rao [°]": cell(result.limit[i, j], 4),
            }
            for i, j in np.ndindex(result.limit.shape)
        ]
    }


def plot(result: Bias) -> Figure:
    """Left: error, median and 5 to 95 %. Right: mean absolute error."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for i, pitch in enumerate(PITCHES_MM):
        for errors, what, style in ((result.mean[i], "mean of φ", "-"),
                                    (result.rigid[i], "rigid fit", "--")):  # fmt: skip
            name = f"{what}, markers {pitch:g} mm apart"
            low, middle, high = np.percentile(errors, [5, 50, 95], axis=1)
            left.plot(STICK_RADII, middle, style, color=f"C{i}", label=name)
            left.fill_between(STICK_RADII, low, high, color=f"C{i}", alpha=0.15)
            right.semilogy(
                STICK_RADII, np.abs(errors).mean(axis=1), style, color=f"C{i}", label=name
            )
        right.semilogy(STICK_RADII, result.limit[i], ":", color=f"C{i}",
                       label=f"Cramér–Rao bound, {pitch:g} mm")  # fmt: skip
    left.set_ylabel("error, median and 5 to 95 % [°]")
    right.set_ylabel("mean absolute error [°]")
    finish(left, right, minor=True, xlabel="stick radius over contact radius c/a [-]")
    right.legend(fontsize=7)
    return figure
