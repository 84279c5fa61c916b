"""Figures of recordings and results; each function returns a Matplotlib figure."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from estimation.estimators.result import Result, State, Track
from estimation.frames.recording import Recording
from estimation.output.record import KeptMarkers
from estimation.output.scene import (
    MARKER_COLOURS,
    STATE_COLOURS,
    choose_rows,
    marker_signs,
    points_down,
    show_state,
    sticking_markers,
)
from estimation.slip.motion import slip_curl, turned_since_counted


def plot_angles(
    results: Mapping[str, Track],
    method: str,
    references: Mapping[str, Float[np.ndarray, " frames"]] | None = None,
) -> Figure:
    """Angle, sticking markers and moment over time, with the state as background colour.

    The axis of the angle is scaled to the chosen method; other curves may exceed it.

    Args:
        results: tracks by method.
        method: the chosen method, drawn with its interval and state.
        references: other angles over the same frames, by label [rad].

    Raises:
        ValueError: there is no result of the chosen method.

    Examples:
        >>> from estimation import estimate_angles, plot_angles, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> figure = plot_angles({"tracked": estimate_angles(recording)}, "tracked")
        >>> print([axis.get_ylabel() for axis in figure.axes])
        ["object's angle [°]", 'markers', 'moment [N·mm]']
    """
    if not isinstance(results, Mapping) or method not in results:
        raise ValueError(f"no result of {method!r}: give results by method, {{{method!r}: result}}")
    main, references = results[method], references or {}
    curves = (main.angle, main.low, main.high, main.stick_markers, main.moment, main.slipping)
    drawn = choose_rows(*curves, *references.values())
    references = {label: values[drawn] for label, values in references.items()}
    main, time = main.take(drawn), main.time[drawn] - main.time[0]
    has_moment = bool(np.isfinite(main.moment).any())
    rows = 3 if has_moment else 2
    size = (9.0, 3.2 + 1.7 * (rows - 1))
    figure, axes = plt.subplots(
        rows, 1, sharex=True, figsize=size, height_ratios=[2.4, 1, 1][:rows]
    )
    for axis in axes:
        _shade_states(axis, time, main.state)
    top = axes[0]
    _draw_references(top, time, references)
    for name in results:
        if name != method and (others := results[name]).answered.any():
            top.plot(time, np.degrees(others.angle[drawn]), lw=0.9, alpha=0.8, label=name)
    _draw_answers(top, time, main)
    top.set_ylabel("object's angle [°]")
    _scale_to(top, main, references.get("truth", np.empty(0)))
    legend = _explain(figure, top, main.state)
    axes[1].plot(time, main.contact_markers, color="0.5", lw=1, label="in contact")
    axes[1].plot(time, main.stick_markers, color="#08306b", lw=1.3, label="sticking")
    axes[1].set_ylabel("markers")
    axes[1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)
    if has_moment:
        axes[2].plot(time, main.moment, color="#7f2704", lw=1.2)
        axes[2].set_ylabel("moment [N·mm]")
    axes[-1].set_xlabel("time since the first frame [s]")
    width, _ = measure_legend(legend)
    figure.subplots_adjust(**set_margins(size, right=width + 0.1, top=0.1, hspace=0.08))
    return figure


def _draw_answers(axis: Axes, time: Float[np.ndarray, " frames"], main: Track) -> None:
    """Draw the chosen method's angle, its interval, and the answers that were withdrawn."""
    method = main.method
    line = axis.plot(time, np.degrees(main.angle), lw=1.8, color="#08306b", label=method)[0]
    ends = np.degrees(main.low), np.degrees(main.high)
    shade = {"color": line.get_color(), "alpha": 0.3, "lw": 0}
    axis.fill_between(time, *ends, label=f"{method}, 95 % interval", **shade)
    if main.withdrawn is not None and main.withdrawn.rows.any():
        withdrawn = np.degrees(main.withdrawn.angle)
        axis.plot(time, withdrawn, ":", lw=1.8, color="#6baed6", label=f"{method}, withdrawn")


def _draw_references(
    axis: Axes,
    time: Float[np.ndarray, " frames"],
    references: Mapping[str, Float[np.ndarray, " frames"]],
) -> None:
    """Draw references, above the chosen method."""
    styles = {"gel": ("-.", "#8c510a"), "truth": (":", "k")}
    for label, angle in references.items():
        style, colour = styles.get(label, ("--", "#e7298a"))
        axis.plot(time, np.degrees(angle), color=colour, ls=style, lw=1.1, label=label, zorder=3)


def _explain(figure: Figure, axis: Axes, states: Sequence[State]) -> Legend:
    """Add a legend of an axis's curves and background colours, beside the axes."""
    handles, labels = axis.get_legend_handles_labels()
    present = [state for state in STATE_COLOURS if state in states]
    handles += [Rectangle((0, 0), 1, 1, color=STATE_COLOURS[state]) for state in present]
    labels += [show_state(state) for state in present]
    return figure.legend(handles, labels, loc="upper right", fontsize=8, frameon=False)


def plot_maps(recording: Recording, result: Result, frames: Sequence[int]) -> Figure:
    """Maps of rotation, of stick and slip, and of the slip's rotation, seen from the object.

    Args:
        recording: the recording.
        result: result of one method.
        frames: rows of the recording to draw.

    Examples:
        >>> from estimation import estimate_angles, plot_maps, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> figure = plot_maps(recording, estimate_angles(recording), frames=[30, 40])
        >>> figure.savefig("maps.png")
        >>> print(figure.axes[0].get_title())
        1.07 s
        incipient
    """
    turned = turned_since_counted(result)
    markers = [
        KeptMarkers(
            row,
            recording.positions[row],
            turned[row],
            recording.valid[row],
            result.stick[row],
            result.contact[row],
        )
        for row in frames
    ]
    down = points_down(recording.convention)
    return plot_markers(recording.layout.reference, recording.unit, result, markers, down=down)


def choose_frames(
    track: Track, markers: Callable[[], Iterable[KeptMarkers]], size: int
) -> list[KeptMarkers]:
    """Markers of the frames to draw maps of, at most five.

    They are the first and the last frame of macro slip and the frame of the largest angle, as far
    as their markers are stored. The others are evenly spread over the contact, or over all frames.

    Args:
        track: track of the method to draw.
        markers: returns the stored markers, frame by frame.
        size: final number of markers; earlier frames of a resumed camera may have another.
    """
    most = 5
    rows = np.array([frame.row for frame in markers() if len(frame.turned) == size])
    touching = rows[track.contact_markers[rows] > 0]
    rows = touching if len(touching) else rows
    slips = np.flatnonzero(track.slipping)
    chosen: set[int] = set()
    if len(slips):
        stored = np.intersect1d(rows, slips)
        ends = stored[[0, -1]] if len(stored) else rows[[np.abs(rows - slips[0]).argmin()]]
        chosen |= set(ends.tolist())
    angles = np.abs(track.angle[rows])
    if np.isfinite(angles).any():
        chosen.add(int(rows[np.nanargmax(angles)]))
    spread = np.linspace(0, len(rows) - 1, most - len(chosen)).astype(int)
    chosen |= set(rows[spread].tolist())
    return [frame for frame in markers() if frame.row in chosen]


def plot_markers(
    reference: Float[np.ndarray, "n d"],
    unit: str,
    track: Track,
    markers: Sequence[KeptMarkers],
    *,
    down: bool = False,
) -> Figure:
    """Maps of rotation, of stick and slip, and of the slip's rotation in stored frames.

    If y points down, the maps have the orientation of the pictures.
    """
    figure, axes = _make_maps(len(markers), reference, down)
    rotation = np.degrees([np.where(frame.contact, frame.turned, np.nan) for frame in markers])
    rotation_scale = _colour_scale(rotation)
    turn = np.degrees([0.5 * _curl(track, frame) for frame in markers])  # half the curl
    turn_scale = _colour_scale(turn)
    x, y = reference[:, 0], reference[:, 1]
    for column, frame in enumerate(markers):
        top, middle, bottom = axes[:, column]
        since = track.time[frame.row] - track.time[0]
        top.set_title(f"{since:.2f} s\n{show_state(track.state[frame.row])}", fontsize=9)
        signs = marker_signs(sticking_markers(track, frame), frame.contact)
        for kind, sign in zip(MARKER_COLOURS, "ox.", strict=True):
            which = signs == sign
            middle.scatter(x[which], y[which], c=MARKER_COLOURS[kind], marker=sign, s=14)
        _scatter(top, x, y, rotation[column], rotation_scale)
        _scatter(bottom, x, y, turn[column], turn_scale)
    for axis, scale, label in (
        (axes[0, -1], rotation_scale, "φ [°]"),
        (axes[2, -1], turn_scale, "rotation of the slip [°]"),
    ):
        figure.colorbar(scale, cax=axis.inset_axes((1.08, 0.0, 0.07, 1.0)), label=label)
    labels = ("sticks", "slips", "no contact (top and bottom: no value)")
    handles = [
        Line2D([], [], marker=sign, ls="", color=colour, label=label)
        for sign, colour, label in zip("ox.", MARKER_COLOURS.values(), labels, strict=True)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3, fontsize=8, frameon=False)
    axes[2, 0].set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
    return figure


def _curl(track: Track, markers: KeptMarkers) -> Float[np.ndarray, " n"]:
    row = markers.row
    softness = float(track.stiffness_ratio[row]), float(track.load_term[row])
    return slip_curl(markers.turned, markers.contact, float(track.angle[row]), softness)


def _shade_states(axis: Axes, time: Float[np.ndarray, " frames"], states: Sequence[State]) -> None:
    """Colour the background between two frames by the state of the first."""
    starts = [i for i, state in enumerate(states) if i == 0 or state != states[i - 1]]
    spans: dict[State, list[tuple[float, float]]] = {}
    for start, stop in zip(starts, [*starts[1:], len(states) - 1], strict=True):
        spans.setdefault(states[start], []).append((time[start], time[stop] - time[start]))
    across = axis.get_xaxis_transform()  # all of the axis's height
    for state, ranges in spans.items():  # one `axvspan` for each takes a minute on a long stream
        axis.broken_barh(ranges, (0.0, 1.0), color=STATE_COLOURS[state], lw=0, transform=across)


def _scale_to(axis: Axes, track: Track, truth: Float[np.ndarray, " frames"]) -> None:
    """Scale an axis to a method's answers, including withdrawn ones, and to the truth [deg]."""
    angles = [track.angle, track.low, track.high, truth]
    angles += [] if track.withdrawn is None else [track.withdrawn.angle]
    degrees = np.degrees(np.concatenate(angles))
    degrees = degrees[np.isfinite(degrees)]
    if len(degrees):
        rim = max(0.05 * float(np.ptp(degrees)), 0.1)
        axis.set_ylim(degrees.min() - rim, degrees.max() + rim)


def _make_maps(
    columns: int, points: Float[np.ndarray, "n d"], down: bool
) -> tuple[Figure, np.ndarray]:
    """A figure of three rows of maps.

    Only the outer maps have ticks, since each tick costs time.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    rim = 0.05 * (high - low).max()
    low, high = low - rim, high + rim
    tall = float(np.clip((high - low)[1] / (high - low)[0], 0.4, 2.5))
    size = (2.1 * columns + 1.9, 3 * 2.0 * tall + 1.7)
    figure, axes = plt.subplots(
        3,
        columns,
        squeeze=False,
        figsize=size,
        subplot_kw={
            "aspect": "equal",
            "xlim": (low[0], high[0]),
            "ylim": (high[1], low[1]) if down else (low[1], high[1]),
        },
        gridspec_kw=set_margins(size, right=1.2, top=0.5, bottom=0.9, wspace=0.1, hspace=0.1),
    )
    for inner in axes[:-1].flat:
        inner.set_xticks([])
    for inner in axes[:, 1:].flat:
        inner.set_yticks([])
    for outer in {*axes[-1], *axes[:, 0]}:
        outer.tick_params(labelsize=7)
    return figure, axes


def set_margins(
    size: tuple[float, float],
    *,
    right: float = 0.15,
    top: float = 0.35,
    bottom: float = 0.55,
    **gaps: float,
) -> dict[str, float]:
    """Positions of a figure's axes.

    They are set by hand, since a layout engine took a sixth of the time of a run.

    Args:
        size: size of the figure [in].
        right: margin on the right [in].
        top: margin on top [in].
        bottom: margin at the bottom, for ticks and labels [in].
        **gaps: gaps between axes over their size [-].
    """
    width, height = size
    return {
        "left": 0.8 / width,
        "right": 1.0 - right / width,
        "top": 1.0 - top / height,
        "bottom": bottom / height,
        **gaps,
    }


def measure_legend(legend: Legend) -> tuple[float, float]:
    """Width and height of a legend, to leave room for it [in]."""
    box = legend.get_window_extent().transformed(legend.figure.dpi_scale_trans.inverted())
    return box.width, box.height


def _scatter(
    axis: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, scale: ScalarMappable
) -> None:
    """Draw coloured dots for finite values, and small grey ones for NaN."""
    finite = np.isfinite(values)
    axis.scatter(x[~finite], y[~finite], s=4, color="0.85")
    axis.scatter(x[finite], y[finite], c=scale.to_rgba(values[finite]), s=18)


def _colour_scale(values: np.ndarray) -> ScalarMappable:
    """A colour scale symmetric about 0, robust against a few outliers."""
    sizes = np.abs(values[np.isfinite(values)])
    limit = float(np.percentile(sizes, 98)) if len(sizes) else 1.0
    return ScalarMappable(Normalize(-limit or -1.0, limit or 1.0), "RdBu_r")
