"""Text files that come from outside, read so that every error helps: texts, numbers, CSV.

Whatever is wrong with a file ends in a ValueError that begins with its name. Files that are not
there or cannot be opened end in the OSError of the system, which names them, too.
"""

import csv
import io
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LARGEST_WHOLE = 2**53
"""From here on double precision no longer has every whole number."""


class RenamedKeyWarning(UserWarning):
    """A file has a key under the name that an earlier version gave it."""


@contextmanager
def naming(path: str | Path, what: str = "") -> Iterator[None]:
    """Put the file's name in front of what is wrong with its content.

    Args:
        path: of the file.
        what: it is not, if there is an error.

    Raises:
        ValueError: in place of every ValueError that does not begin with the name, and of a
            KeyError for a key that is missing.
    """
    start = f"{path} is {what}" if what else f"{path}"
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{start}: the key {error} is missing") from error
    except ImportError:  # a package that is not installed is not the file's fault
        raise
    except ValueError as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{start}: {error}") from error


def read_text(path: Path) -> str:
    """A text file's content.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not UTF-8 text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file in UTF-8: {error}") from error


def as_number(value: Any, name: str) -> float:
    """A number of a TOML file, which may be infinite or NaN.

    Raises:
        ValueError: it is none, or too large.
    """
    if type(value) not in (int, float):  # true and false are not
        raise ValueError(f"{name} must be a number, got {show(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise ValueError(f"{name} is too large a number: {show(value)}") from error


def as_whole(value: Any, name: str) -> int:
    """A whole number of a TOML file, written with or without a decimal point.

    Raises:
        ValueError: it is none, or beyond 2⁵³.
    """
    number = as_number(value, name)
    if not (math.isfinite(number) and number.is_integer() and abs(number) < LARGEST_WHOLE):
        raise ValueError(f"{name} must be a whole number below 2^53, got {show(value)}")
    return int(number)


def show(value: Any) -> str:
    """A value as it may stand in a message, shortened where it is long."""
    shown = repr(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer"
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def read_rows(path: Path, columns: Collection[str] = ()) -> list[tuple[str, dict[str, str]]]:
    """The rows of a CSV file: where each is, for errors, and its cells by the columns' names.

    What a row lacks is empty.

    Args:
        path: of the file.
        columns: that there must be.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a CSV file, or lacks a column.
    """
    reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        names = [cell.strip() for cell in next(reader, [])]
        lines = [(f"{path}, line {reader.line_num}", line) for line in reader if line]
    except csv.Error as error:
        raise ValueError(f"{path}, line {reader.line_num}, is not CSV: {error}") from error
    if missing := [name for name in columns if name not in names]:
        raise ValueError(
            f"{path} lacks the columns {', '.join(missing)}: it needs {' and '.join(columns)}, and "
            f"has {show(names)}"
        )
    return [
        (
            where,
            dict.fromkeys(names, "")
            | {n: cell.strip() for n, cell in zip(names, line, strict=False)},
        )
        for where, line in lines
    ]


def cell_number(cell: str, where: str) -> float:
    """A number in a cell of a CSV file, which may be infinite or NaN.

    Args:
        cell: its text.
        where: the file, the line and the column, for the error.

    Raises:
        ValueError: it is none.
    """
    try:
        return float(cell)
    except ValueError as error:
        raise ValueError(f"{where} is {show(cell)}, no number") from error


def cell_whole(cell: str, where: str) -> int:
    """A whole number in a cell of a CSV file.

    Args:
        cell: its text.
        where: the file, the line and the column, for the error.

    Raises:
        ValueError: it is none.
    """
    return as_whole(cell_number(cell, where), where)
