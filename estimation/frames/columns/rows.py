"""Frames row by row, as files of columns keep them: many at a time are written and read."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from typing import Any, NamedTuple

import numpy as np

from estimation.frames.flat import (
    flatten_frame,
    flatten_layout,
    restore_frame,
    restore_layout,
)
from estimation.frames.inspection import LiveInspector
from estimation.frames.recording import Frame, MarkerLayout
from estimation.frames.source import FrameStream, Source

Columns = Mapping[str, Any]
"""Values of some rows by the name of their column: arrays, texts as lists."""
FORMAT_VERSION = 1
ANSWER = "answer."
"""What the names of columns begin with that are not of the frame, but of what was found in it."""


class RowFile(NamedTuple):
    """A file of rows.

    Attributes:
        layout: of the markers.
        unit: of lengths, mm or px.
        convention: how the axes lie.
        columns: of the rows in order, some rows at a time.
    """

    layout: MarkerLayout
    unit: str
    convention: str
    columns: Iterator[Columns]


def describe_rows(source: Source) -> dict[str, Any]:
    """What a file of the rows of a source says of them beside the columns, ready for JSON."""
    layout = {name: value.tolist() for name, value in flatten_layout(source.layout).items()}
    return {
        "format_version": FORMAT_VERSION,
        "unit": source.unit,
        "convention": source.convention,
        "layout": layout,
    }


def open_rows(about: Mapping[str, Any], columns: Iterator[Columns]) -> RowFile:
    """The file of rows that `describe_rows` has described.

    Args:
        about: its description.
        columns: of its rows.

    Raises:
        ValueError: its format is of another version, or the layout's arrays do not fit each other.
        LookupError: the description lacks something.
        TypeError: something in it is of another kind.
    """
    if about.get("format_version") != FORMAT_VERSION:
        raise ValueError(f"its format is {about.get('format_version')}, not {FORMAT_VERSION}")
    layout = restore_layout(about["layout"], len(about["layout"]["reference"][0]))
    return RowFile(layout, str(about["unit"]), str(about["convention"]), columns)


def batch_rows(
    source: Source, answers: Iterable[Mapping[str, Any]] = (), many: int = 256
) -> Iterator[Columns]:
    """The frames of a source in columns, some rows at a time.

    Args:
        source: of the frames.
        answers: quantities of each frame's answer, by name; may be empty.
        many: rows at a time.

    Raises:
        ValueError: there are fewer answers than frames, but some.
    """
    found = iter(answers)
    first = next(found, None)
    others = None if first is None else chain((first,), found)
    frames = iter(source)
    while batch := list(islice(frames, many)):
        rows = [flatten_frame(frame) for frame in batch]
        if others is not None:
            told = ({ANSWER + name: one for name, one in row.items()} for row in others)
            rows = [row | more for row, more in zip(rows, told, strict=False)]
            if len(rows) < len(batch):
                raise ValueError("there are fewer answers than frames")
        yield {name: _column([row[name] for row in rows]) for name in rows[0]}


def stream_rows(file: RowFile, source: str, name: str, skip: int = 0) -> FrameStream:
    """The frames of a file of rows, one after the other, inspected.

    Args:
        file: of the rows.
        source: where they come from.
        name: short name.
        skip: first frames that are not given.
    """
    inspector = LiveInspector()
    frames = (
        inspector.inspect(frame, file.layout.reference)
        for frame in _restore_rows(file.columns, file.layout)
    )
    wanted = islice(frames, skip, None)
    return FrameStream(file.layout, wanted, name, source, file.convention, file.unit)


def _restore_rows(columns: Iterator[Columns], layout: MarkerLayout) -> Iterator[Frame]:
    """The frames of all rows; where the file is damaged after some, the last one says so."""
    number, none = 0, np.full(layout.reference.shape, np.nan)
    while True:
        try:
            some = next(columns, None)
        except ValueError as error:
            if not number:
                raise
            yield Frame(none, np.nan, number, flaw=f"no more rows can be read: {error}")
            return
        if some is None:
            return
        for i in range(len(some["time"])):
            try:
                frame = restore_frame({name: values[i] for name, values in some.items()})
                _expect_markers(frame, layout)
            except ValueError as error:
                flaw = f"the row cannot be used: {error}"
                frame = Frame(none, float(some["time"][i]), number, flaw=flaw)
            yield frame
            number += 1


def _expect_markers(frame: Frame, layout: MarkerLayout) -> None:
    if frame.positions.shape != layout.reference.shape:
        raise ValueError(f"{len(frame.valid)} markers, not {len(layout.reference)}")


def _column(values: list[Any]) -> Any:
    return values if isinstance(values[0], str) else np.array(values)
