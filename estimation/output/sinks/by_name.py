"""Sinks by name, as the command line and `Settings` have them."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from estimation.frames.bags.source import BagSource
from estimation.frames.columns.lerobot import write_lerobot
from estimation.frames.columns.zarr_folder import write_zarr
from estimation.frames.extras import require_extra
from estimation.frames.source import Source
from estimation.output.sinks.bag import BagWriter, read_answers
from estimation.output.sinks.lines import JsonWriter
from estimation.output.sinks.outlet import close_outlet, open_stdout, open_udp
from estimation.output.sinks.viewer import LiveViewer, ViewerFile, connect_viewer, spawn_viewer
from estimation.tracking.stream import Sink

FILES = {
    "mcap": "frames.mcap",
    "rrd": "frames.rrd",
    "zarr": "frames.zarr",
    "lerobot": "lerobot",
}
"""What each sink that writes a file calls it, beside `angles.csv`.

Those of columns cannot grow by a row that a kill does not damage: they are made from the MCAP file
when all has been answered.
"""
COLUMNS = ("zarr", "lerobot")
EXTRAS = {
    "mcap": ("bags",),
    "rrd": ("view",),
    "rerun": ("view",),
    "zarr": ("bags", "zarr"),
    "lerobot": ("bags", "lerobot"),
}
"""What each sink needs that is not always installed."""
READERS = ("udp", "rerun")
"""Sinks that have an address, `udp:HOST:PORT`; a `rerun` without one opens a viewer."""


def check_sinks(names: tuple[str, ...]) -> None:
    """Check the names of sinks.

    Raises:
        ImportError: an extra is not installed.
        ValueError: there is no such sink.
    """
    for name in names:
        kind, addressed, _ = name.partition(":")
        if addressed and kind in READERS:
            read_address(name)
        elif name not in (*FILES, "json", "rerun"):
            readers = [f"{one}:{at}" for one in READERS for at in ("PORT", "HOST:PORT")]
            known = ", ".join((*FILES, "json", "rerun", *readers))
            raise ValueError(f"there is no sink {name!r} (--sink); there are {known}")
        for extra in EXTRAS.get(kind, ()):
            require_extra(extra, f"the sink {name}")


def open_sinks(
    names: tuple[str, ...],
    folder: Path,
    source: Source,
    method: str,
    rows: int,
    opened: ExitStack,
    tell: Callable[[str], None],
) -> tuple[list[Sink], list[Sink]]:
    """Open sinks beside those that every run has.

    Args:
        names: of the sinks.
        folder: of the files that they write.
        source: of the frames.
        method: whose answers they take.
        rows: that are kept of files that are there.
        opened: closes them.
        tell: told at their end, in a sentence, what has not been passed on.

    Returns:
        Those that hand answers to whoever reads them, none of which waits for its reader; and
        those that write files.

    Raises:
        ImportError: an extra is not installed.
        ValueError: there is no such sink.
        OSError: a file cannot be written, there is no such host, or a viewer does not start.
    """
    check_sinks(names)
    readers: list[Sink] = []
    for name in names:
        if name in FILES:
            continue
        if name.startswith("rerun"):
            at = None if name == "rerun" else read_address(name)
            connect = spawn_viewer if at is None else partial(connect_viewer, *at)
            viewer = LiveViewer(source, method, connect)
            readers.append(viewer)
            outlet = viewer.outlet
        else:
            outlet = open_stdout() if name == "json" else open_udp(*read_address(name))
            readers.append(JsonWriter(outlet.send, method, source.unit))
        opened.callback(close_outlet, outlet, name, tell)
    kinds = {FILES["mcap"]: BagWriter, FILES["rrd"]: ViewerFile}
    files: list[Sink] = [
        opened.enter_context(closing(kinds[file](folder / file, source, method, rows)))
        for file in growing_files(names)
    ]
    return readers, files


def growing_files(names: tuple[str, ...]) -> list[str]:
    """The files that grow with every answer; arguments as for `finish_files`."""
    grown = {"mcap" if name in COLUMNS else name for name in names}
    return [FILES[name] for name in ("mcap", "rrd") if name in grown]


def finish_files(names: tuple[str, ...], folder: Path) -> None:
    """Make the files of columns, when all has been answered.

    Args:
        names: of the sinks.
        folder: of the files.

    Raises:
        ImportError: an extra is not installed.
        OSError: a file cannot be written.
    """
    bag = folder / FILES["mcap"]
    for name, write in zip(COLUMNS, (write_zarr, write_lerobot), strict=True):
        if name in names:
            write(folder / FILES[name], BagSource(bag), read_answers(bag))
    if set(COLUMNS) & set(names) and "mcap" not in names:
        bag.unlink()


def read_address(name: str) -> tuple[str, int]:
    """Host and port of a sink `udp:PORT` or `udp:HOST:PORT`; this machine where no host is named.

    Raises:
        ValueError: there is no port.
    """
    kind, _, address = name.partition(":")
    host, _, port = address.rpartition(":")
    if not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(
            f"the sink {name!r} (--sink) has no port: give {kind}:PORT or {kind}:HOST:PORT"
        )
    return host.strip("[]") or "127.0.0.1", int(port)
