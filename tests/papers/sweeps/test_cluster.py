"""Sweeps on a real Dask cluster of two worker processes."""

import os
import signal
from collections import Counter

import numpy as np
import pytest
from distributed import LocalCluster

from papers.sweeps import on_cluster, run_sweep
from tests.papers.sweeps.squares import CASES, STUDY
from tests.papers.sweeps.test_sweep import SQUARES, assert_right

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)  # sockets of a process that was killed


def cluster(n_workers=2, threads_per_worker=1, **options) -> LocalCluster:
    return LocalCluster(
        n_workers=n_workers,
        threads_per_worker=threads_per_worker,
        dashboard_address=None,
        processes=True,
        **options,
    )


def test_a_worker_killed_in_mid_sweep_costs_nothing(tmp_path):
    log = tmp_path / "log"
    with cluster(env={"SQUARES_LOG": str(log), "SQUARES_PAUSE": "0.1"}) as workers:
        victim = workers.workers[0].pid
        steps = []

        def kill_in_the_middle(finished, total):
            steps.append(finished)
            if len(steps) == 3:
                os.kill(victim, signal.SIGKILL)

        results = run_sweep(
            SQUARES,
            tmp_path / "a.zarr",
            on_cluster(workers.scheduler_address),
            report=kill_in_the_middle,
        )
    assert_right(results)
    assert steps[-1] == CASES
    evaluated = Counter(log.read_text().split())
    assert len(evaluated) == CASES
    # what the dead worker had in work or in memory, not yet stored, is done again
    assert sum(times > 1 for times in evaluated.values()) <= 4 * STUDY.batch


def test_a_worker_without_the_package_is_named(tmp_path):
    hide = tmp_path / "hide.py"
    hide.write_text("import sys\nsys.modules['papers'] = None\n")
    with (
        cluster(preload=[str(hide)]) as workers,
        pytest.raises(ValueError, match=r"cannot import papers.*install"),
    ):
        run_sweep(SQUARES, tmp_path / "a.zarr", on_cluster(workers.scheduler_address), quick=True)
    assert_nothing_lost(tmp_path)


def test_a_worker_of_another_version_is_named(tmp_path):
    old = tmp_path / "old.py"
    old.write_text(
        "import papers.sweeps.study as study\nstudy.code_version = lambda name: '0.0.1+old'\n"
    )
    with (
        cluster(n_workers=1, preload=[str(old)]) as workers,
        pytest.raises(ValueError, match=r"has version 0\.0\.1\+old of the code.*install the same"),
    ):
        run_sweep(SQUARES, tmp_path / "a.zarr", on_cluster(workers.scheduler_address), quick=True)
    assert_nothing_lost(tmp_path)


def test_a_worker_of_many_threads_is_named(tmp_path):
    with (
        cluster(n_workers=1, threads_per_worker=2) as workers,
        pytest.raises(ValueError, match=r"has 2 threads: start it with --nthreads 1"),
    ):
        run_sweep(SQUARES, tmp_path / "a.zarr", on_cluster(workers.scheduler_address), quick=True)
    assert_nothing_lost(tmp_path)


def test_a_scheduler_without_workers_is_told(tmp_path):
    with cluster(n_workers=0) as empty:
        execute = on_cluster(empty.scheduler_address, patience=0.5)
        with pytest.raises(OSError, match=r"has no workers after 0\.5 s"):
            run_sweep(SQUARES, tmp_path / "a.zarr", execute, quick=True)
    assert_nothing_lost(tmp_path)


def test_a_scheduler_that_does_not_answer_is_named(tmp_path):
    with pytest.raises(OSError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1"):
        run_sweep(
            SQUARES, tmp_path / "a.zarr", on_cluster("tcp://127.0.0.1:1", patience=1.0), quick=True
        )
    assert_nothing_lost(tmp_path)


def assert_nothing_lost(folder):
    results = run_sweep(SQUARES, folder / "a.zarr", quick=True)
    np.testing.assert_array_equal(results.values["square"], results.table["x"] ** 2)
