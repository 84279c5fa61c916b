"""Evaluate batches in this process, in local processes, or on a Dask cluster.

Each executor takes the name of a study and its batches, and yields each batch with its outcomes, in
any order. A worker uses one thread, so whole batches run in parallel, not parts of a batch.
"""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import connection
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Int

from papers.sweeps.study import Failure, Table, Values, code_version, evaluate_batch

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "NPROC": "1",  # the pool of threads of JAX's CPU client
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}


class Batch(NamedTuple):
    """Cases to evaluate together: their row numbers in the study's table, and these rows."""

    cases: Int[np.ndarray, " batch"]
    table: Table


Outcome = tuple[Batch, Sequence[Values | Failure]]
Executor = Callable[[str, Sequence[Batch]], Iterator[Outcome]]


def in_process(name: str, batches: Sequence[Batch]) -> Iterator[Outcome]:
    """Evaluate one batch after the other in this process."""
    for batch in batches:
        yield batch, evaluate_batch(name, batch.table)


def local_processes(count: int) -> Executor:
    """An executor with worker processes on this machine; they end whenever this process ends."""

    def execute(name: str, batches: Sequence[Batch]) -> Iterator[Outcome]:
        context = multiprocessing.get_context("spawn")
        with (
            _environment(ONE_THREAD),
            ProcessPoolExecutor(count, context, _end_with_the_parent) as pool,
        ):
            futures = {pool.submit(_work, name, None, batch.table): batch for batch in batches}
            try:
                for future in as_completed(futures):
                    yield futures[future], future.result()
            except BrokenProcessPool as error:
                raise OSError(
                    "a worker process died, perhaps out of memory; finished cases are stored: "
                    "run the same command again to resume"
                ) from error
            finally:
                pool.shutdown(wait=False, cancel_futures=True)

    return execute


def _end_with_the_parent() -> None:
    """Watch the parent from a thread, and end this process as soon as the parent is gone.

    The parent's sentinel becomes ready however the parent ends, even if it is killed. Without a
    parent the worker's current batch would have no receiver.
    """

    def watch(sentinel: int) -> None:
        connection.wait([sentinel])
        os._exit(1)

    parent = multiprocessing.parent_process()
    assert parent is not None  # called in a worker only
    threading.Thread(target=watch, args=(parent.sentinel,), daemon=True).start()


def on_cluster(address: str, patience: float = 10.0) -> Executor:
    """An executor on the workers of a Dask scheduler; workers may join or leave while it runs.

    Args:
        address: address of the scheduler, for example tcp://127.0.0.1:8786.
        patience: longest wait for the scheduler and for the first worker [s].
    """
    from distributed import Client, KilledWorker, as_completed
    from distributed.client import FutureCancelledError

    def execute(name: str, batches: Sequence[Batch]) -> Iterator[Outcome]:
        try:
            client = Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError) as error:
            raise OSError(
                f"no Dask scheduler answers at {address} ({error}): start one with `dask scheduler`"
            ) from error
        with client:
            version = code_version(name)
            _check_workers(client, name, version, patience)
            futures = {
                client.submit(_work, name, version, batch.table, pure=False): batch
                for batch in batches
            }
            for future in as_completed(list(futures), loop=client.loop):
                batch = futures.pop(future)
                try:
                    yield batch, future.result()
                except KilledWorker as error:
                    yield batch, [Failure(f"KilledWorker: {error}"[:200])] * len(batch.cases)
                except FutureCancelledError as error:
                    raise OSError(
                        f"the scheduler at {address} disconnected; finished cases are stored: "
                        "run the same command again to resume"
                    ) from error

    return execute


def _check_workers(client, name: str, version: str, patience: float) -> None:
    """Check that every worker has this version of the package and one thread.

    Raises:
        ValueError: a worker has another version, several threads, or cannot import the package.
        OSError: there is no worker.
    """
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError as error:
        raise OSError(f"the scheduler has no workers after {patience:g} s") from error
    for worker, properties in client.scheduler_info(n_workers=-1)["workers"].items():
        if properties["nthreads"] != 1:
            raise ValueError(
                f"the worker {worker} has {properties['nthreads']} threads: start it with "
                "--nthreads 1"
            )
    package = __package__ or "papers.sweeps"
    for module in dict.fromkeys((package, name)):  # a worker may lack this package: use Python's
        for worker, answer in client.run(import_module, module, on_error="return").items():
            if isinstance(answer, Exception):
                raise ValueError(
                    f"the worker {worker} cannot import {module} ({answer}): install this package "
                    "in its environment"
                )
    for worker, answer in client.run(code_version, name).items():
        if answer != version:
            raise ValueError(
                f"the worker {worker} has version {answer} of the code, this process {version}: "
                "install the same, and start the worker anew"
            )


def _work(name: str, version: str | None, table: Table) -> Sequence[Values | Failure]:
    """Evaluate a batch in a worker."""
    for key, value in ONE_THREAD.items():  # before its first use of JAX
        os.environ.setdefault(key, value)
    jax.config.update("jax_enable_x64", True)
    if version is not None and code_version(name) != version:  # a worker that came late
        raise ValueError(
            f"a worker does not have version {version} of the code: stop it and run again"
        )
    return evaluate_batch(name, table)


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that start inside the `with` block."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
