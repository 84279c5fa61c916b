"""A study: a pure function over a table of cases, named by the module that holds it.

The module has `STUDY`, a `Study`. Only its name and the cases' numbers travel to the workers, which
import the module themselves.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Int, Shaped

Table = Mapping[str, Shaped[np.ndarray, "_ ..."]]
Values = Mapping[str, Shaped[np.ndarray, "..."]]

_T = TypeVar("_T")

PHYSICS = ("contactmodel", "estimation", "calibration")
"""Packages whose change makes results outdated, unless a study says which of them it uses."""


class Study(NamedTuple):
    """What is computed, and for which cases.

    Attributes:
        cases: the table, a column for each argument of `evaluate`; told whether it is to be the
            small one.
        evaluate: results by name from one case, given as keywords; their shapes are the same in
            all cases. Where it raises, the case is recorded as failed with what it said.
        static: columns that fix shapes. They stay plain numbers; cases are batched by them.
        batch: cases of a batch.
        traced: whether `evaluate` is for `jax.vmap`; else cases are evaluated one by one.
        uses: packages that the results depend on.
    """

    cases: Callable[[bool], Table]
    evaluate: Callable[..., Mapping]
    static: tuple[str, ...] = ()
    batch: int = 1
    traced: bool = True
    uses: tuple[str, ...] = PHYSICS


class Failure(NamedTuple):
    """Why a case has no results."""

    reason: str


def find_study(name: str) -> Study:
    """The study of a module.

    Raises:
        ValueError: there is no such module, or it holds no study.
    """
    try:
        study = getattr(import_module(name), "STUDY", None)
    except ModuleNotFoundError as error:
        raise ValueError(f"no study {name!r}: {error}") from error
    if not isinstance(study, Study):
        raise ValueError(f"{name} holds no study; it needs a variable STUDY of type Study")
    return study


def code_version(name: str) -> str:
    """What the results of a study depend on: a hash of its packages and its module."""
    files = [Path(import_module(name).__file__ or "")]
    for package in find_study(name).uses:
        files += sorted(Path(import_module(package).__file__ or "").parent.rglob("*.py"))
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def table_hash(table: Table) -> str:
    """Hash of the names and the numbers of a table."""
    digest = hashlib.sha256()
    for name, column in sorted(table.items()):
        digest.update(f"{name} {column.dtype} {column.shape}".encode())
        digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()[:12]


def make_batches(
    study: Study, table: Table, cases: Int[np.ndarray, " open"]
) -> Iterator[Int[np.ndarray, " batch"]]:
    """Indices of cases that can be evaluated together."""
    keys = [tuple(table[name][case].item() for name in study.static) for case in cases]
    for key in dict.fromkeys(keys):
        alike = cases[[other == key for other in keys]]
        for start in range(0, len(alike), study.batch):
            yield alike[start : start + study.batch]


def evaluate_batch(name: str, table: Table) -> Sequence[Values | Failure]:
    """Results of some cases of equal shape, or why they have none, in their order."""
    rows = _rows(table)
    if not find_study(name).traced:
        return [_attempt(_evaluate_plainly, name, row) for row in rows]
    together = _attempt(_evaluate_together, name, table)
    if not isinstance(together, Failure):
        return together
    alone = [_attempt(_evaluate_together, name, row) for row in rows]  # to see whose failure it was
    return [found if isinstance(found, Failure) else found[0] for found in alone]


def _rows(table: Table) -> list[Table]:
    """The cases one by one, as tables."""
    count = len(next(iter(table.values())))
    return [{key: column[[i]] for key, column in table.items()} for i in range(count)]


def _attempt(evaluate: Callable[[str, Table], _T], name: str, table: Table) -> _T | Failure:
    """What comes of a study's own function, or the failure it ended in.

    Every exception is caught, and only here: what a study may raise cannot be known, one case must
    not stop the others, and what was raised is not lost but stored as the case's reason.
    """
    try:
        return evaluate(name, table)
    except Exception as error:
        return _explain(error)


def _evaluate_plainly(name: str, row: Table) -> Values:
    """One case without JAX, its numbers as Python's."""
    case = {key: column[0].tolist() for key, column in row.items()}
    return {key: np.asarray(value) for key, value in find_study(name).evaluate(**case).items()}


def _evaluate_together(name: str, table: Table) -> Sequence[Values]:
    """Of one compiled program, filled up with the last case where there are too few."""
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
    """The kind of error and its first line; of equinox's, the first after the stacks it shows."""
    lines = str(error).rpartition("EquinoxRuntimeError: ")[2].splitlines()
    first = next((line.strip() for line in lines if line.strip()), "no message")
    return Failure(f"{type(error).__name__}: {first}")
