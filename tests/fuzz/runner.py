"""Cases in processes of their own, which may hang, be killed or crash without ending the run."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import NamedTuple

from tests.fuzz.memory import limit_memory

SECONDS = 60.0
"""Processor time that a case may take."""
PATIENCE = 10.0
"""Times as long by the clock, after which a case has hung."""
MEGABYTES = 2000
"""Memory that a case may take, beyond what the process holds before its first."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


class Verdict(NamedTuple):
    """What came of a case.

    Attributes:
        case: its number.
        outcome: `answered`, `refused` or `failed`.
        damage: what was done to the input.
        message: why it was refused, or how it failed.
        seconds: of processor time that it took.
        megabytes: of memory, beyond what was in use before.
    """

    case: int
    outcome: str
    damage: str = ""
    message: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0


class Job(NamedTuple):
    """What the processes do; its functions are found by their names there.

    Attributes:
        run: a case, by its number.
        prepare: called before the first, with the memory not yet limited.
        seconds: of processor time that a case may take.
    """

    run: Callable[[int], Verdict]
    prepare: Callable[[], None] | None = None
    seconds: float = SECONDS


def run_cases(cases: Sequence[int], job: Job, workers: int = 1) -> Iterator[Verdict]:
    """The verdicts on cases, in their order."""
    every = [Worker(job) for _ in range(workers)]
    idle: SimpleQueue[Worker] = SimpleQueue()
    for worker in every:
        idle.put(worker)

    def run(case: int) -> Verdict:
        worker = idle.get()
        try:
            return worker.run(case)
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(run, cases)
    for worker in every:
        worker.close()


class Worker:
    """Runs cases, one after the other, in a process that is replaced when it hangs or dies."""

    def __init__(self, job: Job) -> None:
        """Start the process."""
        self._job = job
        self._start()

    def run(self, case: int) -> Verdict:
        """The verdict on a case."""
        self._connection.send(case)
        patience = PATIENCE * self._job.seconds
        if not self._connection.poll(patience):
            self._process.kill()
            return self._replace(case, f"gave no answer within {patience:.0f} s")
        try:
            return self._connection.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            if code == -signal.SIGPROF:
                return self._replace(case, f"took more than {self._job.seconds:.0f} s")
            return self._replace(case, f"the process died, exit code {code}")

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        self._process.join()

    def _start(self) -> None:
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._job), daemon=True)
        self._process.start()
        other.close()
        try:
            self._connection.recv()
        except EOFError as error:
            raise RuntimeError("the process that runs cases does not start, see above") from error

    def _replace(self, case: int, message: str) -> Verdict:
        self.close()
        self._start()
        return Verdict(case, "failed", message=message, seconds=self._job.seconds)


def _serve(connection: Connection, job: Job) -> None:
    """Run the cases that are asked for until there are no more."""
    if job.prepare is not None:
        job.prepare()
    limit_memory(MEGABYTES)
    connection.send("ready")
    while True:
        try:
            case = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_PROF, job.seconds)  # then SIGPROF ends the process
        verdict = job.run(case)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        connection.send(verdict)
