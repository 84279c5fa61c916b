"""Data lost when a live run is killed.

`python -m tests.benchmarks.kills --kills 20`: `live` plays the virtual pivot repeatedly, writes an
MCAP file too, and is killed (SIGKILL) at a random moment. The lines on standard output are compared
with the rows of the table, the record and the MCAP file, read by independent tools. The loss of a
file is the time from its last row to the last line.
"""

import csv
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from rich.console import Console
from rich.table import Table

from estimation.frames.archive import write_archive
from estimation.frames.source import record_frames
from estimation.virtual.recording import simulate_pivot
from tests.benchmarks.arguments import make_parser
from tests.benchmarks.inputs import repeat

FRAMES = 4000


def main() -> None:
    """Print a table with a row for each kill."""
    parser = make_parser(__doc__)
    parser.add_argument("--kills", type=int, default=20, help="number of killed runs")
    parser.add_argument("--seed", type=int, default=0, help="seed of the moments")
    arguments = parser.parse_args()
    rng, worst = np.random.default_rng(arguments.seed), np.zeros(3)
    table = Table("run [s]", "lines", "lost of table [s]", "of record [s]", "of MCAP file [s]")
    recording, _ = simulate_pivot(seed=0)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "long.npz"
        write_archive(record_frames(recording.layout, list(repeat(recording, FRAMES))), path)
        for number in range(arguments.kills):
            alive = float(rng.uniform(0.1, 6.0))
            stamps, files = kill_after(alive, path, Path(name) / f"out{number}")
            lost = [stamps[-1] - stamps[min(rows, len(stamps)) - 1] for rows in files]
            worst = np.maximum(worst, lost)
            table.add_row(f"{alive:.2f}", str(len(stamps)), *(f"{one:.3f}" for one in lost))
    Console().print(table)
    Console().print(f"most that was lost: {worst.max():.3f} s")


def kill_after(alive: float, path: Path, out: Path) -> tuple[list[float], list[int]]:
    """Kill a run some seconds after its first line.

    Returns:
        Times of its lines [s], and the numbers of rows in the table, the record and the MCAP file.
    """
    arguments = [str(path), "--fast", "--noise-um", "1", "--sink", "mcap", "--out", str(out)]
    command = [sys.executable, "-m", "estimation", "live", *arguments]
    stamps: list[float] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as run:
        assert run.stdout is not None
        for _ in run.stdout:
            stamps.append(time.monotonic())
            if stamps[-1] > stamps[0] + alive and run.poll() is None:
                run.send_signal(signal.SIGKILL)
    return stamps[1:], count_rows(out / "unfinished")  # the first line is the header


def count_rows(folder: Path) -> list[int]:
    """Numbers of complete rows in the table, the record and the MCAP file."""
    with (folder / "angles.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert all(len(row) == len(header) for row in rows[:-1])
    database = sqlite3.connect(folder / "record.sqlite")
    recorded = database.execute("SELECT COUNT(*) FROM frames").fetchone()[0]
    database.close()
    answered = 0
    with (folder / "frames.mcap").open("rb") as file:
        try:
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                answered += channel.topic == "/contactmodel/answer"
        except EndOfFile:
            pass
    return [len(rows), recorded, answered]


if __name__ == "__main__":
    main()
