"""Run a study over its cases, store finished cases, and resume an interrupted sweep."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from papers.items import Track
from papers.sweeps.executors import Batch, Executor, Outcome, in_process
from papers.sweeps.store import Results, Store, lock, read_results
from papers.sweeps.study import code_version, find_study, make_batches


def run_sweep(
    name: str,
    path: Path,
    executor: Executor = in_process,
    *,
    quick: bool = False,
    report: Callable[[int, int], None] = lambda finished, total: None,
) -> Results:
    """Evaluate the cases of a study that are not in its store yet.

    An interrupted sweep resumes with the missing cases. Failed cases are not tried again; remove
    the store to repeat them. `report` is called with the numbers of finished and of all cases,
    first and after each batch.

    Raises:
        ValueError: the study does not exist, or the store belongs to another study.
        OSError: the store cannot be written, or the connection to the workers is lost.
    """
    study = find_study(name)
    table = study.cases(quick)
    with lock(path):
        store = Store(path, name, code_version(name), table)
        cases, total = store.open_cases, len(next(iter(table.values())))
        finished = total - len(cases)
        report(finished, total)
        batches = [
            Batch(rows, {key: column[rows] for key, column in table.items()})
            for rows in make_batches(study, table, cases)
        ]
        for batch, outcomes in executor(name, batches):
            store.write(batch.cases, outcomes)
            finished += len(outcomes)
            report(finished, total)
    return read_results(path)


def run_study(name: str, quick: bool, track: Track = iter) -> Results:
    """The results of a study for an item; cases missing in the store are evaluated first.

    The quick table is evaluated without a permanent store.

    Raises:
        ValueError: a case failed.
    """

    def execute(name: str, batches: Sequence[Batch]) -> Iterator[Outcome]:
        for batch in track(batches):
            yield from in_process(name, [batch])

    with TemporaryDirectory() as folder:
        path = Path(folder) / "quick.zarr" if quick else store_path(name, quick)
        results = run_sweep(name, path, execute, quick=quick)
    if results.failures:
        raise ValueError(f"{len(results.failures)} cases of {name} failed: {results.failures}")
    return results


def store_path(name: str, quick: bool) -> Path:
    """The default folder of a study's store."""
    return Path("build/sweeps") / f"{name}{'-quick' if quick else ''}.zarr"
