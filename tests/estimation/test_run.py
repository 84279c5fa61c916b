import errno
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.progress import Progress

from estimation.estimators import METHODS
from estimation.fields.contact import find_contact
from estimation.frames.archive import write_archive
from estimation.frames.noise import Noise
from estimation.inputs import UNFINISHED_NAME, Input, identity_of
from estimation.output.explain import explain_settings
from estimation.output.table import MARGIN_COLUMNS
from estimation.pictures.part import Part
from estimation.pictures.reader import ImageSettings
from estimation.run import report_all, run_all
from estimation.settings import Settings, describe_changes
from estimation.softness import LayeredSoftness
from estimation.sources import open_source
from estimation.tracking.tracker import estimate_angles
from estimation.tracking.trackers import Trackers
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot
from tests.cases import domed_pad, lift, rows_of

SHEAR_COLUMNS = (
    "shear_mm",
    "print_correlation",
    "slip_probability",
    "slip_mm",
    "slip_error_mm",
    "slip_since_s",
)
ALERT_COLUMNS = (
    "friction_used",
    "friction",
    "friction_low",
    "friction_high",
    "time_to_slip_s",
    "time_to_slip_low_s",
    "time_to_slip_high_s",
    "alert",
)
COLUMNS = (
    "time_s",
    "frame",
    "source_index",
    "state",
    "reason",
    "angle_deg",
    "angle_low_deg",
    "angle_high_deg",
    "since_s",
    "restarts",
    "stick_markers",
    "contact_markers",
    "contact_radius_mm",
    "moment_Nmm",
    "gel_moment_deg",
    "slip_deg",
    "gel_deg",
    "imprint_deg",
    "withdrawn_state",
    "withdrawn_angle_deg",
    "withdrawn_angle_low_deg",
    "withdrawn_angle_high_deg",
    "withdrawn_stick_markers",
)
ANGLES = np.radians(np.linspace(0.0, 10.0, 20))
FILES = {
    "angles.csv",
    "angles_all.csv",
    "moment.png",
    "summary.json",
    "report.html",
    "angles.png",
    "maps.png",
    "record.sqlite",
}
SINGLE = FILES | {"manifest.json"}
GROWING = {"angles.csv", "record.sqlite"}


@pytest.fixture
def progress():
    return Progress(disable=True)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Recording, outcome and folder of a plain run, and how often it measured a frame."""
    measured = []

    def count(*args):
        measured.append(1)
        return find_contact(*args)

    recording, out = lift(ANGLES, name="<b>&"), tmp_path_factory.mktemp("run") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("estimation.fields.measure.find_contact", count)
        outcome = run_all([Input(recording)], out, Settings(), Progress(disable=True))
    return recording, outcome, out, len(measured)


def test_everything_is_written(written):
    recording, outcome, out, _ = written
    assert not outcome.interrupted
    assert {path.name for path in out.iterdir()} == SINGLE
    rows = rows_of(out / "angles.csv")
    assert tuple(rows[0]) == COLUMNS + MARGIN_COLUMNS + SHEAR_COLUMNS + ALERT_COLUMNS
    assert len(rows) == len(recording)
    result = estimate_angles(recording)
    for i, row in enumerate(rows):
        assert int(row["frame"]) == i
        assert row["state"] == result.state[i]
        assert (row["reason"] == "") == np.isfinite(float(row["angle_deg"]))
        assert float(row["angle_deg"]) == pytest.approx(
            np.degrees(result.angle[i]), abs=1e-6, nan_ok=True
        )
        assert float(row["moment_Nmm"]) == pytest.approx(recording.moment[i, 2])
        # the moment rises in a straight line: no end can be told
        assert row["angle_margin_deg"] == row["moment_margin_Nmm"] == ""
        assert bool(row["stick_ratio"]) == bool(int(row["contact_markers"]))
    everything = rows_of(out / "angles_all.csv")
    assert {row["method"] for row in everything} == set(METHODS)
    assert len(everything) == len(METHODS) * len(recording)


def test_summary_says_what_was_done(tmp_path, progress):
    recording = lift(ANGLES[:5])
    settings = Settings(method="paper", noise=Noise.from_std(2e-3), constants={"threshold": 0.3})
    run_all([Input(recording)], tmp_path, settings, progress)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["method"] == "paper"
    assert summary["settings"]["threshold"] == 0.3
    assert summary["settings"]["noise_in_plane_um"] == 2.0
    assert summary["settings"]["noise_from"] == "given"
    explained = explain_settings(summary["settings"], "paper")
    assert all(one.meaning for one in explained), explained
    assert re.fullmatch(r"[0-9a-f]{64}", summary["sha256"])
    assert sum(summary["methods"]["rigid"]["states"].values()) == len(recording)
    assert any("unloaded reference shape" in note for note in summary["notes"])


def test_withdrawn_answers_have_columns_of_their_own(tmp_path, progress):
    legs = {"angles_deg": (0.0, 5.0, 5.0), "frames": (20, 15)}
    slides = PivotModel(friction_ratio=0.02, noise=3e-3, normal_noise=1e-2)
    recording, _ = simulate_pivot(
        slides, timing=Timing(dropped=0.0), unloaded=3, pressing=8, **legs
    )
    settings = Settings(noise=Noise.from_std(3e-3), keep_withdrawn=True)
    outcome = run_all([Input(recording)], tmp_path, settings, progress)
    rows = rows_of(tmp_path / "angles.csv")
    withdrawn = [row for row in rows if row["withdrawn_angle_deg"]]
    assert withdrawn
    assert all(row["angle_deg"] == row["withdrawn_angle_deg"] for row in withdrawn)  # left in
    assert all(row["state"] == row["withdrawn_state"] and row["reason"] for row in withdrawn)
    figures = json.loads((tmp_path / "summary.json").read_text())["methods"]["tracked"]
    assert figures["withdrawn"] == len(withdrawn)
    # the withdrawn answers are not among the frames without an angle
    missing = figures["without_angle"]
    assert set(missing) == {"before contact", "in macro slip", "while the gel rests"}
    assert sum(missing.values()) == len(rows) - figures["answered"]
    assert "3 before contact" in outcome.lines[0]


def test_the_report_needs_nothing_else(written):
    page = (written[2] / "report.html").read_text()
    sources = re.findall(r"(?:src|href)\s*=\s*\"([^\"]*)\"", page)
    assert len(sources) == 3
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "http" not in re.sub(r"base64,[^\"]*", "", page)
    without_scripts = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert without_scripts.count("<img") == 3


def test_names_from_outside_are_escaped(written):
    page = (written[2] / "report.html").read_text()
    assert "<b>&" not in page
    assert "&lt;b&gt;&amp;" in page


def test_several_recordings_get_a_folder_each(tmp_path, progress):
    inputs = [Input(lift(ANGLES[:4], name=name)) for name in ("left", "right", "left")]
    outcome = run_all(inputs, tmp_path, Settings(), progress)
    assert {path.name for path in tmp_path.iterdir()} == {
        "left-1",
        "left-2",
        "right",
        "manifest.json",
        "overview.png",
        "report.html",
    }
    assert {path.name for path in (tmp_path / "right").iterdir()} == FILES
    assert [line.split(":")[0] for line in outcome.lines[:3]] == ["left-1", "right", "left-2"]
    page = (tmp_path / "report.html").read_text()
    for name in ("left-1", "right", "left-2"):
        assert f'<a href="{name}/report.html">{name}</a>' in page
    run_all(inputs[:1], tmp_path, Settings(), progress)
    assert {path.name for path in tmp_path.iterdir()} == SINGLE


def test_a_frame_is_measured_once_for_all_methods_outline_and_looking_back(written):
    recording, *_, measured = written
    assert measured == len(recording)


def test_ctrl_c_keeps_what_was_done(tmp_path, progress, monkeypatch):
    done = 0
    update = Trackers.update

    def update_until(self, frame):
        nonlocal done
        done += 1
        if done > 9:
            raise KeyboardInterrupt
        return update(self, frame)

    monkeypatch.setattr(Trackers, "update", update_until)
    inputs = [Input(lift(ANGLES, name=name)) for name in ("left", "right")]
    outcome = run_all(inputs, tmp_path, Settings(), progress)
    assert outcome.interrupted
    assert len(rows_of(tmp_path / "left" / "angles.csv")) == 9
    notes = json.loads((tmp_path / "left" / "summary.json").read_text())["notes"]
    words = "Interrupted: 9 of 25 frames were done. The same command with --resume continues."
    assert words in notes
    assert f"  {words}" in outcome.lines
    assert "held so far" in outcome.lines[0]
    assert not (tmp_path / "right").exists()


def test_ctrl_c_before_the_first_answer_leaves_nothing(tmp_path, progress, monkeypatch):
    def interrupt(self, frame):
        raise KeyboardInterrupt

    monkeypatch.setattr(Trackers, "update", interrupt)
    assert run_all([Input(lift(ANGLES))], tmp_path, Settings(), progress).interrupted
    assert not list(tmp_path.iterdir())


def test_ctrl_c_while_the_report_is_written_says_how_to_get_it(tmp_path, progress, monkeypatch):
    def interrupt(run, folder):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("estimation.run.write_run", interrupt)
        outcome = run_all([Input(lift(ANGLES))], tmp_path, Settings(), progress)
    assert outcome.interrupted
    assert f"`python -m estimation report {tmp_path}`" in outcome.lines[-1]
    report_all(tmp_path)
    assert len(rows_of(tmp_path / UNFINISHED_NAME / "angles.csv")) == 25
    assert (tmp_path / UNFINISHED_NAME / "report.html").is_file()


def test_a_recording_may_be_called_as_the_folder_of_the_run(tmp_path, progress, monkeypatch):
    inputs = [Input(lift(ANGLES[:6], name=name)) for name in ("left", UNFINISHED_NAME)]
    monkeypatch.setattr("estimation.run.write_run", lambda run, folder: {})
    monkeypatch.setattr("estimation.output.overview.write_overview", lambda done, folder: None)
    run_all(inputs, tmp_path, Settings(noise=Noise.from_std(1e-3)), progress)
    folders = {path.name for path in tmp_path.iterdir() if path.is_dir()}
    assert folders == {"left", f"{UNFINISHED_NAME}-2"}


def test_a_full_disk_leaves_no_half_written_file(written, tmp_path, progress, monkeypatch):
    recording, _, out, _ = written
    shutil.copytree(out, tmp_path, dirs_exist_ok=True)
    before = (tmp_path / "angles.csv").read_bytes()

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as raised:
        run_all([Input(recording.head(8))], tmp_path, Settings(), progress)
    assert Path(raised.value.filename).parent == tmp_path / "unfinished"
    assert (tmp_path / "angles.csv").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == SINGLE | {"unfinished"}
    assert {path.name for path in (tmp_path / "unfinished").iterdir()} == GROWING
    assert len(rows_of(tmp_path / "unfinished" / "angles.csv")) == 8


def test_a_recording_that_grows_while_it_is_read_is_reported(tmp_path, progress):
    path = tmp_path / "grasp.npz"
    write_archive(lift(np.radians([0.0, 4.0])), path)

    class Growing:
        def put(self, answer):
            path.write_bytes(path.read_bytes() + b"more")

        def restart(self):
            pass

    item = Input(open_source(path, ImageSettings(), "grasp"), place=str(path))
    lines = run_all([item], tmp_path / "out", Settings(), progress, [Growing()]).lines
    assert "  grasp changed while it was read" in lines[-1]


def test_what_differs_between_two_commands_is_named():
    images = ImageSettings(part=Part(crop=(1, 2, 30, 40)))
    then = identity_of("a.mkv", Settings())
    now = identity_of("a.mkv", Settings(images=images, preview=True))
    assert set(describe_changes(then, now)) == {
        "crop=None then, crop=(1, 2, 30, 40) now",
        "preview=False then, preview=True now",
    }
    assert identity_of("a.mkv", Settings(given={"--seed": "the virtual pivot"})) == then
    layered = identity_of("a.mkv", Settings(softness=LayeredSoftness(0.5, 3.0)))
    changes = describe_changes(then, layered)
    assert "thickness=none then, thickness=3.0 now" in changes
    assert describe_changes({"source": "a.mkv", "images": "ImageSettings()"}, now) == [
        "by an earlier version, which compared other settings"
    ]
    assert describe_changes(then | {"version": "0.1.0", "images": "other"}, now) == [
        f"version=0.1.0 then, version={now['version']} now"
    ]


def test_results_in_the_folder_of_pictures_do_not_stop_its_resume(tmp_path):
    (tmp_path / "1.png").touch()
    then = identity_of(str(tmp_path), Settings())
    (tmp_path / "out").mkdir()
    assert identity_of(str(tmp_path), Settings()) == then
    (tmp_path / "2.png").touch()
    assert identity_of(str(tmp_path), Settings()) != then


def test_a_grasp_of_one_recording_is_refused(tmp_path, progress):
    items = [Input(simulate_pivot()[0], place="a.npz")] * 2
    with pytest.raises(ValueError, match=r"two fingers, got a\.npz twice"):
        run_all(items, tmp_path, Settings(grasp=True), progress)


def test_a_file_where_the_folder_should_be(tmp_path, progress):
    path = tmp_path / "out"
    path.write_text("mine")
    with pytest.raises(OSError, match="out"):
        run_all([Input(lift(ANGLES))], path, Settings(), progress)
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("recording", "note"),
    [
        (lift(ANGLES[:12], unloaded=0), "contact from the first usable frame on"),
        (lift(ANGLES[:0], unloaded=12), "no contact in the 12 usable frames of 12"),
        (lift(ANGLES).head(1), "cannot be estimated from 1 frame:"),
        (lift(ANGLES[-1:], unloaded=0), "misfit within each frame"),
        (lift(ANGLES[:6], layout=domed_pad((3, 4))), "cannot be estimated from 12 markers"),
    ],
)
def test_unusual_recordings_are_run_and_explained(tmp_path, progress, recording, note):
    outcome = run_all([Input(recording)], tmp_path, Settings(), progress)
    notes = json.loads((tmp_path / "summary.json").read_text())["notes"]
    assert any(note in line for line in notes), notes
    rows = rows_of(tmp_path / "angles.csv")
    assert len(rows) == len(recording)
    # in Python the same: no error where the command line answers, and its note
    result = estimate_angles(recording)
    angles = [float(row["angle_deg"]) for row in rows]
    assert angles == pytest.approx(np.degrees(result.angle), abs=1e-6, nan_ok=True)
    assert set(result.notes) <= set(notes)
    assert any("noise cannot be estimated" in line for line in notes) == bool(result.notes)
    if "from the first usable frame" in note:  # what the printed angle counts from
        (line,) = [line for line in notes if note in line]
        assert outcome.lines[1:] == [f"  {line}"]


def test_truth_is_compared(tmp_path, progress):
    recording, truth = simulate_pivot(frames=(12, 4, 12), seed=3)
    outcome = run_all([Input(recording, truth)], tmp_path, Settings(), progress)
    figures = json.loads((tmp_path / "summary.json").read_text())["methods"]["rigid"]
    firm = truth.stick.sum(axis=1) >= 10
    assert figures["firm_frames"] == firm.sum()
    result = estimate_angles(recording, "rigid")
    error = np.degrees(np.abs(result.angle - truth.angle))[firm & result.answered]
    assert figures["mean_absolute_error_firm_deg"] == pytest.approx(error.mean(), abs=1e-6)
    assert error.mean() < 0.02
    assert any(f"rigid: mean absolute error {error.mean():.4f}°" in line for line in outcome.lines)
