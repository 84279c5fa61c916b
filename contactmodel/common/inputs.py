"""Text files that come from outside, TOML and CSV, read so that every error helps.

Whatever is wrong with a file ends in a ValueError that begins with its name. Files that are not
there or cannot be opened end in the OSError of the system, which names them, too.
"""

import csv
import io
import math
import tomllib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

LARGEST_WHOLE = 2**53
"""From here on double precision no longer has every whole number."""


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


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The content of a TOML file that has been read.

    Raises:
        ValueError: it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error


def read_toml(path: Path, version: int | None = None) -> dict[str, Any]:
    """A TOML file's content, without its `format_version` where that is given.

    Args:
        path: of the file.
        version: that `format_version` must have.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not TOML, or of another version.
    """
    content = parse_toml(read_text(path), path)
    if version is None:
        return content
    if "format_version" not in content:
        raise ValueError(f"{path}: format_version is missing; this version reads {version}")
    found = content.pop("format_version")
    if type(found) is not int or found != version:
        raise ValueError(f"{path}: format_version is {found!r}; this version reads {version}")
    return content


def as_number(value: Any, name: str) -> float:
    """A number of a TOML file, which may be infinite or NaN.

    Raises:
        ValueError: it is none, or too large.
    """
    if type(value) not in (int, float):  # true and false are not
        raise ValueError(f"{name} must be a number, got {_show(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise ValueError(f"{name} is too large a number: {_show(value)}") from error


def as_whole(value: Any, name: str) -> int:
    """A whole number of a TOML file, written with or without a decimal point.

    Raises:
        ValueError: it is none, or beyond 2⁵³.
    """
    number = as_number(value, name)
    if not (math.isfinite(number) and number.is_integer() and abs(number) < LARGEST_WHOLE):
        raise ValueError(f"{name} must be a whole number below 2^53, got {_show(value)}")
    return int(number)


def as_list(value: Any, name: str) -> list[Any]:
    """A list of anything.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, list):
        raise ValueError(f"{name} must be a list, got {_show(value)}")
    return value


def as_numbers(value: Any, name: str, count: int | None = None) -> list[float]:
    """A list of numbers.

    Args:
        value: of the TOML file.
        name: of it.
        count: how many there must be; any number of them if None.

    Raises:
        ValueError: it is no list, not so long, or holds something else.
    """
    if count not in (None, len(as_list(value, name))):
        raise ValueError(f"{name} must be {count} numbers, got {_show(value)}")
    return [as_number(one, f"each of {name}") for one in value]


def as_matrix(value: Any, name: str) -> Float[np.ndarray, "rows columns"]:
    """A list of lists of numbers, all of the same length.

    Raises:
        ValueError: it is none.
    """
    rows = [as_numbers(row, f"a row of {name}") for row in as_list(value, name)]
    if len({len(row) for row in rows}) != 1:
        raise ValueError(f"{name} must have rows of one length, got {_show(value)}")
    return np.array(rows)


def as_texts(value: Any, name: str) -> tuple[str, ...]:
    """A list of texts.

    Raises:
        ValueError: it is none.
    """
    return tuple(as_text(one, f"each of {name}") for one in as_list(value, name))


def as_flag(value: Any, name: str) -> bool:
    """`true` or `false`.

    Raises:
        ValueError: it is neither.
    """
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, got {_show(value)}")
    return value


def as_text(value: Any, name: str) -> str:
    """A text.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a text, got {_show(value)}")
    return value


def as_table(value: Any, name: str) -> dict[str, Any]:
    """A table of a TOML file.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, dict):
        raise ValueError(f"{name} must be a table, [{name}], got {_show(value)}")
    return value


def expect_keys(table: Mapping[str, Any], name: str, known: Collection[str]) -> None:
    """Check that a table has no other keys.

    Raises:
        ValueError: it has.
    """
    if unknown := sorted(set(table) - set(known)):
        raise ValueError(f"unknown key {unknown[0]!r} in {name}; known are {sorted(known)}")


def _show(value: Any) -> str:
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
            f"has {_show(names)}"
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
        raise ValueError(f"{where} is {_show(cell)}, no number") from error


def cell_whole(cell: str, where: str) -> int:
    """A whole number in a cell of a CSV file.

    Args:
        cell: its text.
        where: the file, the line and the column, for the error.

    Raises:
        ValueError: it is none.
    """
    return as_whole(cell_number(cell, where), where)
