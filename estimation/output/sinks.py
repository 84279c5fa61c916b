"""Sinks by name, as the command line and `Settings` have them."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

from estimation.frames.bags.source import BagSource
from estimation.frames.extras import require_extra
from estimation.frames.lerobot import write_lerobot
from estimation.frames.source import Source
from estimation.frames.zarr_folder import write_zarr
from estimation.output.bag import BagWriter, read_answers
from estimation.output.lines import JsonWriter
from estimation.output.outlet import close_outlet, open_stdout, open_udp
from estimation.tracking.stream import Sink

FILES = {"mcap": "frames.mcap", "zarr": "frames.zarr", "lerobot": "lerobot"}
"""What each sink that writes a file calls it, beside `angles.csv`.

Those of columns cannot grow by a row that a kill does not damage: they are made from the MCAP file
when all has been answered.
"""
GROWING = FILES["mcap"]
"""The file that grows with every answer, where there is any of `FILES`."""


def check_sinks(names: tuple[str, ...]) -> None:
    """Check the names of sinks.

    Raises:
        ImportError: an extra is not installed.
        ValueError: there is no such sink.
    """
    for name in names:
        if name in FILES:
            for extra in {"bags", {"mcap": "bags"}.get(name, name)}:
                require_extra(extra, f"the sink {name}")
        elif name.startswith("udp:"):
            read_address(name)
        elif name != "json":
            known = ", ".join((*FILES, "json", "udp:PORT", "udp:HOST:PORT"))
            raise ValueError(f"there is no sink {name!r} (--sink); there are {known}")


def open_sinks(
    names: tuple[str, ...],
    folder: Path,
    source: Source,
    method: str,
    rows: int,
    opened: ExitStack,
    tell: Callable[[str], None],
) -> list[Sink]:
    """Open sinks beside those that every run has.

    Args:
        names: of the sinks.
        folder: of the files that they write.
        source: of the frames.
        method: whose answers they take.
        rows: that are kept of files that are there.
        opened: closes them.
        tell: told at their end, in a sentence, what has not been passed on.

    Raises:
        ImportError: an extra is not installed.
        ValueError: there is no such sink.
        OSError: a file cannot be written, or there is no such host.
    """
    check_sinks(names)
    sinks: list[Sink] = []
    for file in growing_files(names):
        about = {"unit": source.unit, "convention": source.convention, "rows": rows}
        writer = BagWriter(folder / file, method, **about)
        sinks.append(opened.enter_context(closing(writer)))
    for name in names:
        if name not in FILES:
            outlet = open_stdout() if name == "json" else open_udp(*read_address(name))
            opened.callback(close_outlet, outlet, name, tell)
            sinks.append(JsonWriter(outlet.send, method, source.unit))
    return sinks


def growing_files(names: tuple[str, ...]) -> list[str]:
    """The files that grow with every answer; arguments as for `finish_files`."""
    return [GROWING] if any(name in FILES for name in names) else []


def finish_files(names: tuple[str, ...], folder: Path) -> None:
    """Make the files of columns, when all has been answered.

    Args:
        names: of the sinks.
        folder: of the files.

    Raises:
        ImportError: an extra is not installed.
        OSError: a file cannot be written.
    """
    bag = folder / GROWING
    for name, write in (("zarr", write_zarr), ("lerobot", write_lerobot)):
        if name in names:
            write(folder / FILES[name], BagSource(bag), read_answers(bag))
    if growing_files(names) and "mcap" not in names:
        bag.unlink()


def read_address(name: str) -> tuple[str, int]:
    """Host and port of a sink `udp:PORT` or `udp:HOST:PORT`; this machine where no host is named.

    Raises:
        ValueError: there is no port.
    """
    host, _, port = name.removeprefix("udp:").rpartition(":")
    if not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"the sink {name!r} (--sink) has no port: give udp:PORT or udp:HOST:PORT")
    return host.strip("[]") or "127.0.0.1", int(port)
