"""Read texts, numbers and CSV from outside, with errors that name the file and the cause.

Wrong content raises a ValueError that begins with the file's name. A file that is missing or cannot
be opened raises the system's OSError, which names it too.
"""

import csv
import io
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LARGEST_WHOLE = 2**53
"""Above it, double precision does not hold every whole number."""


class RenamedKeyWarning(UserWarning):
    """A file uses a key's name of an earlier version."""


class RangeWarning(UserWarning):
    """A result lies outside the range in which its error is known."""


@contextmanager
def naming(path: str | Path, what: str = "") -> Iterator[None]:
    """Put the file's name in front of errors about its content.

    Args:
        path: path of the file.
        what: words to put after "PATH is", for example "not a TOML file".

    Raises:
        ValueError: replaces a ValueError that does not begin with the name, and a KeyError for a
            missing key.
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
    """Read a text file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not UTF-8 text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file in UTF-8: {error}") from error


def as_number(value: Any, name: str) -> float:
    """Convert a value of a TOML file to a number, which may be infinite or NaN.

    Raises:
        ValueError: the value is not a number, or too large.
    """
    if type(value) not in (int, float):  # true and false are not
        raise ValueError(f"{name} must be a number, got {show(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise ValueError(f"{name} is too large a number: {show(value)}") from error


def as_whole(value: Any, name: str) -> int:
    """Convert a value of a TOML file, with or without a decimal point, to a whole number.

    Raises:
        ValueError: the value is not a whole number, or its size is 2⁵³ or more.
    """
    number = as_number(value, name)
    if not (math.isfinite(number) and number.is_integer() and abs(number) < LARGEST_WHOLE):
        raise ValueError(f"{name} must be a whole number below 2^53, got {show(value)}")
    return int(number)


def show(value: Any) -> str:
    """Text of a value for a message; long texts are shortened."""
    shown = repr(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer"
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def read_rows(path: Path, columns: Collection[str] = ()) -> list[tuple[str, dict[str, str]]]:
    """Read the rows of a CSV file that has at least these columns.

    Lines at the top that begin with `#` are comments, but for names of columns (`_find_names`).

    Returns:
        For each row, its place in the file, for errors, and its cells by column name. Missing
        cells are empty.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not CSV, lacks a required column, or has a row with more filled
            cells than columns, as decimal commas make them.
    """
    reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        lines = [(f"{path}, line {reader.line_num}", line) for line in reader if line]
    except csv.Error as error:
        raise ValueError(f"{path}, line {reader.line_num}, is not CSV: {error}") from error
    names, lines = _find_names(lines)
    for mark, called in {";": "semicolons", "\t": "tabs"}.items():
        if len(names) == 1 and mark in names[0]:
            raise ValueError(
                f"{path} separates its columns by {called}: write commas between columns, and "
                "points in numbers"
            )
    if missing := [name for name in columns if name not in names]:
        raise ValueError(
            f"{path} lacks the columns {', '.join(missing)}: it requires {', '.join(columns)}, and "
            f"has {show(', '.join(names))}"
        )
    for where, line in lines:
        if any(cell.strip() for cell in line[len(names) :]):
            raise ValueError(
                f"{where}, has {len(line)} cells, but the file has {len(names)} columns "
                f"({','.join(names)}): write numbers with a decimal point, not a comma, and name "
                "every column"
            )
    return [
        (
            where,
            dict.fromkeys(names, "")
            | {n: cell.strip() for n, cell in zip(names, line, strict=False)},
        )
        for where, line in lines
    ]


def _find_names(
    lines: list[tuple[str, list[str]]],
) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """The names of the columns and the lines below them.

    Names may stand behind `#`, as `numpy.savetxt` writes them. They are then the last line that
    begins so, unless the next one has other cells and no number: then all of them are comments.
    """
    rows = [[cell.strip() for cell in line] for _, line in lines]
    top = next((i for i, row in enumerate(rows) if not row[0].startswith("#")), len(rows))
    after = rows[top] if top < len(rows) else []
    if top and (len(after) in (0, len(rows[top - 1])) or any(map(_is_number, after))):
        top -= 1
    names = rows[top] if rows else []
    return [name.removeprefix("#").strip() for name in names[:1]] + names[1:], lines[top + 1 :]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def cell_number(cell: str, where: str) -> float:
    """Convert a cell of a CSV file to a number, which may be infinite or NaN; errors say `where`.

    Raises:
        ValueError: the cell is not a number.
    """
    try:
        return float(cell)
    except ValueError as error:
        raise ValueError(f"{where} is {show(cell)}, no number") from error


def cell_whole(cell: str, where: str) -> int:
    """Convert a cell of a CSV file to a whole number.

    Raises:
        ValueError: the cell is not a whole number, or its size is 2⁵³ or more.
    """
    return as_whole(cell_number(cell, where), where)
