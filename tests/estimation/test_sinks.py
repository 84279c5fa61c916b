"""What sinks write is whole, equal to what was run over, and gone on with after a kill."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rich.progress import Progress
from rosbags.highlevel import AnyReader

from estimation.frames.archive import write_archive
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording, layout_markers
from estimation.frames.source import record_source
from estimation.output.record import RecordWriter
from estimation.output.sinks import FILES, open_sinks
from estimation.run import run_all
from estimation.settings import Settings
from estimation.sources import open_inputs, open_source
from estimation.stream import Stream
from tests.cases import lift
from tests.estimation.frames.test_archive import assert_same

SETTINGS = Settings(noise=Noise.given(1e-3))
ABOUT = ("name", "source", "notes", "warnings")
"""What a recording says of its file, and of what was found in it."""
FORMATS = list(FILES)


def pressed(flat: bool = False) -> Recording:
    """A lift with all that a source may know, markers that are lost, and flawed frames."""
    found = lift(np.radians(np.linspace(0.0, 6.0, 9)), unloaded=3)
    frames = len(found)
    rng = np.random.default_rng(1)
    positions, valid = found.positions.copy(), found.valid.copy()
    positions[4, 7], valid[4, 7] = np.nan, False
    valid[5, 8] = False
    found = replace(
        found,
        positions=positions,
        valid=valid,
        force=rng.normal(size=(frames, 3)),
        moment=rng.normal(size=(frames, 3)),
        forces=rng.normal(size=positions.shape),
        flaws=tuple("torn, “so” to speak" if i == 6 else "" for i in range(frames)),
    )
    if not flat:
        return found
    rotation = rng.normal(size=valid.shape)
    rotation[2] = np.nan
    return replace(
        found,
        layout=layout_markers(found.layout.reference[:, :2]),
        positions=positions[..., :2],
        forces=None,
        force=None,
        moment=None,
        contact=rng.random(valid.shape) < 0.5,
        imprint=rng.normal(size=(frames, 2)),
        rotation=rotation,
        hold=rng.normal(size=(frames, 3)),
        unit="px",
        convention="y down",
    )


def settings_of(recording):
    return replace(SETTINGS, noise=Noise.given(1e-3, recording.unit))


def write(recording, folder: Path, name: str) -> Path:
    """What a sink writes of a recording."""
    (sink,) = open_sinks((name,), folder, recording, "tracked")
    for _ in Stream(recording, settings_of(recording)).answers(sink):
        pass
    sink.close()
    return folder / FILES[name]


def read(path: Path) -> Recording:
    source = open_source(path, SETTINGS.images, "again")
    return record_source(source, list(source))


def assert_alike(found: Recording, expected: Recording) -> None:
    """Assert that two recordings are the same but for where they come from."""
    assert_same(replace(found, **{name: getattr(expected, name) for name in ABOUT}), expected)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("flat", [False, True])
def test_a_recording_comes_back_equal(tmp_path, name, flat):
    recording = pressed(flat)
    assert_alike(read(write(recording, tmp_path, name)), recording)


@pytest.mark.parametrize("name", FORMATS)
def test_what_was_written_is_answered_as_the_recording_was(tmp_path, name):
    recording = lift(np.radians(np.linspace(0.0, 6.0, 9)), unloaded=3)
    path = write(recording, tmp_path, name)
    answers = [
        [answer.estimates["tracked"].angle for answer in Stream(source, SETTINGS).answers()]
        for source in (recording, open_source(path, SETTINGS.images, "again"))
    ]
    np.testing.assert_array_equal(*answers)


def run(path, out, *sinks, resume=False):
    settings = replace(SETTINGS, sink=sinks)
    inputs = open_inputs([str(path)], settings, print, out if resume else None)
    with Progress(disable=True) as progress:
        return run_all(inputs, out, settings, progress, resume=resume)


def test_topics_hold_the_row_the_markers_and_the_wrench(tmp_path):
    recording = pressed()
    path = write(recording, tmp_path, "mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {schema.name for schema in summary.schemas.values()} == {
        "contactmodel_msgs/msg/Frame",
        "contactmodel_msgs/msg/Answer",
        "sensor_msgs/msg/PointCloud2",
        "geometry_msgs/msg/WrenchStamped",
    }
    with AnyReader([path]) as reader:
        last = {}
        for connection, _, data in reader.messages():
            assert connection.msgcount == len(recording)
            last[connection.topic] = reader.deserialize(data, connection.msgtype)
    answer, cloud, wrench = (
        last[f"/contactmodel/{one}"] for one in ("answer", "markers", "wrench")
    )
    assert answer.state in ("stick", "incipient")
    assert answer.angle_low_deg < answer.angle_deg < answer.angle_high_deg
    half = (answer.angle_high_deg - answer.angle_low_deg) / 2.0
    assert answer.angle_variance_deg2 == pytest.approx((half / 1.96) ** 2, rel=1e-3)
    assert [field.name for field in cloud.fields][:3] == ["x", "y", "z"]
    assert cloud.header.stamp.sec == int(recording.time[-1])
    assert cloud.width == recording.valid.shape[1]
    assert wrench.wrench.force.x == recording.force[-1, 0]
    assert wrench.wrench.torque.z == pytest.approx(1e-3 * recording.moment[-1, 2])


@pytest.mark.parametrize("name", FORMATS)
def test_a_killed_run_goes_on_where_it_was(tmp_path, monkeypatch, name):
    """The file is that of a run that was not killed, and could be read after the kill."""
    recording, out = pressed(), tmp_path / "out"
    write_archive(recording, tmp_path / "lift.npz")
    monkeypatch.setattr("estimation.run.CHECKPOINT_S", 0.0)
    whole, take = tmp_path / "whole", RecordWriter.put
    run(tmp_path / "lift.npz", whole, name)

    def take_until(self, answer):
        if answer.row == 8:
            raise MemoryError("killed")
        take(self, answer)

    with monkeypatch.context() as patch:
        patch.setattr(RecordWriter, "put", take_until)
        with pytest.raises(MemoryError):
            run(tmp_path / "lift.npz", out, name)
    killed = out / "unfinished" / FILES[name]
    assert_alike(read(killed), recording.head(8))
    run(tmp_path / "lift.npz", out, name, resume=True)
    assert_alike(read(out / FILES[name]), read(whole / FILES[name]))
    assert not list(out.rglob(f".{FILES[name]}*"))
    assert str(FILES[name]) in (out / "manifest.json").read_text()


@pytest.mark.parametrize("name", FORMATS)
def test_a_better_reference_begins_the_file_anew(tmp_path, name):
    recording = pressed()
    (sink,) = open_sinks((name,), tmp_path, recording, "tracked")
    answers = list(Stream(recording, SETTINGS).answers())
    for answer in answers[:5]:
        sink.put(answer)
    sink.restart()
    moved = replace(recording.layout, reference=recording.layout.reference + 0.01)
    for answer in answers[:3]:
        sink.put(answer._replace(layout=moved))
    sink.close()
    found = read(tmp_path / FILES[name])
    assert len(found) == 3
    np.testing.assert_array_equal(found.layout.reference, moved.reference)


def test_an_unknown_sink_is_refused_before_anything_is_computed(tmp_path):
    write_archive(pressed(), tmp_path / "lift.npz")
    with pytest.raises(ValueError, match=r"no sink 'cvs' \(--sink\); there are mcap"):
        run(tmp_path / "lift.npz", tmp_path / "out", "cvs")
