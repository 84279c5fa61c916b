"""What Rerun's viewer is given: every quantity of every answer, also after a kill; no one waits."""

import os
import sysconfig
import threading
import time
import warnings
from collections import defaultdict
from contextlib import closing, suppress
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader

from estimation.frames.noise import Noise
from estimation.output.sinks.bag import BagWriter
from estimation.output.sinks.by_name import SINK_FILES
from estimation.output.sinks.viewer import LiveViewer, ViewerFile, Viewing, spawn_viewer
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import read_pictures
from estimation.settings import Settings
from estimation.sources import open_source
from estimation.tracking.stream import Stream
from tests.cases import lift
from tests.estimation.pictures.test_reading import write_folder
from tests.test_examples import pictures as turned_pictures

KNOWN = ImageSettings(Sensor(dark=True), rate=30.0)


@pytest.fixture(scope="module")
def recording():
    return lift(np.radians(np.linspace(0.0, 6.0, 9)), unloaded=3)


@pytest.fixture(scope="module")
def answers(recording):
    return list(Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers())


def test_the_viewer_beside_python_is_found_without_its_environment(monkeypatch):
    seen = []
    monkeypatch.setenv("PATH", "/bin")
    stream = SimpleNamespace(spawn=lambda default_blueprint: seen.append(os.environ["PATH"]))
    spawn_viewer(stream)
    assert seen == [os.pathsep.join(("/bin", sysconfig.get_path("scripts")))]


def read_rrd(path):
    """What a recording has of each entity: number of the frame and content, by its path."""
    found = defaultdict(list)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file that was not closed
        chunks = RrdReader(path).stream()
    for chunk in chunks:
        if chunk.is_static or "frame" not in chunk.timeline_names:
            continue
        table = chunk.to_record_batch().to_pydict()
        values = next(table[one] for one in table if ":" in one and "frame" not in one)
        found[chunk.entity_path] += zip(table["frame"], values, strict=True)
    return {path: [value for _, value in sorted(found[path])] for path in found}


def test_the_file_has_every_answer(tmp_path, recording, answers):
    path = tmp_path / "frames.rrd"
    with closing(ViewerFile(path, recording, "tracked")) as sink:
        for answer in answers[:4]:
            sink.put(answer)
        sink.restart()  # with a better reference all are given anew
        for answer in answers:
            sink.put(answer)
    found = read_rrd(path)
    estimates = [answer.estimates["tracked"] for answer in answers]
    expected = [np.degrees([one.angle, one.low, one.high]) for one in estimates]
    np.testing.assert_allclose(found["/angle"], expected)
    sticking = [[one.stick_markers, one.contact_markers] for one in estimates]
    np.testing.assert_array_equal(found["/markers"], sticking)
    states = [str(one.state) for one in estimates]
    assert [one for (one,) in found["/state"]] == [
        one for one, before in zip(states, ["", *states], strict=False) if one != before
    ]
    assert {*found} >= {"/view/markers", "/view/motion", "/margin", "/slip", "/alert", "/reason"}
    assert "/view/picture" not in found


def test_pictures_are_in_the_file_of_the_viewer_and_in_mcap(tmp_path):
    pictures = list(turned_pictures())[:3]
    source = PictureSource(write_folder(tmp_path / "clip", pictures), KNOWN)
    files = [tmp_path / SINK_FILES[one] for one in ("rrd", "mcap")]
    settings = Settings(noise=Noise.from_std(0.01, "px"), images=KNOWN)
    with (
        closing(ViewerFile(files[0], source, "tracked")) as viewer,
        closing(BagWriter(files[1], source, "tracked")) as bag,
    ):
        for _ in Stream(source, settings).answers(viewer, bag):
            pass
    (blobs,) = zip(*read_rrd(files[0])["/view/picture"], strict=True)
    again = read_pictures(files[1] / "contactmodel/picture")
    for blob, expected, picture in zip(blobs, pictures, again, strict=True):
        shown = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_UNCHANGED)
        assert abs(shown.astype(float) - expected).mean() < 3.0
        np.testing.assert_array_equal(picture.image, shown)
    assert len(list(open_source(files[1], settings.images, "frames"))) == len(pictures)


def wait_for_rows(path, count):
    """Wait until a file that grows has its rows; until then it may end in part of a message."""
    patience = time.monotonic() + 20.0
    while time.monotonic() < patience:
        with suppress(RuntimeError, ValueError):
            if len(read_rrd(path).get("/angle", [])) >= count:
                return
        time.sleep(0.05)
    raise AssertionError(f"{path} has no {count} rows after 20 s")


@pytest.mark.parametrize("torn", [0, 8, 50], ids="{} bytes of a message".format)
def test_a_killed_file_is_whole_and_gone_on_with(tmp_path, recording, answers, torn):
    path, killed = tmp_path / "frames.rrd", tmp_path / "killed.rrd"
    with closing(ViewerFile(path, recording, "tracked")) as sink:
        for answer in answers[:7]:
            sink.put(answer)
        wait_for_rows(path, 7)
        sink._stream.flush()  # of other quantities
        on_disc = path.read_bytes()  # before it is closed
        # after the header of 12 bytes comes the first message
        killed.write_bytes(on_disc + on_disc[12 : 12 + torn])
    with closing(ViewerFile(killed, recording, "tracked", rows=7)) as sink:
        for answer in answers[7:]:
            sink.put(answer)
    assert len(read_rrd(killed)["/angle"]) == len(answers)
    assert sorted(os.listdir(tmp_path)) == ["frames.rrd", "killed.rrd"]


def test_a_closed_file_is_gone_on_with(tmp_path, recording, answers):
    path = tmp_path / "frames.rrd"
    for first, last in ((0, 7), (7, len(answers))):
        with closing(ViewerFile(path, recording, "tracked", rows=first)) as sink:
            for answer in answers[first:last]:
                sink.put(answer)
    assert len(read_rrd(path)["/angle"]) == len(answers)


def test_a_file_killed_before_its_first_message_is_begun_again(tmp_path, recording, answers):
    path = tmp_path / "frames.rrd"
    path.write_bytes(b"RRF2")
    with closing(ViewerFile(path, recording, "tracked", rows=1)) as sink:
        for answer in answers[1:]:
            sink.put(answer)
    assert len(read_rrd(path)["/angle"]) == len(answers) - 1


def test_no_one_waits_for_a_viewer(recording, answers, monkeypatch):
    go_on, asked = threading.Event(), []
    monkeypatch.setattr(Viewing, "show", lambda *arguments: go_on.wait())
    sink = LiveViewer(recording, "tracked", asked.append)
    began = time.monotonic()
    for answer in answers * 10:
        sink.put(answer)
    assert time.monotonic() - began < 1.0
    go_on.set()
    sink.outlet.close()
    assert sink.outlet.dropped > 5 * len(answers)
    assert sink.outlet.sent + sink.outlet.dropped == 10 * len(answers)
    assert len(asked) == 1


def test_a_file_that_cannot_be_written_is_said(tmp_path, recording):
    with pytest.raises(OSError, match=r"frames\.rrd"):
        ViewerFile(tmp_path / "none" / "frames.rrd", recording, "tracked")
