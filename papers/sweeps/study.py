"""A study: a pure function over a table of cases, named after the module that defines it.

The module defines `STUDY`, a `Study`. Workers receive only the module's name and the numbers of the
cases, and import the module themselves.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib import import_module
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Int, Shaped

from papers.items import hash_code

Table = Mapping[str, Shaped[np.ndarray, "_ ..."]]
Values = Mapping[str, Shaped[np.ndarray, "..."]]

_T = TypeVar("_T")

PHYSICS = ("contactmodel", "estimation", "calibration")
"""Packages on which a study depends by default: a change in them outdates its results."""


class Study(NamedTuple):
    """A function and its table of cases.

    Attributes:
        cases: returns the table, with a column for each argument of `evaluate`; its argument
            selects the small table.
        evaluate: maps one case, passed as keywords, to results by name. Their shapes must be the
            same in all cases. If it raises, the case fails, and the error is stored as its reason.
        static: columns that determine array shapes. They stay plain numbers, equal in a batch.
        batch: number of cases in a batch.
        traced: whether `evaluate` works under `jax.vmap`; otherwise cases are evaluated one by one.
        uses: packages on which the results depend.
    """

    cases: Callable[[bool], Table]
    evaluate: Callable[..., Mapping]
    static: tuple[str, ...] = ()
    batch: int = 1
    traced: bool = True
    uses: tuple[str, ...] = PHYSICS


class Failure(NamedTuple):
    """The reason why a case has no results."""

    reason: str


def find_study(name: str) -> Study:
    """The study of a module.

    Raises:
        ValueError: the module does not exist, or defines no study.
    """
    try:
        study = getattr(import_module(name), "STUDY", None)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"no study {name!r} ({error}): `python -m papers list` lists the studies; or give a "
            "module of your own"
        ) from error
    if not isinstance(study, Study):
        raise ValueError(f"{name} defines no study; it requires a variable STUDY of type Study")
    return study


def code_version(name: str) -> str:
    """Version of the code that a study's results depend on: a hash of its packages and module."""
    return hash_code(name, find_study(name).uses)


def table_hash(table: Table) -> str:
    """Hash of a table's names and numbers."""
    digest = hashlib.sha256()
    for name, column in sorted(table.items()):
        digest.update(f"{name} {column.dtype} {column.shape}".encode())
        digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()[:12]


def make_batches(
    study: Study, table: Table, cases: Int[np.ndarray, " open"]
) -> Iterator[Int[np.ndarray, " batch"]]:
    """Batches of case indices that can be evaluated together."""
    keys = [tuple(table[name][case].item() for name in study.static) for case in cases]
    for key in dict.fromkeys(keys):
        alike = cases[[other == key for other in keys]]
        for start in range(0, len(alike), study.batch):
            yield alike[start : start + study.batch]


def evaluate_batch(name: str, table: Table) -> Sequence[Values | Failure]:
    """Results of cases of equal shape, or the reasons of their failures, in the order of rows."""
    rows = _rows(table)
    if not find_study(name).traced:
        return [_attempt(_evaluate_plainly, name, row) for row in rows]
    together = _attempt(_evaluate_together, name, table)
    if not isinstance(together, Failure):
        return together
    alone = [_attempt(_evaluate_together, name, row) for row in rows]  # to find the failed cases
    return [outcome if isinstance(outcome, Failure) else outcome[0] for outcome in alone]


def _rows(table: Table) -> list[Table]:
    """A table of one row for each case."""
    count = len(next(iter(table.values())))
    return [{key: column[[i]] for key, column in table.items()} for i in range(count)]


def _attempt(evaluate: Callable[[str, Table], _T], name: str, table: Table) -> _T | Failure:
    """The results of a study's function, or the failure it ended in.

    Only this function catches every exception: a study may raise anything, one case must not stop
    the others, and the error is stored as the case's reason.
    """
    try:
        return evaluate(name, table)
    except Exception as error:
        return _explain(error)


def _evaluate_plainly(name: str, row: Table) -> Values:
    """Evaluate one case without JAX; its numbers are passed as Python numbers."""
    case = {key: column[0].tolist() for key, column in row.items()}
    return {key: np.asarray(value) for key, value in find_study(name).evaluate(**case).items()}


def _evaluate_together(name: str, table: Table) -> Sequence[Values]:
    """Evaluate cases in one compiled program; the last case repeats to fill the batch."""
    study = find_study(name)
    count = len(next(iter(table.values())))
    rows = np.minimum(np.arange(1 if count == 1 else study.batch), count - 1)
    static = tuple((key, table[key][0].item()) for key in study.static)
    moving = {key: column[rows] for key, column in table.items() if key not in study.static}
    values = jax.device_get(_compile(name, static)(moving))
    return [{key: np.asarray(value[i]) for key, value in values.items()} for i in range(count)]


@lru_cache(maxsize=16)
def _compile(name: str, static: tuple[tuple[str, int | float], ...]) -> Callable[[Table], Mapping]:
    evaluate = find_study(name).evaluate
    return eqx.filter_jit(jax.vmap(lambda case: evaluate(**case, **dict(static))))


def _explain(error: Exception) -> Failure:
    """The error's type and first line; for equinox's errors, the first line after its stacks."""
    lines = str(error).rpartition("EquinoxRuntimeError: ")[2].splitlines()
    first = next((line.strip() for line in lines if line.strip()), "no message")
    return Failure(f"{type(error).__name__}: {first}")
