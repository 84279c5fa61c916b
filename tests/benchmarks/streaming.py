"""Processor time of the trackers on one core, by method and by stage.

`python -m tests.benchmarks.streaming`: the virtual pivot with 400 markers, one frame at a time.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is imported

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from estimation.estimators import METHODS, Rigid
from estimation.estimators.rotation import fit_rigid_rotation
from estimation.fields.contact import Region, find_contact
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.fields.stick import grow_stick_region
from estimation.frames.noise import Noise
from estimation.frames.recording import ONSET_MM, Frame, Recording
from estimation.tracking.tracker import Tracker
from estimation.virtual.recording import simulate_pivot
from tests.benchmarks.arguments import make_parser

REPEATS = 10


def main() -> None:
    """Print the tables."""
    make_parser(__doc__).parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    recording, _ = simulate_pivot(seed=0)
    markers = recording.positions.shape[1]
    noise = Noise.from_std(1e-3)
    console = Console()
    whole = Table("method", "frames/s", "median [ms]", "99th percentile [ms]", "largest [ms]")
    for method in METHODS:
        spent = 1e3 * time_updates(recording, method, noise)
        whole.add_row(
            method,
            f"{1e3 / spent.mean():.0f}",
            *(f"{value:.2f}" for value in (*np.percentile(spent, [50, 99]), spent.max())),
        )
    console.print(f"{len(recording)} frames of {markers} markers, {REPEATS} times, one core")
    console.print(whole)
    console.print("stages of `rigid`, frames with contact:")
    console.print(stage_table(recording, noise))


def time_updates(recording: Recording, method: str, noise: Noise) -> np.ndarray:
    """Processor time of every update [s], after one pass to warm up."""
    frames = list(recording)
    spent = []
    for repeat in range(REPEATS + 1):
        tracker = Tracker(recording.layout, method, noise=noise)
        for frame in frames:
            start = time.process_time()
            tracker.update(frame)
            if repeat:
                spent.append(time.process_time() - start)
    return np.array(spent)


def stage_table(recording: Recording, noise: Noise) -> Table:
    """Mean time of each stage, and its share."""
    stencils = make_stencils(recording.layout)
    rigid = Rigid(stencils, noise)
    spent = dict.fromkeys(("fields", "  of it contact", "growth by Eq. 15", "robust fit"), 0.0)

    def timed(stage: str, call: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        start = time.process_time()
        value = call(*args, **kwargs)
        spent[stage] += time.process_time() - start
        return value

    last: Region | None = None

    def stages(frame: Frame) -> bool:
        nonlocal last
        fields = timed("fields", measure_fields, stencils, frame, last=last)
        last = fields.region
        if not fields.contact.any():
            return False
        known = np.isfinite(fields.rotation)
        timed(
            "  of it contact",
            find_contact,
            stencils,
            fields.displacement,
            fields.indentation,
            known,
            ONSET_MM,
            None,
            last,
        )
        segment = timed(
            "growth by Eq. 15",
            grow_stick_region,
            fields,
            stencils.neighbours,
            threshold=rigid.settings.threshold,
            floor=rigid.floor,
        )
        if segment.sum() >= 3:
            timed("robust fit", fit_rigid_rotation, stencils, fields, segment, noise.in_plane)
        return True

    count = sum(stages(frame) for _ in range(REPEATS) for frame in recording)
    total = sum(value for stage, value in spent.items() if not stage.startswith(" "))
    table = Table("stage", "mean [ms]", "share [%]")
    for stage, value in spent.items():
        table.add_row(stage, f"{1e3 * value / count:.3f}", f"{100 * value / total:.0f}")
    return table


if __name__ == "__main__":
    main()
