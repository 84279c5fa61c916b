"""Settings files: tables of TOML read into plain frozen dataclasses, and written from them.

A dataclass describes its table: a field is a key, its type is what may stand there, and its default
holds where the key is left out. `unit` gives a field the unit that its key ends in and the limits
of its value. The structure is read by cattrs, imported only where a file is read: help comes fast.
"""

import tomllib
import warnings
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from math import inf, isfinite, pi
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import numpy as np
import tomli_w
from jaxtyping import AbstractArray

from contactmodel.common.inputs import RenamedKeyWarning, as_number, as_whole, read_text, show

T = TypeVar("T")

SCALES = {"deg": pi / 180.0, "um": 1e-3}
"""Units of files whose attributes have another one: rad and mm."""


def unit(
    name: str = "",
    *,
    above: float = -inf,
    least: float = -inf,
    most: float | None = None,
    required: str = "",
) -> dict[str, Any]:
    """What a field's `metadata` says about its key and its value.

    Args:
        name: unit that the key ends in; those of `SCALES` change the value, too.
        above: limit that `check_limits` refuses, and everything below.
        least: smallest value.
        most: largest value; no limit, but finite, if None.
        required: what to do where the file lacks the key, although the field has a default.
    """
    return {"unit": name, "limits": (above, least, most), "required": required}


def key_of(field: Field) -> str:
    """A field's key in the file: its name and its unit."""
    name = field.metadata.get("unit")
    return f"{field.name}_{name}" if name else field.name


def check_limits(settings: Any) -> None:
    """Refuse a dataclass with a value, or a list of values, beyond the limits of its field.

    Raises:
        ValueError: there is one; the text begins with its key.
    """
    for field in _limited(type(settings)):
        if (value := getattr(settings, field.name)) is None:
            continue
        above, least, most = field.metadata["limits"]
        shown = _to_plain(value, SCALES.get(field.metadata["unit"]))
        for number in shown if isinstance(shown, list) else [shown]:
            low = number >= least and (number > above or above == -inf)
            if low and (isfinite(number) if most is None else number <= most):
                continue
            words = [f"above {above:g}"] * (above > -inf) + [f"from {least:g}"] * (least > -inf)
            words += [] if most in (None, inf) else [f"to {most:g}"]
            kind = "numbers" if isinstance(shown, list) else "a number"
            raise ValueError(f"{key_of(field)} is {shown}; it must be {' '.join([kind, *words])}")


@cache
def _limited(kind: type) -> list[Field]:
    return [field for field in fields(kind) if "limits" in field.metadata]


def read_toml(
    path: Path, version: int | None = None, renamed: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """The content of a TOML file, see `parse_toml`.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not TOML, of another version, or has a key under both of its names.
    """
    return parse_toml(read_text(path), path, version, renamed)


def parse_toml(
    text: str, path: Path, version: int | None = None, renamed: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """The content of a TOML file that has been read, without its `format_version`.

    Args:
        text: of the file.
        path: of it, for errors.
        version: that `format_version` must have; the file has none if None.
        renamed: see `rename_keys`.

    Raises:
        ValueError: it is not TOML, of another version, or has a key under both of its names.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    if version is not None:
        if "format_version" not in content:
            raise ValueError(f"{path}: format_version is missing; this version reads {version}")
        found = content.pop("format_version")
        if type(found) is not int or found != version:
            raise ValueError(f"{path}: format_version is {found!r}; this version reads {version}")
    return rename_keys(content, renamed or {}, path)


def rename_keys(content: dict[str, Any], renamed: Mapping[str, str], path: Path) -> dict[str, Any]:
    """The content with the keys of version 0.1.0 under their present names, with a warning.

    Args:
        content: of the file.
        renamed: present names by old ones, each after its table and a dot; '' if no longer used.
        path: of the file, for errors and warnings.

    Raises:
        ValueError: a key is there under both names.
    """
    notes = []
    for old, new in renamed.items():
        place, _, name = old.rpartition(".")
        table = content.get(place) if place else content
        if old == new or not isinstance(table, dict) or name not in table:
            continue
        value = table.pop(name)
        if place and not table:
            del content[place]
        if new:
            place, _, name = new.rpartition(".")
            table = content.setdefault(place, {}) if place else content
            if not isinstance(table, dict) or name in table:
                raise ValueError(f"{path}: {old} and {new} are the same key: remove {old}")
            table[name] = value
        notes.append(f"{old} is now called {new}" if new else f"{old} is no longer used")
    if notes:
        said = f"{path} is of version 0.1.0, change its keys: {'; '.join(notes)}"
        warnings.warn(said, RenamedKeyWarning, stacklevel=2)
    return content


def from_table(content: Any, kind: type[T], where: str = "") -> T:
    """A dataclass from the content of a table.

    Args:
        content: the table.
        kind: of the dataclass.
        where: name of the table, for errors; none for the file itself.

    Raises:
        ValueError: a key that is unknown or missing, or a wrong value; the text names them.
    """
    from cattrs import BaseValidationError

    try:
        return _converter().structure(content, kind)
    except (BaseValidationError, ValueError) as error:
        raise ValueError(_explain(error, where)) from error


def to_table(settings: Any) -> dict[str, Any]:
    """A dataclass as the content of a table; what is None or empty is left out."""
    table = {
        key_of(one): _to_plain(
            getattr(settings, one.name), SCALES.get(one.metadata.get("unit", ""))
        )
        for one in fields(settings)
    }
    return {key: value for key, value in table.items() if value not in (None, {}, [])}


def _to_plain(value: Any, scale: float | None) -> Any:
    """A value as files have it."""
    if isinstance(value, tuple):
        return [_to_plain(one, scale) for one in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if is_dataclass(value):
        return to_table(value)
    return value if value is None or scale is None else value / scale


def toml_text(content: Any, version: int | None = None) -> str:
    """A TOML document of a table, or of a dataclass.

    Args:
        content: what stands in it.
        version: its `format_version`, if it has one.
    """
    table = to_table(content) if is_dataclass(content) else content
    return tomli_w.dumps(({} if version is None else {"format_version": version}) | table)


@cache
def _converter() -> Any:
    """Reads and writes dataclasses; made once, where it is first needed."""
    from cattrs import Converter

    made = Converter()
    for kind, read in _PLAIN.items():
        made.register_structure_hook(kind, lambda value, _, read=read: read(value))
    made.register_structure_hook_factory(lambda kind: get_origin(kind) is Mapping, _read_mapping)
    made.register_structure_hook_factory(lambda kind: get_origin(kind) is tuple, _read_list)
    made.register_structure_hook_factory(_is_array, _read_array)
    made.register_structure_hook_factory(is_dataclass, _read_table)
    return made


def _expect(kind: type, words: str, value: Any) -> Any:
    """A value of a kind; errors go on where the key's name ends, as do those of numbers."""
    if not isinstance(value, kind):
        raise ValueError(f" must be {words}, got {show(value)}")
    return value


_PLAIN = {
    float: partial(as_number, name=""),
    int: partial(as_whole, name=""),
    bool: partial(_expect, bool, "true or false"),
    str: partial(_expect, str, "a text"),
}
_PLURALS = {float: "numbers", int: "whole numbers", str: "texts"}


def _read_mapping(kind: Any, converter: Any) -> Any:
    return lambda value, _: _expect(dict, "a table", value)


def _read_list(kind: Any, converter: Any) -> Any:
    """Reads tuples of one kind of value, as long as their type says."""
    inner = get_args(kind)
    count = None if inner[-1] is Ellipsis else len(inner)
    words = f"{count or 'a list of'} {_PLURALS.get(inner[0], 'lists or tables')}"

    def read(value: Any, _: Any) -> Any:
        if count not in (None, len(_expect(list, words, value))):
            raise ValueError(f" must be {words}, got {show(value)}")
        return tuple(converter.structure(value, list[inner[0]]))

    return read


def _read_array(kind: Any, converter: Any) -> Any:
    """Reads arrays of numbers, one list or several of the same length."""
    row = tuple[float, ...]
    rows = row if len(kind.dims) == 1 else tuple[row, ...]

    def read(value: Any, _: Any) -> Any:
        found = converter.structure(value, rows)
        if len(kind.dims) == 2 and len({len(row) for row in found}) != 1:
            raise ValueError(f" must have rows of one length, got {show(value)}")
        return np.array(found)

    return read


def _is_array(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, AbstractArray)


def _read_table(kind: Any, converter: Any) -> Any:
    """Reads a dataclass, whose keys are checked before their values."""
    from cattrs.gen import make_dict_structure_fn, override

    own = fields(kind)
    known = {key_of(one): one for one in own}
    needed = [
        key
        for key, one in known.items()
        if one.metadata.get("required") or one.default is one.default_factory is MISSING
    ]
    rules: dict[str, Any] = {
        one.name: override(rename=key_of(one), struct_hook=_scaled(one, converter)) for one in own
    }
    make = make_dict_structure_fn(kind, converter, **rules)

    def read(value: Any, _: Any) -> Any:
        if unknown := sorted(set(_expect(dict, "a table", value)) - set(known)):
            raise ValueError(f"unknown key {unknown[0]!r}; known are {', '.join(known)}")
        if missing := [key for key in needed if key not in value]:
            remedy = known[missing[0]].metadata.get("required")
            said = f"the key {missing[0]!r} is missing"
            raise ValueError(f"{said}: {remedy}" if remedy else said)
        made = make(value, kind)
        check_limits(made)
        return made

    return read


def _scaled(field: Field, converter: Any) -> Any:
    """Reads a value whose attribute has another unit than its key; None for other values."""
    scale = SCALES.get(field.metadata.get("unit", ""))
    if scale is None:
        return None
    return lambda value, kind: _times(converter.structure(value, kind), scale)


def _times(value: Any, scale: float) -> Any:
    """A number, or each of a tuple, by a factor; None stays."""
    if isinstance(value, tuple):
        return tuple(_times(one, scale) for one in value)
    return value if value is None else value * scale


def _explain(error: Any, where: str) -> str:
    """The first of the errors of a table, with the name of the key that it is at."""
    if not hasattr(error, "group_exceptions"):
        if not isinstance(error, ValueError):
            raise error  # the program's fault
        text = str(error)
        if text.startswith(" "):
            return f"{where or 'the file'}{text}"
        return f"{where}: {text}" if where else text
    noted, others = error.group_exceptions()
    if not noted:
        return _explain(others[0], where)
    inner, note = noted[0]
    if not hasattr(note, "name"):
        return _explain(inner, f"{where} #{note.index + 1}")
    key = next(key_of(one) for one in fields(error.cl) if one.name == note.name)
    return _explain(inner, f"{where}.{key}" if where else key)
