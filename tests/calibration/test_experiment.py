"""Experiments in files, and what their commands write."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.experiment import read_experiment
from calibration.forward import Unknown
from contactmodel import Pad
from contactmodel.common.inputs import RenamedKeyWarning
from tests.cases import lift

MINIMAL = """
format_version = 1
shape = "paraboloid"
cells = 12
size_mm = 11.0
frames = [0]
markers = { pitch_mm = 1.0, count = 7 }
[numbers]
shear_modulus_mpa = 0.2
poisson_ratio = 0.5
friction_coefficient = 0.6
radius_mm = 15.0
approach_mm = { start = 0.5, low = 0.1, high = 1.0, prior = [0.5, 0.01] }
twist_deg = { start = 5.0, low = 1.0, high = 20.0 }
"""


def test_what_a_file_says(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL.replace("frames = [0]", "frames = [7, 9]").replace(
        "low = 1.0", "per_frame = true, low = 1.0"))  # fmt: skip
    experiment = read_experiment(str(path))
    twist = experiment.numbers["twist"]
    assert isinstance(twist, Unknown)
    np.testing.assert_allclose(twist.start, np.radians([5.0, 5.0]))
    assert experiment.numbers["approach"].prior == (0.5, 0.01)
    model, data = experiment.of(lift(np.radians(np.linspace(0.0, 5.0, 6))))
    assert model.frames == 2
    assert data.displacement.shape == (2, len(model.markers), 3)
    assert np.abs(model.markers).max() <= model.grid.x[-1]
    for name in ("tac3d_press", "soft_ball"):
        assert any(isinstance(one, Unknown) for one in read_experiment(name).numbers.values())


def test_the_pad_of_a_sensor_fills_in_what_the_file_does_not_say(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL.replace("shear_modulus_mpa = 0.2\n", "").replace("size_mm = 11.0", ""))
    pad = Pad(
        shear_modulus=0.3, poisson_ratio=0.4, marker_depth=0.2, dome_radius=np.inf, radius=12.0
    )
    with pytest.raises(ValueError, match="'size_mm' is missing"):
        read_experiment(str(path), pad)
    experiment = read_experiment(str(path), replace(pad, size=(11.0, 9.0)))
    assert experiment.grid.size == (11.0, 9.0)
    numbers = experiment.numbers
    assert (numbers["shear_modulus"], numbers["poisson_ratio"]) == (0.3, 0.5)
    assert numbers["marker_depth"] == 0.2
    assert numbers["radius"] == 15.0
    assert not {"thickness", "dome_radius"} & set(numbers)  # a half-space, flat


def test_files_of_version_0_1_0_are_read_and_say_what_changed(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL)
    now = read_experiment(str(path))
    old = (
        MINIMAL.replace("_mpa", "")
        .replace("radius_mm", "radius")
        .replace("approach_mm", "approach")
    )
    path.write_text(f"{old}depth = 0.1\n[errors]\nforce_N = 0.02\n")
    with pytest.warns(RenamedKeyWarning, match="numbers.depth is now called numbers.marker_depth"):
        before = read_experiment(str(path))
    assert before.errors == now.errors
    assert set(before.numbers) == {*now.numbers, "marker_depth"}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("format_version = 1\nsize = 3", "unknown key 'size'"),
        ("format_version = 2", "format_version is 2"),
        ("format_version = 1\nshape = 'cube'\ncells = 8", "the key 'frames' is missing"),
        (MINIMAL + "colour = 3", "unknown number 'colour'; choose from shear_modulus_mpa"),
        (
            MINIMAL.replace("high = 20.0", "high = 2.0"),
            "numbers.twist_deg: the start .* between the bounds",
        ),
    ],
)
def test_files_that_are_refused(tmp_path, wrong, message):
    path = tmp_path / "wrong.toml"
    path.write_text(wrong)
    with pytest.raises(ValueError, match=message):
        read_experiment(str(path))


def test_at_finite_strain_the_grid_follows_the_object(tmp_path):
    """Markers must stay above the grid for every position between the bounds."""
    path = tmp_path / "plan.toml"
    sought = "position_mm = { start = [0.0, 0.0], low = -1.5, high = 1.0 }\nthickness_mm = 4.0\n"
    recording = lift(np.radians(np.linspace(0.0, 5.0, 6)))
    minimal = MINIMAL.replace("frames = [0]", "frames = [7]")  # loaded
    path.write_text(minimal + sought)
    every, _ = read_experiment(str(path)).of(recording)
    path.write_text("finite_strain = true" + minimal + sought)
    model, _ = read_experiment(str(path)).of(recording)
    assert np.abs(every.markers).max() > model.grid.x[-1] - 1.5
    assert np.abs(model.markers).max() <= model.grid.x[-1] - 1.5


def test_markers_of_a_plan_beyond_the_grid_are_told_with_the_file(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL.replace("count = 7", "count = 30"))
    with pytest.raises(ValueError, match=r"plan\.toml: markers reach to 14.50 mm along x"):
        read_experiment(str(path)).plan()


def test_a_name_that_is_no_file_lists_the_examples():
    with pytest.raises(
        FileNotFoundError, match=r"sphere does not exist; .* soft_ball, tac3d_press"
    ):
        read_experiment("sphere")


def test_a_frame_that_is_not_there(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL.replace("frames = [0]", "frames = [99]"))
    with pytest.raises(ValueError, match="has rows 0 to"):
        read_experiment(str(path)).of(lift(np.zeros(3)))


def test_a_frame_without_markers_and_a_misread_marker_are_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(MINIMAL)
    experiment, recording = read_experiment(str(path)), lift(np.zeros(3))
    hidden = replace(recording, valid=np.zeros_like(recording.valid))
    with pytest.raises(ValueError, match="row 0 of lift shows no marker above the grid"):
        experiment.of(hidden)
    with pytest.raises(ValueError, match=r"a marker has moved by .* further than the grid"):
        experiment.of(replace(recording, positions=1e3 * recording.positions))
    rest = np.broadcast_to(recording.layout.reference, recording.positions.shape)
    noise = np.random.default_rng(0).normal(size=rest.shape) * experiment.errors.displacement
    with pytest.raises(ValueError, match=r"no marker of lift has moved there .* pressed in"):
        experiment.of(replace(recording, positions=rest + noise))
