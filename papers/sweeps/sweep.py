"""Run a study over its cases, keep what is done, go on where it was stopped."""

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
    tell: Callable[[int, int], None] = lambda finished, total: None,
) -> Results:
    """Evaluate the cases of a study that are not in its store yet.

    However it is stopped, run again it evaluates only what is missing. Cases that failed stay
    failed; to try them again, remove the store.

    Args:
        name: module of the study.
        path: folder of the store.
        executor: where the batches are evaluated.
        quick: the small table instead of the whole one.
        tell: told how many cases are finished, of how many; at first and after each batch.

    Raises:
        ValueError: no such study, or a store that does not belong to it.
        OSError: the store cannot be written, or the workers went away.
    """
    study = find_study(name)
    table = study.cases(quick)
    with lock(path):
        store = Store(path, name, code_version(name), table)
        cases, total = store.open_cases, len(next(iter(table.values())))
        finished = total - len(cases)
        tell(finished, total)
        batches = [
            Batch(rows, {key: column[rows] for key, column in table.items()})
            for rows in make_batches(study, table, cases)
        ]
        for batch, outcomes in executor(name, batches):
            store.write(batch.cases, outcomes)
            finished += len(outcomes)
            tell(finished, total)
    return read_results(path)


def run_study(name: str, quick: bool, track: Track = iter) -> Results:
    """The results of a study, for an item to draw: what its store lacks is evaluated here.

    The quick table is evaluated without a store.

    Args:
        name: module of the study.
        quick: the small table instead of the whole one.
        track: wraps the batches, to show progress.
    """

    def execute(name: str, batches: Sequence[Batch]) -> Iterator[Outcome]:
        for batch in track(batches):
            yield from in_process(name, [batch])

    if not quick:
        return run_sweep(name, store_path(name, quick), execute)
    with TemporaryDirectory() as folder:
        return run_sweep(name, Path(folder) / "quick.zarr", execute, quick=True)


def store_path(name: str, quick: bool) -> Path:
    """Where a study's results are kept unless told otherwise."""
    return Path("build/sweeps") / f"{name}{'-quick' if quick else ''}.zarr"
