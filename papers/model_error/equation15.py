"""Eq. (15)'s threshold: missed and false markers of the stick region, and the angle's error.

Virtual pivots with a known stick mask are turned by 10°. The threshold covers both its readings,
0.4 and 0.4° = 0.007; noise, distance of the markers and stick radius vary as well. As in the paper,
the angle is the mean of φ over the grown region; a region of fewer than three markers gives none.

The best threshold follows the relative noise of φ, measured at markers whose neighbours all stick.
Below about twice this noise, sticking markers fail by chance and the region stops growing. Above
about four times, markers join whose stencils reach into the slip.
"""

from itertools import product
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from estimation.estimators.paper import STRICT_THRESHOLD
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import erode, make_stencils
from estimation.fields.stick import ANGLE_FLOOR_DEG, MIN_STICK_MARKERS, grow_stick_region
from papers.items import Track
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.model_error import settings
from papers.model_error.stencil_bias import draw_frame
from papers.tables import cell, finish

THRESHOLDS = tuple(np.geomspace(0.001, 1.0, 25).tolist())
NOISES_UM = (0.3, 1.0, 3.0, 10.0)
PITCHES_MM = (0.5, 1.0, 1.5)
STICK_RADII = (0.4, 0.6, 0.8)
"""c/a of the contact, whose radius a is 5 mm."""

DRAWS, QUICK_DRAWS = 40, 3


class Condition(NamedTuple):
    """Noise [µm], distance of the markers [mm], and c/a [-]."""

    noise_um: float
    pitch: float
    stick_radius: float


CONDITIONS = [Condition(n, 1.0, c) for n, c in product(NOISES_UM, STICK_RADII)] + [
    Condition(1.0, p, c) for p, c in product(PITCHES_MM, STICK_RADII) if p != 1.0
]


class Thresholds(NamedTuple):
    """Means over the draws: a row for each of `CONDITIONS`, a column for each threshold.

    Attributes:
        missed: share of the sticking markers outside the region [-].
        false: share of the region's markers that slip [-].
        bias: mean error of the answered angles [deg].
        error: mean absolute error; a missing answer counts as the full angle [deg].
        limit: mean absolute error at the Cramér–Rao bound, by condition [deg].
        scatter: noise of φ over the angle, by condition [-].
    """

    missed: Float[np.ndarray, "conditions thresholds"]
    false: Float[np.ndarray, "conditions thresholds"]
    bias: Float[np.ndarray, "conditions thresholds"]
    error: Float[np.ndarray, "conditions thresholds"]
    limit: Float[np.ndarray, " conditions"]
    scatter: Float[np.ndarray, " conditions"]

    @property
    def best(self) -> Int[np.ndarray, " conditions"]:
        """Column of the threshold with the least error."""
        return self.error.argmin(axis=1)


def compute(quick: bool = False, track: Track = iter) -> Thresholds:
    """Draw the frames, and grow the stick region with each threshold."""
    rng = np.random.default_rng(settings.SEED)
    columns = []
    for condition in track(CONDITIONS):
        drawn = [_draw(condition, rng) for _ in range(QUICK_DRAWS if quick else DRAWS)]
        missed, false, error, limit, noise = (np.array(p) for p in zip(*drawn, strict=True))
        answered = np.isfinite(error)
        total = np.where(answered, error, 0.0).sum(axis=0)
        bias = np.where(answered.any(axis=0), total / np.maximum(answered.sum(axis=0), 1), np.nan)
        lost = np.where(answered, np.abs(error), settings.ANGLE_DEG)
        means = (missed.mean(axis=0), false.mean(axis=0), bias, lost.mean(axis=0), limit.mean())
        columns.append((*means, np.sqrt(np.nanmean(noise**2))))
    return Thresholds(*(np.array(column) for column in zip(*columns, strict=True)))


def _draw(
    condition: Condition, rng: np.random.Generator
) -> tuple[list[float], list[float], list[float], float, float]:
    """One frame's missed and false shares and errors by threshold, its bound and noise of φ."""
    theta = float(np.radians(settings.ANGLE_DEG))
    noise = 1e-3 * condition.noise_um
    layout, frame, truth = draw_frame(condition.pitch, condition.stick_radius, noise, rng)
    stencils = make_stencils(layout)
    fields = measure_fields(stencils, frame)
    missed, false, error = [], [], []
    for threshold in THRESHOLDS:
        region = grow_stick_region(
            fields,
            stencils.adjacent,
            threshold=threshold,
            floor=float(np.radians(ANGLE_FLOOR_DEG)),
        )
        missed.append(float((truth & ~region).sum() / truth.sum()))
        false.append(float((region & ~truth).sum() / region.sum()))
        angle = fields.rotation[region].mean() if region.sum() >= MIN_STICK_MARKERS else np.nan
        error.append(float(np.degrees(angle - theta)))
    bound = np.degrees(MEAN_ABSOLUTE * angle_limit(layout.reference[:, :2], truth, noise))
    inner = erode(truth, stencils)  # the motion is affine there: φ is exact but for noise
    scatter = (
        np.sqrt(np.mean((fields.rotation[inner] / theta - 1.0) ** 2)) if inner.any() else np.nan
    )
    return missed, false, error, float(bound), float(scatter)


def tables(result: Thresholds) -> dict[str, list[dict[str, object]]]:
    """A row for each condition: the best threshold, and the errors at the two readings."""
    rows = []
    for i, condition in enumerate(CONDITIONS):
        best = int(result.best[i])
        read = [int(np.argmin(np.abs(np.log(np.array(THRESHOLDS) / threshold))))
                for threshold in (0.4, STRICT_THRESHOLD)]  # fmt: skip
        rows.append(
            {
                "noise [µm]": condition.noise_um,
                "pitch [mm]": condition.pitch,
                "c/a": condition.stick_radius,
                "best threshold": round(THRESHOLDS[best], 3),
                "noise of φ [-]": cell(result.scatter[i], 4),
                "threshold over noise": cell(THRESHOLDS[best] / result.scatter[i], 1),
                "missed [%]": cell(100 * result.missed[i, best], 1),
                "false [%]": cell(100 * result.false[i, best], 1),
                "error [°]": cell(result.error[i, best], 3),
                "at 0.4 [°]": cell(result.error[i, read[0]], 3),
                "at 0.4° [°]": cell(result.error[i, read[1]], 3),
                "Cramér–Rao [°]": cell(result.limit[i], 4),
            }
        )
    return {"": rows}


def plot(result: Thresholds) -> Figure:
    """Shares, bias and error over the threshold, by noise (above) and pitch (below); best ones."""
    figure, axes = plt.subplots(2, 4, figsize=(18, 8), layout="constrained")
    _plot_best(axes[0, 3], axes[1, 3], result)
    axes = axes[:, :3]
    by_noise = [i for i, c in enumerate(CONDITIONS) if c.pitch == 1.0 and c.stick_radius == 0.6]
    by_pitch = [i for i, c in enumerate(CONDITIONS) if c.noise_um == 1.0 and c.stick_radius == 0.6]
    for j, (chosen, name) in enumerate(
        ((by_noise, "{0.noise_um:g} µm"), (by_pitch, "{0.pitch:g} mm"))
    ):
        _plot_row(axes[j], result, chosen, name)
        fixed = "pitch 1 mm" if j == 0 else f"noise {CONDITIONS[chosen[0]].noise_um:g} µm"
        title = f"missed (full) and false (dashed); c/a = 0.6, {fixed}"
        finish(axes[j, 0], legend=8, title=title, ylabel="share of the markers [%]")
        finish(axes[j, 1], title="answered frames only", ylabel="mean error [°]")
        title = "missing angle counts as 0°; dotted: Cramér–Rao bound"
        finish(axes[j, 2], title=title, ylabel="mean absolute error [°]")
    for axis in axes.flat:
        for threshold in (0.4, STRICT_THRESHOLD):
            axis.axvline(threshold, color="0.6", ls=":", lw=1)
    finish(*axes[1], xlabel="threshold of Eq. 15 [-]; dotted: 0.4 and 0.4°")
    return figure


def _plot_best(above, below, result: Thresholds) -> None:
    """The best threshold over the noise of φ, and its error over the bound."""
    best = np.array(THRESHOLDS)[result.best]
    error = result.error.min(axis=1)
    for colour, radius in enumerate(STICK_RADII):
        rows = [i for i, condition in enumerate(CONDITIONS) if condition.stick_radius == radius]
        style = {"ls": "", "marker": "o", "color": f"C{colour}", "label": f"c/a = {radius:g}"}
        above.loglog(result.scatter[rows], best[rows], **style)
        below.loglog(result.limit[rows], error[rows], **style)
    ends = np.array([result.scatter.min(), result.scatter.max()])
    above.loglog(ends, 2.0 * ends, "k--", lw=1, label="2 and 4 times the noise")
    above.loglog(ends, 4.0 * ends, "k--", lw=1)
    ends = np.array([result.limit.min(), result.limit.max()])
    below.loglog(ends, ends, "k:", lw=1, label="the bound")
    above.set(xlabel="noise of φ over φ [-]", ylabel="best threshold [-]")
    below.set(xlabel="Cramér–Rao bound [°]", ylabel="mean absolute error at the best threshold [°]")
    finish(above, below, legend=8)


def _plot_row(axes, result: Thresholds, chosen: list[int], name: str) -> None:
    shares, bias, error = axes
    for colour, i in enumerate(chosen):
        style = {"color": f"C{colour}", "lw": 1.4}
        shares.semilogx(
            THRESHOLDS, 100 * result.missed[i], label=name.format(CONDITIONS[i]), **style
        )
        shares.semilogx(THRESHOLDS, 100 * result.false[i], ls="--", **style)
        bias.semilogx(THRESHOLDS, result.bias[i], **style)
        error.loglog(THRESHOLDS, result.error[i], **style)
        error.axhline(result.limit[i], ls=":", **(style | {"lw": 1.0}))
