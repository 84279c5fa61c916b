"""Memory and time of a stream that goes on for long.

`python -m tests.benchmarks.long_stream --frames 1000000`: the 400 markers of the virtual pivot,
again and again, answered by every method, with table, record and report. With `--answered` the
answers of one pivot are taken again and again: what sinks and report take, without the methods.
With `--chosen` only the chosen method answers, as in a tracker of one's own.
With `--live` frames go the way of `live --fast`, through its thread and its queue, with lines to a
reader; with `--pictures` they are pictures of 640×480 with 70 dots, followed so.
"""

import math
import resource
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from estimation.choices import LiveChoices
from estimation.frames.recording import Frame, Recording
from estimation.frames.source import FrameStream
from estimation.live.feed import Feed
from estimation.live.source import open_live, play
from estimation.output.record import NAME
from estimation.output.sinks.lines import JsonWriter
from estimation.output.sinks.outlet import Outlet
from estimation.run import run_all
from estimation.settings import Settings
from estimation.sources import Input
from estimation.tracking.stream import Answer, Follower, Stream
from estimation.virtual.recording import simulate_pivot
from tests.benchmarks.arguments import make_parser
from tests.benchmarks.inputs import repeat, write_loop

PARTS = 10
"""Rows of the table."""


@dataclass
class Watch:
    """Time and memory whenever another part of the frames has gone by, and after a minute."""

    frames: int
    start_mib: float = field(default_factory=lambda: resident_mib())
    rows: list[tuple[int, float, float]] = field(default_factory=list)
    since: float = field(default_factory=time.process_time)
    counted: int = 0
    minute: float = field(default_factory=lambda: time.monotonic() + 60.0)

    def put(self, answer: Answer) -> None:
        """Count an answer, as a sink."""
        done = answer.row + 1
        early = time.monotonic() > self.minute
        if early or done % (self.frames // PARTS) == 0:
            now = time.process_time()
            spent = 1e3 * (now - self.since) / (done - self.counted)
            self.rows.append((done, spent, resident_mib() - self.start_mib))
            self.since, self.counted = now, done
        if early:
            self.minute = math.inf

    def restart(self) -> None:
        """Go on."""

    def table(self) -> Table:
        """What was seen."""
        table = Table("frames", "processor time per frame [ms]", "memory above the start [MiB]")
        for done, spent, memory in self.rows:
            table.add_row(str(done), f"{spent:.3f}", f"{memory:.0f}")
        return table


def main() -> None:
    """Print the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--frames", type=int, default=20_000, help="frames of the stream")
    parser.add_argument("--answered", action="store_true", help="without the methods' time")
    parser.add_argument("--chosen", action="store_true", help="only the chosen method answers")
    parser.add_argument("--live", action="store_true", help="through the thread of `live`")
    parser.add_argument("--pictures", action="store_true", help="pictures, followed live")
    told = parser.parse_args()
    recording, _ = simulate_pivot(seed=0)
    if told.answered:
        answer_from(recording)
    if told.chosen:
        Settings.methods = property(lambda self: {self.method: self.constants})
    console, out = Console(), Outlet[str](lambda line: None)
    with tempfile.TemporaryDirectory() as name:
        folder, settings = Path(name) / "out", Settings()
        one = Input(FrameStream(recording.layout, repeat(recording, told.frames)))
        if told.pictures:
            write_loop(Path(name) / "clip", told.frames)
            one, _ = open_live(f"{name}/clip", settings, LiveChoices(fast=True), print)
        elif told.live:
            feed = Feed("stream", LiveChoices(fast=True), print, recorded=True)
            one = Input(play(one.source, feed), notes=feed.notes)
        watch = Watch(told.frames)
        sinks = [watch, JsonWriter(out.send, settings.method)]
        try:
            run_all([one], folder, settings, Progress(disable=True), sinks)
        finally:
            console.print(watch.table())
        size = (folder / NAME).stat().st_size / told.frames
    out.close()
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0 - watch.start_mib
    console.print(f"record: {size:.0f} bytes per frame")
    console.print(f"most memory, the report's included: {most:.0f} MiB above the start")
    console.print(f"report: {time.process_time() - watch.since:.0f} s of processor time")


def answer_from(recording: Recording) -> None:
    """Let frames be answered as those of a recording, again and again."""
    answers = list(Stream(recording, Settings()).answers())

    def update(self: Follower, frame: Frame) -> Answer:
        known = answers[self.row % len(answers)]
        estimates = {
            name: replace(one, time=frame.time, source_index=frame.source_index)
            for name, one in known.estimates.items()
        }
        answer = known._replace(row=self.row, frame=frame, estimates=estimates)
        self.row += 1
        return answer

    Follower.update = update


def resident_mib() -> float:
    """Memory of this process that is resident now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


if __name__ == "__main__":
    main()
