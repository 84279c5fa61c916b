"""The leaderboard: every method, every case, one table.

Errors are those of answered frames; the share of frames answered stands beside them. `latency` is
the mean time of one frame on this machine, fields included.
"""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel.common.inputs import cell_number, cell_whole, read_rows
from estimation.estimators import METHODS, RIVALS
from estimation.frames.archive import write_archive
from estimation.frames.files import write_whole
from estimation.frames.noise import Noise, find_noise
from estimation.softness import RIGID_OBJECT
from estimation.tracking.tracker import Tracker
from papers.items import Track
from papers.leaderboard import settings
from papers.leaderboard.cases import Case

ANSWER_FORMAT = """\
# Recordings to answer

Each `.npz` file is a recording: `estimation.read_recording` reads it, and the docstring of
`estimation.write_archive` lists its arrays. Answer with one CSV file, named after your method, and
pass it to `python -m papers leaderboard --angles METHOD.csv`. Its columns are

- `case`: name of the recording, without `.npz`, with the folder it is in, if any.
- `frame`: index of the frame in the recording, from 0: the row of `positions` and `time`. It is not
  `source_index`, the sensor's own count, which jumps where frames were dropped.
- `angle_deg`: the object's angle [°], counter-clockwise seen from the object looking at the pad,
  counted from the unloaded reference shape.

A frame that is not listed, or whose angle is not finite, counts as not answered. A recording that
is not listed gets no row.
"""
"""What another group answers, and how; written beside the recordings as `README.md`."""


class Answers(NamedTuple):
    """What one method says of one case.

    Attributes:
        method: its name.
        case: the case.
        angle: the object's angle [rad]; NaN where there is no answer.
        latency: mean time of a frame [s]; NaN where unknown.
    """

    method: str
    case: Case
    angle: Float[np.ndarray, " frames"]
    latency: float = float("nan")


def answer_all(cases: Sequence[Case], track: Track = iter) -> list[Answers]:
    """The answers of all our methods and the published rivals.

    Args:
        cases: to be answered.
        track: wraps the outer loop, to show progress.
    """
    answers = []
    for case in track(cases):
        noise, _ = find_noise(case.recording)
        answers += [_answer(method, case, noise) for method in METHODS | RIVALS]
    return answers


def read_answers(path: Path, cases: Sequence[Case]) -> list[Answers]:
    """Answers of another group's method, named after the file.

    A CSV with the columns `case`, `frame` and `angle_deg`; `ANSWER_FORMAT` says what they mean.

    Raises:
        ValueError: a column is missing, no such case or frame, or no number.
        OSError: the file cannot be read.
    """
    by_name = {case.name: case for case in cases}
    angles: dict[str, np.ndarray] = {}
    for where, row in read_rows(path, ("case", "frame", "angle_deg")):
        if row["case"] not in by_name:
            raise ValueError(f"{where}: no case {row['case']!r}; there are {', '.join(by_name)}")
        case = by_name[row["case"]]
        angle = angles.setdefault(case.name, np.full(len(case.recording), np.nan))
        frame = cell_whole(row["frame"], f"{where}: frame")
        if not 0 <= frame < len(angle):
            raise ValueError(f"{where}: {case.name} has frames 0 to {len(angle) - 1}")
        value = cell_number(row["angle_deg"], f"{where}: angle_deg")
        angle[frame] = np.radians(value) if np.isfinite(value) else np.nan
    return [Answers(path.stem, by_name[name], angle) for name, angle in angles.items()]


def export_cases(cases: Sequence[Case], folder: Path) -> None:
    """Write the recordings, and a README.md that says how to answer them.

    Raises:
        OSError: a file cannot be written.
    """
    for case in cases:
        write_archive(case.recording, folder / f"{case.name}.npz")
    write_whole(folder / "README.md", ANSWER_FORMAT)


def tabulate(answers: Sequence[Answers]) -> list[dict[str, object]]:
    """One row per case and method, the draws of a case pooled, best first."""
    groups: dict[tuple[str, str], list[Answers]] = {}
    for answer in answers:
        for part in answer.case.parts:
            groups.setdefault((part, answer.method), []).append(answer)
    rows = [_score(part, method, group) for (part, method), group in groups.items()]
    order = list(dict.fromkeys(part for part, _ in groups))
    return sorted(rows, key=lambda row: (order.index(str(row["case"])), _rank(row)))


def plot(answers: Sequence[Answers], rows: Sequence[Mapping[str, object]]) -> Figure:
    """Mean absolute error of every method in every case, with the share answered if below 95 %.

    The last row is the Cramér–Rao bound of one frame: methods that remember may come below it.
    """
    methods = list(dict.fromkeys(answer.method for answer in answers))
    parts = list(dict.fromkeys(str(row["case"]) for row in rows))
    error = np.full((len(methods), len(parts)), np.nan)
    answered = np.zeros_like(error)
    for row in rows:
        place = methods.index(str(row["method"])), parts.index(str(row["case"]))
        error[place] = np.nan if row[MAE] is None else row[MAE]
        answered[place] = row["answered [%]"]
    methods.append("Cramér–Rao bound")
    error = np.vstack([error, [_limit(answers, part) for part in parts]])
    answered = np.vstack([answered, np.full(len(parts), 100.0)])
    figure, axis = plt.subplots(
        figsize=(2.5 + 0.9 * len(parts), 1.8 + 0.4 * len(methods)), layout="constrained"
    )
    image = axis.imshow(np.log10(error), cmap="RdYlGn_r", vmin=-2.5, vmax=1.5, aspect="auto")
    for i, j in np.ndindex(error.shape):
        text = "–" if np.isnan(error[i, j]) else f"{error[i, j]:.3g}"
        text += f"\n{answered[i, j]:.0f} %" if 0.0 < answered[i, j] < 95.0 else ""
        dark = error[i, j] < 0.01 or error[i, j] > 10.0
        axis.text(j, i, text, ha="center", va="center", fontsize=7, color="w" if dark else "k")
    axis.set_xticks(range(len(parts)), parts, rotation=40, ha="right", fontsize=8)
    axis.set_yticks(range(len(methods)), methods, fontsize=8)
    axis.set_title(
        "mean absolute error of answered frames [°], and their share if below 95 %", fontsize=10
    )
    figure.colorbar(image, ax=axis, label="log₁₀ of it")
    return figure


def plot_curves(answers: Sequence[Answers]) -> Figure:
    """Angles over time in the reversing case, draw 0, and in every real one.

    Cut off 15° beyond the reference: what runs away further says nothing.
    """
    shown = {
        answer.case.name: answer.case
        for answer in answers
        if answer.case.relative or answer.case.name == "reversing-0"
    }
    figure, axes = plt.subplots(
        max(len(shown), 1),
        1,
        figsize=(9, 3.2 * max(len(shown), 1)),
        layout="constrained",
        squeeze=False,
    )
    for axis, (name, case) in zip(axes[:, 0], shown.items(), strict=False):
        for answer in answers:
            if answer.case.name == name:
                style = "-" if answer.method in METHODS else ":"
                angle = np.degrees(answer.angle)
                axis.plot(case.recording.time, angle, style, lw=1.1, label=answer.method)
        label = "contact outline, up to a constant" if case.relative else "truth"
        reference = np.degrees(case.reference)
        if case.relative:
            reference = reference - np.nanmedian(reference) + _middle(answers, case)
        axis.plot(case.recording.time, reference, "k--", lw=1.4, label=label)
        axis.set_ylim(np.nanmin(reference) - 15.0, np.nanmax(reference) + 15.0)
        axis.set_title(name, fontsize=10)
        axis.set_ylabel("angle [°]")
        axis.set_xlabel("time [s]")
        axis.legend(fontsize=7, ncols=3)
    return figure


MAE = "mean absolute error [°]"


def _answer(method: str, case: Case, noise: Noise | None) -> Answers:
    softness = RIGID_OBJECT if method in settings.AXIS_METHODS else case.softness
    tracker = Tracker(case.recording.layout, method, noise=noise, softness=softness)
    start = time.perf_counter()
    angle = np.array([tracker.update(frame).angle for frame in case.recording])
    return Answers(method, case, angle, (time.perf_counter() - start) / len(angle))


def _score(part: str, method: str, group: Sequence[Answers]) -> dict[str, object]:
    errors, frames = [], 0
    for answer in group:
        scored = answer.case.parts[part]
        frames += int(scored.sum())
        error = np.degrees(answer.angle - answer.case.reference)[scored]
        error = error[np.isfinite(error)]
        errors.append(error - np.median(error) if answer.case.relative and len(error) else error)
    error = np.concatenate(errors)
    latencies = [answer.latency for answer in group]
    return {
        "case": part,
        "method": method,
        "bias [°]": _round(error.mean() if len(error) else np.nan),
        "spread [°]": _round(error.std() if len(error) else np.nan),
        MAE: _round(np.abs(error).mean() if len(error) else np.nan),
        "answered [%]": round(100 * len(error) / frames, 1),
        "frames": frames,
        "latency [ms]": _round(1e3 * float(np.mean(latencies))),
    }


def _limit(answers: Sequence[Answers], part: str) -> float:
    """Mean absolute error at the bound over a row's frames [deg]; NaN where it is not known."""
    cases = {answer.case.name: answer.case for answer in answers if part in answer.case.parts}
    limits = [case.limit[case.parts[part]] for case in cases.values() if case.limit is not None]
    known = np.concatenate([limit[np.isfinite(limit)] for limit in limits] or [np.zeros(0)])
    return float(np.degrees(known.mean())) if len(known) else float("nan")


def _rank(row: Mapping[str, object]) -> tuple[bool, float]:
    error = row[MAE]
    return (error is None, float(error) if isinstance(error, float) else 0.0)


def _round(value: float) -> float | None:
    """To three digits; None where there is no number."""
    return float(f"{value:.3g}") if np.isfinite(value) else None


def _middle(answers: Sequence[Answers], case: Case) -> float:
    """Middle of the first method's answers where the reference is known [deg]."""
    first = next(answer for answer in answers if answer.case.name == case.name)
    known = first.angle[np.isfinite(case.reference)]
    return float(np.degrees(np.nanmedian(known))) if np.isfinite(known).any() else 0.0
