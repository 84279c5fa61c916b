"""Imports go one way, between and within the packages; no level, file or function is too long."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import contactmodel
from tests.structure import (
    PACKAGES,
    ROOT,
    draw_rooms,
    find_constants,
    find_levels,
    find_rooms,
    imported_modules,
    is_checkout,
    needs_sources,
)

MOST_ENTRIES = 20
LONGEST_FILE, LONGEST_FUNCTION = 400, 60  # lines
MOST_CONSTANTS = 79  # at the top level of the files of `estimation`
SINGLE_WORDS = {"METHODS", "Z95"}
"""Constants whose names may be one word; no others may be added."""


@pytest.mark.parametrize("name", [".git", *PACKAGES])
def test_no_test_of_the_sources_is_skipped_beside_any_of_them(name, tmp_path):
    assert not is_checkout(tmp_path)
    (tmp_path / name).mkdir()
    assert is_checkout(tmp_path)


def test_no_test_of_the_sources_is_skipped_where_they_are_imported():
    if Path(contactmodel.__file__).is_relative_to(ROOT):
        assert is_checkout(ROOT)
        assert not needs_sources.args[0]


@needs_sources
@pytest.mark.parametrize("package", PACKAGES)
def test_imports_go_one_way(package):
    later = {*PACKAGES[PACKAGES.index(package) + 1 :], "tests"}
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        assert not {name.split(".")[0] for name in imported_modules(path)} & later, path


@needs_sources
@pytest.mark.parametrize("package", PACKAGES)
def test_no_files_and_folders_of_a_level_import_each_other(package):
    for level in find_levels(package):
        TopologicalSorter(find_rooms(level)).prepare()  # raises where there is a circle
        entries = [one for one in (ROOT / level).iterdir() if one.name != "__pycache__"]
        assert len(entries) <= MOST_ENTRIES, level


@needs_sources
@pytest.mark.parametrize("package", PACKAGES)
def test_files_and_functions_stay_short(package):
    for path in (ROOT / package).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert text.count("\n") <= LONGEST_FILE, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                assert lines <= LONGEST_FUNCTION, f"{path}: {node.name}"


@needs_sources
def test_constants_are_few_and_their_names_say_what_they_are():
    constants = [
        name for path in (ROOT / "estimation").rglob("*.py") for name in find_constants(path)
    ]
    assert len(constants) <= MOST_CONSTANTS
    assert {name for name in constants if "_" not in name.strip("_")} <= SINGLE_WORDS


@needs_sources
def test_a_picture_shows_every_room():
    level = find_levels("estimation")[0]
    words = {text.get_text() for text in draw_rooms(level).axes[0].texts}
    assert set(find_rooms(level)) <= words
