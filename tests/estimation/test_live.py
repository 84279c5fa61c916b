"""Sources that are followed while they go on: what is lost, silent, gone or full is said."""

import json
import re
import shutil
import socket
import struct
import threading
import time
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest
from rich.progress import Progress
from typer.testing import CliRunner

from estimation.__main__ import app
from estimation.choices import LiveChoices
from estimation.frames.archive import write_archive
from estimation.frames.noise import Noise
from estimation.inputs import open_inputs
from estimation.live.command import follow
from estimation.live.feed import Feed
from estimation.live.source import open_live
from estimation.live.tac3d import Tac3DReceiver
from estimation.output import report
from estimation.output.record import RecordWriter
from estimation.output.table import TableWriter
from estimation.pictures.reader import ImageSettings
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture
from estimation.run import _Job, report_all, run_all
from estimation.settings import Settings
from estimation.tracking.stream import AHEAD_LIVE_FRAMES
from estimation.tracking.tracker import estimate_angles
from tests.cases import domed_pad, lift, rows_of
from tests.estimation.pictures.test_reading import write_folder
from tests.test_examples import pictures as turned_pictures

SETTINGS = Settings(noise=Noise.from_std(1e-3))
FAST = LiveChoices(fast=True)


def items(count, step=0.0, flaw=""):
    for i in range(count):
        yield Picture(None, i * step, i, flaw if i == count - 1 else "")


@pytest.fixture
def plain(monkeypatch):
    """Reports without figures, which take most of a short run's time."""
    monkeypatch.setattr(report, "figure_png", lambda figure: plt.close(figure) or b"")


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "lift.npz"
    angles = np.radians(np.linspace(0.0, 6.0, 9))
    write_archive(lift(angles, unloaded=3, layout=domed_pad((12, 12))), path)
    return path


def test_who_is_slow_misses_the_oldest():
    read, choices, said = threading.Event(), LiveChoices(queue=3), []

    def source():
        yield from items(100)
        read.set()

    feed = Feed("clip", choices, said.append)
    given = feed(source())
    numbers = [next(given).number]
    assert read.wait(10.0)
    numbers += [one.number for one in given]
    assert numbers[-3:] == [97, 98, 99]
    assert feed.lost == 100 - len(numbers)
    assert feed.notes()[0].startswith(f"{feed.lost} frames were lost between source and answer")
    assert not said


def test_a_recording_played_fast_loses_nothing():
    feed = Feed("clip", LiveChoices(fast=True, queue=1), print, recorded=True)
    assert [one.number for one in feed(items(50, 3600.0))] == list(range(50))
    assert feed.notes() == ()


def test_a_recording_keeps_its_pace_but_waits_for_no_clock_that_jumps(monkeypatch):
    stamps = [0.0, 0.05, np.nan, 0.1, 5000.0, 5000.05, 3.0, 3.05]
    monkeypatch.setattr("estimation.live.feed.AHEAD_LIVE_FRAMES", -1)
    feed = Feed("clip", LiveChoices(), print, recorded=True)
    began, seen = time.monotonic(), []
    for _ in feed(iter([Picture(None, one, 0) for one in stamps])):
        seen.append(time.monotonic() - began)
    assert len(seen) == len(stamps)
    for row, least in ((1, 0.05), (3, 0.1), (5, 0.15), (7, 0.2)):
        assert seen[row] >= least - 0.005
    assert seen[-1] < 30.0


def test_a_recording_begins_with_the_first_answer():
    feed, read = Feed("clip", LiveChoices(queue=2), print, recorded=True), threading.Event()

    def source():
        yield from items(3 * AHEAD_LIVE_FRAMES, 1e-4)
        read.set()

    given = feed(source())
    first = [next(given).number for _ in range(AHEAD_LIVE_FRAMES)]  # the first answer takes long
    assert first == list(range(AHEAD_LIVE_FRAMES))
    assert feed.lost == 0
    assert next(given).number == AHEAD_LIVE_FRAMES
    assert read.wait(10.0)
    assert list(given)
    assert feed.lost


def test_a_recording_keeps_its_pace_after_a_slow_first_answer():
    feed, step = Feed("clip", LiveChoices(queue=2), print, recorded=True), 0.02
    given = feed(items(AHEAD_LIVE_FRAMES + 20, step))
    for _ in range(AHEAD_LIVE_FRAMES):
        next(given)
    time.sleep(10 * step)  # the first answer
    began, seen = time.monotonic(), [(time.monotonic(), one) for one in given]
    assert (len(seen), feed.lost) == (20, 0)
    # all but those in the queue and in the reader's hands
    assert seen[-1][0] - began >= (20 - 4) * step


def test_a_slow_camera_start_loses_nothing():
    feed, read = Feed("camera", LiveChoices(queue=2), print), threading.Event()

    def source():
        yield from items(AHEAD_LIVE_FRAMES)
        read.wait(10.0)
        yield from items(AHEAD_LIVE_FRAMES)
        read.clear()

    given = feed(source())
    for _ in range(AHEAD_LIVE_FRAMES):
        next(given)
    read.set()
    while read.is_set():  # more arrive while these are answered
        time.sleep(0.01)
    assert (len(list(given)), feed.lost) == (AHEAD_LIVE_FRAMES, 0)


def test_a_silent_source_is_reported_and_waited_for():
    said, go_on = [], threading.Event()

    def say(line):
        said.append(line)
        go_on.set()

    def source():
        yield from items(1)
        go_on.wait(30.0)
        yield from items(1)

    feed = Feed("pad", LiveChoices(silent_s=0.02), say, arrived=lambda: ("3 packets came.",))
    assert len(list(feed(source()))) == 2
    assert said[0] == "pad: no frame for 0.02 s; waiting. 3 packets came."
    assert said[1].startswith("pad: frames arrive again, after 0.")
    assert feed.notes()[-1].startswith("The source was silent 1 time,")


def test_errors_come_through_flaws_at_the_end_are_said_and_nothing_is_left_open():
    def broken():
        yield from items(2)
        raise OSError("camera:0 is on fire")

    given = Feed("camera-0", LiveChoices(), print)(broken())
    with pytest.raises(OSError, match="on fire"):
        list(given)

    said = []
    list(Feed("camera-0", LiveChoices(), said.append)(items(3, flaw="the camera was disconnected")))
    assert said == ["camera-0: the camera was disconnected"]

    released = threading.Event()

    def camera():
        try:
            while True:
                yield from items(1)
        finally:
            released.set()

    given = Feed("camera-0", LiveChoices(), print)(camera())
    next(given)
    given.close()
    assert released.wait(10.0)


def test_a_feed_may_end_in_the_thread_that_reads_it():
    """Garbage is collected in any thread, so a feed that is given up can end in its own reader."""
    given, taken, ended = [], threading.Event(), threading.Event()

    def source():
        yield from items(1)
        taken.wait(10.0)
        given.pop().close()
        ended.set()
        yield from items(1)

    given.append(Feed("camera-0", LiveChoices(), print)(source()))
    next(given[0])
    taken.set()
    assert ended.wait(10.0)


def compare(tmp_path, name, settings):
    """Rows of the same source, followed as fast as it is answered and run over."""
    run_all(open_inputs([name], settings, print), tmp_path / "run", settings, hidden())
    follow(name, tmp_path / "live", settings, FAST, print)
    found, expected = (rows_of(tmp_path / one / "angles.csv") for one in ("live", "run"))
    assert found == expected
    return found


def hidden():
    return Progress(disable=True)


def test_rows_are_those_of_run_and_on_standard_output(archive, tmp_path, plain, capfd):
    rows = compare(tmp_path, str(archive), SETTINGS)
    lines = [line for line in capfd.readouterr().out.splitlines() if not line.startswith("lift")]
    assert len(lines) == 1 + len(rows)
    assert [line.split(",")[2] for line in lines[1:]] == [row["state"] for row in rows]


def test_rows_of_pictures_are_those_of_run(tmp_path, plain):
    path = write_folder(tmp_path / "clip", list(turned_pictures()))
    known = ImageSettings(Sensor(dark=True), rate=30.0)
    rows = compare(tmp_path, str(path), Settings(noise=Noise.from_std(0.01, "px"), images=known))
    assert rows[3]["angle_deg"] != "nan"


def test_json_has_standard_output_for_itself_and_ctrl_c_makes_the_report(
    archive, tmp_path, plain, capfd, monkeypatch
):
    put = TableWriter.put

    def put_until(self, answer):
        put(self, answer)
        if answer.row == 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(TableWriter, "put", put_until)
    settings = replace(SETTINGS, sink=("json",))
    outcome = follow(str(archive), tmp_path, settings, FAST, print)
    assert not outcome.interrupted
    assert (tmp_path / "report.html").is_file()
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("{")]
    assert len(lines) == 6  # a controller has an answer before the disc has
    assert json.loads(lines[-1])["frame"] == 5


def test_what_was_lost_or_not_used_is_in_the_summary(archive, tmp_path, plain, monkeypatch):
    monkeypatch.setattr(Feed, "notes", lambda self: ("7 frames were lost.",))
    settings, said = replace(SETTINGS, given={"--crop": "pictures"}), []
    outcome = follow(str(archive), tmp_path, settings, FAST, said.append)
    assert outcome.lines[-1] == "7 frames were lost."
    unused = "No effect here: --crop, for pictures only."
    assert said == [f"lift: {unused}"]
    notes = json.loads((tmp_path / "summary.json").read_text())["notes"]
    assert notes[:2] == [unused, "7 frames were lost."]


def test_an_unplugged_camera_ends_with_its_report(tmp_path, plain, monkeypatch):
    shown, released = list(turned_pictures()), []

    class Camera:
        def __init__(self, device):
            self.left = [*shown]

        def isOpened(self):
            return True

        def read(self):
            return (True, self.left.pop(0)) if self.left else (False, None)

        def release(self):
            released.append(True)

    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    said = []
    known = ImageSettings(Sensor(dark=True))
    settings = Settings(noise=Noise.from_std(0.01, "px"), images=known)
    follow("camera:0", tmp_path, settings, LiveChoices(), said.append)
    assert said == ["camera-0: the camera was disconnected"]
    assert released
    rows = rows_of(tmp_path / "angles.csv")
    assert rows[-1]["reason"] == "the camera was disconnected"
    assert len(rows) == len(shown) + 1
    assert (tmp_path / "report.html").is_file()


def test_a_resumed_camera_run_keeps_every_frame(tmp_path, plain, monkeypatch):
    shown, put = list(turned_pictures()), TableWriter.put

    class Killed(BaseException):
        """Stands for a kill: no code of the run handles it."""

    class Camera:
        def __init__(self, device):
            self.count = 0

        def isOpened(self):
            return True

        def read(self):
            time.sleep(0.01)
            self.count += 1
            # a picture that repeats the one before it would not be measured
            return True, shown[min(self.count, len(shown) - 1)] ^ np.uint8(self.count % 2)

        def release(self):
            pass

    def follow_until(row, ends, resume=False, checkpoint_s=5.0):
        def put_until(self, answer):
            put(self, answer)
            if answer.row > 8:  # behind the last state that is stored, the camera loses frames
                monkeypatch.setattr(_Job, "checkpoint_s", 5.0)
                time.sleep(0.04)
            if answer.row == row:
                raise ends

        monkeypatch.setattr(TableWriter, "put", put_until)
        monkeypatch.setattr(_Job, "checkpoint_s", checkpoint_s)
        known = ImageSettings(Sensor(dark=True))
        settings = Settings(noise=Noise.from_std(0.01, "px"), images=known)
        return follow("camera:0", tmp_path, settings, LiveChoices(queue=1), print, resume)

    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    with pytest.raises(Killed):
        follow_until(4, Killed())
    with pytest.raises(ValueError, match=r"killed before it stored a state.*--out"):
        follow_until(9, KeyboardInterrupt(), resume=True)
    shutil.rmtree(tmp_path / "unfinished")
    with pytest.raises(Killed):
        follow_until(12, Killed(), checkpoint_s=0.05)
    before = rows_of(tmp_path / "unfinished" / "angles.csv")[:12]
    follow_until(18, KeyboardInterrupt(), resume=True)
    after = rows_of(tmp_path / "angles.csv")
    assert [row["time_s"] for row in after[:12]] == [row["time_s"] for row in before]
    assert [int(row["frame"]) for row in after] == list(range(18))
    for name in ("time_s", "source_index"):
        assert (np.diff([float(row[name]) for row in after]) > 0).all()
    with pytest.raises(ValueError, match="has ended and cannot be resumed"):
        follow_until(9, KeyboardInterrupt(), resume=True)
    assert rows_of(tmp_path / "angles.csv") == after


def test_a_full_disc_is_said_with_the_file(archive, tmp_path, monkeypatch):
    begin = TableWriter.__init__
    with Path("/dev/full").open("w") as full:

        def begin_on_full_disc(self, *arguments):
            begin(self, *arguments)
            self._file.close()
            self._file = full

        monkeypatch.setattr(TableWriter, "__init__", begin_on_full_disc)
        with pytest.raises(OSError, match=r"angles\.csv cannot be written to \(No space") as raised:
            follow(str(archive), tmp_path, SETTINGS, FAST, print)
    assert "`python -m estimation report`" in str(raised.value)


def test_a_folder_moved_or_removed_meanwhile_is_said_at_once(archive, tmp_path, plain, monkeypatch):
    put, out = TableWriter.put, tmp_path / "out"

    def put_and_move(self, answer):
        put(self, answer)
        if answer.row == 4:
            out.rename(tmp_path / "moved")

    monkeypatch.setattr(TableWriter, "put", put_and_move)
    monkeypatch.setattr(RecordWriter, "needs_commit", True)
    began = time.monotonic()
    with pytest.raises(FileNotFoundError, match=r"record\.sqlite was moved or removed") as raised:
        follow(str(archive), out, SETTINGS, FAST, print)
    assert "`python -m estimation report`" in str(raised.value)
    assert time.monotonic() < began + RecordWriter.patience_s  # no report reads the record
    said = " ".join(report_all(tmp_path / "moved"))
    assert re.search(r"Interrupted: \d+ frames were done\.", said)
    assert "--resume" not in said  # a recording that is played cannot be resumed


def test_a_full_quota_is_a_full_disc(tmp_path):
    resource = pytest.importorskip("resource")  # limits the size of files, not on Windows
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    record = RecordWriter(tmp_path / "record.sqlite", ("tracked",))

    def grow():
        record.keep_checkpoint(0, bytes(2**22))
        record.commit()

    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, limits[1]))
    try:
        with pytest.raises(OSError, match=r"disk I/O error\. Frames .* are saved: free space"):
            grow()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        record.close()


def test_what_cannot_be_followed_is_refused(archive, tmp_path):
    def opened(name, resume=None, **settings):
        open_live(name, replace(SETTINGS, **settings), FAST, print, resume)

    with pytest.raises(ValueError, match="--resume needs a camera"):
        opened(str(archive), tmp_path)
    write_archive(lift(np.zeros(3)), archive.with_name("other.npz"))
    with pytest.raises(ValueError, match=r"holds 2 recordings \(lift, other\): name one"):
        opened(str(archive.parent))
    with pytest.raises(FileNotFoundError, match="does not exist"):
        opened(str(tmp_path / "nothing"))
    with pytest.raises(OSError, match="camera:99 cannot be opened"):
        opened("camera:99")
    with pytest.raises(ValueError, match="give 1 or more"):
        LiveChoices(queue=0)
    refused = CliRunner().invoke(app, ["run", "camera:0", "--out", str(tmp_path / "out")])
    assert "follow it with `python -m estimation live camera:0`" in str(refused.exception)
    assert not Path(tmp_path / "out").exists()


# --- Tac3D --------------------------------------------------------------------------------------


def packets_of(frame, moved, serial, sensor="HDL1"):
    """A frame as the desktop program sends it, in pieces of 1,400 bytes."""
    force, moment = frame.wrench[:3], frame.wrench[3:]
    arrays = {
        "3D_Positions": frame.positions,
        "3D_Displacements": moved,
        "3D_Forces": np.zeros_like(moved),
        "3D_ResultantForce": np.array([force]),
        "3D_ResultantMoment": np.array([moment]),
    }
    head = [f"index: {frame.source_index}", f"SN: {sensor}", f"timestamp: {frame.time}", "data:"]
    data = b""
    for name, values in arrays.items():
        sent = np.ascontiguousarray(values, dtype=np.float64).tobytes()
        shape = f"width: {values.shape[1]}, height: {values.shape[0]}"
        head.append(
            f"  - {{name: {name}, type: mat, dtype: f64, {shape}, offset: {len(data)}, "
            f"length: {len(sent)}}}"
        )
        data += sent
    pieces = ["\n".join(head).encode(), *(data[i : i + 1400] for i in range(0, len(data), 1400))]
    last = len(pieces) - 1
    return [struct.pack("=IHH", serial, last, i) + piece for i, piece in enumerate(pieces)]


def test_frames_of_a_tac3d_sensor_are_followed(tmp_path, plain):
    recording = lift(np.radians(np.linspace(0.0, 6.0, 9)), unloaded=3, layout=domed_pad((12, 12)))
    port = free_port()

    def send():
        out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        rng = np.random.default_rng(0)
        for foreign in (b"", b"no frame", struct.pack("=IHH", 1, 0, 0) + b"{SN: [", b"\xff" * 900):
            out.sendto(foreign, ("127.0.0.1", port))
        for serial, frame in enumerate(recording):
            moved = (frame.positions - recording.layout.reference) * (frame.source_index >= 3)
            for sensor in ("HDL1", "AD2"):
                packets = packets_of(frame, moved, 2 * serial + (sensor == "AD2"), sensor)
                for i in rng.permutation(len(packets)):
                    out.sendto(packets[i], ("127.0.0.1", port))
            time.sleep(0.02)
        out.close()

    put, listen, sender = TableWriter.put, Tac3DReceiver.__init__, threading.Thread(target=send)

    def put_until(self, answer):
        put(self, answer)
        if answer.row == len(recording) - 1:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TableWriter, "put", put_until)

        def listen_and_send(self, name):
            listen(self, name)
            sender.start()

        patch.setattr(Tac3DReceiver, "__init__", listen_and_send)
        outcome = follow(f"tac3d:{port}/HDL1", tmp_path, SETTINGS, LiveChoices(), print)
    sender.join(10.0)
    assert not outcome.interrupted
    rows = rows_of(tmp_path / "angles.csv")  # but for that in which Ctrl-C came
    assert [int(row["source_index"]) for row in rows] == recording.source_index[:-1].tolist()
    expected = estimate_angles(recording, noise=SETTINGS.noise)
    found = [float(row["angle_deg"]) for row in rows]
    np.testing.assert_allclose(found, np.degrees(expected.angle)[:-1], atol=1e-5)
    notes = json.loads((tmp_path / "summary.json").read_text())["notes"]
    expected = "Only HDL1 is followed; other sensors send to the same port: AD2"
    assert f"{expected} (tac3d:PORT/SENSOR chooses)." in notes
    assert any(note.endswith("packets were not of a Tac3D sensor, or damaged.") for note in notes)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_port_that_cannot_be_listened_to_is_refused():
    for name in ("tac3d:", "tac3d:x", "tac3d:0", "tac3d:70000/HDL1"):
        with pytest.raises(ValueError, match="has no port: give tac3d:PORT"):
            Tac3DReceiver(name)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        with pytest.raises(OSError, match="close the other program or SDK that listens to it"):
            Tac3DReceiver(f"tac3d:{other.getsockname()[1]}")
