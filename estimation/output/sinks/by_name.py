"""Sinks by name, as in `--sink` and `Settings`."""

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

SINK_FILES = {
    "mcap": "frames.mcap",
    "rrd": "frames.rrd",
    "zarr": "frames.zarr",
    "lerobot": "lerobot",
}
"""Names of the files that sinks write next to `angles.csv`.

Zarr and LeRobot files cannot grow row by row without the risk of damage by a kill, so they are made
from the MCAP file at the end of the run.
"""


def check_sinks(names: tuple[str, ...]) -> None:
    """Check the names of sinks.

    Raises:
        ImportError: an extra is not installed.
        ValueError: an unknown sink.
    """
    # sinks with an address, `udp:HOST:PORT`; `rerun` without an address opens a viewer
    addressees = ("udp", "rerun")
    extras = {
        "mcap": ("bags",),
        "rrd": ("view",),
        "rerun": ("view",),
        "zarr": ("bags", "zarr"),
        "lerobot": ("bags", "lerobot"),
    }
    for name in names:
        kind, addressed, _ = name.partition(":")
        if addressed and kind in addressees:
            read_address(name)
        elif name not in (*SINK_FILES, "json", "rerun"):
            readers = [f"{reader}:{at}" for reader in addressees for at in ("PORT", "HOST:PORT")]
            choices = ", ".join((*SINK_FILES, "json", "rerun", *readers))
            raise ValueError(f"unknown sink {name!r} (--sink): choose from {choices}")
        for extra in extras.get(kind, ()):
            require_extra(extra, f"the sink {name}")


def open_sinks(
    names: tuple[str, ...],
    folder: Path,
    source: Source,
    method: str,
    rows: int,
    opened: ExitStack,
    say: Callable[[str], None],
) -> tuple[list[Sink], list[Sink]]:
    """Open the sinks that a run has in addition to its table and record.

    Existing files are continued after so many rows. When the stack closes a sink, `say` receives
    a sentence on dropped answers.

    Returns:
        Sinks that send answers to readers without waiting for them, and sinks that write files.

    Raises:
        ImportError: an extra is not installed.
        ValueError: an unknown sink.
        OSError: a file cannot be written, a host is unknown, or a viewer does not start.
    """
    check_sinks(names)
    readers: list[Sink] = []
    for name in names:
        if name in SINK_FILES:
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
        opened.callback(close_outlet, outlet, name, say)
    kinds = {SINK_FILES["mcap"]: BagWriter, SINK_FILES["rrd"]: ViewerFile}
    files: list[Sink] = [
        opened.enter_context(closing(kinds[file](folder / file, source, method, rows)))
        for file in growing_files(names)
    ]
    return readers, files


def growing_files(names: tuple[str, ...]) -> list[str]:
    """Names of the files that grow with every answer."""
    grown = {"mcap" if name in ("zarr", "lerobot") else name for name in names}
    return [SINK_FILES[name] for name in ("mcap", "rrd") if name in grown]


def finish_files(names: tuple[str, ...], folder: Path) -> None:
    """Make the Zarr and LeRobot files from the MCAP file, once all frames are answered.

    Raises:
        ImportError: an extra is not installed.
        OSError: a file cannot be written.
    """
    bag = folder / SINK_FILES["mcap"]
    writers = {"zarr": write_zarr, "lerobot": write_lerobot}
    for name, write in writers.items():
        if name in names:
            write(folder / SINK_FILES[name], BagSource(bag), read_answers(bag))
    if set(writers) & set(names) and "mcap" not in names:
        bag.unlink()


def read_address(name: str) -> tuple[str, int]:
    """Host and port of a sink `udp:PORT` or `udp:HOST:PORT`; without a host, this machine.

    Raises:
        ValueError: the name has no valid port.
    """
    kind, _, address = name.partition(":")
    host, _, port = address.rpartition(":")
    if not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(
            f"the sink {name!r} (--sink) has no port: give {kind}:PORT or {kind}:HOST:PORT"
        )
    return host.strip("[]") or "127.0.0.1", int(port)
