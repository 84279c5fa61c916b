"""Solves per second of the atlas with one worker and with two: `python -m tests.benchmarks.sweep`.

Paths of 40 steps on 64² cells, sampled from the whole table, are solved alternately with one worker
and with two. The machine's load is printed before each, since other programs slow both down. Every
worker first solves the same batch, and the clock starts when all have finished it. So starting and
compiling are excluded, and the timed work is the same for any number of workers.
"""

import os
import time

import jax
import numpy as np

from papers.model_error import atlas
from papers.sweeps import local_processes
from papers.sweeps.executors import Batch
from tests.benchmarks.arguments import make_parser

CASES = 32
TURNS = 2
NAME = "papers.model_error.atlas"


def measure(workers: int) -> float:
    """Solves per second with a number of workers."""
    table = atlas.cases(quick=False)
    cases = np.random.default_rng(0).permutation(len(table["cells"]))[:CASES]
    batches = [
        Batch(rows, {key: column[rows] for key, column in table.items()})
        for rows in np.split(cases, len(cases) // atlas.STUDY.batch)
    ]
    ends = []
    for _ in local_processes(workers)(NAME, [batches[0]] * workers + batches):
        ends.append(time.perf_counter())
    return len(cases) * sum(atlas.STEPS) / (ends[-1] - ends[workers - 1])


if __name__ == "__main__":
    make_parser(__doc__).parse_args()
    jax.config.update("jax_enable_x64", True)
    found = {1: [], 2: []}
    for workers in [1, 2] * TURNS:
        load = os.getloadavg()[0]
        found[workers].append(measure(workers))
        print(f"load {load:.1f}, workers {workers}: {found[workers][-1]:.1f} solves/s", flush=True)
    one, two = (np.mean(rates) for rates in found.values())
    print(f"two workers do {two / one:.2f} times as many")
