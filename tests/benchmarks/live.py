"""Processor time of each frame of `live`, from the first one of a new process on.

`python -m tests.benchmarks.live [SOURCE]`: a recording (default: the virtual pivot) is played as by
`live --fast`, with all methods, lines, table and record. Answers before the first 24 frames have
arrived are given in one batch. `--paced` plays it at its own pace and counts the lost frames.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is imported

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from contactmodel.common.command_line import lasting_imports
from tests.benchmarks.arguments import make_parser

with lasting_imports():
    from estimation.choices import LiveChoices
    from estimation.live.command import follow
    from estimation.live.feed import Feed
    from estimation.settings import Settings
    from estimation.tracking.stream import AHEAD_LIVE_FRAMES, Follower


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("source", nargs="?", default="", help="path or data set (default: pivot)")
    parser.add_argument("--paced", action="store_true", help="play it at its own pace")
    given = parser.parse_args()
    console = Console(stderr=True)  # standard output has the answers
    taken, answered = list[float](), list[float]()
    take, update = Feed._take, Follower.update

    def stamp(feed: Feed) -> Any:
        taken.append(time.thread_time())
        return take(feed)

    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(Feed, "_take", stamp),
        patch.object(Follower, "update", timed(update, answered)),
    ):
        choices = LiveChoices(fast=not given.paced)
        outcome = follow(given.source, Path(folder) / "out", Settings(), choices, console.print)
    spent = 1e3 * np.diff(taken)
    first, later = spent[AHEAD_LIVE_FRAMES - 1], spent[AHEAD_LIVE_FRAMES:]
    table = Table("processor time of", "[ms]")
    table.add_row(f"the first {AHEAD_LIVE_FRAMES} answers together", f"{first:.0f}")
    table.add_row("the longest of them", f"{1e3 * max(answered[:AHEAD_LIVE_FRAMES]):.0f}")
    for label, value in (
        ("a later frame, median", np.median(later)),
        ("99th percentile", np.percentile(later, 99)),
        ("largest", later.max()),
    ):
        table.add_row(label, f"{value:.1f}")
    console.print(table, *outcome.lines, sep="\n")


def timed(call: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    """The function, with the processor time of each call added to the list [s]."""

    def wrapper(*args: Any) -> Any:
        start = time.thread_time()
        value = call(*args)
        spent.append(time.thread_time() - start)
        return value

    return wrapper


if __name__ == "__main__":
    main()
