"""Pictures per second from a continuous marker pattern to the angle, and where the time goes.

`python -m tests.benchmarks.corners`: rendered pivots, 640×480, 400 corners, one picture at a time.
Beside the time by the clock stands that of the processor: on a busy machine they differ.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is imported
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from estimation.images.board import connect_corners, read_cells
from estimation.images.corner_tracking import to_light
from estimation.images.corners import find_corners, fit_corners
from estimation.images.pattern import Pattern, render_pattern
from estimation.images.placing import place_board
from estimation.images.render import Camera
from estimation.images.rings import find_saddles, read_rings
from estimation.noise import Noise
from estimation.sensor import Sensor
from estimation.sources.corners import CornerReader
from estimation.sources.markers import ImageSettings
from estimation.sources.pictures import Picture
from estimation.tracker import Tracker
from estimation.virtual.recording import PivotModel
from estimation.virtual.surface import simulate_surface

REPEATS = 40


def main() -> None:
    """Print the table."""
    jax.config.update("jax_enable_x64", True)
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    camera, rng = Camera(), np.random.default_rng(0)
    model = PivotModel(pitch=23.0 * camera.mm_per_px, friction_ratio=0.3)
    pattern = Pattern.coded((20, 20), model.pitch)
    motions, _ = simulate_surface(model, np.array([0.0, 1.0]), np.radians([0.0, 8.0]))
    rest, turned = (
        render_pattern(
            camera, lambda points, move=move: camera.project(move(points)[:, :2]), pattern, rng
        )
        for move in motions
    )
    sensor = Sensor(mm_per_px=camera.mm_per_px)
    reader = CornerReader(Picture(rest, 0.0, 0), ImageSettings(sensor))
    tracker = Tracker(reader.layout, noise=Noise.given(4e-4))
    clock = iter(range(10**6))

    def whole() -> None:
        frame = reader.frame(reader.read(Picture(turned, 0.0, 0)))
        tracker.update(replace(frame, time=float(next(clock))))

    grey, style, plan = to_light(turned), reader.tracker.style, reader.tracker.plan
    seeds = find_saddles(grey, style.radius).astype(float)
    rings = read_rings(grey, seeds, style.radius)
    rings = rings.take(rings.good)
    corners = find_corners(grey, style)
    board = connect_corners(corners, style.pitch)
    cells = [read_cells(grey, corners, board, 0)]
    frame = reader.frame(reader.read(Picture(turned, 0.0, 0)))
    stages: dict[str, Callable[[], object]] = {
        "picture to angle": whole,
        "  saddles": lambda: find_saddles(grey, style.radius),
        "  rings": lambda: read_rings(grey, seeds, style.radius),
        "  fit": lambda: fit_corners(grey, rings, style),
        "  neighbours": lambda: connect_corners(corners, style.pitch),
        "  place": lambda: place_board(plan, corners, board, cells),
        "  read, all stages": lambda: reader.read(Picture(turned, 0.0, 0)),
        "  estimate (`tracked`)": lambda: tracker.update(replace(frame, time=float(next(clock)))),
    }
    table = Table("stage", "median [ms]", "least [ms]", "processor, median [ms]", "per second")
    for stage, call in stages.items():
        wall, busy = time_calls(call)
        table.add_row(
            stage,
            *(f"{1e3 * one:.2f}" for one in (np.median(wall), wall.min(), np.median(busy))),
            f"{1.0 / np.median(busy):.0f}",
        )
    Console().print(f"{len(corners.position)} corners, {REPEATS} times, one core")
    Console().print(table)


def time_calls(call: Callable[[], object]) -> tuple[np.ndarray, np.ndarray]:
    """Seconds by the clock and of the processor, after three calls to warm up."""
    wall, busy = [], []
    for repeat in range(REPEATS + 3):
        start, used = time.perf_counter(), time.process_time()
        call()
        if repeat >= 3:
            wall.append(time.perf_counter() - start)
            busy.append(time.process_time() - used)
    return np.array(wall), np.array(busy)


if __name__ == "__main__":
    main()
