"""Figures of a contact's load against its limit: moment and friction."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from estimation.estimators.result import Track
from estimation.output.plots import measure_legend, set_margins
from estimation.output.scene import choose_rows
from estimation.slip.alert import AlertLevel, GripPath
from estimation.slip.branch import Branch


def loads_of(track: Track) -> tuple[Float[np.ndarray, " frames"], str]:
    """The moments that the margin follows from, and their label: measured, else by the markers."""
    if np.isfinite(track.moment).any():
        return track.moment, "moment [N·mm]"
    return np.degrees(track.gel_moment), "moment by markers [°]"


def plot_moment(results: Mapping[str, tuple[Track, Branch | None]]) -> Figure:
    """Moment against angle, and the fitted curve of partial-slip torsion.

    Args:
        results: track, and the fitted branch or None, by name.
    """
    size = (5.2 * len(results), 4.2)
    figure, axes = plt.subplots(1, len(results), figsize=size, squeeze=False)
    legends = list[Legend]()
    for axis, (name, (result, branch)) in zip(axes[0], results.items(), strict=True):
        result = result.take(choose_rows(result.angle, loads_of(result)[0]))
        loads, quantity = loads_of(result)
        slip = result.slipping
        for where, colour, label in ((~slip, "#08306b", "holds"), (slip, "#d6604d", "macro slip")):
            if not np.isfinite(result.angle[where] + loads[where]).any():
                continue
            axis.plot(
                np.degrees(result.angle[where]),
                loads[where],
                ".",
                color=colour,
                label=label,
            )
        if branch is not None:
            furthest = np.nanmax(branch.sign * (result.angle - branch.start))
            angle = branch.start + branch.sign * np.linspace(0.0, furthest, 200)
            scale, unit = (np.degrees(1.0), "°") if branch.by_markers else (1.0, " N·mm")
            limit, rms = scale * branch.limit, scale * branch.rms
            label = (
                f"curve, pressure {branch.pressure},\nlimit {limit:.3g}{unit}, rms {rms:.2g}{unit}"
            )
            axis.plot(np.degrees(angle), scale * branch.moment(angle), "k", lw=1.1, label=label)
        axis.set_title(name, fontsize=9)
        axis.set(xlabel="object's angle [°]", ylabel=quantity)
        if axis.lines:
            legends.append(axis.legend(loc="lower left", fontsize=8, frameon=False))
    title = 0.22  # room of a title [in]
    above = title + max([measure_legend(legend)[1] for legend in legends], default=0.0)
    margins = set_margins(size, top=above, wspace=0.25)
    figure.subplots_adjust(**margins)
    for legend in legends:
        height = size[1] * (margins["top"] - margins["bottom"])
        legend.set_bbox_to_anchor((0.0, 1.0 + title / height))
    return figure


def plot_friction(track: Track, grips: GripPath) -> Figure:
    """Friction in use and friction coefficient over time, and the alerts."""
    colours = {
        AlertLevel.WATCH: "#f2c14e",
        AlertLevel.ACT: "#f2803a",
        AlertLevel.SLIPS: "#c92a2a",
    }
    alerts = [np.array([shown == level for shown in grips.level], dtype=float) for level in colours]
    drawn = choose_rows(grips.friction_used, grips.friction, grips.friction_high, *alerts)
    time, grips = track.time[drawn] - track.time[0], grips.take(drawn)
    size = (9.0, 3.2)
    figure, axis = plt.subplots(figsize=size, gridspec_kw=set_margins(size, top=0.15))
    axis.plot(time, grips.friction_used, color="#08306b", lw=1.4, label="in use")
    axis.plot(time, grips.friction, color="#b2182b", lw=1.1, label="coefficient, 95 % interval")
    axis.fill_between(
        time, grips.friction_low, grips.friction_high, color="#b2182b", alpha=0.2, lw=0
    )
    for (level, colour), alerted in zip(colours.items(), alerts, strict=True):
        bar = np.where(alerted[drawn], 0.0, np.nan)
        axis.plot(time, bar, color=colour, lw=6, solid_capstyle="butt", label=f"alert: {level}")
    axis.set_ylim(bottom=0.0)
    axis.set(xlabel="time [s]", ylabel="friction [-]")
    axis.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
    return figure
