"""The settings of a run with units and meanings, from the docstrings of the settings."""

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from contactmodel.common.options import describe_parameters
from estimation.choices import AlertSettings, ContactSettings, Known
from estimation.estimators import METHODS, PUBLISHED_METHODS, method_settings
from estimation.settings import Settings
from estimation.softness.files import SOFTNESS_KINDS


class Explained(NamedTuple):
    """A setting of a run."""

    name: str  # name as in `summary.json`
    value: str  # value as text
    unit: str  # unit of the value; empty if it has none
    meaning: str  # meaning; empty if no docstring describes it


def explain_settings(settings: Mapping[str, Any], method: str) -> list[Explained]:
    """Each setting of a run with its unit and meaning; the seed only if one was used."""
    owners: list[object] = [Settings, ContactSettings, AlertSettings, Known]
    kind = settings.get("softness", {}).get("kind")
    owners += [SOFTNESS_KINDS[kind]] if kind in SOFTNESS_KINDS else []
    owners += [type(method_settings(method))] if method in METHODS | PUBLISHED_METHODS else []
    meanings = {name: text for owner in owners for name, text in describe_parameters(owner).items()}
    meanings |= {
        "noise_in_plane": meanings["noise_um"],
        "noise_from": "source of the noise: given, the recording's first frames, or the misfit "
        "within each frame.",
        "kind": "kind of softness correction.",
    }
    used = {name: value for name, value in _flatten(settings) if (name, value) != ("seed", None)}
    return [_explain(name, value, meanings) for name, value in used.items()]


def _explain(name: str, value: Any, meanings: Mapping[str, str]) -> Explained:
    """A setting; docstrings describe it under its name, with or without the unit."""
    key = name.rpartition(".")[2]
    plain, _, suffix = key.rpartition("_")
    meaning = meanings.get(key) or meanings.get(plain, "")
    unit = re.search(r"\s*\[([^\[\]]+)\]", meaning)
    if unit is not None:
        meaning = meaning.replace(unit[0], "", 1)
    in_name = suffix if key not in meanings and plain in meanings else ""
    in_name = {"um": "µm", "millipx": "px/1000"}.get(in_name, in_name)  # px/1000: older records
    shown = in_name or (unit[1] if unit else "")
    meaning = re.sub(r"^\w\w", lambda start: start[0].capitalize(), meaning)  # not single symbols
    return Explained(name, _show(value), shown.strip("-"), meaning)


def _flatten(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by name; those in a table have its name as prefix, and empty tables are omitted."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{before}{name}.")
        else:
            yield before + name, value


def _show(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_show, value))
    return str(value)
