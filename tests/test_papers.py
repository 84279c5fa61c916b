"""Every item of every paper runs in its quick size, and every printed number has ours beside it."""

import csv
import re
import sys
from functools import cache
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest

from papers.__main__ import main
from papers.items import ITEMS
from papers.marker_images import clips
from papers.published import KINDS, compare, read_published
from tests.cases import slow_case

PUBLISHED = {paper: read_published(paper) for paper in ITEMS}


AT_MOST = {
    ("fig7b", "mean_absolute_error"): 0.02,
    ("fig7b", "mean_absolute_error_10um"): 0.1,
    ("fig9b", "mean_absolute_error"): 0.3,
    ("fig9b", "worst_object"): 0.3,
}
"""Errors that ours must keep to [deg]: targets of the study, an order below what was printed."""

SLOW = ("fig8b", "fig9b", "error_comparison", "section_vi")  # each solves many contacts


@cache
def result_of(compute):
    """Once for the items that share it."""
    return compute(quick=True)


@pytest.mark.parametrize(
    "item",
    [slow_case(i) if i in SLOW else i for i in ITEMS["li2024"]],
)
def test_printed_numbers_are_reproduced_or_told_apart(item):
    module = import_module(f"papers.li2024.{item}")
    result = result_of(module.compute)
    rows = [row for row in PUBLISHED["li2024"] if row.item == item]
    assert rows, f"{item} has no row in published.csv"
    ours = module.numbers(result)
    verdicts = [one["verdict"] for one in compare(rows, ours)]
    assert "WRONG" not in verdicts, verdicts
    for row, verdict in zip(rows, verdicts, strict=True):  # hardware is compared, never passed
        assert (verdict == "compared") == (row.kind == "hardware")
        assert np.isfinite(ours[row.quantity])
    for (of, quantity), most in AT_MOST.items():
        assert of != item or ours[quantity] < most
    assert all(module.tables(result).values())
    plt.close(module.plot(result))


def test_every_row_belongs_to_an_item_and_gives_its_reason():
    for paper, rows in PUBLISHED.items():
        for row in rows:
            assert row.item in ITEMS[paper]
            assert row.kind in KINDS
            assert row.source
            # a tolerance has a number and a reason; of hardware nothing is tolerated
            assert (row.kind == "hardware") == (row.tolerance == "")
            assert row.kind == "hardware" or row.tolerance.partition(": ")[2]
            assert row.kind == "hardware" or row.allowed >= 0


def test_a_row_that_should_differ_is_wrong_when_it_does_not():
    row = PUBLISHED["li2024"][0]._replace(value=2.0, tolerance="0.1: for the test", differs="why")
    assert row.judge(2.05) == "WRONG"
    assert row.judge(2.5) == "differs"
    assert row._replace(differs="").judge(2.05) == "reproduced"
    assert row._replace(differs="").judge(float("nan")) == "WRONG"
    assert row._replace(kind="hardware", tolerance="").judge(2.0) == "compared"


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["papers", *map(str, arguments)])
    main()


def test_run_draws_and_prints_ours_beside_theirs(tmp_path, monkeypatch, capsys):
    with pytest.raises(SystemExit) as done:
        run(monkeypatch, "run", "li2024", "method", "--quick", "--out", tmp_path)
    assert not done.value.code
    assert "reproduced" in capsys.readouterr().out
    assert (tmp_path / "li2024" / "method.png").stat().st_size > 0
    written = (tmp_path / "li2024" / "method_published.csv").read_text()
    rows = list(csv.DictReader(written.splitlines()))
    assert {row["verdict"] for row in rows} == {"reproduced"}
    page = (tmp_path / "index.html").read_text()
    for link in re.findall(r'(?:href|src)="([^"#]+)"', page):
        assert (tmp_path / link).is_file(), link
    assert "Constants of the method as printed" in page
    assert page.count("<td>reproduced</td>") == len(rows)


def test_an_interrupted_run_is_resumed(tmp_path, monkeypatch):
    def stop(**_):
        raise RuntimeError("stopped")

    def run_both(*options):
        with pytest.raises(SystemExit) as done:
            run(monkeypatch, "run", "--quick", "--out", tmp_path, *options)
        return done.value.code

    items = [("li2024", "method"), ("marker_images", "registered")]
    monkeypatch.setattr("papers.__main__.choose_items", lambda paper, item: items)
    monkeypatch.setattr("papers.marker_images.registered.compute", stop)
    assert run_both() == 2
    first = (tmp_path / "li2024" / "method.png").stat().st_mtime_ns
    assert not (tmp_path / "marker_images").exists()
    nothing = clips.Clips(tmp_path, [], {})
    monkeypatch.setattr("papers.marker_images.registered.compute", lambda **_: nothing)
    assert not run_both("--resume")
    assert (tmp_path / "li2024" / "method.png").stat().st_mtime_ns == first
    assert (tmp_path / "marker_images" / "registered.png").exists()
    page = (tmp_path / "index.html").read_text()
    assert '<h3 id="li2024-method">' in page
    assert '<h3 id="marker_images-registered">' in page


def test_ctrl_c_says_what_is_kept_and_how_to_resume(tmp_path, monkeypatch, capsys):
    def interrupt(**_):
        raise KeyboardInterrupt

    items = [("li2024", "method"), ("marker_images", "registered")]
    monkeypatch.setattr("papers.__main__.choose_items", lambda paper, item: items)
    monkeypatch.setattr("papers.marker_images.registered.compute", interrupt)
    monkeypatch.setattr("contactmodel.common.command_line._leave_at_once", lambda: None)
    with pytest.raises(SystemExit) as done:
        run(monkeypatch, "run", "--quick", "--out", tmp_path)
    assert done.value.code == 130
    said = " ".join(capsys.readouterr().err.split())
    kept = f"interrupted: finished items are in {tmp_path}; repeat the command with --resume"
    assert kept in said
    assert (tmp_path / "li2024" / "method.png").exists()


def test_an_item_without_its_data_does_not_stop_the_others(tmp_path, monkeypatch, capsys):
    def compute(**_):
        raise OSError("cannot be downloaded")

    items = [("marker_images", "clips"), ("li2024", "method")]
    monkeypatch.setattr("papers.__main__.choose_items", lambda paper, item: items)
    monkeypatch.setattr("papers.marker_images.clips.compute", compute)
    with pytest.raises(SystemExit) as done:
        run(monkeypatch, "run", "--quick", "--out", tmp_path)
    assert done.value.code == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "marker_images clips: cannot be downloaded" in said
    assert f"marker_images clips left out of the results in {tmp_path}" in said
    assert (tmp_path / "li2024" / "method.png").exists()
    page = (tmp_path / "index.html").read_text()
    assert "<b>marker_images clips</b>: cannot be downloaded" in page
    assert '<h3 id="li2024-method">' in page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "smith1999"], "unknown paper 'smith1999'; choose from li2024"),
        (["run", "li2024", "fig99"], "li2024 has no item 'fig99'; it has method"),
        (["sweep", "papers.nothing"], "no study 'papers.nothing'"),
    ],
)
def test_unknown_names_are_told_with_what_there_is(monkeypatch, capsys, arguments, message):
    with pytest.raises(SystemExit) as done:
        run(monkeypatch, *arguments)
    assert done.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_a_table_without_rows_is_written(tmp_path, monkeypatch):
    one = [("marker_images", "registered")]
    monkeypatch.setattr("papers.__main__.choose_items", lambda paper, item: one)
    nothing = clips.Clips(tmp_path, [], {})
    monkeypatch.setattr("papers.marker_images.registered.compute", lambda **_: nothing)
    with pytest.raises(SystemExit) as done:
        run(monkeypatch, "run", "--quick", "--out", tmp_path)
    assert not done.value.code
    folder = tmp_path / "marker_images"
    assert (folder / "registered_worst.csv").read_text().strip() == ""
    assert (folder / "registered.png").exists()
