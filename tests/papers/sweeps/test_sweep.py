"""Sweeps in this process and in local ones: results, resumption, failed cases, bad stores."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest

from papers.sweeps import find_study, in_process, local_processes, read_results, run_sweep
from papers.sweeps.store import lock
from papers.sweeps.study import Study, make_batches
from tests.papers.sweeps.squares import CASES, STUDY

SQUARES = "tests.papers.sweeps.squares"
ROOT = Path(__file__).parents[3]


def assert_right(results):
    x, cells = results.table["x"], results.table["cells"]
    assert results.done.sum() == CASES - 1
    assert not results.done[13]
    assert results.failures == {13: "ValueError: 13 has no square"}
    np.testing.assert_array_equal(results.values["square"][results.done], x[results.done] ** 2)
    np.testing.assert_array_equal(results.values["sum"][results.done, 1], (x * cells)[results.done])
    assert np.isnan(results.values["square"][13])


def test_every_case_is_done_or_says_why_not(tmp_path):
    steps = []
    results = run_sweep(SQUARES, tmp_path / "a.zarr", report=lambda *step: steps.append(step))
    assert_right(results)
    assert steps[0] == (0, CASES)
    assert steps[-1] == (CASES, CASES)


def test_traced_cases_are_batched_and_a_failed_one_does_not_spoil_its_batch(tmp_path):
    results = run_sweep("tests.papers.sweeps.traced", tmp_path / "a.zarr")
    assert results.done.sum() == CASES - 1
    assert "13 has no square" in results.failures[13]
    x = results.table["x"][results.done]
    # sums of up to 3 numbers: exact
    np.testing.assert_array_equal(results.values["square"][results.done], x**2)
    cells = results.table["cells"][results.done]
    np.testing.assert_array_equal(results.values["sum"][results.done, 0], x * cells)


def test_batches_hold_cases_of_equal_shape_and_every_case_once():
    table = STUDY.cases(False)
    batches = list(make_batches(STUDY, table, np.arange(CASES)))
    assert all(len(set(table["cells"][batch])) == 1 for batch in batches)
    assert sorted(np.concatenate(batches)) == list(range(CASES))
    assert max(map(len, batches)) == STUDY.batch


def test_a_killed_sweep_goes_on_without_losing_or_repeating_a_case(tmp_path):
    log, store = tmp_path / "log", tmp_path / "a.zarr"
    environment = os.environ | {"SQUARES_LOG": str(log), "SQUARES_PAUSE": "0.1"}
    command = [sys.executable, "-m", "papers", "sweep", SQUARES, "--store", str(store)]
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL)
    while not log.exists() or len(log.read_text().split()) < 12:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = read_results(store)
    assert 0 < kept.done.sum() < CASES - 1
    subprocess.run(
        command, cwd=ROOT, env=environment | {"SQUARES_PAUSE": "0"}, check=True, capture_output=True
    )
    assert_right(read_results(store))
    evaluated = Counter(log.read_text().split())
    assert len(evaluated) == CASES
    again = {case for case, times in evaluated.items() if times > 1}
    assert len(again) <= STUDY.batch  # the batch that was in work when it was killed
    assert not again & {f"{x:g}" for x in kept.table["x"][kept.done]}


def test_workers_end_with_their_parent_and_what_was_done_is_stored(tmp_path):
    log, store = tmp_path / "log", tmp_path / "a.zarr"
    environment = os.environ | {"SQUARES_LOG": str(log), "SQUARES_PAUSE": "0.05"}
    command = ["-m", "papers", "sweep", SQUARES, "--workers", "2", "--store", str(store)]
    process = subprocess.Popen(
        [sys.executable, *command], cwd=ROOT, env=environment, stderr=subprocess.DEVNULL
    )
    while not log.exists() or len(log.read_text().split()) < 5 * STUDY.batch:
        time.sleep(0.02)
    children = psutil.Process(process.pid).children(recursive=True)
    assert len(children) >= 2
    process.kill()  # which nobody can handle; SIGTERM, unhandled, ends a process alike
    process.wait()
    _, left = psutil.wait_procs(children, timeout=10.0)
    assert left == []
    evaluated = log.read_text().split()
    kept = read_results(store)
    # each of two workers may have had a batch in work, and another on its way to the store
    assert kept.done.sum() + len(kept.failures) >= len(evaluated) - 4 * STUDY.batch > 0


def test_a_relative_path_is_as_good_as_a_whole_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # whose name is that of a group inside, so that zarr would cut it off inner paths
    assert run_sweep(SQUARES, Path("results"), quick=True).done.all()
    assert read_results(Path("results")).done.all()
    assert run_sweep(SQUARES, tmp_path / "results", quick=True).done.all()


def test_local_processes_do_the_same(tmp_path):
    assert_right(run_sweep(SQUARES, tmp_path / "a.zarr", local_processes(2)))


def test_a_finished_sweep_evaluates_nothing(tmp_path):
    run_sweep(SQUARES, tmp_path / "a.zarr")

    def refuse(name, batches):
        assert not batches
        return iter(())

    assert_right(run_sweep(SQUARES, tmp_path / "a.zarr", refuse))


def test_a_store_left_half_made_is_made_anew(tmp_path):
    left = tmp_path / ".a.zarr.new"  # killed while the table was written
    left.mkdir()
    (left / "zarr.json").write_text("{")
    assert run_sweep(SQUARES, tmp_path / "a.zarr", quick=True).done.all()
    assert not left.exists()


@pytest.mark.parametrize("lost", ["state", "results", "zarr.json", "cases/x", "results/sum/c"])
def test_a_half_written_store_is_refused_and_left_as_it_is(tmp_path, lost):
    store = tmp_path / "a.zarr"
    run_sweep(SQUARES, store, quick=True)
    path = store / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    before = sorted(store.rglob("*"))
    with pytest.raises(ValueError, match="not a complete store"):
        run_sweep(SQUARES, store, quick=True)
    assert sorted(store.rglob("*")) == before


def test_a_store_of_another_table_or_version_is_refused(tmp_path, monkeypatch):
    store = tmp_path / "a.zarr"
    run_sweep(SQUARES, store, quick=True)
    with pytest.raises(ValueError, match=r"has table .*another folder"):
        run_sweep(SQUARES, store)
    monkeypatch.setattr("papers.sweeps.sweep.code_version", lambda name: "0.0.1+old")
    with pytest.raises(ValueError, match=r"has version .* sweep 0\.0\.1\+old"):
        run_sweep(SQUARES, store, quick=True)
    assert read_results(store).done.sum() == 4


def test_two_sweeps_cannot_write_to_one_store(tmp_path):
    with lock(tmp_path / "a.zarr"), pytest.raises(ValueError, match="another sweep is writing"):
        run_sweep(SQUARES, tmp_path / "a.zarr", in_process, quick=True)


@pytest.mark.parametrize(
    ("name", "message"),
    [("papers.nothing", "no study 'papers.nothing'"), ("papers.sweeps", "defines no study")],
)
def test_unknown_studies_are_named(name, message):
    with pytest.raises(ValueError, match=message):
        find_study(name)


def test_results_of_another_shape_are_a_failed_case(tmp_path, monkeypatch):
    def evaluate(x, cells):
        return {"sum": np.zeros(3 if x == 2 else 2)}

    odd = Study(STUDY.cases, evaluate, traced=False)
    monkeypatch.setattr("tests.papers.sweeps.squares.STUDY", odd)
    results = run_sweep(SQUARES, tmp_path / "a.zarr", quick=True)
    assert results.failures == {2: "sum has shape (3,), in the other cases (2,)"}
    assert results.done.sum() == 3
