"""The commands: what they write, resume, refuse and return."""

import numpy as np
import pytest
from typer.testing import CliRunner

from contactmodel import Layer, Pad, Pose, read_pad, solve_contact
from contactmodel import __main__ as cli
from contactmodel.common.inputs import RenamedKeyWarning
from contactmodel.simulate.configuration import EXAMPLES, read_simulation
from contactmodel.simulate.run import run_simulation
from contactmodel.verify import table as checks
from contactmodel.verify.rows import Row
from tests.cases import rows_of

RUN = CliRunner()
SMALL = """
[grid]
cells = [24, 24]
size_mm = [12.0, 12.0]
[pad]
shear_modulus_mpa = 0.2
poisson_ratio = 0.48
[object]
[indenter]
shape = "sphere"
radius_mm = 20.0
[contact]
friction_coefficient = 0.5
[motion]
[[motion.legs]]
steps = 1
approach_mm = 0.5
[[motion.legs]]
steps = 2
twist_deg = 4.0
"""
SHAPE_FROM_FILE = """shape = "height_map"
heights_mm_file = "ball.npy"
spacing_mm = [0.25, 0.25]"""


@pytest.fixture
def config(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SMALL, encoding="utf-8")
    return file


def table(folder):
    return rows_of(folder / "path.csv")


def test_simulate_writes_fields_table_and_pictures_and_goes_on(config, tmp_path):
    out = tmp_path / "out"
    first = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert first.exit_code == 0, first.output
    rows = table(out)
    assert [float(row["twist_deg"]) for row in rows] == pytest.approx([0.0, 2.0, 4.0])
    assert float(rows[2]["moment_nmm"]) > float(rows[1]["moment_nmm"]) > 0.0
    for name in ("pressure", "traction", "stick_slip", "slip", "path"):
        assert (out / f"{name}.png").stat().st_size > 5000
    with np.load(out / "steps" / "0003.npz") as fields:
        assert fields["pressure"].shape == (24, 24)
        assert fields["traction"].shape == (2, 24, 24)
    kept = (out / "steps" / "0002.npz").stat().st_mtime_ns
    last = out / "steps" / "0003.npz"
    last.write_bytes(last.read_bytes()[:1000])  # cut short
    second = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert second.exit_code == 0
    assert (out / "steps" / "0002.npz").stat().st_mtime_ns == kept
    assert table(out) == rows
    last.write_bytes(b"")
    third = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert third.exit_code == 0, third.output
    assert table(out) == rows
    assert not list(out.rglob(".part-*"))
    config.write_text(SMALL.replace("4.0", "5.0"), encoding="utf-8")
    other = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert other.exit_code == 2
    assert "another simulation" in other.stderr


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "poisson_ratio = 0.48",
            "poisson_ratio = 0.6",
            "pad: poisson_ratio is 0.6; it must be a number from 0 to 0.5",
        ),
        ("poisson_ratio = 0.48", "", "pad: the key 'poisson_ratio' is missing"),
        (
            "poisson_ratio = 0.48",
            "poisson_ratio = 0.48\nthickness_mm = 0.0",
            "pad: thickness_mm is 0.0; it must be a number above 0",
        ),
        (
            "poisson_ratio = 0.48",
            "poisson_ratio = 0.48\nthickness_mm = 0.4",
            "pad: thickness_mm is 0.4, less than a cell of 0.5",
        ),
        (
            "poisson_ratio = 0.48",
            "poisson_ratio = 0.48\nthickness_mm = 2.0\nmarker_depth_mm = 2.1",
            "pad: marker_depth_mm is 2.1; it must not be larger than thickness_mm, 2.0",
        ),
        (
            "friction_coefficient = 0.5",
            "friction_coefficient = -0.5",
            "contact: friction_coefficient is -0.5; it must be a number from 0",
        ),
        ("twist_deg = 4.0", "twist_deg = 4.0\nmoment_nmm = 1.0", "both moment_nmm and twist_deg"),
        (
            "friction_coefficient = 0.5",
            "friction_coefficient = 0.5\npressure_exponent = 0.3",
            "'reference_pressure_mpa' is missing",
        ),
        (
            "friction_coefficient = 0.5",
            "friction_coefficient = 0.5\npressure_exponent = 1.0\nreference_pressure_mpa = 0.1",
            "exponent of friction that falls with pressure must be below 1",
        ),
        ("[motion]", "[motion]\nsliding = 1", "motion.sliding must be true or false, got 1"),
        ("approach_mm = 0.5", "normal_force_n = 0.5", "first_approach_mm, at which the bodies"),
        (
            "twist_deg = 4.0",
            "shear_force_n = 1.0",
            "motion.legs #2.shear_force_n must be 2 numbers",
        ),
        ("radius_mm", "radius_m", "indenter: unknown key 'radius_m'; known are"),
        ('"sphere"', '"pyramid"', "indenter: unknown shape 'pyramid'; known are"),
        ("cells = [24, 24]", "cells = 24", "grid.cells must be 2 whole numbers, got 24"),
        ("cells = [24, 24]", "cells = [24.5, 24]", "grid.cells #1 must be a whole number"),
        ("steps = 2", "steps = 0", "motion.legs #2: steps is 0; it must be a number from 1"),
        (
            "steps = 2",
            "steps = 4.5",
            "motion.legs #2.steps must be a whole number below 2^53, got 4.5",
        ),
        ("steps = 2", 'steps = "4"', "motion.legs #2.steps must be a number, got '4'"),
        (
            "shear_modulus_mpa = 0.2",
            'shear_modulus_mpa = "soft"',
            "pad.shear_modulus_mpa must be a number",
        ),
        (
            "poisson_ratio = 0.48",
            "poisson_ratio = true",
            "pad.poisson_ratio must be a number, got True",
        ),
        ('"sphere"', '["a"]', "unknown shape ['a']"),
        (
            "radius_mm = 20.0",
            "radius_mm = 20.0\nposition_mm = [0.0]",
            "position_mm must be 2 numbers",
        ),
        ("[motion]", "[motion]\ncentre_mm = [0, 0, 0]", "centre_mm must be 2 numbers"),
        ("twist_deg = 4.0", "shift_mm = 1.0", "motion.legs #2.shift_mm must be 2 numbers, got 1.0"),
        ("[object]", "", "the key 'object' is missing"),
        ("radius_mm = 20.0", "", "indenter: the key 'radius_mm' is missing"),
        ("[motion]", "[motion", "line"),
    ],
)
def test_wrong_configurations_are_told(config, tmp_path, old, new, words):
    config.write_text(SMALL.replace(old, new), encoding="utf-8")
    result = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert words in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


def test_the_pad_may_come_from_a_sensor_description(config, tmp_path):
    config.write_text(SMALL.replace("[pad]\nshear_modulus_mpa = 0.2\npoisson_ratio = 0.48\n", ""))
    with pytest.raises(ValueError, match="pad: the key 'shear_modulus_mpa' is missing"):
        read_simulation(config)
    config.write_text(SMALL.replace("shear_modulus_mpa = 0.2\n", "").replace("size_mm", "# "))
    pad = Pad(shear_modulus=0.3, poisson_ratio=0.4, thickness=2.0, size=(12.0, 10.0))
    simulation = read_simulation(config, pad)
    body = simulation.contact.elastomer
    assert isinstance(body, Layer)
    assert simulation.contact.grid.size == (12.0, 10.0)
    # what the file says itself goes before
    np.testing.assert_allclose([body.shear_modulus, body.poisson_ratio], [0.3, 0.48])
    # a folder with another pad is another simulation
    assert "# shear_modulus_mpa = 0.3" in simulation.text


def test_simulate_reads_the_pad_of_a_sensor_description(config, tmp_path):
    sensor = tmp_path / "sensor.toml"
    sensor.write_text("format_version = 1\n[markers]\nkind = 'dots'\n[pad]\nthickness_mm = 3.0\n")
    assert read_pad(sensor) == Pad(thickness=3.0)
    sensor.write_text("format_version = 1\n[pad]\nthickness_mm = -3.0\n")
    arguments = ["--sensor", str(sensor), "--out", str(tmp_path / "out")]
    result = RUN.invoke(cli.app, ["simulate", str(config), *arguments])
    assert result.exit_code == 2
    words = "sensor.toml: pad: thickness_mm is -3.0; it must be a number above 0"
    assert words in " ".join(result.stderr.split())


def test_a_file_of_version_0_1_0_is_read_and_says_what_changed(config):
    config.write_text(SMALL.replace("[pad]", "[elastomer]"))
    with pytest.warns(RenamedKeyWarning, match=r"small\.toml is of .* elastomer is now called pad"):
        simulation = read_simulation(config)
    np.testing.assert_allclose(simulation.contact.elastomer.shear_modulus, 0.2)


def test_an_output_that_is_a_file_is_told(config, tmp_path):
    out = tmp_path / "out"
    out.write_text("mine", encoding="utf-8")
    result = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert result.exit_code == 2
    assert "is a file; choose a folder" in " ".join(result.stderr.split())
    assert out.read_text(encoding="utf-8") == "mine"


def test_without_contact_it_says_so(config, tmp_path):
    config.write_text(SMALL.replace("approach_mm = 0.5", "approach_mm = -0.5"), encoding="utf-8")
    result = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0  # and no picture warns of an empty mean: warnings are errors
    assert "do not touch in 3 of 3 steps" in " ".join(result.stderr.split())


def test_a_missing_file_names_the_examples(tmp_path):
    result = RUN.invoke(cli.app, ["simulate", "nowhere.toml", "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert "pivoting_cube" in result.stderr


def test_a_failing_step_is_told(config, tmp_path):
    config.write_text(SMALL.replace("approach_mm = 0.5", "approach_mm = 9.0"), encoding="utf-8")
    result = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "edge of the grid" in " ".join(result.stderr.split())


def test_forces_and_moments_in_place_of_motion(config, tmp_path):
    """With all there is besides: a shape that goes along, friction that falls with pressure."""
    given = SMALL.replace("[motion]", "[motion]\nfirst_approach_mm = 0.1\nsliding = true")
    law = "friction_coefficient = 0.5\nreference_pressure_mpa = 0.05\npressure_exponent = 0.2"
    given = given.replace("friction_coefficient = 0.5", law)
    given = given.replace("approach_mm = 0.5", "normal_force_n = 0.2")
    config.write_text(given.replace("twist_deg = 4.0", "moment_nmm = 0.04"), encoding="utf-8")
    resultants = read_simulation(config).resultants
    np.testing.assert_allclose(resultants.normal_force, [0.2, 0.2, 0.2])
    np.testing.assert_allclose(resultants.moment, [0.0, 0.02, 0.04])
    out = tmp_path / "out"
    result = RUN.invoke(cli.app, ["simulate", str(config), "--out", str(out)])
    assert result.exit_code == 0, result.output
    rows = table(out)
    # tolerance of the resultants, 1e-7 of what friction carries
    np.testing.assert_allclose([float(row["force_z_n"]) for row in rows], -0.2, rtol=1e-6)
    np.testing.assert_allclose(
        [float(row["moment_nmm"]) for row in rows], [0.0, 0.02, 0.04], atol=1e-6
    )
    assert float(rows[2]["twist_deg"]) > 1.5 * float(rows[1]["twist_deg"]) > 0.0


def test_corrected_force_and_moment(config, tmp_path):
    pad = "poisson_ratio = 0.48\nthickness_mm = 4.0"
    off = SMALL.replace("poisson_ratio = 0.48", pad).replace(
        "[motion]", "[motion]\ncorotated = true"
    )
    off = off.replace("approach_mm = 0.5\n[[motion.legs]]\nsteps = 2", "approach_mm = 0.5")
    on = off.replace(pad, f"{pad}\nradius_mm = 8.0\nneo_hookean = true")
    results = []
    for name, text in (("off", off), ("on", on)):
        config.write_text(text, encoding="utf-8")
        [(_, solution)] = run_simulation(read_simulation(config), tmp_path / name)
        results.append(solution)
    contact = read_simulation(config).contact
    pose = Pose(0.5, twist=np.radians(4.0), corotated=True)
    correction = solve_contact(contact, pose).correction  # by the program of the simulation
    ratio = float(results[1].force[2]) / float(results[0].force[2])
    assert ratio == pytest.approx(float(correction.force), abs=1e-3)  # other friction
    assert abs(ratio - 1.0) > 5e-3
    config.write_text(on.replace("twist_deg = 4.0", "moment_nmm = 0.04"), encoding="utf-8")
    with pytest.raises(ValueError, match="corotated cannot be combined with forces or moments"):
        read_simulation(config)


def test_shipped_examples_can_be_read():
    names = [item.name.removesuffix(".toml") for item in EXAMPLES.iterdir()]
    assert sorted(names) == ["cube_on_layer", "pivoting_cube", "shifted_sphere"]
    for name in names:
        assert len(read_simulation(name)) > 5


@pytest.mark.parametrize(("error", "status"), [(0.5, 0), (2.0, 1), (float("nan"), 1)])
def test_verify_tells_by_its_exit_status(monkeypatch, error, status):
    row = Row("a row " * 20, 1.234567, 1.0, error, 1.0, "nothing " * 10)
    monkeypatch.setattr(checks, "CHECKS", (lambda count: [row],))
    monkeypatch.setattr(checks, "convergence", list)
    result = RUN.invoke(cli.app, ["verify"])
    assert result.exit_code == status
    assert ("FAILED" in result.stdout) == bool(status)
    assert "1.234567" in result.stdout
    assert "…" not in result.stdout


def test_maps_of_height_and_friction_come_from_files(config, tmp_path):
    x = 0.25 * (np.arange(65) - 32)
    np.save(tmp_path / "ball.npy", (x[:, None] ** 2 + x**2) / 40.0)
    np.save(tmp_path / "mu.npy", np.full((24, 24), 0.5))
    text = SMALL.replace('shape = "sphere"\nradius_mm = 20.0', SHAPE_FROM_FILE).replace(
        "friction_coefficient = 0.5", 'friction_coefficient_file = "mu.npy"'
    )
    (tmp_path / "maps.toml").write_text(text, encoding="utf-8")
    out = ["--out", str(tmp_path / "maps")]
    moment, sphere = (
        float(list(run_simulation(read_simulation(file), tmp_path / file.stem))[-1][1].moment)
        for file in (tmp_path / "maps.toml", config)
    )
    # the paraboloid is lower than the sphere by r²/4R² of its height, the map bilinear: percents
    assert moment == pytest.approx(sphere, rel=0.03)
    np.save(tmp_path / "mu.npy", np.full((24, 24), 0.1))  # the same file, another map
    changed = RUN.invoke(cli.app, ["simulate", str(tmp_path / "maps.toml"), *out])
    assert changed.exit_code == 2
    assert "another simulation" in changed.output
    np.save(tmp_path / "mu.npy", np.full((24, 24), np.inf))
    endless = RUN.invoke(cli.app, ["simulate", str(tmp_path / "maps.toml"), *out])
    assert "mu.npy must hold numbers from 0" in endless.output
    np.save(tmp_path / "mu.npy", np.full((24, 20), 0.5))
    misfit = ["simulate", str(tmp_path / "maps.toml"), "--out", str(tmp_path / "misfit")]
    refused = RUN.invoke(cli.app, misfit)
    assert refused.exit_code == 2
    assert "map of shape (24, 24)" in refused.output
    (tmp_path / "mu.npy").unlink()
    assert "mu.npy" in RUN.invoke(cli.app, misfit).output
