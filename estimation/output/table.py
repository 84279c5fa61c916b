"""Tables of results: one column for each quantity of a `Record`, one row for each frame."""

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import (
    Label,
    Record,
    Text,
    Track,
    Whole,
    Withdrawn,
    show_degrees,
    show_numbers,
)
from estimation.frames.files import growing, write_whole
from estimation.slip.alert import GripPath
from estimation.slip.margin import MarginPath
from estimation.slip.motion import accumulate_slip, follow_gel
from estimation.slip.shear import ShearPath
from estimation.tracking.stream import Answer

MARGIN_COLUMNS = (
    "stick_ratio",
    "angle_margin_deg",
    "angle_margin_low_deg",
    "angle_margin_high_deg",
    "moment_margin_Nmm",
    "moment_margin_low_Nmm",
    "moment_margin_high_Nmm",
)
"""Columns of the margin before macro slip; empty where it is undetermined."""

Table = Mapping[str, list[str]]
"""The cells of a table, by column."""


class TableWriter:
    """The sink that writes `angles.csv` row by row, as frames are answered.

    The table has the columns of the finished one; those that need the whole recording are empty.

    Examples:
        >>> from contextlib import closing
        >>> from pathlib import Path
        >>> from estimation import Settings, Stream, TableWriter, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> with closing(TableWriter(Path("angles.csv"), "tracked", recording.unit)) as table:
        ...     for answer in Stream(recording, Settings()).answers(table):
        ...         pass  # its row is on the disc
        >>> print(len(Path("angles.csv").read_text().splitlines()), "lines, the header included")
        44 lines, the header included
    """

    def __init__(self, path: str | Path, method: str, unit: str, rows: int = 0) -> None:
        """Make a table, or continue an existing one.

        Args:
            path: path of the table.
            method: method whose answers are written.
            unit: unit of lengths, mm or px.
            rows: number of rows to keep of an existing table.

        Raises:
            OSError: the table cannot be written.
        """
        self._path, self._method, self._unit = Path(path), method, unit
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("r+" if rows else "w", encoding="utf-8", newline="")
        self._headed = bool(rows)
        for _ in range(rows + 1 if rows else 0):
            self._file.readline()
        self._file.seek(self._file.tell())
        self._file.truncate()

    def put(self, answer: Answer) -> None:
        """Write the next row; it is on the disc when this returns."""
        table = tabulate_answer(answer, self._method, self._unit)
        with growing(self._path):
            self._file.write(csv_text(table, heading=not self._headed))
            self._file.flush()
        self._headed = True

    def restart(self) -> None:
        """Clear the table."""
        self._file.seek(0)
        self._file.truncate()
        self._headed = False

    def close(self) -> None:
        """Close the table."""
        with growing(self._path):
            self._file.close()


def write_table(
    path: Path,
    track: Track,
    imprint: Float[np.ndarray, " frames"],
    margins: MarginPath,
    shears: ShearPath,
    grips: GripPath,
    unit: str,
) -> None:
    """Write `angles.csv` of one method, completely or not at all.

    The imprint is its rotation in each frame [rad]; NaN where unknown.

    Raises:
        OSError: the table cannot be written.
    """
    tables = (
        tabulate(part, imprint[rows], rows.start, unit)
        | tabulate_margin(part, margins.take(rows))
        | tabulate_shear(shears.take(rows), unit)
        | tabulate_grip(grips.take(rows))
        for part, rows in _parts(track)
    )
    write_whole(path, _below_one_another(tables))


def write_tables(
    path: Path, tracks: Iterable[Track], imprint: Float[np.ndarray, " frames"], unit: str
) -> None:
    """Write `angles_all.csv`, one method below the other, completely or not at all.

    The imprint is its rotation in each frame [rad]; NaN where unknown.

    Raises:
        OSError: the table cannot be written.
    """
    tables = (
        {"method": [track.method] * len(part.time)}
        | tabulate(part, imprint[rows], rows.start, unit)
        for track in tracks
        for part, rows in _parts(track)
    )
    write_whole(path, _below_one_another(tables))


def tabulate_answer(answer: Answer, method: str, unit: str) -> Table:
    """The row of `angles.csv` for a method's estimate in an answer."""
    track = Track.gather(method, [answer.estimates[method]])
    imprint = np.array([answer.frame.imprint[0]])
    table = tabulate(track, imprint, answer.row, unit)
    table |= tabulate_margin(track, MarginPath.of(answer.margin))
    table |= tabulate_shear(ShearPath.of(answer.shear), unit)
    return table | tabulate_grip(GripPath.of((answer.friction, answer.alert)))


def read_cells(table: Table) -> dict[str, str | int | float]:
    """The first row of a table as words, integers and floats; NaN for an empty cell.

    Columns of withdrawn answers are omitted, since no answer is withdrawn frame by frame.
    """
    kinds = {Label: str, Text: str, Whole: int}
    declared = Record.columns().items()
    readers = {column.name: kinds.get(Record.__annotations__[name]) for name, column in declared}
    readers |= {"frame": int, "alert": str}
    return {
        name: (readers.get(name) or (lambda cell: float(cell or "nan")))(cells[0])
        for name, cells in table.items()
        if not name.startswith("withdrawn_")
    }


def tabulate(
    track: Track,
    imprint: Float[np.ndarray, " frames"] | None = None,
    first: int = 0,
    unit: str = "mm",
) -> dict[str, list[str]]:
    """The cells of a method's answers by column; withdrawn answers have separate columns.

    The imprint is its rotation in each frame [rad]; frames are counted from `first`. Columns of
    lengths end in their unit.
    """
    frames, table = range(len(track.time)), dict[str, list[str]]()
    for name, column in track.columns().items():
        if column.name:
            table[re.sub("_mm$", f"_{unit}", column.name)] = column.show(getattr(track, name))
        if name == "time":
            table["frame"] = [str(first + i) for i in frames]
    series = {"slip_deg": accumulate_slip(track), "gel_deg": follow_gel(track)}
    series["imprint_deg"] = np.full(len(frames), np.nan) if imprint is None else imprint
    table |= {name: show_degrees(angles) for name, angles in series.items()}
    withdrawn = track.withdrawn
    for name, column in Withdrawn.columns().items():
        if not (column.name and column.answer):
            continue
        cells = [""] * len(frames)
        if withdrawn is not None and withdrawn.rows.any():
            shown = column.show(getattr(withdrawn, name))
            cells = [cell if row else "" for cell, row in zip(shown, withdrawn.rows, strict=True)]
        table[f"withdrawn_{column.name}"] = cells
    return table


def tabulate_margin(track: Track, margins: MarginPath) -> dict[str, list[str]]:
    """The cells of `MARGIN_COLUMNS`, by column; empty for NaN."""
    stick, contact = track.stick_markers, track.contact_markers
    ratio = np.sqrt(np.where(contact, stick / np.maximum(contact, 1), np.nan))
    values = (ratio, *np.degrees(margins[:3]), *margins[3:-1])
    return _fill(MARGIN_COLUMNS, values)


def tabulate_shear(shears: ShearPath, unit: str) -> dict[str, list[str]]:
    """The cells of the gel's shear and the slip along it, by column; empty for NaN."""
    lengths = f"slip_{unit}", f"slip_error_{unit}", "slip_since_s"
    names = (f"shear_{unit}", "print_correlation", "slip_probability", *lengths)
    return _fill(names, shears[: len(names)])


def tabulate_grip(grips: GripPath) -> dict[str, list[str]]:
    """The cells of friction and alerts, by column; empty for NaN."""
    names = (
        "friction_used",
        "friction",
        "friction_low",
        "friction_high",
        "time_to_slip_s",
        "time_to_slip_low_s",
        "time_to_slip_high_s",
    )
    *numbers, levels = grips
    return _fill(names, numbers) | {"alert": [str(level) for level in levels]}


def csv_text(table: Mapping[str, Iterable[object]], heading: bool = True) -> str:
    """A table as CSV, from its cells by column; a cell that is None is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if heading:
        writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return text.getvalue()


def _parts(track: Track) -> Iterator[tuple[Track, slice]]:
    chunk = 10_000  # rows of a table to format at a time
    for start in range(0, len(track.time), chunk):
        rows = slice(start, min(start + chunk, len(track.time)))
        yield track.take(rows), rows


def _below_one_another(tables: Iterable[Table]) -> Iterator[str]:
    for number, table in enumerate(tables):
        yield csv_text(table, heading=number == 0)


def _fill(
    names: Iterable[str], columns: Iterable[Float[np.ndarray, " frames"]]
) -> dict[str, list[str]]:
    """The cells of numbers, by column; empty for NaN."""
    return {
        name: ["" if cell == "nan" else cell for cell in show_numbers(values)]
        for name, values in zip(names, columns, strict=True)
    }
