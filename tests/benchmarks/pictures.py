"""Time from a picture in memory to the object's angle, for each kind of markers, on one core.

`python -m tests.benchmarks.pictures [KIND…]`: `ImageTracker` answers a rendered pivot, twisted to
8° and back, after one pass to warm up. A KIND may also be a real clip, with imprint: a video, a
folder of pictures, or a clip of the data set `pivot-videos` by name, such as
`screw_driver_blue_gray/exp_num_1/camera_0`. `--start` measures the first answer of a new process,
imports included.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is imported
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import NamedTuple
from unittest.mock import patch

import cv2
import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import estimation.pictures.corners.reader as corners
import estimation.pictures.corners.tracking as corner_tracking
import estimation.pictures.dots.reader as dots
import estimation.pictures.dots.style as style
import estimation.pictures.speckle.reader as speckle_source
import estimation.pictures.speckle.tracking as speckle
from estimation.frames import datasets
from estimation.frames.noise import Noise
from estimation.pictures.corners.pattern import Pattern, render_pattern
from estimation.pictures.dots.tracking import DotTracker
from estimation.pictures.hold import HoldFollower
from estimation.pictures.imprint.follower import ImprintFollower
from estimation.pictures.imprint.painted import Painted
from estimation.pictures.reader import ImageSettings
from estimation.pictures.render import Camera, project_discs, render_dots, scatter_speckle
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import read_pictures
from estimation.settings import Settings
from estimation.tracking.image_tracker import ImageTracker
from estimation.tracking.tracker import Tracker
from estimation.virtual.recording import PivotModel
from estimation.virtual.surface import Motion, simulate_surface
from tests.benchmarks.arguments import make_parser

ANGLES_DEG = (0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
PASSES = 6
LARGE = Camera()
SMALL = Camera(width=320, height=240)

Owner = ModuleType | type
STAGES: dict[str, list[tuple[str, Owner, str]]] = {
    "dots": [
        ("grey levels", dots, "to_grey"),
        ("seeds", style, "find_seeds"),
        ("fit to the table", style, "fit_alike"),
        ("fit in full", style, "fit_dots"),
        ("which dot is which", DotTracker, "update"),
        ("without dots", dots, "paint_out"),
        ("print around dots", Painted, "level"),
        ("contact region", dots.DotReader, "_contact"),
        ("print on the gel", HoldFollower, "update"),
        ("imprint", ImprintFollower, "update"),
        ("angle (`tracked`)", Tracker, "update"),
    ],
    "corners": [
        ("saddles and rings", corner_tracking, "find_corners"),
        ("neighbours", corner_tracking, "connect_corners"),
        ("cells", corner_tracking, "read_cells"),
        ("place", corner_tracking, "place_board"),
        ("contact region", corners, "region_of_dispersion"),
        ("rotation", corners, "measure_rotation"),
        ("angle (`tracked`)", Tracker, "update"),
    ],
    "speckle": [
        ("finer picture", speckle, "Sampler"),
        ("match", speckle, "match_subsets"),
        ("clipped", speckle, "count_clipped"),
        ("neighbours agree", speckle.SpeckleTracker, "_fits"),
        ("rotation", speckle_source, "measure_rotation"),
        ("angle (`tracked`)", Tracker, "update"),
    ],
}
"""Timed functions; none of them calls another."""


class Case(NamedTuple):
    """Pictures to measure."""

    name: str
    kind: str
    pictures: list[np.ndarray]
    mm_per_px: float | None


def main() -> None:
    """Print a table for each kind."""
    parser = make_parser(__doc__)
    kinds = f"{', '.join(CASES)}, or a path or name of a clip (default: all kinds)"
    parser.add_argument("kinds", nargs="*", default=list(CASES), metavar="KIND", help=kinds)
    parser.add_argument("--start", action="store_true", help="time the first answer instead")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for name in given.kinds:
        case = CASES[name]() if name in CASES else read_clip(name)
        (measure_start if given.start else measure)(case)


def render_dot_pictures(
    camera: Camera, shape: tuple[int, int], pitch_px: float, radius_px: float = 4.3
) -> Case:
    """Pictures of dots in rows."""
    pitch = pitch_px * camera.mm_per_px
    y, x = np.mgrid[: shape[0], : shape[1]].reshape(2, -1)
    centres = pitch * (np.stack([x, y], axis=1) - 0.5 * (np.array(shape[::-1]) - 1))
    rng = np.random.default_rng(0)
    taken = [
        render_dots(
            camera,
            *project_discs(
                camera, lambda p, m=m: m(p)[:, :2], centres, radius_px * camera.mm_per_px
            ),
            rng,
        )
        for m in motions(camera)
    ]
    return Case(f"{len(centres)} dots", "dots", taken, camera.mm_per_px)


def render_corner_pictures() -> Case:
    """Pictures of a coded checkerboard."""
    rng, pattern = np.random.default_rng(0), Pattern.coded((20, 20), 23.0 * LARGE.mm_per_px)
    taken = [
        render_pattern(LARGE, lambda p, m=m: LARGE.project(m(p)[:, :2]), pattern, rng)
        for m in motions(LARGE)
    ]
    return Case("400 corners", "corners", taken, LARGE.mm_per_px)


def render_speckle_pictures() -> Case:
    """Pictures of speckle."""
    rng, radius = np.random.default_rng(0), 2.0 * LARGE.mm_per_px
    size = (LARGE.width + 80) * LARGE.mm_per_px, (LARGE.height + 80) * LARGE.mm_per_px
    centres = scatter_speckle(size, radius, 0.45, rng)
    taken = [
        render_dots(LARGE, *project_discs(LARGE, lambda p, m=m: m(p)[:, :2], centres, radius), rng)
        for m in motions(LARGE)
    ]
    return Case("speckle", "speckle", taken, LARGE.mm_per_px)


def motions(camera: Camera) -> list[Motion]:
    """Motions of the surface in a pivot; the contact covers a third of the picture's height."""
    model = PivotModel(friction_ratio=0.3)
    assert camera.mm_per_px == LARGE.mm_per_px
    load = np.append(0.0, np.ones(len(ANGLES_DEG) - 1))
    return simulate_surface(model, load, np.radians(ANGLES_DEG)).motions


def read_clip(name: str) -> Case:
    """The first frames of a clip, given by its path or its name in `pivot-videos`."""
    path = Path(name)
    if not path.exists():
        path = datasets.fetch("pivot-videos").parents[1] / f"{name}.avi"
    taken = [p.image for _, p in zip(range(100), read_pictures(path), strict=False)]
    return Case(name, "dots", [one for one in taken if one is not None], None)


CASES: dict[str, Callable[[], Case]] = {
    "dots-320": lambda: render_dot_pictures(SMALL, (7, 10), 31.0),
    "dots-640-few": lambda: render_dot_pictures(LARGE, (8, 10), 58.0, 7.3),
    "dots-640": lambda: render_dot_pictures(LARGE, (20, 20), 22.0),
    "corners": render_corner_pictures,
    "speckle": render_speckle_pictures,
}


def measure(case: Case) -> None:
    """Time every frame and every stage, and print them."""
    images = ImageSettings(Sensor(marker=case.kind, mm_per_px=case.mm_per_px))
    noise = Noise.from_std(0.01 * images.scale, images.unit)
    tracker = ImageTracker(Settings(noise=noise, images=images))
    there_and_back = [*case.pictures, *case.pictures[:0:-1]]
    number, spent, wall = 0, [], []
    with timed_stages(case.kind) as stages:
        for repeat in range(PASSES + 1):
            if repeat == 1:
                stages.update(dict.fromkeys(stages, 0.0))
            for picture in there_and_back:
                start, used = time.perf_counter(), time.process_time()
                tracker.update(picture, float(number))
                number += 1
                if repeat:
                    spent.append(time.process_time() - used)
                    wall.append(time.perf_counter() - start)
    total = float(np.sum(spent))
    height, width = case.pictures[0].shape[:2]
    console = Console()
    console.print(
        f"{case.name}, {width}×{height}: {len(spent) / total:.0f} frames/s by processor time, "
        f"median {1e3 * np.median(spent):.2f} ms ({1e3 * np.median(wall):.2f} ms by the clock), "
        f"99th percentile {1e3 * np.percentile(spent, 99):.2f} ms "
        f"({1e3 * np.percentile(wall, 99):.2f} ms); {len(spent)} frames"
    )
    table = Table("stage", "mean [ms]", "share [%]")
    stages["everything else"] = total - sum(stages.values())
    for stage, value in stages.items():
        table.add_row(stage, f"{1e3 * value / len(spent):.3f}", f"{100 * value / total:.0f}")
    console.print(table)


def measure_start(case: Case) -> None:
    """Time new processes from their start to the first answer, imports included."""
    script = (
        "import sys, cv2; from estimation import ImageTracker; "
        "ImageTracker().update(cv2.imread(sys.argv[1], cv2.IMREAD_UNCHANGED), 0.0)"
    )
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        cv2.imwrite(str(path), case.pictures[0])
        for _ in range(PASSES):
            before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run([sys.executable, "-c", script, str(path)], check=True)
            wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            console.print(
                f"{case.name}: first answer after {wall:.2f} s, {spent:.2f} s of processor time"
            )


@contextmanager
def timed_stages(kind: str) -> Iterator[dict[str, float]]:
    """Measure the processor time of each stage [s]."""
    spent = {stage: 0.0 for stage, _, _ in STAGES[kind]}

    def timed(stage: str, call: Callable) -> Callable:
        def wrapper(*args: object, **kwargs: object) -> object:
            start = time.process_time()
            value = call(*args, **kwargs)
            spent[stage] += time.process_time() - start
            return value

        return wrapper

    patches = [
        patch.object(owner, name, timed(stage, getattr(owner, name)))
        for stage, owner, name in STAGES[kind]
    ]
    for one in patches:
        one.start()
    try:
        yield spent
    finally:
        for one in patches:
            one.stop()


if __name__ == "__main__":
    main()
