"""Output of a run: tables, a summary and a self-contained report."""

import base64
import io
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from estimation.estimators.result import State, Track
from estimation.frames.files import json_number, write_json, write_whole
from estimation.frames.stretches import find_stretches
from estimation.output.answer import describe_run
from estimation.output.explain import explain_settings
from estimation.output.found import KnownTruth, Run
from estimation.output.load_plots import plot_friction, plot_moment
from estimation.output.missing import count_missing
from estimation.output.player import describe_play
from estimation.output.plots import choose_frames, plot_angles, plot_markers
from estimation.output.scene import page_colours, points_down
from estimation.output.table import MARGIN_COLUMNS, write_table, write_tables
from estimation.slip.alert import AlertLevel
from estimation.slip.branch import Branch
from estimation.slip.motion import accumulate_slip, follow_gel
from estimation.slip.onset import MacroSlip

FIRM_MARKERS = 10
"""Sticking markers from which a frame counts among those with many."""


def write_run(run: Run, folder: Path, *, table: bool = True) -> dict[str, Any]:
    """Write `angles.csv`, `angles_all.csv`, `summary.json`, `report.html` and its figures.

    Without `table`, `angles.csv` is left to the run itself, which is still writing it.

    Returns:
        The content of `summary.json`.

    Raises:
        OSError: a file cannot be written; files written before are complete.
    """
    main = run.main
    if table:
        write_table(
            folder / "angles.csv", main, run.imprint, run.margin, run.shears, run.grips, run.unit
        )
    write_tables(folder / "angles_all.csv", run.results.values(), run.imprint, run.unit)
    summary = summarise(run)
    write_json(folder / "summary.json", summary)
    references = find_references(run)
    shown = choose_frames(main, run.markers, len(run.reference))
    down = points_down(run.convention)
    pictures = {
        "angles.png": plot_angles(run.results, run.method, references),
        "maps.png": plot_markers(run.reference, run.unit, main, shown, down=down),
    }
    if np.isfinite(main.moment).any() or run.margin.last is not None:
        pictures["moment.png"] = plot_moment({run.name: (main, run.margin.last)})
    if np.isfinite(run.grips.friction_used).any():
        pictures["friction.png"] = plot_friction(main, run.grips)
    images = {name: figure_png(figure) for name, figure in pictures.items()}
    write_page(folder, images, render_report(run, summary, images))
    return summary


def _list_figures(with_truth: bool) -> tuple[tuple[str, str, int], ...]:
    """Figures of a method in the report: label, name in the summary, and digits."""
    figures = (
        ("frames with an angle", "answered", 0),
        ("smallest angle [°]", "angle_min_deg", 2),
        ("largest angle [°]", "angle_max_deg", 2),
        ("median half-width [°]", "half_width_median_deg", 4),
        ("largest slip over the gel [°]", "slip_largest_deg", 2),
        ("slip over the gel in the last frame with an angle [°]", "slip_last_deg", 2),
    )
    many = f"{FIRM_MARKERS} or more markers stick"
    errors = (
        ("mean absolute error [°]", "mean_absolute_error_deg", 4),
        (f"mean absolute error [°], {many}", "mean_absolute_error_firm_deg", 4),
        (f"share of intervals that cover the truth, {many}", "interval_holds_truth_firm", 3),
    )
    return figures + errors if with_truth else figures


def render_report(run: Run, summary: Mapping[str, Any], images: Mapping[str, bytes]) -> str:
    """The report of a run, with the content of `summary.json`, as an HTML page."""
    references, down = find_references(run), points_down(run.convention)
    lie = "x is to the right, y up, seen from the object."
    if down:
        lie = "x is to the right and y down, as in the pictures."
    return render_page(
        "report.html",
        images,
        run=run,
        summary=summary,
        answer=describe_run(run),
        outlined=bool(np.isfinite(run.outline).any()),
        slid=bool(np.isfinite(run.shears.slip).any()),
        printed=bool(np.isfinite(run.shears.slip_probability).any()),
        down=down,
        lie=lie,
        colours=page_colours(),
        figures=_list_figures(with_truth=run.truth is not None),
        settings=explain_settings(run.settings, run.method),
        play=describe_play(run, references),
    )


def find_references(run: Run) -> dict[str, Float[np.ndarray, " frames"]]:
    """Angles to draw besides those of the methods, by label [rad]."""
    main, references = run.main, {}
    if np.isfinite(run.outline).any():
        references[run.turns] = _outline_from(run.outline, main)
        references["gel"] = follow_gel(main)
    if run.truth is not None:
        references["truth"] = run.truth.angle
    return references


def describe_branch(branch: Branch | None) -> dict[str, Any] | None:
    """The figures of a branch of the moment–angle curve; None if the data cannot determine it."""
    if branch is None:
        return None
    unit, scale = ("deg", np.degrees(1.0)) if branch.by_markers else ("Nmm", 1.0)
    error = branch.limit * np.sqrt(branch.covariance[0, 0])
    return {
        "moments": "by markers" if branch.by_markers else "measured",
        "pressure": branch.pressure,
        f"limit_{unit}": json_number(scale * branch.limit),
        f"limit_standard_error_{unit}": json_number(scale * error),
        f"stiffness_{unit}_per_deg": json_number(scale * np.radians(branch.stiffness)),
        "start_deg": json_number(np.degrees(branch.start)),
        f"start_moment_{unit}": json_number(scale * branch.sign * branch.start_moment),
        f"rms_{unit}": json_number(scale * branch.rms),
        "points": branch.points,
    }


def summarise(run: Run) -> dict[str, Any]:
    """The summary of a run for JSON; None for a missing number."""
    main = run.main
    return {
        "version": version("contactmodel"),
        "recording": run.name,
        "source": run.source,
        "convention": run.convention,
        "sha256": run.sha256,
        "settings": dict(run.settings),
        "method": run.method,
        "frames": len(main.time),
        "first_time_s": json_number(main.time[0]),
        "duration_s": json_number(np.ptp(main.time)),
        "dropped_frames": int(np.clip(np.diff(main.source_index) - 1, 0, None).sum()),
        "branch": describe_branch(run.margin.last),
        "margin_last": _describe_margin(run),
        "outcome": _describe_outcome(run),
        "friction": _describe_friction(run),
        "first_alerts_s": {
            str(level): json_number(main.time[run.grips.level.index(level)] - main.time[0])
            for level in (AlertLevel.WATCH, AlertLevel.ACT, AlertLevel.SLIPS)
            if level in run.grips.level
        },
        "macro_slips": [_describe_slip(slip, main.time[0]) for slip in run.slips],
        "methods": {name: _figures(track, run.truth) for name, track in run.results.items()},
        "notes": list(run.notes),
    }


def _describe_margin(run: Run) -> dict[str, float | None] | None:
    """The margin in the last frame that has one, and its time; None without one."""
    rows, time = np.flatnonzero(np.isfinite(run.margin.angle)), run.main.time
    if not len(rows):
        return None
    numbers = [values[rows[-1]] for values in run.margin[:-1]]
    values = (*np.degrees(numbers[:3]), *numbers[3:])
    cells = {
        name: json_number(value) for name, value in zip(MARGIN_COLUMNS[1:], values, strict=True)
    }
    return {"time_s": json_number(time[rows[-1]] - time[0])} | cells


def _describe_outcome(run: Run) -> dict[str, str | float | None]:
    """The outcome of the grasp; times count from the first frame."""
    outcome = run.outcome
    return {
        "word": outcome.word,
        "probability_slipped": json_number(outcome.probability),
        "onset_s": json_number(outcome.onset - run.main.time[0]),
    }


def _describe_friction(run: Run) -> dict[str, float | None] | None:
    """The last known coefficient, and the largest friction in use; None without forces."""
    grips = run.grips
    used = grips.friction_used[np.isfinite(grips.friction_used)]
    if not len(used):
        return None
    rows = np.flatnonzero(np.isfinite(grips.friction))
    last = rows[-1] if len(rows) else 0
    return {
        "coefficient": json_number(grips.friction[last]),
        "low": json_number(grips.friction_low[last] if len(rows) else used.max()),
        "high": json_number(grips.friction_high[last]),
        "most_used": json_number(used.max()),
    }


def _describe_slip(slip: MacroSlip, start: float) -> dict[str, float | bool | None]:
    """Begin and end of a macro slip; times count from the first frame."""
    return {
        "onset_s": json_number(slip.onset - start),
        "onset_low_s": json_number(slip.low - start),
        "onset_high_s": json_number(slip.high - start),
        "regained_s": json_number(slip.regained - start),
        "certain": slip.certain,
    }


def _figures(result: Track, truth: KnownTruth | None) -> dict[str, Any]:
    """Figures of one method."""
    answered = result.answered
    angle = np.degrees(result.angle[answered])
    half_width = np.degrees(result.high - result.low)[answered] / 2.0
    slip = np.degrees(accumulate_slip(result))
    slip = slip[np.isfinite(slip)]
    figures = {
        "answered": int(answered.sum()),
        "slip_largest_deg": json_number(max(slip, key=abs, default=np.nan)),
        "slip_last_deg": json_number(slip[-1] if len(slip) else np.nan),
        "without_angle": count_missing(result),
        "withdrawn": 0 if result.withdrawn is None else int(result.withdrawn.rows.sum()),
        "states": {str(state): result.state.count(state) for state in State},
        "macro_slip_s": _spans(result.time - result.time[0], result.slipping),
        "angle_min_deg": json_number(angle.min(initial=np.inf)),
        "angle_max_deg": json_number(angle.max(initial=-np.inf)),
        "half_width_median_deg": json_number(np.median(half_width) if len(half_width) else np.nan),
    }
    return figures if truth is None else figures | _errors(result, truth)


def _spans(time: Float[np.ndarray, " frames"], where: np.ndarray) -> list[list[float]]:
    """Times of the frame before each stretch of True, of its first and last, and of the next [s].

    The onset lies between the first two times, the end between the last two.
    """
    last = len(time) - 1
    return [
        [round(float(time[i]), 6) for i in (max(a - 1, 0), a, b - 1, min(b, last))]
        for a, b in find_stretches(where)
    ]


def _errors(result: Track, truth: KnownTruth) -> dict[str, Any]:
    """Errors of all answers, and of those of frames in which ten markers or more always stuck."""
    error = np.abs(np.degrees(result.angle - truth.angle))
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    firm = truth.stick_markers >= FIRM_MARKERS
    figures: dict[str, Any] = {"firm_frames": int(firm.sum())}
    for name, where in (("", result.answered), ("_firm", result.answered & firm)):
        figures |= {
            f"answered{name}": int(where.sum()),
            f"mean_absolute_error{name}_deg": json_number(
                error[where].mean() if where.any() else np.nan
            ),
            f"interval_holds_truth{name}": json_number(
                inside[where].mean() if where.any() else np.nan
            ),
        }
    return figures


def _outline_from(
    outline: Float[np.ndarray, " frames"], result: Track
) -> Float[np.ndarray, " frames"]:
    """The outline's direction, shifted to the angle in the first frame that has both."""
    shared = np.nonzero(result.answered & np.isfinite(outline))[0]
    return outline - outline[shared[0]] + result.angle[shared[0]] if len(shared) else outline


def figure_png(figure: Figure) -> bytes:
    """The PNG of a figure, which is closed."""
    buffer = io.BytesIO()
    figure.set_dpi(130)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # lays out and draws once, where `savefig` does so twice
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # all of it is opaque
    picture.save(buffer, "png", compress_level=3, dpi=(figure.dpi, figure.dpi))
    plt.close(figure)
    return buffer.getvalue()


def render_page(
    template: str, images: Mapping[str, bytes], *, package: str = "", **content: Any
) -> str:
    """A page from a template of a package or of reports, with its figures by name embedded."""
    inline = {
        name: "data:image/png;base64," + base64.b64encode(image).decode()
        for name, image in images.items()
    }
    return _find_templates(package).get_template(template).render(images=inline, **content)


def write_page(folder: Path, images: Mapping[str, bytes], page: str) -> None:
    """Write a page as `report.html`, and its figures beside it.

    Raises:
        OSError: a file cannot be written.
    """
    for name, image in images.items():
        write_whole(folder / name, image)
    write_whole(folder / "report.html", page)


@cache
def _find_templates(package: str) -> jinja2.Environment:
    """The templates of a package and of reports, each read once."""
    packages = (package, "estimation.output") if package else ("estimation.output",)
    return jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name) for name in packages]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
