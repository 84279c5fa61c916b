"""Memory and time of a long stream.

`python -m tests.benchmarks.long_stream --frames 1000000`: the virtual pivot with 400 markers is
repeated, and answered by every method, with table, record and report. `--answered` reuses the
answers of one pivot, to measure sinks and report without the methods. `--chosen` runs the chosen
method only, as a tracker of your own does. `--live` passes frames through the thread and the queue
of `live --fast`, with lines to a reader. `--pictures` does the same with pictures of 640×480 with
70 dots.
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
from estimation.inputs import Input
from estimation.live.feed import Feed
from estimation.live.source import open_live, play
from estimation.output.record import RECORD_NAME
from estimation.output.sinks.lines import JsonWriter
from estimation.output.sinks.outlet import Outlet
from estimation.run import run_all
from estimation.settings import Settings
from estimation.tracking.stream import Answer, Follower, Stream
from estimation.virtual.recording import simulate_pivot
from tests.benchmarks.arguments import make_parser
from tests.benchmarks.inputs import repeat, write_loop

PARTS = 10
"""Rows of the table."""


@dataclass
class Watch:
    """A sink that records time and memory after each part of the frames, and after a minute."""

    frames: int
    start_mib: float = field(default_factory=lambda: resident_mib())
    rows: list[tuple[int, float, float]] = field(default_factory=list)
    since: float = field(default_factory=time.process_time)
    counted: int = 0
    minute: float = field(default_factory=lambda: time.monotonic() + 60.0)

    def put(self, answer: Answer) -> None:
        """Count an answer."""
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
        """Do nothing."""

    def table(self) -> Table:
        """The recorded times and memory."""
        table = Table("frames", "processor time per frame [ms]", "memory above the start [MiB]")
        for done, spent, memory in self.rows:
            table.add_row(str(done), f"{spent:.3f}", f"{memory:.0f}")
        return table


def main() -> None:
    """Print the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--frames", type=int, default=20_000, help="number of frames")
    parser.add_argument("--answered", action="store_true", help="measure without the methods")
    parser.add_argument("--chosen", action="store_true", help="run the chosen method only")
    parser.add_argument("--live", action="store_true", help="use the thread of `live`")
    parser.add_argument("--pictures", action="store_true", help="track pictures live")
    arguments = parser.parse_args()
    recording, _ = simulate_pivot(seed=0)
    if arguments.answered:
        answer_from(recording)
    if arguments.chosen:
        Settings.methods = property(lambda self: {self.method: self.constants})
    console, out = Console(), Outlet[str](lambda line: None)
    with tempfile.TemporaryDirectory() as name:
        folder, settings = Path(name) / "out", Settings()
        one = Input(FrameStream(recording.layout, repeat(recording, arguments.frames)))
        if arguments.pictures:
            write_loop(Path(name) / "clip", arguments.frames)
            one, _ = open_live(f"{name}/clip", settings, LiveChoices(fast=True), print)
        elif arguments.live:
            feed = Feed("stream", LiveChoices(fast=True), print, recorded=True)
            one = Input(play(one.source, feed), notes=feed.notes)
        watch = Watch(arguments.frames)
        sinks = [watch, JsonWriter(out.send, settings.method)]
        try:
            run_all([one], folder, settings, Progress(disable=True), sinks)
        finally:
            console.print(watch.table())
        size = (folder / RECORD_NAME).stat().st_size / arguments.frames
    out.close()
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0 - watch.start_mib
    console.print(f"record: {size:.0f} bytes per frame")
    console.print(f"most memory, the report's included: {most:.0f} MiB above the start")
    console.print(f"report: {time.process_time() - watch.since:.0f} s of processor time")


def answer_from(recording: Recording) -> None:
    """Replace the methods: answer frames with the repeated answers of a recording."""
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
    """Resident memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


if __name__ == "__main__":
    main()
