import os
import pickle
import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import count, cycle, islice

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rich.progress import Progress

from estimation.estimators.result import Record
from estimation.frames.archive import write_archive
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout
from estimation.frames.source import FrameStream
from estimation.frames.state import load_state, save_state
from estimation.inputs import Input, find_earlier, open_inputs
from estimation.output import report
from estimation.output.record import FORMAT_VERSION, RecordReader, RecordWriter
from estimation.output.sinks.lines import LineWriter
from estimation.output.table import TableWriter
from estimation.run import report_all, run_all
from estimation.settings import Settings
from estimation.tracking.stream import AHEAD_LIVE_FRAMES, Checkpoint, Stream
from estimation.tracking.tracker import estimate_angles
from estimation.tracking.trackers import Trackers
from tests.cases import lift

SETTINGS = Settings(noise=Noise.from_std(1e-3))
ANGLES = np.radians(np.linspace(0.0, 8.0, 12))
TABLES = ("angles.csv", "angles_all.csv", "summary.json")


class Taken:
    """A sink that keeps what it takes."""

    def __init__(self):
        self.answers, self.restarts = [], 0

    def put(self, answer):
        self.answers.append(answer)

    def restart(self):
        self.answers, self.restarts = [], self.restarts + 1


def streamed(recording, frames=None):
    return FrameStream(recording.layout, iter(frames or recording), source="socket")


@pytest.fixture(scope="module")
def recording():
    return lift(ANGLES)


def test_any_frames_give_the_answers_of_a_recording(recording):
    taken, result = Taken(), estimate_angles(recording, noise=SETTINGS.noise)
    answers = list(Stream(streamed(recording), SETTINGS).answers(taken))
    assert answers == taken.answers
    assert [answer.row for answer in answers] == list(range(len(recording)))
    for name in Record.columns():
        found = [getattr(answer.estimates["tracked"], name) for answer in answers]
        np.testing.assert_array_equal(found, getattr(result, name))


def test_noise_is_told_by_the_first_frames(recording):
    stream = Stream(streamed(recording), Settings())
    assert stream.follower.noise is None or stream.follower.noise.frames <= len(recording)
    assert len(list(stream.answers())) == len(recording)
    with pytest.raises(ValueError, match="stream has no frames"):
        Stream(FrameStream(recording.layout, ()), Settings())


class Moved:
    """A source that finds a better reference in some frame."""

    name, source, convention, unit, notes, warnings = "moved", "", "", "mm", (), ()
    live = False

    def __init__(self, recording, at):
        self.layout, self.provisional = recording.layout, True
        self._recording, self._at = recording, at

    def __iter__(self):
        for i, frame in enumerate(self._recording):
            if i == self._at:
                old = self.layout
                self.layout = MarkerLayout(old.reference + 0.0, old.neighbours, old.grid_shape)
                self.provisional = False
            yield frame


def test_a_clock_in_ms_is_noted():
    recording = lift(ANGLES)
    frames = (replace(frame, time=1e3 * frame.time) for frame in recording)
    late = Stream(FrameStream(recording.layout, frames), Settings()).follower.notes
    assert "are the time stamps in s?" in " ".join(late)
    good = Stream(FrameStream(recording.layout, iter(recording)), Settings()).follower.notes
    assert "time stamps" not in " ".join(good)
    for live in (True, False):  # a recording may be slow; alerts of a live source cannot
        for noise in (None, SETTINGS.noise):
            frames = (replace(frame, time=float(i)) for i, frame in enumerate(recording))
            source = FrameStream(recording.layout, frames, live=live)
            stream = Stream(source, replace(SETTINGS, noise=noise))
            assert len(list(stream.answers())) == len(recording)
            notes = " ".join(stream.follower.notes)
            assert notes.count("are the time stamps in s?") == live


def test_a_better_reference_answers_the_frames_before_anew(recording, monkeypatch):
    taken = Taken()
    answers = list(Stream(Moved(recording, 6), SETTINGS).answers(taken))
    assert taken.restarts == 1
    assert [answer.row for answer in taken.answers] == list(range(len(recording)))
    assert len(answers) == len(recording) + 6
    monkeypatch.setattr("estimation.tracking.stream.MOST_HELD_FRAMES", 4)
    taken, stream = Taken(), Stream(Moved(recording, 6), SETTINGS)
    assert len(list(stream.answers(taken))) == len(recording)
    assert taken.restarts == 0
    assert "From frame 6 on" in stream.follower.notes[-1]


def test_a_stream_goes_on_from_a_checkpoint(recording):
    whole = list(Stream(streamed(recording), SETTINGS).answers())
    first = Stream(streamed(recording), SETTINGS)
    before = list(islice(first.answers(), 9))
    resumed = load_state(first.checkpoint())
    assert isinstance(resumed, Checkpoint)
    rest = FrameStream(recording.layout, islice(recording, resumed.row, None))
    after = list(Stream(rest, SETTINGS, resumed).answers())
    for one, other in zip([*before, *after], whole, strict=True):
        assert one.estimates["tracked"].angle == pytest.approx(
            other.estimates["tracked"].angle, abs=0.0, nan_ok=True
        )
        assert one.row == other.row


def test_a_state_that_could_run_something_is_refused():
    class Evil:
        def __reduce__(self):
            return os.system, ("true",)

    for state in (
        pickle.dumps(Evil()),
        pickle.dumps(("0", print)),
        b"nothing",
        b"\x80\x05\x8e" + b"\xff" * 8,
    ):
        with pytest.raises(ValueError, match="cannot be resumed"):
            load_state(state)
    with pytest.raises(ValueError, match="is not read"):
        load_state(save_state(TableWriter))
    with pytest.raises(ValueError, match="its state is of version 0"):
        load_state(pickle.dumps(("0", 1.0)))


def test_a_killed_run_is_whole_so_far_and_goes_on(recording, tmp_path, monkeypatch):
    whole, out = tmp_path / "whole", tmp_path / "cut"
    run_all([Input(recording)], whole, SETTINGS, Progress(disable=True))
    monkeypatch.setattr("estimation.run._Job.checkpoint_s", 0.0)

    def until(row):
        put = TableWriter.put

        def put_until(self, answer):
            if answer.row == row:
                raise MemoryError("killed")
            put(self, answer)

        return put_until

    with monkeypatch.context() as patch:
        patch.setattr(TableWriter, "put", until(9))
        with pytest.raises(MemoryError):
            run_all([Input(recording)], out, SETTINGS, Progress(disable=True))
    assert {path.name for path in out.iterdir()} == {"unfinished"}
    rows = (out / "unfinished" / "angles.csv").read_text().splitlines()
    assert len(rows) == 1 + 9
    lines = report_all(out)
    assert f"{out / 'unfinished' / 'report.html'}" in lines[0]
    page = (out / "unfinished" / "report.html").read_text()
    assert f"Interrupted: 10 of {len(recording)} frames were done." in page
    with pytest.raises(ValueError, match="continue it with the same command and --resume"):
        run_all([Input(recording)], out, SETTINGS, Progress(disable=True))
    with pytest.raises(ValueError, match="has 10 frames of an unfinished run"):
        run_all([Input(recording)] * 2, out, SETTINGS, Progress(disable=True), resume=True)
    (out / "unfinished" / ".angles.csv.half").write_text("time_s,fr")  # as write_whole leaves it
    with RecordReader(out / "unfinished" / "record.sqlite") as record:
        row, state = record.checkpoint()
        assert row == 9
    rest = FrameStream(
        recording.layout,
        islice(recording, row, None),
        recording.name,
        recording.source,
        recording.convention,
        notes=recording.notes,
    )
    job = Input(rest, checkpoint=load_state(state))
    run_all([job], out, SETTINGS, Progress(disable=True), resume=True)
    for name in TABLES:
        assert (out / name).read_text() == (whole / name).read_text()
    assert {one.name for one in out.iterdir()} == {one.name for one in whole.iterdir()}


def test_ctrl_c_within_a_frame_is_gone_on_with_as_if_it_had_not_come(tmp_path, monkeypatch):
    monkeypatch.setattr("estimation.run._Job.checkpoint_s", 0.0)
    monkeypatch.setattr("estimation.output.overview.write_overview", lambda done, folder: None)
    monkeypatch.setattr(report, "figure_png", lambda figure: plt.close(figure) or b"")
    for name in "ab":
        write_archive(lift(ANGLES), tmp_path / f"{name}.npz")
    names = [str(tmp_path)]  # which also holds the results
    out, whole, kept = tmp_path / "cut [1]", tmp_path / "whole", "a/angles.csv"
    run_all(open_inputs(names, SETTINGS, print), whole, SETTINGS, Progress(disable=True))
    calls, update = count(), Trackers.update

    def update_until(self, frame):
        if next(calls) > 26:
            update(self, frame)  # half done
            raise KeyboardInterrupt
        return update(self, frame)

    with monkeypatch.context() as patch:
        patch.setattr(Trackers, "update", update_until)
        inputs = open_inputs(names, SETTINGS, print)
        assert run_all(inputs, out, SETTINGS, Progress(disable=True)).interrupted
    written = (out / kept).stat().st_mtime_ns
    for _ in range(2):  # and a run that has finished
        inputs = open_inputs(names, SETTINGS, print, out)
        assert inputs[0].record == out / "a" / "record.sqlite"
        run_all(inputs, out, SETTINGS, Progress(disable=True), resume=True)
        for name in (f"{inner}/{table}" for inner in "ab" for table in TABLES):
            assert (out / name).read_text() == (whole / name).read_text(), name
        assert (out / kept).stat().st_mtime_ns == written


@pytest.mark.parametrize("live", [False, True])
def test_ctrl_c_is_the_end_of_what_is_live(recording, live, tmp_path, monkeypatch):
    monkeypatch.setattr("estimation.output.overview.write_overview", lambda done, folder: None)
    monkeypatch.setattr(report, "figure_png", lambda figure: plt.close(figure) or b"")

    def cut():
        yield from islice(recording, 9)
        raise KeyboardInterrupt

    source = FrameStream(recording.layout, cut(), live=live)
    outcome = run_all([Input(source)], tmp_path, SETTINGS, Progress(disable=True))
    assert outcome.interrupted != live


def test_the_noise_of_what_is_live_is_told_sooner(recording):
    read = []
    frames = (read.append(frame) or frame for frame in islice(cycle(recording), 200))
    Stream(FrameStream(recording.layout, frames, live=True), Settings())
    assert len(read) == AHEAD_LIVE_FRAMES
    Stream(FrameStream(recording.layout, frames), Settings())
    assert len(read) == AHEAD_LIVE_FRAMES + 96


def test_a_run_may_end_while_its_record_is_read(tmp_path, monkeypatch):
    writer = RecordWriter(tmp_path / "record.sqlite", ("tracked",))
    writer.set_metadata(format_version=FORMAT_VERSION)
    writer.commit()
    with RecordReader(tmp_path / "record.sqlite") as record:
        monkeypatch.setattr("estimation.output.record.RecordWriter.patience_s", 0.0)
        writer.close()
        assert len(record) == 0


def test_a_record_on_a_full_disk_says_how_to_go_on(tmp_path):
    writer = RecordWriter(tmp_path / "record.sqlite", ("tracked",))
    writer._database.execute("PRAGMA max_page_count = 1")  # no more pages than there are
    with pytest.raises(OSError, match=r"record\.sqlite: .* is full\. Frames up to .* --resume"):
        writer.set_metadata(notes="long" * 10_000)
    writer._database.close()


def test_a_reader_sees_no_frames_that_a_run_adds_later(recording, tmp_path):
    path = str(tmp_path / "record.sqlite")
    writer = RecordWriter(path, ("tracked", "rigid"))
    writer.set_metadata(format_version=FORMAT_VERSION)
    first, later, *_ = Stream(streamed(recording), SETTINGS).answers()
    with closing(writer):
        writer.put(first)
        writer.commit()
        with RecordReader(path) as record:
            before = len(record.track("tracked").angle)
            writer.put(later)
            writer.commit()
            assert before == len(record) == len(record.shears().shear) == 1
    with RecordReader(path) as record:
        assert len(record) == 2


def test_the_record_has_every_quantity_and_some_markers(recording, tmp_path):
    path = str(tmp_path / "record.sqlite")
    writer = RecordWriter(path, ("tracked", "rigid"))
    writer.set_metadata(format_version=FORMAT_VERSION)
    answers = list(Stream(streamed(recording), SETTINGS).answers())
    for row in range(2 * RecordWriter.most_kept):
        writer.put(answers[row % len(answers)]._replace(row=row))
    writer.close()
    with RecordReader(path) as record:
        assert len(record) == 2 * RecordWriter.most_kept
        track = record.track("rigid")
        for name in Record.columns():
            expected = [getattr(answer.estimates["rigid"], name) for answer in answers]
            np.testing.assert_array_equal(getattr(track, name)[: len(answers)], expected)
        kept = [one.row for one in record.markers()]
        assert kept == list(range(0, 2 * RecordWriter.most_kept, 2))
    with closing(sqlite3.connect(path)) as database:  # as if the disk was full from the start
        database.execute("DELETE FROM about")
        database.commit()
    with pytest.raises(ValueError, match=r"has format None.*: remove it and run again"):
        RecordReader(path)
    (tmp_path / "other").write_bytes(b"no database at all, but long enough to be looked at" * 40)
    with pytest.raises(ValueError, match="not the record of a run, or damaged"):
        RecordReader(tmp_path / "other")
    with pytest.raises(FileNotFoundError, match="give the output folder"):
        report_all(tmp_path / "nowhere")


def test_lines_say_each_frame_once(recording):
    said = []
    writer = LineWriter(said.append, "tracked")
    for answer in Stream(Moved(recording, 6), SETTINGS).answers(writer):
        assert len(said) <= answer.row + 2 or answer.row < 6
    assert said[0] == LineWriter.header
    assert len(said) == 1 + len(recording)
    rows = [
        dict(zip(LineWriter.header.split(","), line.split(","), strict=True)) for line in said[1:]
    ]
    assert rows[0]["alert"] == "unknown"  # nothing touches
    assert {row["alert"] for row in rows} >= {"unknown", "none"}


def test_a_record_of_other_settings_is_not_resumed(recording, tmp_path):
    out = tmp_path / "out"
    run_all([Input(recording)], out, SETTINGS, Progress(disable=True))
    with pytest.raises(FileNotFoundError, match="give the output folder of a run"):
        report_all(tmp_path)  # whose run this is not
    with pytest.raises(ValueError, match="give the output folder of the run"):
        report_all(out / "unfinished")
    assert find_earlier(out, "", recording.source, SETTINGS) == (None, out / "record.sqlite")
    with pytest.raises(
        ValueError, match=r"other files \(method='tracked' then, method='rigid' now\)"
    ):
        find_earlier(out, "", recording.source, replace(SETTINGS, method="rigid"))
