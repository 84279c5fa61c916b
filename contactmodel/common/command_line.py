"""Command lines of all four packages: help, errors and the set-up of JAX.

This module does not import JAX. Modules of commands import the code of a command inside its
function, so that help appears at once.
"""

import gc
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

from contactmodel.common.cache import cache_folder
from contactmodel.common.inputs import RangeWarning, RenamedKeyWarning

errors = Console(stderr=True)
say = partial(errors.print, markup=False, highlight=False, soft_wrap=True)


class Commands(TyperGroup):
    """A group of commands whose list shows the whole first paragraph of each help text."""

    def format_commands(self, ctx, formatter) -> None:
        """Write the list; long texts are wrapped, not cut."""
        rows = []
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            purpose = (command.help or "").split("\n\n")[0] if command else ""
            rows.append((name, " ".join(purpose.split())))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def make_app(purpose: str) -> typer.Typer:
    """An application without commands, with the option `--version`."""
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
    """Run an application in double precision; wrong input is reported on stderr, exit status 2."""
    _set_up_jax()
    _print_all_signs()
    warnings.showwarning = partial(_show_warning, otherwise=warnings.showwarning)
    try:
        app()
    except (ValueError, OSError, RuntimeError) as error:
        say_error(describe_error(error))
        sys.exit(2)
    except SystemExit as end:
        if end.code == 130 and "jax" in sys.modules:
            _leave_at_once()
        raise


def _leave_at_once() -> NoReturn:
    """End after Ctrl-C without Python's clean-up, in which a compilation by JAX would crash."""
    with suppress(OSError):  # of a closed pipe
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(130)


@contextmanager
def lasting_imports() -> Iterator[None]:
    """Exclude what is imported from garbage collection, for the imports of a command.

    Modules last as long as the process, but each full collection would visit all their objects:
    of a run over two recordings, that is a tenth of the processor time. Only the first command of
    a process does this, because what is garbage at that time is never freed.
    """
    gc.disable()
    try:
        yield
        if not gc.get_freeze_count():
            gc.freeze()
    finally:
        gc.enable()


def describe_error(error: Exception) -> str:
    """The message of an error with its notes; the file first, if the system reports one."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror.lower()}"
    return "; ".join([str(error), *getattr(error, "__notes__", [])])


def say_error(message: str) -> None:
    """Print an error message on stderr."""
    errors.print(f"[red]error:[/red] {escape(message)}", highlight=False, soft_wrap=True)


def _show_warning(
    message: Warning | str, category: type[Warning], *where: Any, otherwise: Callable[..., None]
) -> None:
    """Print our own warnings without the line of the program."""
    if issubclass(category, (RenamedKeyWarning, RangeWarning)):
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
    """Options of every application, before its commands."""


def _print_all_signs() -> None:
    """Print in UTF-8 where the encoding lacks our signs, as that of files on Windows does."""
    for stream in (sys.stdout, sys.stderr):
        if not isinstance(stream, io.TextIOWrapper):
            continue
        try:
            "−".encode(stream.encoding)
        except UnicodeEncodeError:
            stream.reconfigure(encoding="utf-8")


def _set_up_jax() -> None:
    """Switch JAX to double precision, and keep compiled programs in a folder for later runs.

    JAX's own environment variables are used, because most commands need no JAX and importing it
    takes long. `JAX_ENABLE_COMPILATION_CACHE=0` switches the folder off. Above 1 GiB, the programs
    that were unused for longest are deleted. A file lock keeps processes apart. If the folder
    cannot be read or written, programs are only compiled again.
    """
    os.environ["JAX_ENABLE_X64"] = "True"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder() / "compiled"))
    os.environ.setdefault("JAX_COMPILATION_CACHE_MAX_SIZE", str(2**30))  # bytes; also locks it
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    if "jax" in sys.modules:  # imported by a caller, who chooses the folder
        sys.modules["jax"].config.update("jax_enable_x64", True)
