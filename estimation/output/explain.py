"""The settings of a run with units and meaning, as the docstrings of the settings have them."""

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from contactmodel.common.options import describe_parameters
from estimation.choices import AlertSettings, ContactSettings, Known
from estimation.estimators import METHODS, RIVALS, method_settings
from estimation.settings import Settings
from estimation.softness.files import KINDS


class Explained(NamedTuple):
    """A setting of a run.

    Attributes:
        name: as in `summary.json`.
        value: as text.
        unit: of the value; empty where it has none.
        meaning: empty where nothing is said of it.
    """

    name: str
    value: str
    unit: str
    meaning: str


def explain_settings(settings: Mapping[str, Any], method: str) -> list[Explained]:
    """Each setting of a run with its unit and meaning.

    Args:
        settings: as in `summary.json`.
        method: the chosen one.
    """
    owners: list[object] = [Settings, ContactSettings, AlertSettings, Known]
    kind = settings.get("softness", {}).get("kind")
    owners += [KINDS[kind]] if kind in KINDS else []
    owners += [type(method_settings(method))] if method in METHODS | RIVALS else []
    said = {name: text for one in owners for name, text in describe_parameters(one).items()}
    said |= {
        "noise_in_plane": said["noise_um"],
        "noise_from": "source of the noise: given, the recording's first frames, or the misfit "
        "within each frame.",
        "kind": "kind of softness correction.",
    }
    return [_explain(name, value, said) for name, value in _flatten(settings)]


def _explain(name: str, value: Any, said: Mapping[str, str]) -> Explained:
    """A setting, named in the docstrings as it is here or without its unit."""
    key = name.rpartition(".")[2]
    plain, _, suffix = key.rpartition("_")
    meaning = said.get(key) or said.get(plain, "")
    unit = re.search(r"\s*\[([^\[\]]+)\]", meaning)
    if unit is not None:
        meaning = meaning.replace(unit[0], "", 1)
    in_name = "" if key in said or plain not in said else {"millipx": "px/1000"}.get(suffix, suffix)
    shown = in_name.replace("um", "µm") or (unit[1] if unit else "")
    meaning = re.sub(r"^\w\w", lambda start: start[0].capitalize(), meaning)  # but not a symbol
    return Explained(name, _show(value), shown.strip("-"), meaning)


def _flatten(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by name, those in tables by the names of both; empty tables are left out."""
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
