"""Options of a command, made from the settings that it fills in.

A settings object is a dataclass whose docstring says under `Attributes:` what each field is, with
its unit. Those lines are the help, its defaults the defaults: nothing is said twice. A field of
type `tuple[str, ...]` is an option that may be given several times.
"""

import functools
import inspect
import re
from collections.abc import Callable
from dataclasses import Field, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

_PLAIN = (bool, int, float, str, Path)
_SEVERAL = tuple[str, ...]


def option(
    shown: str = "", *names: str, more: str = "", metavar: str | None = None
) -> dict[str, Any]:
    """Metadata of a field: what its help calls a default of None, and its names as an option.

    Args:
        shown: what holds where the option is not given.
        *names: instead of that of the field, such as `--dark/--bright`.
        more: what its help says at the end.
        metavar: what stands for its value in the help; that of its type by default.
    """
    return {"shown": shown, "names": names, "more": more, "metavar": metavar}


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """A command that has an option for each plain field of its parameters that are dataclasses.

    A dataclass within a dataclass is spread as well; a field of another type keeps its default. One
    that is made while the program runs is given as `Annotated[Any, made]`.
    """
    hints = get_type_hints(command, include_extras=True)
    signature = inspect.signature(command)
    owners = {name: (*get_args(hint)[1:], hint)[0] for name, hint in hints.items()}
    whole = {name: owners[name] for name in signature.parameters if is_dataclass(owners[name])}
    parameters = [
        one.replace(annotation=hints[name])
        for name, one in signature.parameters.items()
        if name not in whole
    ]
    parameters += [option for owner in whole.values() for option in _options_of(owner)]

    @functools.wraps(command)
    def spread_command(**given: Any) -> None:
        command(
            **{name: given[name] for name in signature.parameters if name not in whole},
            **{name: _fill(owner, given) for name, owner in whole.items()},
        )

    vars(spread_command)["__signature__"] = signature.replace(
        parameters=[one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in parameters]
    )
    spread_command.__annotations__ = {one.name: one.annotation for one in parameters}
    return spread_command


def describe_parameters(owner: object) -> dict[str, str]:
    """What the docstring of a class or function says of each attribute or argument."""
    if isinstance(owner, type) and owner.__base__ is not None:
        inherited = describe_parameters(owner.__base__)
    else:
        inherited = {}
    text = inspect.getdoc(owner) or ""
    section = re.search(r"^(?:Attributes|Args):\n((?:[ \t]+.*\n?|\n)*)", text, re.MULTILINE)
    if section is None:
        return inherited
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8,}.*)*)", section.group(1), re.MULTILINE)
    return inherited | {name: " ".join(said.split()) for name, said in entries}


def _options_of(owner: type) -> list[inspect.Parameter]:
    said, hints = describe_parameters(owner), get_type_hints(owner)
    options = []
    for field in fields(owner):
        if is_dataclass(hints[field.name]):
            options += _options_of(hints[field.name])
        elif _is_plain(hints[field.name]):
            told = _option(field, hints[field.name], said[field.name])
            options.append(told)
    return options


def _is_plain(hint: Any) -> bool:
    if hint == _SEVERAL:
        return True
    if get_origin(hint) is not tuple and get_args(hint):  # of a union
        return all(map(_is_plain, get_args(hint)))
    return all(one in (*_PLAIN, NoneType) for one in get_args(hint) or (hint,))


def _option(field: Field, hint: Any, said: str) -> inspect.Parameter:
    names = field.metadata.get("names", ())
    if not names and hint is bool:
        names = (f"--{field.name.replace('_', '-')}",)  # without its opposite
    shown = field.metadata.get("shown", "")
    text = said[:1].upper() + said[1:] + field.metadata.get("more", "")
    metavar = field.metadata.get("metavar")
    made = typer.Option(*names, help=text, show_default=shown or True, metavar=metavar)
    return inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=None if hint == _SEVERAL else field.default,
        annotation=Annotated[list[str] | None if hint == _SEVERAL else hint, made],
    )


def _fill(owner: type, given: dict[str, Any]) -> Any:
    hints, filled = get_type_hints(owner), {}
    for field in fields(owner):
        if is_dataclass(hints[field.name]):
            filled[field.name] = _fill(hints[field.name], given)
        elif _is_plain(hints[field.name]):
            value = given[field.name]
            filled[field.name] = tuple(value or ()) if hints[field.name] == _SEVERAL else value
    return owner(**filled)
