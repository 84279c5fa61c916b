"""Files that appear whole or not at all."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


def write_whole(path: Path, content: str | bytes | Iterable[str]) -> None:
    """Write a file under a temporary name beside its own, then give it its name.

    Args:
        path: of the file.
        content: of it; text may come in parts.

    Raises:
        OSError: the folder cannot be written to, or the disk is full; nothing is left behind.
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
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


@contextmanager
def growing(path: Path) -> Iterator[None]:
    """Name the file that grows where it cannot, as on a full disc.

    Raises:
        OSError: it cannot be written to.
    """
    try:
        yield
    except OSError as error:
        raise OSError(
            f"{path} cannot be written to ({error.strerror or error}): the frames before are kept; "
            "`python -m estimation report` makes a report of them"
        ) from error


@contextmanager
def write_folder(path: Path) -> Iterator[Path]:
    """A folder under a temporary name, which gets its own, and replaces another, once it is whole.

    Args:
        path: of the folder.

    Raises:
        OSError: it cannot be written; nothing is left behind.
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
    """Make the folder if need be, and see that files can be made in it.

    Raises:
        OSError: it is a file, or it cannot be written to.
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
