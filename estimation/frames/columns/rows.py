"""Frames as rows of files of columns; rows are written and read in batches."""

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
"""Values of a batch of rows by the name of their column: arrays, and lists of texts."""
FORMAT_VERSION = 1
"""Version of the format that is written and read."""
ANSWER_PREFIX = "answer."
"""Prefix of columns that belong to a frame's answer instead of the frame."""


class RowFile(NamedTuple):
    """A file of rows of frames, whose columns come in order, in batches."""

    layout: MarkerLayout
    unit: str
    convention: str
    columns: Iterator[Columns]


def describe_rows(source: Source) -> dict[str, Any]:
    """Describe the rows of a source, for the file beside its columns; ready for JSON."""
    layout = {name: value.tolist() for name, value in flatten_layout(source.layout).items()}
    return {
        "format_version": FORMAT_VERSION,
        "unit": source.unit,
        "convention": source.convention,
        "layout": layout,
    }


def open_rows(about: Mapping[str, Any], columns: Iterator[Columns]) -> RowFile:
    """Make a file of rows from the description of `describe_rows`.

    Raises:
        ValueError: the format has another version, or the layout's arrays do not fit each other.
        LookupError: the description lacks an entry.
        TypeError: an entry of the description has the wrong type.
    """
    if about.get("format_version") != FORMAT_VERSION:
        raise ValueError(
            f"its format version is {about.get('format_version')}, not {FORMAT_VERSION}"
        )
    layout = restore_layout(about["layout"], len(about["layout"]["reference"][0]))
    return RowFile(layout, str(about["unit"]), str(about["convention"]), columns)


def batch_rows(
    source: Source, answers: Iterable[Mapping[str, Any]] = (), many: int = 256
) -> Iterator[Columns]:
    """Convert frames, and the quantities of their answers if there are any, to columns, in batches.

    Raises:
        ValueError: there are answers, but fewer than frames.
    """
    quantities = iter(answers)
    first = next(quantities, None)
    given = None if first is None else chain((first,), quantities)
    frames = iter(source)
    while batch := list(islice(frames, many)):
        rows = [flatten_frame(frame) for frame in batch]
        if given is not None:
            named = ({ANSWER_PREFIX + name: value for name, value in row.items()} for row in given)
            rows = [row | answer for row, answer in zip(rows, named, strict=False)]
            if len(rows) < len(batch):
                raise ValueError("there are fewer answers than frames")
        yield {name: _column([row[name] for row in rows]) for name in rows[0]}


def stream_rows(file: RowFile, source: str, name: str, skip: int = 0) -> FrameStream:
    """Stream the frames of a file of rows, inspected one after the other."""
    inspector = LiveInspector()
    frames = (
        inspector.inspect(frame, file.layout.reference)
        for frame in _restore_rows(file.columns, file.layout)
    )
    wanted = islice(frames, skip, None)
    return FrameStream(file.layout, wanted, name, source, file.convention, file.unit)


def _restore_rows(columns: Iterator[Columns], layout: MarkerLayout) -> Iterator[Frame]:
    """The frames of all rows; if the file is damaged, a last frame gives the reason."""
    number, none = 0, np.full(layout.reference.shape, np.nan)
    while True:
        try:
            batch = next(columns, None)
        except ValueError as error:
            if not number:
                raise
            yield Frame(none, np.nan, number, flaw=f"no more rows can be read: {error}")
            return
        if batch is None:
            return
        for i in range(len(batch["time"])):
            try:
                frame = restore_frame({name: values[i] for name, values in batch.items()}, layout)
            except ValueError as error:
                flaw = f"the row cannot be used: {error}"
                frame = Frame(none, float(batch["time"][i]), number, flaw=flaw)
            yield frame
            number += 1


def _column(values: list[Any]) -> Any:
    return values if isinstance(values[0], str) else np.array(values)
