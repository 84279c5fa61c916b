"""Live angles while few markers stick, and while the object slides over gel at rest.

Round pivots are turned once, turned and turned back, or held in between; friction and noise are
random over a decade or more. The table shows how often the interval holds the truth, by the number
of markers that have never slipped.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure

from estimation.estimators.result import Result
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Truth, simulate_pivot
from papers.items import Track
from papers.tables import cell, finish
from papers.virtual_pivots import settings

FRICTION_RATIOS, NOISES_MM = (0.02, 0.3), (1e-3, 1e-2)
GROUPS = {"20 and more": (20, 400), "10 to 19": (10, 19), "5 to 9": (5, 9), "3 and 4": (3, 4)}
"""Markers that have never slipped, by name."""
FAR_DEG = 1.0
"""Distance of the truth from the interval that counts as far [deg]."""


class Pivot(NamedTuple):
    """The frames in contact of one recording."""

    sticking: Int[np.ndarray, " frames"]  # number of markers that have never slipped
    error: Float[np.ndarray, " frames"]  # angle minus truth [deg]; NaN without an answer
    middle: Float[np.ndarray, " frames"]  # middle of the interval minus truth [deg]
    half_width: Float[np.ndarray, " frames"]  # half-width of the interval [deg]
    outside: Float[np.ndarray, " frames"]  # distance of the truth from the interval [deg]; 0 inside
    # mask of the frames from the first with fewer than three sticking markers on
    slid: Bool[np.ndarray, " frames"]


def compute(quick: bool = False, track: Track = iter) -> list[Pivot]:
    """Simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["slides"]
    return [_follow(draw) for draw in track(range(draws))]


def _follow(draw: int) -> Pivot:
    rng = np.random.default_rng((4, draw))
    friction, noise = (
        float(np.exp(rng.uniform(*np.log(span)))) for span in (FRICTION_RATIOS, NOISES_MM)
    )
    there, back = float(rng.uniform(3.0, 20.0)), float(rng.uniform(-30.0, 5.0))
    angles, frames = (
        ((0.0, 1.5 * there), (30,)),
        ((0.0, there, back), (30, 60)),
        ((0.0, there, there, back), (30, 20, 60)),
    )[draw % 3]
    model = PivotModel(friction_ratio=friction, noise=noise)
    recording, truth = simulate_pivot(model, angles_deg=angles, frames=frames, seed=draw)
    result = estimate_angles(recording)
    touching = np.isfinite(truth.angle) & result.contact.any(axis=1)
    return Pivot(
        truth.stick.sum(axis=1)[touching],
        np.degrees(result.angle - truth.angle)[touching],
        np.degrees(0.5 * (result.low + result.high) - truth.angle)[touching],
        np.degrees(result.high - result.low)[touching] / 2.0,
        measure_outside(result, truth)[touching],
        np.maximum.accumulate(truth.macro_slip)[touching],
    )


def measure_outside(result: Result, truth: Truth) -> Float[np.ndarray, " frames"]:
    """Distance of the truth from the interval [deg]; 0 inside, NaN without an answer."""
    outside = np.maximum(result.low - truth.angle, truth.angle - result.high)
    return np.degrees(np.maximum(outside, 0.0))


def tables(result: list[Pivot]) -> dict[str, list[dict[str, object]]]:
    """A row for each range of markers, one for sliding frames; and counts of the recordings."""
    pooled = Pivot(*(np.concatenate(parts) for parts in zip(*result, strict=True)))
    chosen = {
        name: (pooled.sticking >= least) & (pooled.sticking <= most) & ~pooled.slid
        for name, (least, most) in GROUPS.items()
    } | {"fewer, or slid before": pooled.slid}
    rows = [_row(name, pooled, frames) for name, frames in chosen.items()]
    far = sum(bool((pivot.outside > FAR_DEG).any()) for pivot in result)
    slid = sum(bool(pivot.slid.any()) for pivot in result)
    counts: dict[str, object] = {
        "recordings": len(result),
        "object slides": slid,
        f"an angle more than {FAR_DEG:g}° outside": far,
    }
    return {"": rows, "_recordings": [counts]}


def _row(name: str, pooled: Pivot, frames: Bool[np.ndarray, " frames"]) -> dict[str, object]:
    answered = frames & np.isfinite(pooled.error)
    return {
        "markers that never slipped": name,
        "frames": int(frames.sum()),
        "answered [%]": cell(100.0 * answered.sum() / max(frames.sum(), 1), 1),
        "mean absolute error [°]": cell(np.abs(pooled.error[answered]), 3),
        "median half-width [°]": cell(pooled.half_width[answered], 3, np.median),
        "interval holds [%]": cell(100.0 * (pooled.outside[answered] == 0.0), 1),
    }


def plot(result: list[Pivot]) -> Figure:
    """Half-width over the truth's distance from the middle; below the line the truth is outside."""
    figure, axis = plt.subplots(figsize=(5.6, 4.8), layout="constrained")
    pooled = Pivot(*(np.concatenate(parts) for parts in zip(*result, strict=True)))
    for slid, colour, label in (
        (False, "#08306b", "3 markers or more have never slipped"),
        (True, "#d6604d", "the object slides, or slid before"),
    ):
        frames = (pooled.slid == slid) & np.isfinite(pooled.error)
        off = np.maximum(np.abs(pooled.middle[frames]), 1e-4)
        axis.loglog(off, pooled.half_width[frames], ".", ms=3, color=colour, label=label)
    ends = [1e-4, 40.0]
    axis.plot(ends, ends, color="0.4", lw=0.8)
    off = "distance of the truth from the interval's middle [°]"
    finish(axis, legend=8, xlabel=off, ylabel="half-width of the 95 % interval [°]")
    return figure
