"""Figures that compare recordings: of several sensors, or of a gripper's two fingers."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.estimators.grasp import Grasp
from estimation.estimators.result import Track
from estimation.output.plots import set_margins
from estimation.output.scene import choose_rows


def plot_overview(
    results: Mapping[str, Track],
    outlines: Mapping[str, tuple[str, Float[np.ndarray, " frames"]]],
) -> Figure:
    """Angles of several recordings and of their contact outlines, each on its own clock.

    An outline or imprint has no zero, so its curve starts on that of the angle.

    Args:
        results: tracks by recording.
        outlines: label and angle [rad] of the outline or imprint, by recording.

    Examples:
        >>> from estimation import estimate_angles, follow_outline, plot_overview, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> outlines = {"lift": ("outline", follow_outline(recording).angle)}
        >>> figure = plot_overview({"lift": estimate_angles(recording)}, outlines)
        >>> figure.savefig("overview.png")
        >>> print([text.get_text() for text in figure.axes[0].get_legend().get_texts()][-1])
        bar on the zero line: macro slip
    """
    size = (9.0, 4.5)
    figure, axis = plt.subplots(figsize=size, gridspec_kw=set_margins(size))
    for number, (name, track) in enumerate(results.items()):
        what, outline = outlines[name]
        drawn = choose_rows(track.angle, track.low, track.high, track.slipping, outline)
        result, outline = track.take(drawn), outline[drawn]
        time = result.time - track.time[0]
        colour = f"C{number}"
        axis.plot(time, np.degrees(result.angle), color=colour, lw=1.6, label=f"{name}: angle")
        axis.fill_between(
            time, np.degrees(result.low), np.degrees(result.high), color=colour, alpha=0.3, lw=0
        )
        shared = np.nonzero(result.answered & np.isfinite(outline))[0]
        if len(shared):
            outline = outline - outline[shared[0]] + result.angle[shared[0]]
            axis.plot(time, np.degrees(outline), "--", color=colour, lw=1, label=f"{name}: {what}")
        level = np.where(result.slipping, 0.0, np.nan)
        axis.plot(time, level, color=colour, lw=5, alpha=0.35, solid_capstyle="butt")
    for width, label in ((9, "95 % interval"), (5, "bar on the zero line: macro slip")):
        axis.plot([], [], color="0.5", lw=width, alpha=0.35, solid_capstyle="butt", label=label)
    axis.axhline(0.0, color="0.7", lw=0.6)
    axis.set(xlabel="time since the recording's first frame [s]", ylabel="object's angle [°]")
    axis.legend(fontsize=8, frameon=False)
    return figure


def plot_grasp(grasp: Grasp, names: Sequence[str]) -> Figure:
    """Both fingers' angles on one clock, their joint angle, and their difference.

    Args:
        grasp: the comparison.
        names: names of the two recordings.

    Examples:
        >>> from estimation import compare_fingers, estimate_angles, plot_grasp, simulate_pivot
        >>> tracks = [
        ...     estimate_angles(simulate_pivot(angles_deg=(0.0, turn), frames=(20,), seed=seed)[0])
        ...     for seed, turn in ((0, 10.0), (1, -10.0))  # the fingers face each other
        ... ]
        >>> figure = plot_grasp(compare_fingers(*tracks), ["left", "right"])
        >>> figure.savefig("grasp.png")
        >>> print([axis.get_ylabel() for axis in figure.axes])
        ["object's angle [°]", 'difference [°]']
    """
    drawn = choose_rows(grasp.first, grasp.second, grasp.low, grasp.high, grasp.holds)
    time, low, high, first, second, holds = (
        values[drawn]
        for values in (grasp.time, grasp.low, grasp.high, grasp.first, grasp.second, grasp.holds)
    )
    size = (9.0, 5.4)
    margins = set_margins(size, top=0.15, hspace=0.06)
    figure, (top, bottom) = plt.subplots(
        2, 1, sharex=True, figsize=size, height_ratios=[2.4, 1], gridspec_kw=margins
    )
    label = "joint angle, 95 % interval"
    top.fill_between(time, *np.degrees([low, high]), color="0.8", lw=0, label=label)
    for angle, name, colour in zip((first, second), names, ("C0", "C1"), strict=True):
        top.plot(time, np.degrees(angle), color=colour, lw=1.4, label=name)
    top.set_ylabel("object's angle [°]")
    top.legend(fontsize=8, frameon=False)
    difference = np.degrees(second - first)
    bottom.plot(time, difference, color="0.7", lw=1, label="no marker sticks on a finger")
    holding = np.where(holds, difference, np.nan)
    bottom.plot(time, holding, "k", lw=1.3, label="markers stick on both fingers")
    bottom.axhline(0.0, color="0.7", lw=0.6)
    bottom.set(xlabel=f"time since the first frame of {names[0]} [s]", ylabel="difference [°]")
    bottom.legend(fontsize=8, frameon=False)
    return figure
