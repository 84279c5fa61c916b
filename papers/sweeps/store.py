"""The Zarr store of a sweep: its cases, their states and their results.

A case is marked as done only after its results are written, and Zarr replaces whole files. So a
sweep can be interrupted at any moment without damage to the store.
"""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zarr
from filelock import FileLock, Timeout
from jaxtyping import Bool, Int, Shaped

from papers.sweeps.study import Failure, Table, Values, table_hash

OPEN, DONE, FAILED = 0, 1, 2
_CHUNK = 64  # cases per file
_FORMAT = 1


class Results(NamedTuple):
    """The contents of a store."""

    table: Table  # the cases
    # results by name; NaN, 0 or False for cases without results
    values: dict[str, Shaped[np.ndarray, "cases ..."]]
    done: Bool[np.ndarray, " cases"]  # mask of the cases with results
    failures: dict[int, str]  # reasons of the failed cases, by row


class Store:
    """The store of a sweep, open for writing; one process at a time."""

    def __init__(self, path: Path, name: str, version: str, table: Table) -> None:
        """Open the store, or create it.

        Raises:
            ValueError: the folder is not a store, or is one of another study, version or table.
        """
        attributes = {
            "format": _FORMAT,
            "study": name,
            "version": version,
            "columns": sorted(table),
            "table": table_hash(table),
        }
        if not path.exists():
            _make(path, attributes, table)
        self.path = path
        self._group = _open(path, "r+")
        for key, value in attributes.items():
            if self._group.attrs.get(key) != value:
                raise ValueError(
                    f"the store {path} has {key} {self._group.attrs.get(key)}, this sweep {value}: "
                    "write to another folder, or remove the old store"
                )

    @property
    def open_cases(self) -> Int[np.ndarray, " open"]:
        """Row numbers of the cases that are neither done nor failed."""
        return np.nonzero(_read(self._group, "state") == OPEN)[0]

    def write(self, cases: Int[np.ndarray, " batch"], outcomes: Sequence[Values | Failure]) -> None:
        """Store the outcomes of some cases."""
        outcomes = [self._fit(outcome) for outcome in outcomes]
        state = np.array([FAILED if isinstance(o, Failure) else DONE for o in outcomes], np.uint8)
        good = [outcome for outcome in outcomes if not isinstance(outcome, Failure)]
        for key in good[0] if good else ():
            stacked = np.stack([values[key] for values in good])
            _array(self._group, f"results/{key}").oindex[cases[state == DONE]] = stacked
        if FAILED in state:
            reasons = np.array([o.reason for o in outcomes if isinstance(o, Failure)])
            _array(self._group, "reason").oindex[cases[state == FAILED]] = reasons
        _array(self._group, "state").oindex[cases] = state

    def _fit(self, outcome: Values | Failure) -> Values | Failure:
        """The outcome, or a failure if its results differ in name or shape from the other cases."""
        if isinstance(outcome, Failure):
            return outcome
        results = self._group["results"]
        assert isinstance(results, zarr.Group)
        for key, value in outcome.items():
            if key not in results:
                results.create_array(
                    key,
                    shape=(len(_read(self._group, "state")), *value.shape),
                    chunks=(_CHUNK, *(max(length, 1) for length in value.shape)),
                    dtype=value.dtype,
                    fill_value=np.nan if value.dtype.kind == "f" else 0,
                    config={"write_empty_chunks": True},
                )
            shape = _array(results, key).shape[1:]
            if shape != value.shape:
                return Failure(f"{key} has shape {value.shape}, in the other cases {shape}")
        if missing := set(results) - set(outcome):
            return Failure(f"there is no {', '.join(sorted(missing))}")
        return outcome


@contextmanager
def lock(path: Path) -> Iterator[None]:
    """Prevent other processes from writing to the same store.

    Raises:
        ValueError: another process is writing to it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    file_lock = FileLock(path.resolve().with_name(f".{path.name}.lock"))
    try:
        held = file_lock.acquire(timeout=0)
    except Timeout as error:
        raise ValueError(f"another sweep is writing to {path}") from error
    with held:
        yield


def read_results(path: Path) -> Results:
    """The current contents of a store.

    Raises:
        ValueError: the store does not exist, or is incomplete.
    """
    if not path.exists():
        raise ValueError(f"there is no store {path}")
    group = _open(path, "r")
    state, reasons = _read(group, "state"), _read(group, "reason")
    return Results(
        table=_read_all(group, "cases"),
        values=_read_all(group, "results"),
        done=state == DONE,
        failures={int(row): str(reasons[row]) for row in np.nonzero(state == FAILED)[0]},
    )


def _make(path: Path, attributes: dict, table: Table) -> None:
    """Create a store without results, under a temporary name until it is complete."""
    temporary = path.with_name(f".{path.name}.new")
    shutil.rmtree(temporary, ignore_errors=True)
    count = len(next(iter(table.values())))
    group = zarr.open_group(temporary, mode="w", attributes=attributes)
    group.create_group("results")
    cases = group.create_group("cases")
    for key, column in table.items():
        cases.create_array(key, data=np.ascontiguousarray(column))
    group.create_array("state", shape=(count,), chunks=(count,), dtype="uint8", fill_value=OPEN)
    group.create_array("reason", shape=(count,), chunks=(count,), dtype="string", fill_value="")
    temporary.rename(path)


def _open(path: Path, mode) -> zarr.Group:
    """Open the store's group and check that it is complete."""
    try:
        group = zarr.open_group(path.resolve(), mode=mode)  # zarr cuts the root off inner paths
        state = _read(group, "state")
        columns = group.attrs["columns"]
        assert isinstance(columns, list)
        names = ["reason", *(f"cases/{key}" for key in columns)]
        whole = all(len(_read(group, name)) == len(state) for name in names)
        files = len(set(np.nonzero(state == DONE)[0] // _CHUNK))
        results = group["results"]
        assert isinstance(results, zarr.Group)
        stored = [array.nchunks_initialized for _, array in results.arrays()]
        whole &= all(chunks >= files for chunks in stored) and (bool(stored) or not files)
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(_broken(path)) from error
    if not whole:
        raise ValueError(_broken(path))
    return group


def _broken(path: Path) -> str:
    return f"{path} is not a complete store of a sweep: check it, or remove it to start again"


def _array(group: zarr.Group, name: str) -> zarr.Array:
    """An array of a group.

    Raises:
        KeyError: the group has no array of that name.
    """
    array = group[name]
    if not isinstance(array, zarr.Array):
        raise KeyError(name)
    return array


def _read(group: zarr.Group, name: str) -> np.ndarray:
    return np.asarray(_array(group, name)[...])


def _read_all(group: zarr.Group, name: str) -> dict[str, np.ndarray]:
    inner = group[name]
    assert isinstance(inner, zarr.Group)
    return {key: np.asarray(array[...]) for key, array in inner.arrays()}
