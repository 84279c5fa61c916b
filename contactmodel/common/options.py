"""Command options made from settings dataclasses.

The docstring of a settings dataclass describes each field with its unit under `Attributes:`. These
lines are the options' help, and the fields' defaults are the options' defaults, so that nothing is
written twice. A field of type `tuple[str, ...]` is an option that may be repeated.
"""

import functools
import inspect
import re
from collections.abc import Callable, Iterable
from dataclasses import Field, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

_PLAIN = (bool, int, float, str, Path)
_SEVERAL = tuple[str, ...]


def option(
    shown: str = "", *names: str, more: str = "", metavar: str | None = None, of: str = ""
) -> dict[str, Any]:
    """Metadata of a field: its option's names, and texts of the help.

    Args:
        shown: text for a default of None: what applies without the option.
        *names: names in place of the field's, such as `--dark/--bright`.
        more: text at the end of the help.
        metavar: placeholder of the value in the help; by default that of its type.
        of: what the option applies to, in words; empty if to everything.
    """
    return {"shown": shown, "names": names, "more": more, "metavar": metavar, "of": of}


def given_options(choices: Any) -> dict[str, str]:
    """Options whose value is not their default, each with what it applies to (`option`'s `of`)."""
    given = {}
    for field in fields(choices):
        value = getattr(choices, field.name)
        if is_dataclass(value):
            given |= given_options(value)
        elif value not in (field.default, field.default_factory):
            given[_names(field)[0]] = field.metadata.get("of", "")
    return given


def expect_none(given: Iterable[str], why: str) -> None:
    """Check that no options were given that would have no effect.

    Args:
        given: names of the options that were given.
        why: the case in which they have no effect, such as `with --k-ratio`.

    Raises:
        ValueError: some were.
    """
    if names := list(given):
        them = "it" if len(names) == 1 else "them"
        verb = "has" if len(names) == 1 else "have"
        raise ValueError(f"{', '.join(names)} {verb} no effect {why}: leave {them} out")


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each dataclass parameter of a command by one option per plain field.

    Nested dataclasses are spread as well. A field of another type keeps its default. A dataclass
    that is made while the program runs is annotated as `Annotated[Any, made]`.
    """
    hints = get_type_hints(command, include_extras=True)
    signature = inspect.signature(command)
    owners = {name: (*get_args(hint)[1:], hint)[0] for name, hint in hints.items()}
    whole = {name: owners[name] for name in signature.parameters if is_dataclass(owners[name])}
    parameters = [
        parameter.replace(annotation=hints[name])
        for name, parameter in signature.parameters.items()
        if name not in whole
    ]
    parameters += [option for owner in whole.values() for option in _options_of(owner)]

    @functools.wraps(command)
    def spread_command(**options: Any) -> None:
        command(
            **{name: options[name] for name in signature.parameters if name not in whole},
            **{name: _fill(owner, options) for name, owner in whole.items()},
        )

    vars(spread_command)["__signature__"] = signature.replace(
        parameters=[
            parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters
        ]
    )
    spread_command.__annotations__ = {
        parameter.name: parameter.annotation for parameter in parameters
    }
    return spread_command


def describe_parameters(owner: object) -> dict[str, str]:
    """Descriptions of attributes or arguments in the docstring of a class or function."""
    if isinstance(owner, type) and owner.__base__ is not None:
        inherited = describe_parameters(owner.__base__)
    else:
        inherited = {}
    text = inspect.getdoc(owner) or ""
    section = re.search(r"^(?:Attributes|Args):\n((?:[ \t]+.*\n?|\n)*)", text, re.MULTILINE)
    if section is None:
        return inherited
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8,}.*)*)", section.group(1), re.MULTILINE)
    return inherited | {name: " ".join(text.split()) for name, text in entries}


def _options_of(owner: type) -> list[inspect.Parameter]:
    descriptions, hints = describe_parameters(owner), get_type_hints(owner)
    options = []
    for field in fields(owner):
        if is_dataclass(hints[field.name]):
            options += _options_of(hints[field.name])
        elif _is_plain(hints[field.name]):
            options.append(_option(field, hints[field.name], descriptions[field.name]))
    return options


def _is_plain(hint: Any) -> bool:
    if hint == _SEVERAL:
        return True
    if get_origin(hint) is not tuple and get_args(hint):  # a union
        return all(map(_is_plain, get_args(hint)))
    return all(kind in (*_PLAIN, NoneType) for kind in get_args(hint) or (hint,))


def _names(field: Field) -> tuple[str, ...]:
    return field.metadata.get("names", ()) or (f"--{field.name.replace('_', '-')}",)


def _option(field: Field, hint: Any, description: str) -> inspect.Parameter:
    names = field.metadata.get("names", ())
    if not names and hint is bool:
        names = _names(field)  # without an option --no-…
    shown = field.metadata.get("shown", "")
    text = description[:1].upper() + description[1:] + field.metadata.get("more", "")
    metavar = field.metadata.get("metavar")
    made = typer.Option(*names, help=text, show_default=shown or True, metavar=metavar)
    return inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=None if hint == _SEVERAL else field.default,
        annotation=Annotated[list[str] | None if hint == _SEVERAL else hint, made],
    )


def _fill(owner: type, options: dict[str, Any]) -> Any:
    hints, filled = get_type_hints(owner), {}
    for field in fields(owner):
        if is_dataclass(hints[field.name]):
            filled[field.name] = _fill(hints[field.name], options)
        elif _is_plain(hints[field.name]):
            value = options[field.name]
            filled[field.name] = tuple(value or ()) if hints[field.name] == _SEVERAL else value
    return owner(**filled)
