"""What can happen to an input: files, their contents and their bytes are damaged at random."""

import copy
import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.contents import Input, to_bytes

Mutate = Callable[[np.random.Generator, Any], Any]
NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e12, 1e300, -1e300)
"""Values that no measurement has."""
VALUES = (
    *NUMBERS,
    *(-1, 0, 2, 10**6, 2**63, 10**400, True, False),
    *("", "x", "1.0", "é" * 300, "\0", "../up", "dots"),
    *([], [1.0], [[1.0]], ["a"], [1, [2]], {}, {"a": 1}, [0.0] * 999),
    datetime.date(2024, 2, 29),
)
"""Values of a TOML file that hold something else than was meant."""
CELLS = ("", " ", "x", "nan", "inf", "-1", "1e300", "1e999", "0", "1,5", '"', "\0", "é", "9" * 5000)
DTYPES = ("f2", "f4", ">f8", "i1", "u8", "?", "c16", "U3", "S2", "O", "M8[s]", "f4,i2")
HEADERS = ((b"'shape': (", b"'shape': (999999999, "), (b"False", b"True"), (b"<f8", b"|O8"))
MUTATIONS = (1, 1, 1, 2, 3)
"""Of one input: most are damaged once, since the first error hides the others."""


def mutate(rng: np.random.Generator, base: Input) -> tuple[Input, str]:
    """A damaged copy of an input, and what was done to it."""
    content, done = copy.deepcopy(base), []
    for _ in range(_choose(rng, MUTATIONS)):
        way = _choose(rng, (_change_content,) * 6 + (_change_bytes,) * 2 + (_change_files,))
        done.append(way(rng, content))
    return content, ", ".join(done)


def _change_content(rng: np.random.Generator, content: Input) -> str:
    """Change what a file holds, its format kept."""
    name = _choose(rng, sorted(content))
    ways = _ways(content[name])
    if not ways:
        return _change_bytes(rng, content)
    way = _choose(rng, ways)
    content[name] = way(rng, content[name])
    return f"{way.__name__[1:]} {name}"


def _change_bytes(rng: np.random.Generator, content: Input) -> str:
    """Change the bytes of a file."""
    name, way = _choose(rng, sorted(content)), _choose(rng, BYTES)
    content[name] = way(rng, to_bytes(name, content[name]))
    return f"{way.__name__[1:]} {name}"


def _change_files(rng: np.random.Generator, content: Input) -> str:
    """Delete, copy or swap files."""
    one, other = _choose(rng, sorted(content)), _choose(rng, sorted(content))
    kind = rng.integers(3)
    if kind == 0 and len(content) > 1:
        del content[one]
        return f"delete {one}"
    if kind == 1 or one == other:
        path = Path(one)
        copied = path.with_name(f"{path.stem}{_choose(rng, ('0', 'a', ' (1)', 'é'))}{path.suffix}")
        content[str(copied)] = copy.deepcopy(content[one])
        return f"copy {one} to {copied}"
    first, second = (to_bytes(name, content[name]) for name in (one, other))
    content[one], content[other] = second, first
    return f"swap {one} and {other}"


def _ways(content: Any) -> tuple[Mutate, ...]:
    if isinstance(content, np.ndarray):
        return ARRAYS
    if isinstance(content, dict):
        return ENTRIES if any(isinstance(one, np.ndarray) for one in content.values()) else TABLES
    return ROWS if isinstance(content, list) else ()


def _choose(rng: np.random.Generator, options: Any) -> Any:
    return options[rng.integers(len(options))]


# bytes


def _flip(rng: np.random.Generator, data: bytes) -> bytes:
    """Other bits, half of the time in the header."""
    flipped = bytearray(data)
    reach = min(len(data), 200) if rng.random() < 0.5 else len(data)
    for _ in range(int(2 ** rng.uniform(0, 6)) if data else 0):
        flipped[rng.integers(reach)] ^= 1 << int(rng.integers(8))
    return bytes(flipped)


def _cut(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _behead(rng: np.random.Generator, data: bytes) -> bytes:
    return data[rng.integers(len(data) + 1) :]


def _overwrite(rng: np.random.Generator, data: bytes) -> bytes:
    """A stretch of one byte, or of noise, in place of what was there."""
    start = int(rng.integers(len(data) + 1))
    length = int(rng.integers(1, 1 + max(len(data) // 8, 4)))
    noise = rng.bytes(length) if rng.random() < 0.5 else bytes([rng.integers(256)]) * length
    return data[:start] + noise + data[start + length :]


def _repeat(rng: np.random.Generator, data: bytes) -> bytes:
    """A stretch twice."""
    start, end = sorted(rng.integers(len(data) + 1, size=2).tolist())
    return data[:end] + data[start:]


def _empty(rng: np.random.Generator, data: bytes) -> bytes:
    return b""


# arrays


def _set(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """Some elements, or all, to a value that cannot be."""
    changed = array.copy()
    if not changed.size or changed.dtype.kind not in "iufb":
        return changed
    where = rng.random(changed.shape) < _choose(rng, (0.02, 0.3, 1.0))
    where.flat[rng.integers(changed.size)] = True
    with np.errstate(all="ignore"):
        changed[where] = np.asarray(_choose(rng, NUMBERS)).astype(changed.dtype)
    return changed


def _index(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """One element of whole numbers just off, far off or at their limits."""
    changed = array.copy()
    if changed.size and changed.dtype.kind in "iu":
        info = np.iinfo(changed.dtype)
        values = (info.min, info.max, -2, array.size, max(array.shape, default=1), 10**6)
        value = min(max(_choose(rng, values), info.min), info.max)
        changed.flat[rng.integers(changed.size)] = value
    return changed


def _scale(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        if array.dtype.kind not in "iuf":
            return array
        return (array * 10.0 ** rng.integers(-12, 13)).astype(array.dtype)


def _retype(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        try:
            return array.astype(np.dtype(_choose(rng, DTYPES)))
        except (TypeError, ValueError):
            return array.astype("U")


def _reshape(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """Another shape: an axis more or less, cut, empty, longer or transposed."""
    shapes = [array[None], array.ravel(), array.T, array[..., None]]
    if array.ndim:
        axis = int(rng.integers(array.ndim))
        count = int(rng.integers(array.shape[axis] + 1))
        few = np.take(array, np.arange(count), axis=axis)
        shapes += [few, few, array[:1], array[:0], array[0] if len(array) else array]
        shapes += [np.concatenate([array, few], axis=axis)]
    return np.asarray(_choose(rng, shapes))


def _permute(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """Along an axis: another order, the other way round, or with repetition."""
    if not array.ndim or not array.size:
        return array
    axis = int(rng.integers(array.ndim))
    count = array.shape[axis]
    orders = (
        rng.permutation(count),
        np.arange(count)[::-1],
        np.sort(rng.integers(count, size=count)),
    )
    return np.take(array, _choose(rng, orders), axis=axis)


# tables


def _replace(rng: np.random.Generator, table: dict) -> dict:
    """One value, at any depth, by another kind of value."""
    if places := _places(table):
        holder, key = _choose(rng, places)
        holder[key] = _choose(rng, VALUES)
    return table


def _drop(rng: np.random.Generator, table: dict) -> dict:
    """One value fewer, at any depth."""
    if places := _places(table):
        holder, key = _choose(rng, places)
        del holder[key]
    return table


def _add(rng: np.random.Generator, table: dict) -> dict:
    """One value more, at any depth."""
    holder = _choose(rng, [table, *(h for h, _ in _places(table) if isinstance(h, dict))])
    holder[_choose(rng, ("unknown", "", "format_version", "kind", "noise"))] = _choose(rng, VALUES)
    return table


def _tweak(rng: np.random.Generator, table: dict) -> dict:
    """One number scaled, or in place of it one that cannot be."""
    numbers = [place for place in _places(table) if type(place[0][place[1]]) in (int, float)]
    if numbers:
        holder, key = _choose(rng, numbers)
        scaled = holder[key] * _choose(rng, (-1, 1e-9, 1e3, 1e9, 1000, 10**12))
        holder[key] = _choose(rng, (scaled, _choose(rng, NUMBERS)))
    return table


def _exchange(rng: np.random.Generator, table: dict) -> dict:
    """One value by another of the file."""
    if places := _places(table):
        (holder, key), (other, name) = _choose(rng, places), _choose(rng, places)
        holder[key] = copy.deepcopy(other[name])
    return table


def _lengthen(rng: np.random.Generator, table: dict) -> dict:
    """A list longer by one of its own values, in another order."""
    lists = [holder for holder, _ in _places(table) if isinstance(holder, list)]
    if lists:
        values = _choose(rng, lists)
        values.append(copy.deepcopy(_choose(rng, values)))
        rng.shuffle(values)
    return table


def _twice(rng: np.random.Generator, table: dict) -> bytes:
    """A key that is given twice."""
    text = to_bytes(".toml", table)
    lines = text.splitlines(keepends=True)
    return text + _choose(rng, lines) if lines else text


def _places(table: dict) -> list[tuple[Any, Any]]:
    """Holder and key of every value of a table, at any depth."""
    found: list[tuple[Any, Any]] = []
    holders: list[Any] = [table]
    while holders:
        holder = holders.pop()
        for key in list(holder) if isinstance(holder, dict) else range(len(holder)):
            found.append((holder, key))
            if isinstance(holder[key], dict | list):
                holders.append(holder[key])
    return found


# entries of an archive


def _entry(rng: np.random.Generator, entries: dict) -> dict:
    """One array changed."""
    name = _choose(rng, sorted(entries))
    if isinstance(entries[name], np.ndarray):
        entries[name] = _choose(rng, ARRAYS)(rng, entries[name])
    return entries


def _stored(rng: np.random.Generator, entries: dict) -> dict:
    """The bytes of one array changed, its checksum right."""
    name = _choose(rng, sorted(entries))
    entries[name] = _choose(rng, BYTES)(rng, to_bytes(".npy", entries[name]))
    return entries


def _rename(rng: np.random.Generator, entries: dict) -> dict:
    """An array lost, under another name, or under another one's."""
    name = _choose(rng, sorted(entries))
    entry = entries.pop(name)
    other = _choose(rng, ("unknown", None, *sorted(entries))) if entries else "unknown"
    return entries if other is None else entries | {other: entry}


# arrays' headers


def _claim(rng: np.random.Generator, array: np.ndarray) -> bytes:
    """A header that claims another shape, order or type than the data have."""
    before, after = _choose(rng, HEADERS)
    data = to_bytes(".npy", array)
    spare = b" " * (len(after) - len(before))
    return data.replace(spare, b"", 1).replace(before, after, 1)


# rows of cells


def _cell(rng: np.random.Generator, rows: list) -> list:
    row = _choose(rng, rows)
    row[rng.integers(len(row))] = _choose(rng, CELLS)
    return rows


def _column(rng: np.random.Generator, rows: list) -> list:
    """A column lost, twice, or empty."""
    place, kind = int(rng.integers(len(rows[0]))), rng.integers(3)
    for row in rows:
        cell = row[place : place + 1]
        row[place : place + 1] = ([], cell * 2, [""])[kind]
    return [row or [""] for row in rows]


def _row(rng: np.random.Generator, rows: list) -> list:
    """Rows cut, in another order, with repetition, or of another length."""
    order = (
        np.arange(rng.integers(1, len(rows) + 1)),
        rng.permutation(len(rows)),
        np.sort(rng.integers(len(rows), size=len(rows))),
    )
    rows = [list(rows[i]) for i in _choose(rng, order)]
    _choose(rng, rows).append(_choose(rng, CELLS))
    return rows


BYTES: tuple[Mutate, ...] = (_flip, _flip, _cut, _behead, _overwrite, _repeat, _empty)
ARRAYS: tuple[Mutate, ...] = (
    _set,
    _set,
    _index,
    _scale,
    _retype,
    _reshape,
    _reshape,
    _permute,
    _claim,
)
TABLES: tuple[Mutate, ...] = (
    *(_replace, _replace, _tweak, _tweak, _tweak),
    *(_drop, _add, _exchange, _lengthen, _twice),
)
ENTRIES: tuple[Mutate, ...] = (*(_entry,) * 6, _stored, _rename)
ROWS: tuple[Mutate, ...] = (_cell, _cell, _column, _row)
