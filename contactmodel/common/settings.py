"""Settings files: TOML tables that are read into frozen dataclasses and written from them.

A dataclass describes its table: a field is a key, the field's type is the type of the value, and
its default applies if the key is missing. `unit` sets the unit at the end of the key and the limits
of the value. cattrs reads the structure. It is imported only to read a file, so that help is fast.
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
"""Factors from units of files to those of attributes, rad and mm."""


def unit(
    name: str = "",
    *,
    above: float = -inf,
    least: float = -inf,
    most: float | None = None,
    required: str = "",
) -> dict[str, Any]:
    """`metadata` of a field: unit of its key and limits of its value.

    Args:
        name: unit at the end of the key; units of `SCALES` also convert the value.
        above: exclusive lower limit.
        least: smallest allowed value.
        most: largest allowed value; if None, every finite value is allowed.
        required: advice if the key is missing; makes it required although the field has a default.
    """
    return {"unit": name, "limits": (above, least, most), "required": required}


def key_of(field: Field) -> str:
    """Key of a field in the file: its name and its unit."""
    name = field.metadata.get("unit")
    return f"{field.name}_{name}" if name else field.name


def check_limits(settings: Any) -> None:
    """Check that all values of a dataclass, and of its lists, are within their fields' limits.

    Raises:
        ValueError: a value is outside its limits; the message begins with its key.
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
    """Read a TOML file; see `parse_toml`.

    Args:
        path: path of the file.
        version: required `format_version`; None if the file has none.
        renamed: renamed keys, see `rename_keys`.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not TOML, has another version, or has a key under both of its names.
    """
    return parse_toml(read_text(path), path, version, renamed)


def parse_toml(
    text: str, path: Path, version: int | None = None, renamed: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Parse the text of a TOML file; its `format_version` is checked and removed.

    Args:
        text: text of the file.
        path: path of the file, for errors.
        version: required `format_version`; None if the file has none.
        renamed: renamed keys, see `rename_keys`.

    Raises:
        ValueError: the text is not TOML, has another version, or has a key under both of its names.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    if version is not None:
        if "format_version" not in content:
            raise ValueError(
                f"{path}: format_version is missing: add `format_version = {version}` at the top"
            )
        stated = content.pop("format_version")
        if type(stated) is not int or stated != version:
            raise ValueError(f"{path}: format_version is {stated!r}; this version reads {version}")
    return rename_keys(content, renamed or {}, path)


def rename_keys(content: dict[str, Any], renamed: Mapping[str, str], path: Path) -> dict[str, Any]:
    """Rename the keys of version 0.1.0 to their present names, and warn.

    Args:
        content: content of the file, changed in place.
        renamed: present names by old names, each with its table and a dot; '' if no longer used.
        path: path of the file, for errors and warnings.

    Raises:
        ValueError: a key is present under both names.
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
        warning = f"{path} is of version 0.1.0, change its keys: {'; '.join(notes)}"
        warnings.warn(warning, RenamedKeyWarning, stacklevel=2)
    return content


def from_table(content: Any, kind: type[T], where: str = "") -> T:
    """Make a dataclass from the content of a table; errors name the table, '' for the file itself.

    Raises:
        ValueError: a key is unknown or missing, or its value is wrong; the message names the key.
    """
    from cattrs import BaseValidationError

    try:
        return _converter().structure(content, kind)
    except (BaseValidationError, ValueError) as error:
        raise ValueError(_explain(error, where)) from error


def to_table(settings: Any) -> dict[str, Any]:
    """Content of a dataclass's table; values that are None or empty are left out."""
    table = {
        key_of(field): _to_plain(
            getattr(settings, field.name), SCALES.get(field.metadata.get("unit", ""))
        )
        for field in fields(settings)
    }
    return {key: value for key, value in table.items() if value not in (None, {}, [])}


def _to_plain(value: Any, scale: float | None) -> Any:
    """A value in the form and unit of files."""
    if isinstance(value, tuple):
        return [_to_plain(item, scale) for item in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if is_dataclass(value):
        return to_table(value)
    return value if value is None or scale is None else value / scale


def toml_text(content: Any, version: int | None = None) -> str:
    """TOML text of a table or a dataclass, with the `format_version` unless it is None."""
    table = to_table(content) if is_dataclass(content) else content
    return tomli_w.dumps(({} if version is None else {"format_version": version}) | table)


@cache
def _converter() -> Any:
    """The converter of dataclasses; made once, at its first use."""
    from cattrs import Converter

    made = Converter()
    for kind, read in _PLAIN.items():
        made.register_structure_hook(kind, lambda value, _, read=read: read(value))
    made.register_structure_hook_func(
        lambda kind: get_origin(kind) is Mapping, lambda value, _: _expect(dict, "a table", value)
    )
    made.register_structure_hook_factory(lambda kind: get_origin(kind) is tuple, _read_list)
    made.register_structure_hook_factory(_is_array, _read_array)
    made.register_structure_hook_factory(is_dataclass, _read_table)
    return made


def _expect(kind: type, words: str, value: Any) -> Any:
    """Check the type of a value; errors continue the key's name, like those of numbers."""
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


def _read_list(kind: Any, converter: Any) -> Any:
    """Read tuples of values of one type, of the length that their type states."""
    inner = get_args(kind)
    count = None if inner[-1] is Ellipsis else len(inner)
    words = f"{count or 'a list of'} {_PLURALS.get(inner[0], 'lists or tables')}"

    def read(value: Any, _: Any) -> Any:
        if count not in (None, len(_expect(list, words, value))):
            raise ValueError(f" must be {words}, got {show(value)}")
        return tuple(converter.structure(value, list[inner[0]]))

    return read


def _read_array(kind: Any, converter: Any) -> Any:
    """Read arrays of numbers: one list, or several of the same length."""
    row = tuple[float, ...]
    rows = row if len(kind.dims) == 1 else tuple[row, ...]

    def read(value: Any, _: Any) -> Any:
        numbers = converter.structure(value, rows)
        if len(kind.dims) == 2 and len({len(row) for row in numbers}) != 1:
            raise ValueError(f" must have rows of one length, got {show(value)}")
        return np.array(numbers)

    return read


def _is_array(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, AbstractArray)


def _read_table(kind: Any, converter: Any) -> Any:
    """Read a dataclass; keys are checked before values."""
    from cattrs.gen import make_dict_structure_fn, override

    keys = {key_of(field): field for field in fields(kind)}
    needed = [
        key
        for key, field in keys.items()
        if field.metadata.get("required") or field.default is field.default_factory is MISSING
    ]
    rules: dict[str, Any] = {
        field.name: override(rename=key, struct_hook=_scaled(field, converter))
        for key, field in keys.items()
    }
    make = make_dict_structure_fn(kind, converter, **rules)

    def read(value: Any, _: Any) -> Any:
        if unknown := sorted(set(_expect(dict, "a table", value)) - set(keys)):
            raise ValueError(f"unknown key {unknown[0]!r}; known are {', '.join(keys)}")
        if missing := [key for key in needed if key not in value]:
            remedy = keys[missing[0]].metadata.get("required")
            message = f"the key {missing[0]!r} is missing"
            raise ValueError(f"{message}: {remedy}" if remedy else message)
        made = make(value, kind)
        check_limits(made)
        return made

    return read


def _scaled(field: Field, converter: Any) -> Any:
    """Reader of a value whose attribute has another unit than its key; None for other values."""
    scale = SCALES.get(field.metadata.get("unit", ""))
    if scale is None:
        return None
    return lambda value, kind: _times(converter.structure(value, kind), scale)


def _times(value: Any, scale: float) -> Any:
    """A number, or each number of a tuple, times a factor; None stays None."""
    if isinstance(value, tuple):
        return tuple(_times(item, scale) for item in value)
    return value if value is None else value * scale


def _explain(error: Any, where: str) -> str:
    """Message of the first error in a table, with the name of its key."""
    if not hasattr(error, "group_exceptions"):
        if not isinstance(error, ValueError):
            raise error  # an error of the program
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
    key = next(key_of(field) for field in fields(error.cl) if field.name == note.name)
    return _explain(inner, f"{where}.{key}" if where else key)
