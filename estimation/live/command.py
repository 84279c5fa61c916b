"""The command `live`: answers while a source runs, and the report at its end."""

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from rich.progress import Progress

from estimation.choices import LiveChoices
from estimation.live.server import WindowServer
from estimation.live.source import open_live
from estimation.live.window import Window
from estimation.output.sinks.lines import LineWriter
from estimation.output.sinks.outlet import close_outlet, open_stdout
from estimation.run import RunEnd, run_all
from estimation.settings import Settings
from estimation.tracking.stream import Sink


def follow(
    name: str,
    out: Path,
    settings: Settings,
    choices: LiveChoices,
    say: Callable[[str], None],
    resume: bool = False,
) -> RunEnd:
    """Answer the frames of a source as they arrive, with a line for each on standard output.

    The source is a camera, a Tac3D port or a recording; without a name, the virtual pivot. Ctrl-C
    or SIGTERM ends the run and makes the report.

    Raises:
        ValueError: a wrong setting, or the name is not that of a source.
        OSError: the source cannot be read, or a file cannot be written.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    item, feed = open_live(name, settings, choices, say, out if resume else None)
    sinks: list[Sink] = []
    with ExitStack() as opened:
        if "json" not in settings.sink:  # the JSON lines use standard output
            outlet = open_stdout()
            opened.callback(close_outlet, outlet, "standard output", say)
            sinks.append(LineWriter(outlet.send, settings.method))
        if choices.window:
            window = Window(item.source, feed, settings.method)
            server = WindowServer(window, feed.name, choices.window_host, choices.window_port)
            opened.callback(_close_window, window, server, say)
            say(f"window: {server.address}")
            sinks.append(window)
        outcome = run_all([item], out, settings, Progress(disable=True), sinks, resume)
    return outcome._replace(lines=[*outcome.lines, *feed.notes()])


def _close_window(window: Window, server: WindowServer, say: Callable[[str], None]) -> None:
    window.end("the run has ended")
    server.close()
    if note := window.describe():
        say(note)
