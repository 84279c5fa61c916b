"""Solves per second of the atlas with one worker and with two: `python -m tests.benchmarks.sweep`.

Twenty-four paths of 40 steps on 64² cells, spread over the whole table. The clock starts when every
worker has given back its first batch: starting and compiling are left out.
"""

import time

import jax
import numpy as np

from papers.model_error import atlas
from papers.sweeps import local_processes
from papers.sweeps.executors import Batch

CASES = 24
NAME = "papers.model_error.atlas"


def measure(workers: int) -> float:
    """Solves per second."""
    table = atlas.cases(quick=False)
    cases = np.random.default_rng(0).permutation(len(table["cells"]))[:CASES]
    batches = [
        Batch(rows, {key: column[rows] for key, column in table.items()})
        for rows in np.split(cases, len(cases) // atlas.STUDY.batch)
    ]
    ends = []
    for _ in local_processes(workers)(NAME, batches):
        ends.append(time.perf_counter())
    counted = (len(ends) - workers) * atlas.STUDY.batch * sum(atlas.STEPS)
    return counted / (ends[-1] - ends[workers - 1])


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    one, two = measure(1), measure(2)
    print(f"one worker {one:.1f}, two workers {two:.1f} solves/s: {two / one:.2f} times as many")
