"""Sinks by name, as the command line and `Settings` have them."""

from pathlib import Path

from estimation.frames.source import Source
from estimation.output.bag import BagWriter

FILES = {"mcap": "frames.mcap"}
"""What each sink that writes a file calls it, beside `angles.csv`."""


def check_sinks(names: tuple[str, ...]) -> None:
    """Check the names of sinks.

    Raises:
        ValueError: there is no such sink.
    """
    for name in names:
        if name not in FILES:
            raise ValueError(f"there is no sink {name!r} (--sink); there are {', '.join(FILES)}")


def open_sinks(
    names: tuple[str, ...], folder: Path, source: Source, method: str, rows: int = 0
) -> list[BagWriter]:
    """Open sinks beside those that every run has; those with a `close` must be closed.

    Args:
        names: of the sinks.
        folder: of the files that they write.
        source: of the frames.
        method: whose answers they take.
        rows: that are kept of files that are there.

    Raises:
        ImportError: an extra is not installed.
        OSError: a file cannot be written.
    """
    about = {"unit": source.unit, "convention": source.convention, "rows": rows}
    return [BagWriter(folder / FILES[name], method, **about) for name in names]
