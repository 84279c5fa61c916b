"""What sinks write is whole, equal to what was run over, and gone on with after a kill."""

import json
import os
import socket
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from mcap.reader import make_reader
from rich.progress import Progress
from rosbags.highlevel import AnyReader

from estimation.frames.archive import write_archive
from estimation.frames.columns.zarr_folder import write_zarr
from estimation.frames.flat import FRAME_FIELDS
from estimation.frames.inspection import inspect_recording
from estimation.frames.noise import Noise
from estimation.frames.recording import Frame, Recording, layout_markers
from estimation.frames.source import record_source
from estimation.inputs import open_inputs
from estimation.output.record import RecordWriter
from estimation.output.sinks.by_name import (
    SINK_FILES,
    check_sinks,
    finish_files,
    open_sinks,
    read_address,
)
from estimation.output.sinks.outlet import Outlet, open_udp
from estimation.output.table import TableWriter
from estimation.run import run_all
from estimation.settings import Settings
from estimation.sources import open_source, read_recording
from estimation.tracking.stream import Stream
from tests.cases import lift, rows_of
from tests.estimation.frames.test_archive import assert_same
from tests.estimation.test_viewer import read_rrd

SETTINGS = Settings(noise=Noise.from_std(1e-3))
ABOUT = ("name", "source", "notes", "warnings")
"""What a recording says of its file, and of what was found in it."""
FORMATS = ("mcap", "zarr", "lerobot")
"""What can be run over again."""


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
    points = rng.normal(size=(frames, 7))
    points[:, 4:] = 1.0, 1.0, 0.2  # a covariance
    return replace(
        found,
        layout=layout_markers(found.layout.reference[:, :2]),
        positions=positions[..., :2],
        forces=None,
        force=None,
        moment=None,
        contact=rng.random(valid.shape) < 0.5,
        imprint=rng.normal(size=(frames, 2)),
        print_point=points,
        rotation=rotation,
        hold=rng.normal(size=(frames, 3)),
        others=np.arange(valid.size).reshape(valid.shape) % 7 == 0,
        pictured=True,
        unit="px",
        convention="y down",
    )


def settings_of(recording):
    return replace(SETTINGS, noise=Noise.from_std(1e-3, recording.unit))


@contextmanager
def opened(recording, folder, name, say=print):
    with ExitStack() as stack:
        readers, files = open_sinks((name,), folder, recording, "tracked", 0, stack, say)
        yield from readers + files
    finish_files((name,), folder)


def write(recording, folder: Path, name: str) -> Path:
    """What a sink writes of a recording."""
    with opened(recording, folder, name) as sink:
        for _ in Stream(recording, settings_of(recording)).answers(sink):
            pass
    return folder / SINK_FILES[name]


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
    assert [one.name for one in tmp_path.iterdir()] == [SINK_FILES[name]]


def test_files_of_frames_have_every_field_of_a_frame():
    assert {*FRAME_FIELDS} == {one.name for one in fields(Frame)}


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


def test_a_killed_run_goes_on_where_it_was(tmp_path, monkeypatch):
    """The files are those of the recording, and it could be read after the kill."""
    recording, out, sinks = pressed(), tmp_path / "out", ("mcap", "zarr", "rrd")
    write_archive(recording, tmp_path / "lift.npz")
    monkeypatch.setattr("estimation.run._Job.checkpoint_s", 0.0)
    take = RecordWriter.put

    def take_until(self, answer):
        if answer.row == 8:
            raise MemoryError("killed")
        take(self, answer)

    with monkeypatch.context() as patch:
        patch.setattr(RecordWriter, "put", take_until)
        with pytest.raises(MemoryError):
            run(tmp_path / "lift.npz", out, *sinks)
    assert_alike(read(out / "unfinished" / SINK_FILES["mcap"]), recording.head(8))
    run(tmp_path / "lift.npz", out, *sinks, resume=True)
    assert len(read_rrd(out / SINK_FILES["rrd"])["/angle"]) == len(recording)
    for name in sinks:
        if name in FORMATS:
            assert_alike(read(out / SINK_FILES[name]), recording)
        assert SINK_FILES[name] in (out / "manifest.json").read_text()
    assert not list(out.rglob(".frames*"))


@pytest.mark.parametrize("name", FORMATS)
def test_a_better_reference_begins_the_file_anew(tmp_path, name):
    recording = pressed()
    answers = list(Stream(recording, SETTINGS).answers())
    moved = replace(recording.layout, reference=recording.layout.reference + 0.01)
    with opened(recording, tmp_path, name) as sink:
        for answer in answers[:5]:
            sink.put(answer)
        sink.restart()
        for answer in answers[:3]:
            sink.put(answer._replace(layout=moved))
    found = read(tmp_path / SINK_FILES[name])
    assert len(found) == 3
    np.testing.assert_array_equal(found.layout.reference, moved.reference)


def test_an_unknown_sink_is_refused_before_anything_is_computed(tmp_path):
    write_archive(pressed(), tmp_path / "lift.npz")
    with pytest.raises(ValueError, match=r"unknown sink 'cvs' \(--sink\): choose from mcap"):
        run(tmp_path / "lift.npz", tmp_path / "out", "cvs")


# --- lines --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def answers():
    return list(Stream(pressed(), SETTINGS).answers())


def test_lines_of_json_are_the_rows_of_the_table(tmp_path, answers, capfd):
    with opened(pressed(), tmp_path, "json") as sink:
        table = TableWriter(str(tmp_path / "angles.csv"), "tracked", "mm")
        for answer in answers:
            sink.put(answer)
            table.put(answer)
        table.close()
        sink.put(answers[0])  # was said
        sink.restart()
    lines = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    rows = rows_of(tmp_path / "angles.csv")
    assert len(lines) == len(rows) == len(answers)
    for line, row in zip(lines, rows, strict=True):
        for name, value in line.items():
            expected = row[name]
            if value is None:
                assert expected in ("", "nan"), name
            else:
                assert str(value) == expected or value == float(expected), name
    assert lines[-1]["angle_deg"] is not None
    assert isinstance(lines[-1]["stick_markers"], int)


def test_packets_arrive_and_a_port_without_a_reader_delays_nothing(tmp_path, answers):
    reader = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    reader.bind(("127.0.0.1", 0))
    reader.settimeout(10.0)
    port = reader.getsockname()[1]
    with opened(pressed(), tmp_path, f"udp:{port}") as sink:
        for answer in answers[:3]:
            sink.put(answer)
        found = [json.loads(reader.recv(65536))["frame"] for _ in range(3)]
        reader.close()
        sink.put(answers[3])
    assert found == [0, 1, 2]


def test_a_reader_that_is_slow_or_gone_is_not_waited_for():
    go_on = threading.Event()
    written = []

    def write(line):
        go_on.wait()
        written.append(line)

    slow = Outlet(write, most=4)
    for i in range(20):
        slow.send(str(i))
    go_on.set()
    slow.close()
    assert written[-4:] == ["16", "17", "18", "19"]
    assert slow.sent == len(written) < 6
    assert slow.describe("json").startswith(f"json: {20 - slow.sent} of 20 frames dropped")

    read, gone = os.pipe()
    os.close(read)
    broken = Outlet(lambda line: os.write(gone, line.encode()) and None)
    broken.send("a")
    broken.close()
    os.close(gone)
    assert (broken.sent, broken.dropped) == (0, 1)

    stuck = Outlet(lambda line: threading.Event().wait())
    stuck.send("a")
    stuck.send("b")
    began = time.monotonic()
    stuck.close(patience=0.05)
    assert time.monotonic() - began < 5.0
    assert stuck.dropped


@pytest.mark.parametrize("name", ["udp:", "udp:x", "udp:0", "udp:70000", "udp:host:"])
def test_a_port_that_is_none_is_refused(name):
    with pytest.raises(ValueError, match=r"has no port: give udp:PORT"):
        check_sinks((name,))


def test_an_unknown_host_is_named():
    with pytest.raises(OSError, match=r"host 'no\.invalid' of the sink udp.* check its name"):
        open_udp("no.invalid", 9000)


def test_addresses_are_read():
    assert read_address("udp:9000") == ("127.0.0.1", 9000)
    assert read_address("udp:10.0.0.2:9000") == ("10.0.0.2", 9000)
    assert read_address("udp:[::1]:9000") == ("::1", 9000)


# --- columns ------------------------------------------------------------------------------------


def test_a_zarr_group_opens_without_us(tmp_path):
    recording = pressed()
    group = zarr.open_group(write(recording, tmp_path, "zarr"), mode="r")
    np.testing.assert_array_equal(group["positions"][:], recording.positions)
    assert group["flaw"][6] == recording.flaws[6]
    assert group["answer.state"][0] == "no_contact"
    angles = group["answer.angle_deg"][:]
    assert np.isfinite(angles[-1])
    assert group.attrs["unit"] == "mm"


def test_a_lerobot_set_has_points_and_what_its_readers_ask_for(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    recording = pressed()
    path = write(recording, tmp_path, "lerobot")
    info = json.loads((path / "meta" / "info.json").read_text())
    frames, markers = recording.valid.shape
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (1, frames, 30)
    points = info["features"]["observation.tactile.points"]
    assert points["shape"] == [markers, 6]
    assert points["names"] == ["dx", "dy", "dz", "Fx", "Fy", "Fz"]
    data = parquet.read_table(path / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"])
    found = np.array(data["observation.tactile.points"].to_pylist())
    np.testing.assert_array_equal(found[..., 3:], recording.forces.astype(np.float32))
    moved = (recording.positions - recording.layout.reference).astype(np.float32)
    np.testing.assert_array_equal(found[..., :3], moved)
    np.testing.assert_allclose(data["timestamp"], np.arange(frames) / 30.0, atol=1e-5)
    assert data["observation.contact.state"][-1].as_py() in ("stick", "incipient")
    statistics = json.loads((path / "meta" / "stats.json").read_text())
    mean = np.array(statistics["observation.tactile.points"]["mean"])
    np.testing.assert_allclose(mean, np.nanmean(found, axis=0), atol=1e-6)
    episode = parquet.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()[0]
    assert (episode["length"], episode["dataset_to_index"]) == (frames, frames)
    tasks = parquet.read_table(path / "meta" / "tasks.parquet").to_pandas()
    assert tasks["task_index"].tolist() == [0]
    assert tasks.index.tolist() == episode["tasks"]


def test_a_lerobot_set_keeps_a_clock_of_the_day(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    recording = pressed()
    since = recording.time - recording.time[0]
    path = write(replace(recording, time=1.7e9 + since), tmp_path, "lerobot")
    data = parquet.read_table(path / "data/chunk-000/file-000.parquet")
    np.testing.assert_allclose(data["observation.contact.time_s"], 1.7e9 + since, atol=1e-5, rtol=0)
    np.testing.assert_allclose(data["timestamp"], since, atol=1e-5)
    assert not [name for name in data.column_names if "__" in name]  # fields of messages


def test_a_recording_is_written_without_answers(tmp_path):
    recording = pressed()
    write_zarr(tmp_path / "lift.zarr", recording)
    assert_alike(read_recording(tmp_path / "lift.zarr"), inspect_recording(recording))
    write_zarr(tmp_path / "lift.zarr", recording.head(3))  # over the other
    assert len(read(tmp_path / "lift.zarr")) == 3
    assert [one.name for one in tmp_path.iterdir()] == ["lift.zarr"]


def test_what_is_no_group_of_ours_is_refused(tmp_path):
    path = tmp_path / "other.zarr"
    zarr.create_group(path)
    with pytest.raises(
        ValueError, match=r"other\.zarr is not a Zarr group of frames, or is damaged"
    ):
        read_recording(path)
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text("{}")
    with pytest.raises(ValueError, match=r"info\.json is not of a LeRobot data set, or damaged"):
        read_recording(tmp_path / "set")
