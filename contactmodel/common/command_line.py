"""What the commands of all four packages share: how they look, fail and use JAX.

Importing this module imports no JAX, and a module of commands imports what it runs within the
functions that run it: help is shown at once.
"""

import os
import sys
import warnings
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

from contactmodel.common.cache import cache_folder
from contactmodel.common.inputs import RenamedKeyWarning

errors = Console(stderr=True)
say = partial(errors.print, markup=False, highlight=False, soft_wrap=True)


class Commands(TyperGroup):
    """A group of commands that lists them with the whole first paragraph of their help."""

    def format_commands(self, ctx, formatter) -> None:
        """Write the list, wrapped where it would be cut."""
        rows = []
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            purpose = (command.help or "").split("\n\n")[0] if command else ""
            rows.append((name, " ".join(purpose.split())))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def make_app(purpose: str) -> typer.Typer:
    """An application without commands yet, with `--version`."""
    app = typer.Typer(
        cls=Commands,
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback(help=purpose)(_take_version)
    return app


def run_app(app: typer.Typer) -> None:
    """Run an application in double precision; wrong input goes to stderr, exit status 2."""
    _set_up_jax()
    warnings.showwarning = partial(_show_warning, otherwise=warnings.showwarning)
    try:
        app()
    except (ValueError, OSError, RuntimeError) as error:
        say_error(str(error))
        sys.exit(2)


def say_error(message: str) -> None:
    """A line on stderr."""
    errors.print(f"[red]error:[/red] {escape(message)}", highlight=False, soft_wrap=True)


def _show_warning(
    message: Warning | str, category: type[Warning], *where: Any, otherwise: Callable[..., None]
) -> None:
    """What an old file's keys are called now goes to the user without a place in the program."""
    if issubclass(category, RenamedKeyWarning):
        say(f"note: {message}")
    else:
        otherwise(message, category, *where)


def _print_version(wanted: bool) -> bool:
    if wanted:
        from contactmodel import __version__

        print(f"contactmodel {__version__}")
        raise typer.Exit
    return wanted


def _take_version(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """What every application takes before its commands."""


def _set_up_jax() -> None:
    """Double precision, and a folder for compiled programs, which the next run need not compile.

    By JAX's own environment variables: most commands need no JAX, and importing it takes long.
    `JAX_ENABLE_COMPILATION_CACHE=0` switches the folder off. It grows to 1 GiB, then the programs
    go that were not used for longest; FileLock keeps processes apart. A folder that cannot be read
    or written costs what compiling costs, nothing else.
    """
    os.environ["JAX_ENABLE_X64"] = "True"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder() / "compiled"))
    os.environ.setdefault("JAX_COMPILATION_CACHE_MAX_SIZE", str(2**30))  # bytes; also locks it
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    if "jax" in sys.modules:  # imported by a caller, who chooses where programs are kept
        sys.modules["jax"].config.update("jax_enable_x64", True)
