"""The overview page of `papers run`: `index.html` in its folder."""

import ast
import csv
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from estimation.frames.files import write_whole
from estimation.output.report import render_page
from papers.items import ITEMS


class Made(NamedTuple):
    """A computed item."""

    name: str  # name of the item
    title: str  # one sentence that describes it
    picture: str  # path of its figure, relative to the folder
    tables: list[str]  # paths of its tables, relative to the folder
    # rows that compare a printed number with ours; empty without printed numbers
    compared: list[dict[str, str]]


def picture_of(out: Path, paper: str, item: str) -> Path:
    """The figure of an item in the folder, written once its tables are."""
    return out / paper / f"{item}.png"


def write_index(out: Path, left_out: Mapping[tuple[str, str], str]) -> None:
    """Write `index.html`: every item whose figure is in the folder, and why items were skipped.

    Raises:
        OSError: the page cannot be written.
    """
    made = {
        paper: [
            _describe(out, paper, item)
            for item in items
            if picture_of(out, paper, item).is_file() and (paper, item) not in left_out
        ]
        for paper, items in ITEMS.items()
    }
    reasons = {" ".join(item): reason for item, reason in left_out.items()}
    page = render_page("index.html", {}, package="papers", made=made, left_out=reasons)
    write_whole(out / "index.html", page)


def describe_item(paper: str, item: str) -> str:
    """The description of an item: the first line of the docstring of its module or package."""
    folder = resources.files(f"papers.{paper}")
    source = folder / f"{item}.py"
    if not source.is_file():
        source = folder / item / "__init__.py"
    text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or item
    return text.splitlines()[0]


def _describe(out: Path, paper: str, item: str) -> Made:
    files = [*(out / paper).glob(f"{item}.csv"), *sorted((out / paper).glob(f"{item}_*.csv"))]
    tables = [file.relative_to(out).as_posix() for file in files]
    compared: list[dict[str, str]] = []
    published = out / paper / f"{item}_published.csv"
    if published.is_file():
        with published.open(encoding="utf-8", newline="") as file:
            compared = list(csv.DictReader(file))
    picture = picture_of(out, paper, item).relative_to(out).as_posix()
    return Made(item, describe_item(paper, item), picture, tables, compared)
