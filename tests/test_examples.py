"""The examples run, short as they are, and give the angles that they should."""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest

from estimation import estimate_angles, read_recording
from estimation.pictures.render import Camera, render_dots
from tests import bags
from tests.bags import Sent
from tests.cases import domed_pad, lift
from tests.fuzz.inputs import GRID, RADIUS

EXAMPLES = Path(__file__).parents[1] / "examples"
ANGLES = np.radians(np.linspace(0.0, 6.0, 7))


def load(name):
    return SimpleNamespace(**runpy.run_path(str(EXAMPLES / f"{name}.py")))


@pytest.fixture(scope="module")
def recording():
    return lift(ANGLES, unloaded=3, layout=domed_pad((12, 12)))


def degrees(out):
    return [float(found) for found in re.findall(r"(-?[0-9.]+|nan)°", out)]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_examples_are_short_and_listed(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 30
    assert f"`{path.name}`" in (EXAMPLES / "README.md").read_text(encoding="utf-8")


def pictures():
    """Dots that are turned about the middle, more and more; a black picture first."""
    camera, middle = Camera(width=128, height=108), GRID.mean(axis=0)
    arm, rng = (GRID - middle) @ [1.0, 1.0j], np.random.default_rng(0)
    share = np.exp(-((np.abs(arm) / 40.0) ** 4))
    axes = np.broadcast_to(RADIUS * np.eye(2), (len(GRID), 2, 2))
    yield np.zeros((108, 128), np.uint8)
    for angle in np.radians([0.0, 3.0, 6.0, 9.0]):
        turned = np.exp(1j * angle * share) * arm
        centres = middle + np.stack([turned.real, turned.imag], axis=1)
        yield render_dots(camera, centres, axes, rng)


def test_a_camera(monkeypatch, capsys):
    class Capture:
        def __init__(self, device):
            assert device == 0
            self.images = list(pictures())

        def isOpened(self):
            return True

        def read(self):
            return (True, self.images.pop(0)) if self.images else (False, None)

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    load("opencv_camera").main("0")
    first, *others = capsys.readouterr().out.splitlines()
    assert first == "unknown: nan° (nan to nan) the picture is black"
    assert len([line for line in others if line != "grip harder"]) == 4


def test_a_camera_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(SystemExit, match=r"nowhere\.mp4 cannot be opened: give the number"):
        load("opencv_camera").main(str(tmp_path / "nowhere.mp4"))


def test_the_callback_of_pytac3d(recording, capsys):
    example = load("pytac3d_callback")
    for frame in recording:
        moved = frame.positions - recording.layout.reference
        message = {"SN": "HDL1", "sendTimestamp": frame.time, "3D_Positions": frame.positions}
        example.receive(message | {"3D_Displacements": moved * (frame.source_index >= 3)}, None)
    found = degrees(capsys.readouterr().out)
    assert len(found) == len(ANGLES)
    assert found[-1] == pytest.approx(6.0, abs=0.5)


@pytest.fixture
def ros(monkeypatch):
    """The part of ROS 2's Python interface that a node uses."""
    published, subscribed = [], {}

    class Node:
        def __init__(self, name):
            assert name

        def create_publisher(self, kind, topic, depth):
            return SimpleNamespace(publish=lambda message: published.append((topic, message)))

        def create_subscription(self, kind, topic, callback, depth):
            subscribed[topic] = callback

    for name, content in {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"PointCloud2": object},
        "std_msgs": {},
        "std_msgs.msg": {"Float64": SimpleNamespace},
    }.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return published, subscribed


def test_a_ros_2_node(recording, ros):
    published, subscribed = ros
    load("ros2_node").AngleNode()
    for frame in recording:
        cloud = bags.cloud(frame.positions, round(1e9 * frame.time))
        subscribed["markers"](cloud)
    assert {topic for topic, _ in published} == {"angle"}
    assert len(published) == len(recording)
    assert np.degrees(published[-1][1].data) == pytest.approx(6.0, abs=0.5)


def test_a_bag_to_a_table(recording, tmp_path, capsys):
    sent = [
        Sent("/pad", bags.cloud(frame.positions, i * 10**7), i * 10**7)
        for i, frame in enumerate(recording)
    ]
    path = bags.write_mcap(tmp_path / "lift.mcap", sent)
    load("bag_to_csv").main(str(path / "pad"), str(tmp_path / "angles.csv"))
    assert len(capsys.readouterr().out.splitlines()) == len(recording)
    assert len((tmp_path / "angles.csv").read_text().splitlines()) == 1 + len(recording)


def test_own_markers(capsys):
    load("own_markers").main()
    found = degrees(capsys.readouterr().out)
    truth, seen = np.array(found[::2]), np.array(found[1::2])
    known = np.isfinite(seen)
    assert known.sum() >= 6
    # noise of 1 µm on markers of a contact of 12 mm, and the rim that turns less
    np.testing.assert_allclose(seen[known], truth[known], atol=0.1)


def test_a_table_of_markers(recording, tmp_path, capsys):
    table, rng = tmp_path / "lift.csv", np.random.default_rng(0)
    lines = [
        f"{frame.time},{marker},{','.join(map(str, place))}"
        for frame in recording
        for marker, place in enumerate(frame.positions)
        if frame.source_index == 0 or marker % 9 or rng.random() < 0.5
    ]
    rng.shuffle(lines)
    table.write_text("\n".join(["time_s,marker,x,y,z", *lines]))
    load("markers_table").main(str(table), str(tmp_path / "lift.npz"))
    assert f"{len(recording)} frames, 144 of 144 markers are in the" in capsys.readouterr().out
    found = read_recording(tmp_path / "lift.npz")
    np.testing.assert_array_equal(found.time, recording.time)
    same = found.positions == recording.positions
    assert 0.9 < same.all(axis=2).mean() < 1.0
    assert np.isnan(found.positions[~same]).all()
    assert np.degrees(estimate_angles(found).angle[-1]) == pytest.approx(6.0, abs=0.5)
    names = "time_s,marker,x,y,z"
    for head in ("\ufeff" + names, "# run 7\n" + names):  # by Excel; with a comment
        table.write_text("\n".join([head, *lines]), encoding="utf-8")
        load("markers_table").main(str(table), str(tmp_path / "same.npz"))
        np.testing.assert_array_equal(
            read_recording(tmp_path / "same.npz").positions, found.positions
        )
    for text, message in (
        ("\n".join(lines), "lacks the columns time_s, marker, x, y"),
        ("\n".join([names, *lines]).replace(",", ";"), "separates its columns by semicolons"),
        (f"{names}\n0,00,1,2,50,3,50,0,00\n", "write numbers with a decimal point"),
        (f"{names}\n0.0,0,1.0,high,0.0\n", "line 2: y is 'high', no number"),
    ):
        table.write_text(text)
        with pytest.raises(ValueError, match=message):
            load("markers_table").main(str(table), "")
    table.write_text("\n".join([names, *lines, lines[0]]))
    with pytest.raises(AssertionError, match="a marker is twice at one time"):
        load("markers_table").main(str(table), "")


def test_two_fingers(capsys):
    load("two_fingers").main()
    found = np.array(degrees(capsys.readouterr().out)).reshape(-1, 2)
    assert np.nanmax(found[:, 0]) == pytest.approx(10.0, abs=0.5)
    assert np.nanmin(found[:, 0]) < -10.0
    assert np.nanmin(found[:, 1]) > 0.0


def test_two_fingers_that_disagree_have_a_wide_joint_interval():
    def finger(angle):
        return SimpleNamespace(angle=angle, low=angle - 0.01, high=angle + 0.01)

    join = load("two_fingers").join
    assert join(finger(0.2), finger(-0.2)) == pytest.approx((0.2, 0.01 / np.sqrt(2.0)))
    assert join(finger(0.2), finger(np.nan)) == pytest.approx((0.2, 0.01))
    joint, half = join(finger(0.2), finger(0.0))  # restarted by 0.2 rad
    assert joint - half <= 0.0 < 0.2 <= joint + half
    assert np.isnan(join(finger(np.nan), finger(np.nan))).all()
