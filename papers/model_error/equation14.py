"""Error of Eq. (14), θ = −φ, as maps to read a correction from, drawn from the atlas.

The share of the object's turn that the elastomer does not show where it sticks, 1 − φ/θ, depends on
k and on the elastomer's thickness beside the contact's radius; hardly on how much sticks, and on
friction only through that. Divide a measured φ by one minus the map's value.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from matplotlib.tri import TriAnalyzer, Triangulation

from papers.model_error import atlas
from papers.sweeps import run_study

LEVELS = (1, 2, 5, 10, 20, 30, 40, 50, 60, 70)
"""Contour lines [%]."""


class Maps(NamedTuple):
    """The twist out of the atlas, a row for each case and a column for each step.

    Attributes:
        stiffness_ratio: k [-].
        thickness: h/a [-].
        friction: μ [-].
        thick: cases on the thickest elastomer.
        thin: cases on the thinnest.
        stick_ratio: share of the contact that sticks [-].
        missed: 1 − φ/θ where it sticks [%]; NaN where nothing does.
    """

    stiffness_ratio: Float[np.ndarray, " cases"]
    thickness: Float[np.ndarray, " cases"]
    friction: Float[np.ndarray, " cases"]
    thick: Bool[np.ndarray, " cases"]
    thin: Bool[np.ndarray, " cases"]
    stick_ratio: Float[np.ndarray, "cases steps"]
    missed: Float[np.ndarray, "cases steps"]


def compute(quick: bool = False, track: Callable[[Iterable], Iterable] = iter) -> Maps:
    """Solve, or read what `python -m papers sweep papers.model_error.atlas` has done."""
    found = run_study("papers.model_error.atlas", quick, track)
    if found.failures:
        raise ValueError(f"{len(found.failures)} contacts failed: {found.failures}")
    out = slice(0, atlas.STEPS[0])
    values, table = found.values, found.table
    return Maps(
        stiffness_ratio=table["stiffness_ratio"],
        thickness=table["thickness"] / values["contact_radius"],
        friction=table["friction"],
        thick=table["thickness"] == max(atlas.THICKNESSES),
        thin=table["thickness"] == min(atlas.THICKNESSES),
        stick_ratio=values["stick_ratio"][:, out],
        missed=100.0 * (1.0 - values["stick_rotation"][:, out] / values["twist"][:, out]),
    )


def tables(result: Maps) -> dict[str, list[dict[str, object]]]:
    """A row for each k and thickness: what is missed while all sticks and when little does."""
    rows = []
    pairs = sorted({*zip(result.stiffness_ratio, result.thickness.round(2), strict=True)})
    for k, thickness in pairs:
        chosen = (result.stiffness_ratio == k) & (result.thickness.round(2) == thickness)
        ratio, missed = result.stick_ratio[chosen], result.missed[chosen]
        firm, little = ratio > 0.8, (ratio > 0.1) & (ratio < 0.3)
        rows.append(
            {
                "k": float(k),
                "h/a": float(thickness),
                "missed, more than 80 % sticks [%]": _mean(missed[firm]),
                "missed, 10 to 30 % sticks [%]": _mean(missed[little]),
                "half-spaces, k/(1+k) [%]": round(100.0 * float(k / (1.0 + k)), 2),
            }
        )
    return {"": rows}


def _mean(missed: np.ndarray) -> float | None:
    return round(float(missed.mean()), 2) if len(missed) else None


def plot(result: Maps) -> Figure:
    """Maps over k and h/a, over k and stick ratio on a thick and a thin elastomer, and over μ."""
    figure, axes = plt.subplots(2, 2, figsize=(11, 8.5), layout="constrained")
    grip = result.friction == result.friction.max()
    first = result.missed[grip, 0]
    by_k = (len(np.unique(result.stiffness_ratio)), -1)  # the table runs through h for each k
    k, height = (
        values[grip].reshape(by_k) for values in (result.stiffness_ratio, result.thickness)
    )
    _shade(axes[0, 0], axes[0, 0].contourf, axes[0, 0].contour, k, np.log10(height),
           first.reshape(by_k))  # fmt: skip
    ticks = [0.5, 1.0, 2.0, 5.0, 10.0]
    axes[0, 0].set_yticks(np.log10(ticks), [f"{tick:g}" for tick in ticks])
    axes[0, 0].set(title="all sticks", ylabel="thickness over contact radius h/a [-]")
    for axis, chosen, name in (
        (axes[0, 1], result.thick, "thick"),
        (axes[1, 0], result.thin, "thin"),
    ):
        k = np.broadcast_to(result.stiffness_ratio[:, None], result.missed.shape)[chosen]
        _map(axis, k.ravel(), result.stick_ratio[chosen].ravel(), result.missed[chosen].ravel())
        low, high = result.thickness[chosen].min(), result.thickness[chosen].max()
        axis.set(title=f"{name}: h/a = {low:.2g} to {high:.2g}", ylabel="stick ratio [-]")
    for axis in (axes[0, 0], axes[0, 1], axes[1, 0]):
        axis.set_xlabel("k = G_S/G_B [-]")
    _plot_friction(axes[1, 1], result)
    return figure


def _map(axis, x: np.ndarray, y: np.ndarray, missed: np.ndarray) -> None:
    """Of scattered points, each once: where two coincide, Delaunay would stumble."""
    points = np.stack([x, y, missed])[:, np.isfinite(missed)]
    _, first = np.unique(points[:2].round(9), axis=1, return_index=True)
    x, y, missed = points[:, first]
    net = Triangulation(x, y)
    net.set_mask(TriAnalyzer(net).get_flat_tri_mask(0.01))
    _shade(axis, axis.tricontourf, axis.tricontour, net, missed)


def _shade(axis, shade, contour, *field) -> None:
    shades = shade(*field, levels=20, cmap="viridis")
    lines = contour(*field, levels=LEVELS, colors="w", linewidths=0.8)
    axis.clabel(lines, fmt="%g %%", fontsize=8)
    axis.figure.colorbar(shades, ax=axis, label="1 − φ/θ [%]")


def _plot_friction(axis, result: Maps) -> None:
    """What is missed as the contact slips, by friction, for one k."""
    k = np.unique(result.stiffness_ratio)[len(np.unique(result.stiffness_ratio)) // 2]
    for chosen, style in ((result.thin, "o-"), (result.thick, "s--")):
        for i, friction in enumerate(np.unique(result.friction)):
            rows = chosen & (result.friction == friction) & (result.stiffness_ratio == k)
            name = f"μ = {friction:g}" if style == "o-" else None
            axis.plot(result.stick_ratio[rows].T, result.missed[rows].T, style, ms=3, lw=1,
                      color=f"C{i}", label=name)  # fmt: skip
    axis.set(xlabel="stick ratio [-]", ylabel="1 − φ/θ [%]",
             title=f"k = {k:g}; full: thin, dashed: thick")  # fmt: skip
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
