"""Files and folders that appear only when they are complete."""

import json
import math
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def write_whole(path: Path, content: str | bytes | Iterable[str]) -> None:
    """Write a file, in parts if they are given, under a temporary name; rename it when complete.

    Raises:
        OSError: the folder cannot be written to, or the disk is full; no partial file remains.
    """
    parts = [content] if isinstance(content, str | bytes) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            for part in parts:
                file.write(part.encode("utf-8") if isinstance(part, str) else part)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:  # as on a full disk
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_json(path: Path, content: Any) -> None:
    """Write content as JSON with indented lines, as a whole.

    Raises:
        OSError: as for `write_whole`.
    """
    write_whole(path, json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def json_number(value: Any, digits: int = 6) -> float | None:
    """A number for JSON, rounded; None if it is not finite."""
    number = float(value)
    return round(number, digits) if math.isfinite(number) else None


@contextmanager
def growing(path: Path) -> Iterator[None]:
    """Name the file in the error if a file cannot grow, for example on a full disk.

    Raises:
        OSError: the file cannot be written to.
    """
    try:
        yield
    except OSError as error:
        raise OSError(
            f"{path} cannot be written to ({error.strerror or error}): the earlier frames are "
            "saved; `python -m estimation report` makes a report of them"
        ) from error


def expect_present(path: Path) -> None:
    """Expect that a growing file is still in its place: a file without a name is lost at the end.

    Raises:
        FileNotFoundError: the file was removed, or its folder was moved.
    """
    if not path.exists():
        raise FileNotFoundError(
            f"{path} was moved or removed during the run, which has ended: if its folder was "
            "moved, `python -m estimation report` makes a report of its frames; else run again"
        )


@contextmanager
def write_folder(path: Path) -> Iterator[Path]:
    """Make a folder under a temporary name, and rename it when it is complete.

    An existing folder of that name is replaced.

    Raises:
        OSError: the folder cannot be written; no partial folder remains.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as outer:
        folder = Path(outer).resolve() / path.name
        folder.mkdir()
        yield folder
        if path.exists():
            path.rename(Path(outer) / "earlier")
        folder.rename(path)


def check_writable(folder: Path) -> None:
    """Create the folder if it does not exist, and check that files can be written in it.

    Raises:
        OSError: the path is a file, or the folder cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{folder} is a file: give the name of a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = error.strerror or error
        raise OSError(f"{folder} cannot be written to ({why}): give another folder") from error
