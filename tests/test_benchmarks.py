"""The benchmarks' command lines; what they measure is not tested."""

import os
import runpy
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "benchmarks"
NAMES = sorted(
    path.stem for path in FOLDER.glob("*.py") if '"__main__"' in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", NAMES)
def test_help_is_printed_and_nothing_measured(name, monkeypatch, capsys):
    monkeypatch.setattr(os, "environ", os.environ.copy())  # where some set numbers of threads
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as done:
        runpy.run_module(f"tests.benchmarks.{name}", run_name="__main__")
    assert not done.value.code
    assert f"python -m tests.benchmarks.{name}" in capsys.readouterr().out
