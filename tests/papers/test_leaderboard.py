import csv
import sys

import numpy as np
import pytest

from estimation.estimators import METHODS, RIVALS
from estimation.frames import datasets
from estimation.frames.archive import read_archive
from estimation.virtual.recording import PivotModel, simulate_pivot
from papers.__main__ import main
from papers.leaderboard import alarms, board, cases, settings

LIFT = {"angles_deg": (0.0, 10.0), "frames": (6,), "unloaded": 4, "pressing": 3}
TINY = {
    "rigid": settings.Condition(PivotModel(friction_ratio=0.3), path=LIFT),
    "gappy": settings.Condition(
        PivotModel(friction_ratio=0.3), path=LIFT, shift_mm=(0.3, 0.0), missing=0.1, dropped=0.2
    ),
}


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setattr(settings, "CONDITIONS", TINY)
    model = PivotModel(friction_ratio=0.3)
    monkeypatch.setattr(  # the solver's path is tested with its own study
        cases,
        "simulate_elongated",
        lambda friction, draw, _: simulate_pivot(model, seed=draw, **LIFT),
    )
    monkeypatch.setattr(settings, "GRIPS", (0.1,))
    monkeypatch.setattr(settings, "TWIST", {"angles_deg": (0.0, 25.0), "frames": (15,)})
    monkeypatch.setattr(datasets, "find", lambda name: None)


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["papers", "leaderboard", "--quick", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


def test_command_writes_every_method_and_another_groups(monkeypatch, tmp_path):
    perfect = cases.virtual_case("rigid", 0)
    lines = [
        f"rigid-0,{frame},{np.degrees(angle) + 0.5:.6f}"
        for frame, angle in enumerate(perfect.reference)
        if np.isfinite(angle)
    ]
    theirs = tmp_path / "theirs.csv"
    theirs.write_text("\n".join(["case,frame,angle_deg", *lines[1:]]))
    arguments = ("--out", tmp_path, "--angles", theirs, "--export", tmp_path / "cases")
    assert not run(monkeypatch, *arguments)
    folder = tmp_path / "leaderboard"
    assert {path.name for path in folder.iterdir()} == {
        "leaderboard.csv",
        "leaderboard.png",
        "warnings.csv",
        "curves.png",
    }
    with (folder / "leaderboard.csv").open() as file:
        rows = {(row["case"], row["method"]): row for row in csv.DictReader(file)}
    every = {(c, m) for c in (*TINY, "elongated") for m in METHODS | RIVALS}
    assert set(rows) == every | {("rigid", "theirs")}
    other = rows["rigid", "theirs"]
    # written with six digits
    assert float(other["bias [°]"]) == pytest.approx(0.5, abs=1e-5)
    assert float(other["spread [°]"]) == pytest.approx(0.0, abs=1e-5)
    assert float(other["answered [%]"]) == pytest.approx(100 * (1 - 1 / len(lines)), abs=0.1)
    exported = read_archive(tmp_path / "cases" / "gappy-0.npz")
    np.testing.assert_array_equal(
        exported.positions, cases.virtual_case("gappy", 0).recording.positions
    )
    assert 0.05 < np.mean(~exported.valid) < 0.15
    assert "`frame`: index of the frame in the recording" in (
        tmp_path / "cases" / "README.md"
    ).read_text(encoding="utf-8")


def test_a_frame_is_the_row_of_the_recording_and_not_its_source_index(tmp_path):
    case = cases.virtual_case("gappy", 0)
    assert case.recording.source_index[-1] > len(case.recording)  # frames were dropped
    (tmp_path / "theirs.csv").write_text(
        f"case,frame,angle_deg\ngappy-0,{len(case.recording) - 1},5"
    )
    (theirs,) = board.read_answers(tmp_path / "theirs.csv", [case])
    assert np.degrees(theirs.angle[-1]) == pytest.approx(5.0)
    (tmp_path / "late.csv").write_text(
        f"case,frame,angle_deg\ngappy-0,{case.recording.source_index[-1]},5"
    )
    with pytest.raises(ValueError, match=r"line 2: gappy-0 has frames 0 to"):
        board.read_answers(tmp_path / "late.csv", [case])


def test_draws_repeat(monkeypatch):
    one, two = cases.virtual_case("gappy", 3), cases.virtual_case("gappy", 3)
    np.testing.assert_array_equal(one.recording.positions, two.recording.positions)
    assert not np.array_equal(
        one.recording.positions[0], cases.virtual_case("gappy", 4).recording.positions[0]
    )


def test_a_method_that_cannot_answer_says_so_in_its_row():
    case = cases.virtual_case("rigid", 0)
    silent = board.Answers("silent", case, np.full(len(case.recording), np.nan))
    (row,) = board.tabulate([silent])
    assert row["answered [%]"] == 0.0
    assert row["mean absolute error [°]"] is None


def test_the_constant_of_a_relative_reference_does_not_count():
    case = cases.virtual_case("rigid", 0)._replace(relative=True)
    (row,) = board.tabulate([board.Answers("turned", case, case.reference + 0.7)])
    # rounding
    assert row["mean absolute error [°]"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("case,frame\nrigid-0,0", "lacks the columns angle_deg"),
        ("case,frame,angle_deg\nother,0,1.0", "no case 'other'; there are rigid-0"),
        ("case,frame,angle_deg\nrigid-0,99,1.0", "rigid-0 has frames 0 to"),
        ("case,frame,angle_deg\nrigid-0,0,much", "line 2"),
        ("case,frame,angle_deg\nrigid-0", "line 2"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(monkeypatch, tmp_path, capsys, text, message):
    (tmp_path / "theirs.csv").write_text(text)
    assert run(monkeypatch, "--out", tmp_path, "--angles", tmp_path / "theirs.csv") == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_slip_warnings_come_before_macro_slip():
    rows = {row["warning"]: row for row in alarms.tabulate_warnings(draws=1)}
    lead = rows["turning_ratio"]["mean lead [s]"]
    assert isinstance(lead, float)
    assert lead > 0.0
    assert rows["turning_ratio"]["missed"] == "0 of 1"
