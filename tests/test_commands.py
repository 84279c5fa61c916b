"""What the commands of all packages share: their help comes at once, and nothing of it is cut."""

import os
import re
import subprocess
import sys
from importlib import import_module

import pytest
import typer
from rich.progress import Progress
from typer.testing import CliRunner

import papers
from contactmodel.common import command_line
from contactmodel.common.command_line import describe_error
from papers import console
from papers.__main__ import _Cases

PACKAGES = ("contactmodel", "estimation", "calibration", "papers")
HEAVY = {"cv2", "jax", "matplotlib", "scipy.optimize", "scipy.spatial", "scipy.stats"}


def test_commands_are_known_without_what_they_run():
    modules = ", ".join(f"{package}.__main__" for package in PACKAGES)
    code = f"import sys, {modules}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(done.stdout.split())


@pytest.mark.parametrize("name", PACKAGES)
def test_public_names_are_there_on_demand(name):
    package = import_module(name)
    assert set(package.__all__) < set(dir(package))
    for public in package.__all__:
        assert getattr(package, public) is not None, public
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?(\+[\w.]+)?", package.__version__)
    unknown = "no_such"
    with pytest.raises(AttributeError, match=f"'{name}' has no attribute '{unknown}'"):
        getattr(package, unknown)


def commands(app):
    """Every command below an application, by the words that lead to it."""
    group = typer.main.get_command(app)
    found, waiting = {}, [((), group)]
    while waiting:
        words, command = waiting.pop()
        if hasattr(command, "commands"):
            waiting += [((*words, name), one) for name, one in command.commands.items()]
        else:
            found[" ".join(words)] = command
    return found


COMMANDS = commands(console.app)


def test_one_command_has_those_of_all_packages():
    assert {"simulate", "estimation run", "calibration noise", "papers sweep"} < set(COMMANDS)
    for package in PACKAGES[1:]:
        own = commands(import_module(f"{package}.__main__").app)
        assert {f"{package} {name}" for name in own} < set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_what_is_taken_where_nothing_is_given(name):
    for option in COMMANDS[name].params:
        flag = option.is_flag and not option.secondary_opts if hasattr(option, "is_flag") else True
        said = isinstance(option.show_default, str) or option.default is not None
        assert flag or option.required or said, option.name


def test_lists_of_commands_are_not_cut(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for group in ("estimation", "calibration", "papers"):
        shown = " ".join(CliRunner().invoke(console.app, [group, "--help"]).output.split())
        for name, command in COMMANDS.items():
            if name.startswith(f"{group} "):
                assert " ".join(command.help.split("\n\n")[0].split()) in shown


@pytest.mark.parametrize("words", [[], ["estimation"], ["calibration"], ["papers"]])
def test_version_is_told(words):
    shown = CliRunner().invoke(console.app, [*words, "--version"])
    assert (shown.exit_code, shown.output) == (0, f"contactmodel {papers.__version__}\n")


def test_ctrl_c_leaves_without_what_would_crash_a_compilation(monkeypatch):
    def end(status):
        raise InterruptedError(status)

    app = command_line.make_app("Waits.")

    @app.command()
    def wait():
        raise KeyboardInterrupt

    monkeypatch.setattr(command_line.sys, "argv", ["app", "wait"])
    monkeypatch.setitem(command_line.sys.modules, "jax", import_module("jax"))
    monkeypatch.setattr(command_line.os, "_exit", end)
    with pytest.raises(InterruptedError, match="130"):
        command_line.run_app(app)


def test_a_missing_file_is_named_first(tmp_path):
    path = tmp_path / "nope.csv"
    with pytest.raises(FileNotFoundError) as caught:
        path.read_text()
    assert describe_error(caught.value) == f"{path}: no such file or directory"
    assert describe_error(OSError("the disk is full")) == "the disk is full"


def test_progress_without_a_known_end_counts_what_is_done():
    progress = Progress(disable=True)
    unknown = progress.add_task("cases", total=None, completed=14)
    known = progress.add_task("cases", total=20, completed=14)
    shown = {task.id: _Cases().render(task).plain for task in progress.tasks}
    assert shown == {unknown: "14 done", known: "14 of 20"}


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8", "utf-16"])
def test_signs_are_printed_whatever_the_encoding(encoding):
    """On Windows, output to a file is cp1252, which has no minus sign."""
    code = (
        "from contactmodel.common.command_line import run_app, say\n"
        "run_app(lambda: (print('−2°'), say('−3°')))"
    )
    own = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run([sys.executable, "-c", code], env=own, capture_output=True, check=True)
    used = encoding if encoding.startswith("utf") else "utf-8"
    assert done.stdout.decode(used).strip() == "−2°"
    assert done.stderr.decode(used).strip() == "−3°"


def compile_with(folder, **environment):
    """Run a command's set-up and compile a function, in a process of its own."""
    code = (
        "from contactmodel.common.command_line import run_app\n"
        "run_app(lambda: None)\n"
        "import jax, jax.numpy as jnp\n"
        "jax.config.update('jax_persistent_cache_min_compile_time_secs', 0.0)\n"
        "print(float(jax.jit(lambda x: jnp.sin(x) + 1.0)(0.0)), jnp.ones(1).dtype)"
    )
    own = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    everything = {**own, "CONTACTMODEL_CACHE": str(folder), **environment}
    done = subprocess.run(
        [sys.executable, "-c", code], env=everything, capture_output=True, text=True, check=True
    )
    assert done.stdout == "1.0 float64\n"
    return done.stderr


def test_what_commands_compile_is_kept_unless_switched_off(tmp_path):
    compile_with(tmp_path / "off", JAX_ENABLE_COMPILATION_CACHE="0")
    assert not (tmp_path / "off").exists()
    compile_with(tmp_path / "on", JAX_ENABLE_COMPILATION_CACHE="1")
    kept = list((tmp_path / "on" / "compiled").glob("*-cache"))
    assert kept
    for one in kept:
        one.write_bytes(one.read_bytes()[:100])  # as of a process that was killed, or a full disk
    assert "cache" not in compile_with(tmp_path / "on", JAX_ENABLE_COMPILATION_CACHE="1")


def test_a_cache_folder_that_cannot_be_made_does_no_harm(tmp_path):
    (tmp_path / "file").write_text("no folder")
    assert "cache" not in compile_with(tmp_path / "file", JAX_ENABLE_COMPILATION_CACHE="1")
