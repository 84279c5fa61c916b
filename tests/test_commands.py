"""What the commands of all packages share: their help comes at once, and nothing of it is cut."""

import subprocess
import sys
from importlib import import_module

import pytest
import typer
from typer.testing import CliRunner

import papers
from papers import console

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
    assert package.__version__.count(".") == 2
    with pytest.raises(AttributeError, match=f"'{name}' has no attribute 'no_such'"):
        package.no_such  # noqa: B018


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
