"""Error of Eq. (14), θ = −φ, as maps from which to read a correction, drawn from the atlas.

Where the elastomer sticks, it misses the share 1 − φ/θ of the object's turn. This share depends on
k and on h/a, the elastomer's thickness over the contact's radius. Linear elasticity has no length
scale, so contacts of two sizes must fall on one curve. The stick ratio and friction hardly matter,
and not at all on a thick elastomer. To correct a measured φ, divide it by one minus the map's
value, or multiply it by 1 + k', with k' from the curve of k'/k, which is nearly the same for all k.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from matplotlib.tri import TriAnalyzer, Triangulation

from papers.items import Track
from papers.model_error import atlas
from papers.sweeps import run_study
from papers.tables import cell, finish

LEVELS = (1, 2, 5, 10, 20, 30, 40, 50, 60, 70)
"""Contour lines [%]."""


class Maps(NamedTuple):
    """The atlas while the twist grows: a row for each case, a column for each step."""

    stiffness_ratio: Float[np.ndarray, " cases"]  # k [-]
    thickness: Float[np.ndarray, " cases"]  # h/a [-]
    friction: Float[np.ndarray, " cases"]  # μ [-]
    large: Bool[np.ndarray, " cases"]  # mask of the cases with the larger of the two contacts
    thick: Bool[np.ndarray, " cases"]  # mask of the large contacts on the thickest elastomer
    thin: Bool[np.ndarray, " cases"]  # mask of the large contacts on the thinnest elastomer
    stick_ratio: Float[np.ndarray, "cases steps"]  # share of the contact that sticks [-]
    # 1 − φ/θ over the stick region [%]; NaN if nothing sticks
    missed: Float[np.ndarray, "cases steps"]


def compute(quick: bool = False, track: Track = iter) -> Maps:
    """Solve the atlas; results of `python -m papers sweep papers.model_error.atlas` are reused."""
    results = run_study("papers.model_error.atlas", quick, track)
    out = slice(0, atlas.STEPS[0])
    values, table = results.values, results.table
    large = table["indentation"] == max(atlas.INDENTATIONS)
    return Maps(
        stiffness_ratio=table["stiffness_ratio"],
        thickness=table["thickness"] / values["contact_radius"],
        friction=table["friction"],
        large=large,
        thick=large & (table["thickness"] == max(atlas.THICKNESSES)),
        thin=large & (table["thickness"] == min(atlas.THICKNESSES)),
        stick_ratio=values["stick_ratio"][:, out],
        missed=100.0 * (1.0 - values["stick_rotation"][:, out] / values["twist"][:, out]),
    )


def tables(result: Maps) -> dict[str, list[dict[str, object]]]:
    """A row for each k, thickness and size: the missed share at large and at small stick ratios."""
    rows = []
    frictions = len(np.unique(result.friction))
    for chosen in np.arange(len(result.friction)).reshape(-1, frictions):  # friction varies fastest
        k, ratio, missed = (
            values[chosen] for values in (result.stiffness_ratio, result.stick_ratio, result.missed)
        )
        rows.append(
            {
                "k": float(k[0]),
                "h/a": cell(result.thickness[chosen], 2),
                "contact": "large" if result.large[chosen[0]] else "small",
                "missed, more than 80 % sticks [%]": cell(missed[ratio > 0.8], 2),
                "missed, 10 to 30 % sticks [%]": cell(missed[(ratio > 0.1) & (ratio < 0.3)], 2),
                "half-spaces, k/(1+k) [%]": cell(100.0 * k[0] / (1.0 + k[0]), 2),
            }
        )
    return {"": rows}


def plot(result: Maps) -> Figure:
    """Maps over k, h/a and stick ratio above; friction, size and k'/k below."""
    figure, axes = plt.subplots(2, 3, figsize=(16, 9), layout="constrained")
    _plot_sizes(axes[0, 0], result)
    for axis, chosen, name in (
        (axes[0, 1], result.thick, "thick"),
        (axes[0, 2], result.thin, "thin"),
    ):
        k = np.broadcast_to(result.stiffness_ratio[:, None], result.missed.shape)[chosen]
        _map(axis, k.ravel(), result.stick_ratio[chosen].ravel(), result.missed[chosen].ravel())
        low, high = result.thickness[chosen].min(), result.thickness[chosen].max()
        axis.set(title=f"{name}: h/a = {low:.2g} to {high:.2g}", ylabel="stick ratio [-]")
    for axis in axes[0]:
        axis.set_xlabel("k = G_S/G_B [-]")
    _plot_friction(axes[1, 0], result)
    _plot_collapse(axes[1, 1], axes[1, 2], result)
    return figure


def _firm(result: Maps) -> Bool[np.ndarray, " cases"]:
    """Mask of the cases with the greatest friction, where most of the contact sticks at first."""
    return result.friction == result.friction.max()


def _plot_sizes(axis, result: Maps) -> None:
    """Map of the missed share over k and h/a, for contacts of both sizes."""
    by_k = (len(np.unique(result.stiffness_ratio)), -1)  # the table runs through h and a for each k
    k, height, missed = (
        values[_firm(result)].reshape(by_k)
        for values in (result.stiffness_ratio, result.thickness, result.missed[:, 0])
    )
    order = np.argsort(height, axis=1)
    field = (np.take_along_axis(values, order, 1) for values in (k, np.log10(height), missed))
    _shade(axis, axis.contourf, axis.contour, *field)
    ticks = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0]
    axis.set_yticks(np.log10(ticks), [f"{tick:g}" for tick in ticks])
    axis.set(title="nearly all sticks", ylabel="thickness over contact radius h/a [-]")


def _plot_collapse(left, right, result: Maps) -> None:
    """The missed share, and k' = missed/(1 − missed) divided by k, over h/a for both sizes."""
    for chosen, style in ((result.large, "o-"), (~result.large, "x--")):
        for i, k in enumerate(np.unique(result.stiffness_ratio)[1:]):
            rows = chosen & _firm(result) & (result.stiffness_ratio == k)
            share = 0.01 * result.missed[rows, 0]
            name = f"k = {k:g}" if style == "o-" else None
            for axis, shown in ((left, 100.0 * share), (right, share / (1.0 - share) / k)):
                axis.semilogx(result.thickness[rows], shown, style, ms=4, lw=1, color=f"C{i}",
                              label=name)  # fmt: skip
    left.set(ylabel="1 − φ/θ [%]", title="full, dots: large contacts; dashed, crosses: small")
    right.set(ylabel="k'/k, with θ = (1 + k') φ [-]", title="apparent k of a layer")
    finish(left, right, legend=8, minor=True, xlabel="thickness over contact radius h/a [-]")


def _map(axis, x: np.ndarray, y: np.ndarray, missed: np.ndarray) -> None:
    """Contour map of scattered points without duplicates, on which Delaunay would fail."""
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
    """The missed share over the stick ratio, by friction, for one k."""
    k = np.unique(result.stiffness_ratio)[len(np.unique(result.stiffness_ratio)) // 2]
    for chosen, style in ((result.thin, "o-"), (result.thick, "s--")):
        for i, friction in enumerate(np.unique(result.friction)):
            rows = chosen & (result.friction == friction) & (result.stiffness_ratio == k)
            name = f"μ = {friction:g}" if style == "o-" else None
            axis.plot(result.stick_ratio[rows].T, result.missed[rows].T, style, ms=3, lw=1,
                      color=f"C{i}", label=name)  # fmt: skip
    axis.set_title(f"k = {k:g}; full: thin, dashed: thick")
    finish(axis, legend=7, xlabel="stick ratio [-]", ylabel="1 − φ/θ [%]")
