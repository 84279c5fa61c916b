"""Entries: the answers of a method to the cases, read from a CSV file and checked.

The checks need no recording, so a wrong file is rejected within a second.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.common.inputs import cell_number, cell_whole, read_rows, show
from papers.leaderboard.cases import SPLITS, Case, list_cases

COLUMNS = ("case", "frame", "angle_deg")
FEW, SMALL = 20, 1.0
"""Varying angles are taken for radians if there are at least `FEW`, all below `SMALL` degrees."""


class Entry(NamedTuple):
    """The answers of a method."""

    name: str  # name of the method
    # angle of the object by case [rad]; NaN without an answer
    angle: dict[str, Float[np.ndarray, " frames"]]
    slipped: dict[str, float]  # probability that the object slipped out, by lift [-]
    latency: dict[str, float]  # mean time per frame by case, where measured [s]
    pictures: bool = False  # whether the method works on pictures only


def read_entry(path: Path, cases: Mapping[str, Case]) -> Entry:
    """Read an entry from a CSV file, and name it after the file; the README explains the columns.

    Raises:
        ValueError: a column is missing, a row has more cells than columns or a `slipped` beside an
            angle, a case or frame does not exist, a cell is not a number, an angle is not from -180
            to 180°, a frame has two answers, the angles look like radians, or there is no answer.
        OSError: the file cannot be read.
    """
    given = path.is_dir() or path.stat().st_size
    rows = read_rows(path, COLUMNS) if given else []
    if not rows:
        raise ValueError(
            f"{path} has no answers: give a line with the columns {','.join(COLUMNS)}, then a line "
            "for each answered frame"
        )
    angle: dict[str, np.ndarray] = {}
    slipped: dict[str, float] = {}
    lines: dict[tuple[str, int], str] = {}
    for where, row in rows:
        case = _find_case(row["case"], cases, where)
        frame = _read_frame(row["frame"], case, where)
        if (case.name, frame) in lines:
            raise ValueError(
                f"{where} answers frame {frame} of {case.name} a second time, after "
                f"{lines[case.name, frame]}: remove one of the two"
            )
        lines[case.name, frame] = where.rpartition(", ")[2]
        if case.lift:
            chance = _read_chance(row, where)
            slipped[case.name] = max(chance, slipped.get(case.name, 0.0))
        else:
            value = _read_angle(row, where)
            of_case = angle.setdefault(case.name, np.full(case.frames, np.nan))
            of_case[frame] = np.radians(value) if np.isfinite(value) else np.nan
    _refuse_radians(path, angle)
    return Entry(path.stem, angle, slipped, {})


def write_entry(entry: Entry) -> str:
    """The CSV text of an entry."""
    lines = [",".join((*COLUMNS, "slipped"))]
    for name, angle in entry.angle.items():
        lines += [
            f"{name},{frame},{np.degrees(angle[frame]):.2f},"
            for frame in np.flatnonzero(np.isfinite(angle))
        ]
    lines += [f"{name},0,,{chance:.3f}" for name, chance in entry.slipped.items()]
    return "\n".join(lines) + "\n"


def _find_case(name: str, cases: Mapping[str, Case], where: str) -> Case:
    if name in cases:
        return cases[name]
    split = next(iter(cases.values())).split
    for other in SPLITS:
        if name in list_cases(other):
            raise ValueError(
                f"{where}: {name} is a {other} case, and {split} cases are ranked: leave it out, "
                f"or rank with --split {other}"
            )
    near = get_close_matches(name, cases, n=1)
    hint = f"did you mean {near[0]}?" if near else f"a valid case is {next(iter(cases))};"
    raise ValueError(
        f"{where}: there is no case {show(name)}; {hint} cases.csv of `--export DIR` lists all"
    )


def _read_frame(cell: str, case: Case, where: str) -> int:
    frame = cell_whole(cell, f"{where}: frame")
    if not 0 <= frame < case.frames:
        raise ValueError(
            f"{where}: {case.name} has frames 0 to {case.frames - 1}, got {frame}: give the row "
            "of `positions` in the recording, not its `source_index`"
        )
    return frame


def _read_angle(row: Mapping[str, str], where: str) -> float:
    if row.get("slipped", "").lower() not in ("", "nan"):
        raise ValueError(
            f"{where}: {row['case']} asks for an angle, but `slipped` is {show(row['slipped'])}: "
            "leave it empty, and write the angle with a decimal point, not a comma"
        )
    value = cell_number(row["angle_deg"], f"{where}: angle_deg")
    if abs(value) > 180.0:  # 350° is wrong where −10° is right
        raise ValueError(f"{where}: angle_deg is {value:g}: give an angle from -180 to 180")
    return value


def _read_chance(row: Mapping[str, str], where: str) -> float:
    if not row.get("slipped"):
        raise ValueError(
            f"{where}: {row['case']} is a lift and has no `slipped`: give the probability, from 0 "
            "to 1, that the object has slipped"
        )
    chance = cell_number(row["slipped"], f"{where}: slipped")
    if not 0.0 <= chance <= 1.0:
        raise ValueError(f"{where}: slipped is {chance:g}: give a probability from 0 to 1")
    return chance


def _refuse_radians(path: Path, angle: dict[str, Float[np.ndarray, " frames"]]) -> None:
    values = np.degrees(np.concatenate([*angle.values(), np.zeros(0)]))
    values = values[np.isfinite(values)]
    if len(values) >= FEW and np.ptp(values) > 0.0 and np.abs(values).max() < SMALL:
        raise ValueError(
            f"{path}: all {len(values)} angles are within ±{np.abs(values).max():.2g}°, but the "
            "objects turn by several degrees: `angle_deg` must be in degrees, not radians"
        )
