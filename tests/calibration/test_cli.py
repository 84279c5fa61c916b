import json

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.__main__ import app
from calibration.softness.choices import ShapeChoices
from contactmodel import Pad
from contactmodel.common.inputs import RangeWarning
from estimation import LayeredSoftness
from estimation.frames.archive import write_archive
from estimation.pictures.sensor import Sensor, read_sensor, write_sensor
from estimation.softness import read_softness
from tests.cases import lift


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory):
    path = tmp_path_factory.mktemp("rest") / "rest.npz"
    write_archive(lift(np.zeros(0), unloaded=60), path)
    return path


def test_noise_of_a_sensor_at_rest(at_rest, tmp_path):
    result = CliRunner().invoke(app, ["noise", str(at_rest), "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    noise = read_sensor(tmp_path / "sensor.toml").noise
    assert noise.in_plane == pytest.approx(1e-3, rel=0.05)  # 24000 samples
    assert noise.unit == "mm"
    found = json.loads((tmp_path / "noise.json").read_text())
    assert found["in_plane"] == noise.in_plane
    assert found["drift_per_s"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)
    assert found["temporal_correlation"][0] == pytest.approx(0.0, abs=0.05)
    assert "<img" in (tmp_path / "report.html").read_text()


def test_noise_keeps_the_rest_of_a_description(at_rest, tmp_path):
    known = Sensor(pad=Pad(thickness=3.0, marker_depth=0.4))
    write_sensor(known, tmp_path / "before.toml")
    arguments = ["--sensor", str(tmp_path / "before.toml"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["noise", str(at_rest), *arguments])
    assert result.exit_code == 0, result.output
    assert read_sensor(tmp_path / "out" / "sensor.toml").pad == known.pad


def test_noise_asks_for_rest(tmp_path):
    write_archive(lift(np.radians(np.linspace(0.0, 12.0, 60))), tmp_path / "moves.npz")
    result = CliRunner().invoke(
        app, ["noise", str(tmp_path / "moves.npz"), "--out", str(tmp_path / "out")]
    )
    assert "not at rest" in str(result.exception)


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    """Two grasps of an object of k = 0.5, and what a stage read of it."""
    folder = tmp_path_factory.mktemp("grasps")
    angles = np.radians(np.linspace(0.0, 8.0, 13))
    for name in "ab":
        recording = lift(angles, name=name, seed=ord(name))
        write_archive(recording, folder / f"{name}.npz")
        rows = zip(recording.time[5:], np.degrees(1.5 * angles), strict=True)
        lines = ["time_s,angle_deg", *(f"{time},{angle}" for time, angle in rows)]
        (folder / f"{name}.csv").write_text("\n".join(lines))
    return folder


def arguments(folder, out, *more):
    files = [str(folder / f"{name}.npz") for name in "ab"]
    references = [x for name in "ab" for x in ("--reference", str(folder / f"{name}.csv"))]
    arguments = ["--same-clock", "--noise-um", "1", "--out", str(out)]
    return ["softness", *files, *references, *arguments, *more]


def test_softness_of_two_grasps(grasps, tmp_path):
    result = CliRunner().invoke(app, arguments(grasps, tmp_path))
    assert result.exit_code == 0, result.output
    softness = read_softness(tmp_path / "softness.toml")
    # the gel's own turn is 1.5 times less than the stage's; a rigid fit of 1 µm knows it to 0.1 %
    assert softness.stiffness_ratio == pytest.approx(0.5, abs=0.01)
    figures = json.loads((tmp_path / "softness.json").read_text())["object"]
    assert any(line.startswith("L: the references") for line in figures["undetermined"])
    assert len(figures["grasps"]) == 2
    assert "<img" in (tmp_path / "report.html").read_text()


def test_softness_of_two_objects_is_pooled_too(grasps, tmp_path):
    more = ("--object", "sponge", "--object", "tube")
    result = CliRunner().invoke(app, arguments(grasps, tmp_path, *more))
    assert result.exit_code == 0, result.output
    names = {path.name for path in tmp_path.iterdir()}
    assert {"sponge.toml", "tube.toml", "softness.toml", "all-objects.png"} <= names


def test_softness_on_a_layer_of_known_thickness(grasps, tmp_path):
    """Of the sensor's description, but for the depth: an option goes before."""
    write_sensor(Sensor(pad=Pad(thickness=80.0, marker_depth=0.4)), tmp_path / "pad.toml")
    ball = ("--object", "ball", "--radius-mm", "2000")  # as large as that it is flat
    more = ("--zeroed", "--sensor", str(tmp_path / "pad.toml"), "--depth-mm", "0", *ball)
    result = CliRunner().invoke(app, arguments(grasps, tmp_path, *more))
    assert result.exit_code == 0, result.output
    softness = read_softness(tmp_path / "softness.toml")
    assert isinstance(softness, LayeredSoftness)
    assert (softness.thickness, softness.depth, softness.object_radius) == (80.0, 0.0, 2000.0)
    # as thick as that it is a half-space, of which the fixture is
    assert softness.stiffness_ratio == pytest.approx(0.5, abs=0.02)
    assert "<img" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--flip",), "turns the other way"),
        (("--object", "a", "--object", "b", "--object", "c"), "3 objects for 2 recordings"),
        (("--reference", "outline"), "3 references for 2 recordings"),
        (("--k-ratio", "2"), "--same-clock, --reference have no effect with --k-ratio"),
        (("--depth-mm", "0.3"), "--zeroed --same-clock"),
        (("--radius-mm", "0"), "above 0, or inf for a flat surface"),
        (("--height-mm", "-1"), "above 0, or inf if it is gripped far away"),
        (("--side-mm", "5"), "--side-mm needs --height-mm"),
        (("--width-mm", "5"), "--width-mm needs --height-mm"),
        (("--width-mm", "0"), "above 0, or inf for other objects"),
        (("--height-mm", "5", "--side-mm", "5", "--width-mm", "9"), "are both given"),
        (("--edge-mm", "1"), "only a cylinder with a flat face has one"),
        (("--height-mm", "5", "--side-mm", "5", "--edge-mm", "3"), "at most half of the side's"),
        (("--height-mm", "5", "--side-mm", "5", "--edge-mm", "-1"), "at most half of the side's"),
        (("--thickness-mm", "3"), "--zeroed --same-clock"),
    ],
)
def test_softness_leaves_nothing_behind_where_it_fails(grasps, tmp_path, more, message):
    result = CliRunner().invoke(app, arguments(grasps, tmp_path, *more))
    assert message in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_options_without_effect_are_refused(grasps, tmp_path):
    first, second = (str(grasps / f"{name}.npz") for name in "ab")
    csv = str(grasps / "a.csv")
    for command, message in (
        (("softness", first, "--reference", "outline", "--flip"), "--flip has no effect with"),
        (("softness", first, second, "--k-ratio", "1"), "equal fingers"),
        (("squeeze", csv, "--radius-mm", "9"), "--radius-mm has no effect on a CSV of travel"),
        (("squeeze", first, "--radius-mm", "9", "--pads", "1"), "--pads has no effect on a rec"),
    ):
        result = CliRunner().invoke(app, [*command, "--out", str(tmp_path)])
        assert message in str(result.exception)


def test_markers_below_the_surface_of_a_thick_gel(grasps, tmp_path):
    more = ("--zeroed", "--depth-mm", "0.2")
    result = CliRunner().invoke(app, arguments(grasps, tmp_path, *more))
    assert result.exit_code == 0, result.output
    assert "on a thick elastomer with markers at 0.2 mm depth" in result.output
    # the surface has turned further than the markers, which the fixture has on the surface
    assert 0.2 < read_softness(tmp_path / "softness.toml").stiffness_ratio < 0.49


def test_a_square_bar_is_a_cylinder_that_twists_like_it():
    assert ShapeChoices(height_mm=10.0, width_mm=10.0).lengths == (
        np.inf,
        10.0,
        pytest.approx(5.47),
        0.0,
    )
    with pytest.warns(RangeWarning, match="10 mm wide and 3 mm high"):
        ShapeChoices(height_mm=3.0, width_mm=10.0)


def test_an_interrupted_fit_leaves_nothing_behind(grasps, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("calibration.softness.report.fit_objects", interrupted)
    assert CliRunner().invoke(app, arguments(grasps, tmp_path)).exit_code != 0
    assert not list(tmp_path.iterdir())
