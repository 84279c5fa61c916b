"""Bags are read message by message, and give what the same sensor's files give."""

import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from estimation.frames.bags.bag import is_bag, split_place
from estimation.frames.bags.source import BagSource
from estimation.frames.bags.topics import list_topics
from estimation.frames.noise import Noise
from estimation.pictures.reader import ImageSettings
from estimation.pictures.stream import read_pictures
from estimation.settings import Settings
from estimation.sources import find_paths, find_recordings, read_recording
from estimation.tracking.stream import Stream
from tests import bags
from tests.bags import Sent
from tests.cases import domed_pad, lift
from tests.estimation.frames.test_tac3d import press
from tests.estimation.frames.test_tac3d import write as write_tac3d

SETTINGS = Settings(noise=Noise.from_std(1e-3))
STEP = 33_333_333
"""Between messages [ns]."""


def tac3d_messages(arrays, **changes):
    """The messages of the arrays of a Tac3D folder."""
    rows = zip(arrays["3D_Positions"], arrays["3D_Displacements"], strict=True)
    return [
        bags.tac3d(
            positions,
            moved,
            int(arrays["index"][i]),
            float(arrays["sendTimestamp"][i]),
            Forces=arrays["3D_Forces"][i].ravel(),
            ResultantForce=arrays["3D_ResultantForce"][i, 0],
            ResultantMoment=arrays["3D_ResultantMoment"][i, 0],
            **changes,
        )
        for i, (positions, moved) in enumerate(rows)
    ]


def sent(topic, messages):
    return [Sent(topic, message, i * STEP) for i, message in enumerate(messages)]


@pytest.fixture(scope="module")
def arrays():
    return press(20)  # the messages have a fixed number of markers


WRITERS = {
    "lift.mcap": bags.write_mcap,
    "lift.bag": bags.write_ros1,
    "lift": bags.write_ros2,
    "lift_mcap": lambda path, messages: bags.write_ros2(path, messages, mcap=True),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_bag_of_tac3d_frames_is_the_folder(tmp_path, arrays, name):
    path = WRITERS[name](tmp_path / name, sent("/tactile_frame", tac3d_messages(arrays)))
    (place,) = find_recordings(path)
    found, expected = read_recording(place), read_recording(write_tac3d(tmp_path / "a", arrays))
    same = ("positions", "valid", "time", "source_index", "force", "moment", "forces")
    for one in same:
        np.testing.assert_array_equal(getattr(found, one), getattr(expected, one))
    np.testing.assert_array_equal(found.layout.reference, expected.layout.reference)
    assert found.flaws == expected.flaws
    assert found.name == name.split(".")[0]


def test_frames_come_one_at_a_time(tmp_path, arrays):
    path = bags.write_mcap(tmp_path / "a.mcap", sent("/t", tac3d_messages(arrays)))
    source, given = BagSource(path), []
    for frame in source:
        given.append(frame.source_index)
        if len(given) == 3:
            break
    assert given == [100, 101, 102]
    assert [frame.source_index for frame in BagSource(path, skip=12)] == [112, 113]
    assert len(source) == len(arrays["index"])


def test_two_fingers_in_one_message_are_two_recordings(tmp_path, arrays):
    messages = tac3d_messages(arrays)
    other = tac3d_messages(arrays | {"index": arrays["index"] + 7})
    both = [bags.pair(*two, i * STEP) for i, two in enumerate(zip(messages, other, strict=True))]
    path = bags.write_mcap(tmp_path / "grasp.mcap", sent("/tactile", both))
    assert [one.name for one in list_topics(path)] == ["/tactile/left", "/tactile/right"]
    with pytest.raises(ValueError, match=r"2 topics .*--topic.*/tactile/left, /tactile/right"):
        find_recordings(path)
    left, right = find_paths([str(path)], print, ["/tactile/left", "tactile/right"])
    assert [one.name for one in (left, right)] == ["left", "right"]
    assert [read_recording(one).source_index[0] for one in (left, right)] == [100, 107]


def test_points_are_markers_in_metres(tmp_path):
    recording = lift(np.radians(np.linspace(0.0, 3.0, 4)), unloaded=2, layout=domed_pad((6, 6)))
    positions = recording.positions.copy()
    positions[:, 5] = np.nan
    clouds = [bags.cloud(one, i * STEP, ros1=True) for i, one in enumerate(positions)]
    path = bags.write_ros1(tmp_path / "points.bag", sent("/markers", clouds))
    found = read_recording(path)
    kept = np.delete(positions, 5, axis=1)
    np.testing.assert_allclose(found.positions, kept, atol=1e-6)  # single precision
    np.testing.assert_allclose(found.time, np.arange(6) * STEP * 1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.layout.reference, found.positions[0])
    assert "1 markers were never seen and are left out" in found.notes
    later = read_recording(path, ImageSettings(unloaded=1))
    np.testing.assert_array_equal(later.layout.reference, found.positions[1])
    with pytest.raises(ValueError, match=r"points\.bag: no message 9 with markers .*unloaded"):
        read_recording(path, ImageSettings(unloaded=9))


PIXELS = np.random.default_rng(0).integers(60, 190, (24, 32, 3), dtype=np.uint8)
FLAT = np.full((24, 32, 3), (90, 140, 60), dtype=np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("bgr8", PIXELS, PIXELS),
        ("rgb8", PIXELS[..., ::-1].copy(), PIXELS),
        ("mono8", PIXELS[..., 0].copy(), PIXELS[..., 0]),
        ("mono16", PIXELS[..., 0].astype("<u2") * 256, PIXELS[..., 0].astype("u2") * 256),
        ("rgb16", PIXELS[..., ::-1].astype("<u2") * 256, PIXELS.astype("u2") * 256),
        ("yuv422_yuy2", cv2.cvtColor(FLAT, cv2.COLOR_BGR2YUV_YUY2), FLAT),
        ("yuv422", cv2.cvtColor(FLAT, cv2.COLOR_BGR2YUV_UYVY), FLAT),
    ],
)
def test_raw_pictures_are_read(tmp_path, encoding, pixels, expected):
    messages = [bags.image(pixels, encoding, i * STEP, ros1=True) for i in range(2)]
    path = bags.write_mcap(tmp_path / "clip.mcap", sent("/camera", messages), ros1=True)
    found = list(read_pictures(path))
    assert [(one.number, one.flaw) for one in found] == [(0, ""), (1, "")]
    assert found[1].time == pytest.approx(STEP * 1e-9)
    for one in found:
        # the colours of YUV are rounded
        np.testing.assert_allclose(one.image, expected, atol=3 if "yuv" in encoding else 0)


def test_compressed_pictures_are_read_and_damaged_ones_flawed(tmp_path):
    data = cv2.imencode(".png", PIXELS)[1].tobytes()
    messages = [bags.compressed(data, 0), bags.compressed(data[:100], STEP)]
    messages += [bags.image(PIXELS, "32FC3", 2 * STEP)]
    path = bags.write_mcap(tmp_path / "clip.mcap", sent("/camera/image/compressed", messages[:2]))
    first, second = read_pictures(path)
    np.testing.assert_array_equal(first.image, PIXELS)
    assert second.image is None
    assert "damaged" in second.flaw
    path = bags.write_mcap(tmp_path / "raw.mcap", sent("/camera", messages[2:]))
    (third,) = read_pictures(path)
    assert third.flaw.startswith("pictures encoded as 32FC3 are not read: convert them")


def test_a_clock_that_stands_still_is_refused(tmp_path):
    cloud = bags.cloud(domed_pad().reference)
    path = bags.write_mcap(tmp_path / "still.mcap", [Sent("/t", cloud, 0)] * 12)
    with pytest.raises(ValueError, match=r"still: the clock stands still"):
        Stream(BagSource(path), Settings())


def test_markers_go_before_pictures_and_a_topic_is_named(tmp_path, arrays):
    messages = sent("/scene", [bags.image(PIXELS, "bgr8", i * STEP) for i in range(3)])
    messages += sent("/pad/frame", tac3d_messages(arrays))
    messages += sent("/clock", [bags.header(0)])
    path = bags.write_mcap(tmp_path / "a.mcap", messages)
    assert [one.describe() for one in list_topics(path)] == [
        "/clock: not tactile (std_msgs/msg/Header, 1 messages)",
        "/pad/frame: Tac3D frames (tactile_msgs/msg/Frame, 14 messages)",
        "/scene: pictures (sensor_msgs/msg/Image, 3 messages)",
    ]
    assert BagSource(find_recordings(path)[0]).layout.grid_shape == (20, 20)
    (scene,) = find_recordings(path, ["/scene"])
    assert split_place(scene) == (path, "scene")
    assert len(list(read_pictures(scene))) == 3
    with pytest.raises(ValueError, match="has no topic other; it holds /clock: not tactile"):
        find_recordings(path, ["/other"])
    with pytest.raises(ValueError, match=r"/clock: not tactile .*is expected"):
        find_recordings(path, ["/clock"])
    with pytest.raises(ValueError, match="is neither a bag nor a LeRobot data set"):
        find_recordings(tmp_path, ["/scene"])


def test_a_bag_without_a_sensor_is_refused_with_what_it_holds(tmp_path):
    path = bags.write_mcap(tmp_path / "drive.mcap", sent("/clock", [bags.header(0)]))
    with pytest.raises(ValueError, match=r"drive\.mcap has no topic of Tac3D frames.*/clock"):
        find_recordings(path)


def test_pillars_are_refused_with_a_reason(tmp_path):
    path = tmp_path / "hub.mcap"
    with path.open("wb") as file:
        writer = bags.McapWriter(file)
        writer.start("ros2")
        name = "papillarray_ros_v2/msg/SensorState"
        schema = writer.register_schema(name, "ros2msg", b"float64 gfX\n")
        channel = writer.register_channel("/hub_0/sensor_0", "cdr", schema)
        writer.add_message(channel, 0, bytes(12), 0)
        writer.finish()
    for topics in ([], ["/hub_0/sensor_0"]):
        with pytest.raises(ValueError, match="nine pillars of a PapillArray are too few"):
            find_recordings(path, topics)


def test_messages_of_wrong_length_are_flawed_frames(tmp_path, arrays):
    positions = [one.reshape(-1, 3)[:20] for one in arrays["3D_Positions"]]
    clouds = [bags.cloud(one, i * STEP) for i, one in enumerate(positions)]
    clouds[3] = bags.cloud(positions[3][:-2], 3 * STEP)
    clouds[5] = replace(clouds[5], data=clouds[5].data[:50])
    found = read_recording(bags.write_mcap(tmp_path / "a.mcap", sent("/t", clouds)))
    assert found.flaws[3] == "the message cannot be used: it has 18 markers, the first message 20"
    assert "declares 240 bytes and has 50" in found.flaws[5]
    assert sum(map(bool, found.flaws)) == 2
    clouds = [replace(one, fields=one.fields[:2]) for one in clouds]
    with pytest.raises(ValueError, match=r"b\.mcap: no message shows markers: .*lacks .* z"):
        read_recording(bags.write_mcap(tmp_path / "b.mcap", sent("/t", clouds)))


def test_a_cut_off_bag_gives_what_is_there(tmp_path, arrays):
    messages = sent("/t", tac3d_messages(arrays))
    whole = bags.write_mcap(tmp_path / "whole.mcap", messages)
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    frames = list(BagSource(str(cut)))
    assert 1 < len(frames) < len(messages)
    assert frames[-1].flaw.startswith("the bag is damaged from here on")
    assert not any(frame.flaw for frame in frames[:-1])
    unfinished = bags.write_mcap(tmp_path / "killed.mcap", messages, end=False)
    assert not next(iter(BagSource(unfinished))).flaw
    cut.write_bytes(data[:60])
    with pytest.raises(ValueError, match=r"cut\.mcap .*damaged"):
        find_recordings(cut)


@pytest.mark.parametrize(("name", "advice"), [("a.bag", "rosbag reindex"), ("a", r"recover")])
def test_a_cut_off_bag_with_an_index_names_what_repairs_it(tmp_path, arrays, name, advice):
    path = WRITERS["lift.bag" if advice.startswith("rosbag") else "lift"](
        tmp_path / name,
        sent(
            "/t", [bags.cloud(domed_pad().reference, i * STEP, ros1="." in name) for i in range(9)]
        ),
    )
    file = path if path.is_file() else next(path.glob("*.db3"))
    file.write_bytes(file.read_bytes()[:-5000])
    with pytest.raises(ValueError, match=f"damaged .*: copy it again, or .*{advice}"):
        find_recordings(path)


def test_bags_of_other_encodings_are_refused(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Image", "protobuf", b"")
        channel = writer.register_channel("/camera", "protobuf", schema)
        writer.add_message(channel, 0, b"\1\2", 0)
        writer.finish()
    (picture,) = read_pictures(path)
    assert "/camera is encoded as protobuf/protobuf: only ROS messages" in picture.flaw


def test_a_bag_is_streamed_as_its_folder_is(tmp_path):
    found = lift(np.radians(np.linspace(0.0, 6.0, 8)), unloaded=3)
    moved = found.positions - found.layout.reference
    moved[:3] = 0.0
    messages = [
        bags.tac3d(*both, i, float(found.time[i]))
        for i, both in enumerate(zip(found.positions, moved, strict=True))
    ]
    path = bags.write_mcap(tmp_path / "lift.mcap", sent("/t", messages))
    answers = [
        [answer.estimates["tracked"].angle for answer in Stream(source, SETTINGS).answers()]
        for source in (BagSource(path), replace(found, layout=BagSource(path).layout))
    ]
    np.testing.assert_array_equal(*answers)
    assert np.isfinite(answers[0]).sum() >= 8


def test_what_is_no_bag_is_none(tmp_path):
    (tmp_path / "metadata.yaml").write_text("a: 1\n")
    assert not is_bag(tmp_path)
    assert split_place(tmp_path / "absent") is None
    assert split_place(tmp_path) is None


def test_a_bag_without_the_extra_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap", None)
    (tmp_path / "a.mcap").touch()
    with pytest.raises(ValueError, match=r"a\.mcap needs mcap .*contactmodel\[bags\]"):
        read_recording(tmp_path / "a.mcap")
