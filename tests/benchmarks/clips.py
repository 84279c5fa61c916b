"""Processor time per picture of a run over a clip, by stage, on one core.

`python -m tests.benchmarks.clips CLIP…`: videos or folders of pictures are read, answered by every
method and written as by `python -m estimation run`, after some pictures to warm up. `--scale 2`
enlarges the pictures first; the decoding time is then that of BMP files.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is imported
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from itertools import islice
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import cv2
import jax
from rich.console import Console
from rich.table import Table

import estimation.pictures.dots.reader as dots
import estimation.pictures.reading as reading
from estimation.fields.outline import OutlineFollower
from estimation.frames.noise import Noise
from estimation.output.record import RecordWriter
from estimation.output.table import TableWriter
from estimation.pictures.hold import HoldFollower
from estimation.pictures.imprint.follower import ImprintFollower
from estimation.pictures.imprint.painted import Painted
from estimation.pictures.reading import PictureSource
from estimation.pictures.stream import count_pictures, read_pictures
from estimation.settings import Settings
from estimation.slip.margin import MarginWatch
from estimation.slip.onset import SlipWatch
from estimation.tracking.observation import Observer
from estimation.tracking.stream import Stream
from estimation.tracking.trackers import Trackers
from tests.benchmarks.arguments import make_parser

STAGES: tuple[tuple[str, ModuleType | type, str], ...] = (
    ("decode", reading, "read_pictures"),
    ("dots", dots.DotReader, "_find"),
    ("which dot is which", dots.DotTracker, "update"),
    ("without dots", dots, "paint_out"),
    ("without dots", Painted, "level"),
    ("contact region", dots.DotReader, "_contact"),
    ("print on the gel", HoldFollower, "update"),
    ("imprint", ImprintFollower, "update"),
    ("fields", Observer, "observe"),
    ("estimators", Trackers, "update"),
    ("slip and margin", OutlineFollower, "update"),
    ("slip and margin", SlipWatch, "update"),
    ("slip and margin", MarginWatch, "predict"),
    ("sinks", RecordWriter, "put"),
    ("sinks", TableWriter, "put"),
)
"""Timed functions; the time of a timed function excludes that of others that it calls."""


class Clock:
    """Processor time by stage [s], without the time of other stages called from it."""

    def __init__(self) -> None:
        """Start at 0."""
        self.spent: dict[str, float] = {}
        self._inner = [0.0]

    def wrap(self, stage: str, call: Callable) -> Callable:
        """The function with its time counted; for a generator, the time of each step."""

        def timed(*args: object, **kwargs: object) -> object:
            made = self._count(stage, lambda: call(*args, **kwargs))
            return self._steps(stage, made) if isinstance(made, Iterator) else made

        return timed

    def _steps(self, stage: str, steps: Iterator) -> Iterator:
        end = object()
        while (step := self._count(stage, lambda: next(steps, end))) is not end:
            yield step

    def _count(self, stage: str, call: Callable) -> object:
        self._inner.append(0.0)
        start = time.process_time()
        value = call()
        whole = time.process_time() - start
        self.spent[stage] = self.spent.get(stage, 0.0) + whole - self._inner.pop()
        self._inner[-1] += whole
        return value


def main() -> None:
    """Print a table for each clip."""
    parser = make_parser(__doc__)
    parser.add_argument(
        "clips", nargs="+", type=Path, metavar="CLIP", help="video or folder of pictures"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="factor of the pictures' size [-]")
    parser.add_argument("--warm-up", type=int, default=20, help="untimed pictures at the start")
    parser.add_argument(
        "--pictures", type=int, default=200, help="largest number of timed pictures"
    )
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cv2.setNumThreads(1)
    for clip in arguments.clips:
        with tempfile.TemporaryDirectory() as folder:
            path, most = clip, arguments.warm_up + arguments.pictures
            if arguments.scale != 1.0:
                path = enlarge(clip, arguments.scale, Path(folder) / "enlarged", most)
            measure(clip, path, Path(folder), arguments.warm_up, most)


def enlarge(clip: Path, scale: float, folder: Path, most: int) -> Path:
    """Write the first pictures of a clip at another size to a folder, and return it."""
    folder.mkdir()
    for picture in islice(read_pictures(clip), most):
        if picture.image is not None:
            image = cv2.resize(picture.image, None, fx=scale, fy=scale)
            cv2.imwrite(str(folder / f"{picture.number:05}.bmp"), image)
    return folder


def measure(clip: Path, path: Path, folder: Path, warm_up: int, most: int) -> None:
    """Time a run over the first pictures, and print the times."""
    warm_up = min(warm_up, (count_pictures(path) or most) // 2)
    clock, settings = Clock(), Settings(noise=Noise.from_std(0.01, "px"))
    with ExitStack() as opened:
        for stage, owner, name in STAGES:
            timed = clock.wrap(stage, getattr(owner, name))
            opened.enter_context(patch.object(owner, name, timed))
        source = PictureSource(path)
        stream = Stream(source, settings)
        record = RecordWriter(folder / "record.sqlite", tuple(settings.methods))
        table = TableWriter(folder / "angles.csv", settings.method, source.unit)
        sinks = (opened.enter_context(closing(record)), opened.enter_context(closing(table)))
        answers = stream.answers(*sinks)
        size = next(answers).frame.positions.shape[0]
        for _ in islice(answers, warm_up - 1):
            pass
        clock.spent.clear()
        start = time.process_time()
        count = sum(1 for _ in islice(answers, most - warm_up))
        whole = time.process_time() - start
    console = Console()
    console.print(
        f"{clip}: {size} markers, {count} pictures, {1e3 * whole / count:.2f} ms of processor time "
        f"each, {count / whole:.0f} a second"
    )
    shown = Table("stage", "mean [ms]", "share [%]")
    clock.spent["everything else"] = whole - sum(clock.spent.values())
    for stage, spent in clock.spent.items():
        shown.add_row(stage, f"{1e3 * spent / count:.2f}", f"{100 * spent / whole:.0f}")
    console.print(shown)


if __name__ == "__main__":
    main()
