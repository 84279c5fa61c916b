"""Memory and time of a stream that goes on for long.

`python -m tests.benchmarks.long_stream --frames 1000000`: the 400 markers of the virtual pivot,
again and again, answered by every method, with table, record and report. With `--answered` the
answers of one pivot are taken again and again: what sinks and report take, without the methods.
"""

import resource
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from estimation.frames.recording import Frame, Recording
from estimation.frames.source import FrameStream
from estimation.output.record import NAME
from estimation.run import run_all
from estimation.settings import Settings
from estimation.sources import Input
from estimation.tracking.stream import Answer, Follower, Stream
from estimation.virtual.recording import simulate_pivot
from tests.benchmarks.arguments import make_parser

PARTS = 10
"""Rows of the table."""


@dataclass
class Watch:
    """Time and memory whenever another part of the frames has gone by."""

    frames: int
    start_mib: float = field(default_factory=lambda: resident_mib())
    rows: list[tuple[int, float, float]] = field(default_factory=list)
    since: float = field(default_factory=time.process_time)

    def count(self, done: int) -> None:
        """So many frames have gone by."""
        if done % (self.frames // PARTS) == 0:
            now = time.process_time()
            spent = 1e3 * (now - self.since) / (self.frames // PARTS)
            self.rows.append((done, spent, resident_mib() - self.start_mib))
            self.since = now

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
    told = parser.parse_args()
    recording, _ = simulate_pivot(seed=0)
    if told.answered:
        answer_from(recording)
    watch, console = Watch(told.frames), Console()
    with tempfile.TemporaryDirectory() as folder:
        source = FrameStream(recording.layout, repeat(recording, watch))
        run_all([Input(source)], Path(folder), Settings(), Progress(disable=True))
        console.print(watch.table())
        size = (Path(folder) / NAME).stat().st_size / told.frames
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


def repeat(recording: Recording, watch: Watch) -> Iterator[Frame]:
    """The frames of a recording again and again, on one clock."""
    frames = list(recording)
    period = frames[-1].time - frames[0].time + 1.0
    for done in range(1, watch.frames + 1):
        turn, row = divmod(done - 1, len(frames))
        frame = frames[row]
        yield replace(frame, time=frame.time + turn * period, source_index=done - 1)
        watch.count(done)


def resident_mib() -> float:
    """Memory of this process that is resident now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


if __name__ == "__main__":
    main()
