"""Output of a run over several recordings: the overview, and two fingers as one grasp."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimation.estimators.grasp import Disagreement, Fit, Grasp, compare_fingers
from estimation.estimators.measurement import Z95
from estimation.estimators.result import show_degrees, show_numbers, show_plain
from estimation.frames.files import json_number, write_json, write_whole
from estimation.frames.names import counted
from estimation.output.answer import describe_run, describe_turns
from estimation.output.comparison_plots import plot_grasp, plot_overview
from estimation.output.found import Run
from estimation.output.load_plots import plot_moment
from estimation.output.report import (
    describe_branch,
    figure_png,
    render_page,
    write_page,
)
from estimation.output.table import csv_text
from estimation.slip.motion import find_restarts
from estimation.slip.outcome import Outcome, join_outcomes


def put_side_by_side(
    done: Sequence[tuple[Run, Mapping[str, Any]]], folder: Path
) -> tuple[list[str], list[str]]:
    """Write the angles of several recordings side by side, and two fingers as one grasp.

    If the fingers cannot be compared, the report and the first line give the reason.

    Returns:
        Lines to print first, if the fingers disagree or are not compared, and lines to print last.
    """
    runs = [run for run, _ in done]
    if not all(run.settings["grasp"] for run in runs) or len(runs) != 2:
        write_overview(done, folder)
        return [], []
    outcome = describe_joint_outcome(runs)
    try:
        grasp = compare_fingers(runs[0].main, runs[1].main)
    except ValueError as error:
        reason = f"no comparison: {error}"
        write_overview(done, folder, notes=[reason, outcome])
        return [reason], [outcome]
    first: list[str] = []
    if grasp.raw is not None and grasp.raw.clear:
        first = [grasp.raw.describe(), *describe_evidence(runs)]
    left_out, fits = describe_fits(grasp, [run.name for run in runs])
    write_overview(done, folder, grasp, notes=[outcome, *first, *left_out])
    return [*first[:1], *(f"  {line}" for line in first[1:])], [outcome, *left_out, *fits]


def write_overview(
    done: Sequence[tuple[Run, Mapping[str, Any]]],
    folder: Path,
    grasp: Grasp | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write `overview.png` and `report.html`: the angles of several recordings side by side.

    For a grasp, also `comparison.csv`, `grasp.json`, `grasp.png` and, with moments, `moment.png`.

    Each run comes with its summary; the recordings are named after the folders in `folder` that
    hold their reports. The notes are sentences for the head of the report.

    Raises:
        OSError: a file cannot be written.
    """
    named = {run.name: run for run, _ in done}
    figure = plot_overview(
        {name: run.main for name, run in named.items()},
        {name: (run.turns, run.outline) for name, run in named.items()},
    )
    images = {"overview.png": figure_png(figure)}
    figures = None
    if grasp is not None:
        figures = _describe_grasp(grasp, named)
        write_json(folder / "grasp.json", figures)
        start = float(done[0][0].main.time[0])
        write_whole(folder / "comparison.csv", _comparison(grasp, start))
        images["grasp.png"] = figure_png(plot_grasp(grasp, list(named)))
        branches = {name: (run.main, run.margin.last) for name, run in named.items()}
        if any(branch or np.isfinite(track.moment).any() for track, branch in branches.values()):
            images["moment.png"] = figure_png(plot_moment(branches))
    page = render_page(
        "overview.html",
        images,
        runs=[summary for _, summary in done],
        answer=_count_outcomes([run for run, _ in done])
        if grasp is None
        else describe_grasp(grasp),
        answers=[describe_run(run) for run, _ in done],
        grasp=figures,
        angles=[] if grasp is None else _sample(grasp),
        clocks="" if grasp is None else describe_clocks(grasp),
        notes=notes,
    )
    write_page(folder, images, page)


def describe_grasp(grasp: Grasp) -> str:
    """A sentence on the object's rotation by both fingers, and on their difference."""
    if grasp.disagrees and grasp.raw is not None:
        return (
            f"The fingers disagree by up to {abs(np.degrees(grasp.raw.largest)):.1f}°, "
            f"{grasp.raw.time:.2f} s after the first frame: see the answer of each finger"
        )
    turns = describe_turns(grasp.joint, grasp.low, grasp.high)
    differ = f"they differ by {np.degrees(grasp.fixed.rms):.2f}° rms where markers stick on both"
    aligned = "" if grasp.own_clocks else ", their clocks aligned"
    return f"{turns[0].upper()}{turns[1:]} by both fingers; {differ}{aligned}"


def describe_joint_outcome(runs: Sequence[Run]) -> str:
    """Whether the object slipped at either of two fingers, and where they differ, in a sentence."""
    joint = join_outcomes(*(run.outcome for run in runs))
    text = f"Joint outcome: {_show_outcome(joint)}"
    others = [run for run in runs if run.outcome.word != joint.word]
    if not others:
        return f"{text}, at both fingers"
    (other,) = others
    decisive = runs[0] if other is runs[1] else runs[1]
    text += f", at {decisive.name}; at {other.name}: {_show_outcome(other.outcome)}"
    if (joint.word, other.outcome.word) == ("slipped", "held"):
        text += f". Either the object slipped at one finger only, or {other.name} missed the slip"
    return text


def _show_outcome(outcome: Outcome) -> str:
    """An outcome in words, with its probability where one is known."""
    if outcome.word == "unknown" or np.isnan(outcome.probability):
        return outcome.phrase
    return f"{outcome.phrase} (probability of a slip {outcome.probability:.2f})"


def describe_evidence(runs: Sequence[Run]) -> list[str]:
    """Prints and restarts of fingers that disagree, in a sentence each, and advice."""
    lines = []
    for run in runs:
        touching = run.main.contact_markers > 0
        printed = int((touching & np.isfinite(run.imprint)).sum())
        restarts = find_restarts(run.main)
        times = ", ".join(f"{time:.2f}" for time in restarts[:3]) + (", …" if restarts[3:] else "")
        counts = "its angle was not restarted"
        if restarts:
            counts = (
                f"its angle was lost and restarted {times} s after its first frame, which leaves "
                "out earlier rotation"
            )
        prints = "no print is visible"
        if printed:
            prints = f"the print is visible in {printed} of {touching.sum()} frames of contact"
        lines.append(f"{run.name}: {prints}; {counts}")
    advice = "prefer the finger whose print is always visible and whose angle was not restarted"
    return [*lines, f"{advice} (documentation: Fingers that disagree)"]


def describe_fits(grasp: Grasp, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Frames left out of the fits; then joint answer, remaining differences and clocks in use."""
    left_out = [
        f"{name}: its angle was restarted; {counted(count, 'frame', 'frames')} with another start "
        "than most are left out of the joint angle"
        for name, count in zip(names, grasp.left_out, strict=True)
        if count
    ]
    most_doubt = 0.1  # standard error from which the slope is undetermined [-]
    offset, rms = f"{np.degrees(grasp.fixed.angle_offset):.2f}°", np.degrees(grasp.fixed.rms)
    lines = [
        describe_grasp(grasp),
        f"with an angle offset of {offset} fitted, the fingers differ by {rms:.3f}° rms before "
        "macro slip",
    ]
    free = grasp.free
    if free.errors[0] < most_doubt:
        lines.append(
            f"with a slope fitted too, {free.slope:.3f} ± {free.errors[0]:.3f} (standard error) of "
            f"the second finger's angle over the first's, by {np.degrees(free.rms):.3f}°"
        )
    else:
        lines.append("the object turned too little while both held it to compare their slopes")
    return left_out, [*lines, describe_clocks(grasp)]


def describe_clocks(grasp: Grasp) -> str:
    """The clocks that a comparison uses, in a sentence."""
    fit = grasp.fixed
    if not grasp.own_clocks:
        doubt = "; it removes less than half of their difference: check the clocks"
        return (
            f"The clock offset of {fit.clock_offset:.3f} ± {fit.errors[1]:.3f} s (standard error) "
            f"is fitted to the fingers' motions over 0.4 s{'' if grasp.explains_half else doubt}"
        )
    most = Z95 * fit.errors[1]
    return (
        "The recordings' own clocks are used: the angles show no offset between them, but do not "
        f"exclude one of up to {most:.2g} s"
    )


def _count_outcomes(runs: Sequence[Run]) -> str:
    """The number of recordings by outcome."""
    words = Counter(run.outcome.phrase for run in runs)
    counts = ", ".join(f"{n} {word}" for word, n in words.most_common())
    return f"Of {len(runs)} recordings {counts}"


def _describe_grasp(grasp: Grasp, runs: Mapping[str, Run]) -> dict[str, Any]:
    """The figures of a grasp for JSON; None for a missing number."""
    first, second = runs
    return {
        "first": first,
        "second": second,
        "outcome": _describe_joint_outcome(grasp, list(runs.values())),
        "before_offsets": None if grasp.raw is None else _describe_raw(grasp.raw),
        "own_clocks": grasp.own_clocks,
        "slope_fixed": _describe_fit(grasp.fixed),
        "slope_free": _describe_fit(grasp.free),
        "branches": {name: describe_branch(run.margin.last) for name, run in runs.items()},
    }


def _describe_joint_outcome(grasp: Grasp, runs: Sequence[Run]) -> dict[str, Any]:
    """The joint outcome for JSON; its time counts from the first finger's first frame."""
    late = 0.0, grasp.fixed.clock_offset
    joint = join_outcomes(
        *(
            run.outcome._replace(onset=run.outcome.onset - run.main.time[0] + offset)
            for run, offset in zip(runs, late, strict=True)
        )
    )
    return {
        "word": joint.word,
        "probability_slipped": json_number(joint.probability),
        "onset_s": json_number(joint.onset),
        "at": [run.name for run in runs if run.outcome.word == joint.word],
    }


def _describe_raw(raw: Disagreement) -> dict[str, Any]:
    """The fingers' difference before offsets are fitted, in the units of the command line."""
    return {
        "disagree": raw.clear,
        "rms_difference_deg": json_number(np.degrees(raw.rms)),
        "largest_difference_deg": json_number(np.degrees(raw.largest)),
        "half_width_deg": json_number(np.degrees(raw.interval)),
        "time_s": json_number(raw.time),
        "share_of_frames_beyond_interval": json_number(raw.share),
    }


def _describe_fit(fit: Fit) -> dict[str, Any]:
    """A fit of two fingers, in the units of the command line."""
    slope_error, clock_error, angle_error = fit.errors
    return {
        "rms_difference_deg": json_number(np.degrees(fit.rms)),
        "slope": json_number(fit.slope),
        "slope_standard_error": json_number(slope_error),
        "clock_offset_s": json_number(fit.clock_offset),
        "clock_offset_standard_error_s": json_number(clock_error),
        "angle_offset_deg": json_number(np.degrees(fit.angle_offset)),
        "angle_offset_standard_error_deg": json_number(np.degrees(angle_error)),
        "correlation_of_slope_and_clock_offset": json_number(fit.correlation),
        "frames_compared": fit.frames,
    }


def _comparison(grasp: Grasp, start: float) -> str:
    """Both fingers' angles and the joint angle as CSV, one row for each frame of the first.

    Args:
        grasp: the comparison.
        start: time stamp of the first finger's first frame [s].
    """
    angles = {
        "first_deg": grasp.first,
        "second_deg": grasp.second,
        "joint_deg": grasp.joint,
        "joint_low_deg": grasp.low,
        "joint_high_deg": grasp.high,
    }
    table = {"time_s": show_numbers(start + grasp.time)}
    table |= {name: show_degrees(angle) for name, angle in angles.items()}
    return csv_text(table | {"holds": show_plain(grasp.holds.astype(int))})


def _sample(grasp: Grasp) -> list[dict[str, float | bool | None]]:
    """The joint angle and the fingers' difference at evenly spaced frames [°, s]."""
    count = 11  # frames
    rows = np.flatnonzero(np.isfinite(grasp.joint))
    spaced = np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(int)
    difference = grasp.second - grasp.first
    angles = {"first": grasp.first, "second": grasp.second, "difference": difference}
    angles |= {"joint": grasp.joint, "low": grasp.low, "high": grasp.high}
    return [
        {"time_s": json_number(grasp.time[i]), "holds": bool(grasp.holds[i])}
        | {name: json_number(np.degrees(angle[i])) for name, angle in angles.items()}
        for i in rows[spaced]
    ]
