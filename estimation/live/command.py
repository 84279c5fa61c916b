"""Follow a source live: answers as they come, the report when it ends."""

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
from estimation.run import Outcome, run_all
from estimation.settings import Settings
from estimation.tracking.stream import Sink


def follow(
    name: str,
    out: Path,
    settings: Settings,
    choices: LiveChoices,
    say: Callable[[str], None],
    resume: bool = False,
) -> Outcome:
    """Answer what a source gives while it gives it, a line for each frame on standard output.

    Ctrl-C or SIGTERM ends it, and the report is made.

    Args:
        name: of a camera or a recording; the virtual pivot where it is empty.
        out: folder to write to.
        settings: of the run.
        choices: how it is followed.
        say: told what happens to the source.
        resume: go on with a camera where an earlier run was cut off.

    Raises:
        ValueError: a wrong setting, or no source.
        OSError: it cannot be read, or something cannot be written.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    one, feed = open_live(name, settings, choices, say, out if resume else None)
    sinks: list[Sink] = []
    with ExitStack() as opened:
        if "json" not in settings.sink:  # which has standard output for itself
            outlet = open_stdout()
            opened.callback(close_outlet, outlet, "standard output", say)
            sinks.append(LineWriter(outlet.send, settings.method))
        if choices.window:
            window = Window(one.source, feed, settings.method)
            server = WindowServer(window, feed.name, choices.window_host, choices.window_port)
            opened.callback(_close_window, window, server, say)
            say(f"window: {server.address}")
            sinks.append(window)
        outcome = run_all([one], out, settings, Progress(disable=True), sinks, resume)
    return outcome._replace(lines=[*outcome.lines, *feed.notes()])


def _close_window(window: Window, server: WindowServer, say: Callable[[str], None]) -> None:
    window.end("the run has ended")
    server.close()
    if note := window.describe():
        say(note)
