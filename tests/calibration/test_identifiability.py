"""What an experiment tells: against what is known in closed form."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration import experiment as experiments
from calibration.__main__ import app
from calibration.field_result import FieldData
from calibration.forward import FieldModel, Unknown, press_and_move
from calibration.identifiability import identify
from contactmodel import Grid, Pose

K, TWIST = 0.5, 0.15
PITCH = 8.0 / 7.0

PLAN = f"""
format_version = 1
shape = "paraboloid"
cells = 16
size_mm = 11.0
frames = [0]
markers = {{ pitch_mm = {PITCH!r}, count = 8 }}
[numbers]
shear_modulus_mpa = 0.2
poisson_ratio = 0.5
friction_coefficient = 1e3
radius_mm = 15.0
approach_mm = 0.6
stiffness_ratio = {{ start = {K}, low = 0.01, high = 10.0 }}
twist_deg = {{ start = 8.6, low = 0.05, high = 34.0, prior = [8.6, 0.1] }}
"""


def linear_twist(numbers, grid):
    """The scene with θ × r: the contraction of a true rotation would tell θ a little."""
    scene = press_and_move("paraboloid")(numbers, grid)
    path = scene.path
    linear = Pose(path.approach, path.shift, path.twist, path.centre, linear=True)
    return scene._replace(path=linear)


def experiment(**changed):
    """A ball that sticks on a half-space, both incompressible: θ and k show as θ/(1 + k)."""
    at = (np.arange(8) - 3.5) * PITCH
    markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    model = FieldModel(linear_twist, Grid((16, 16), (11.0, 11.0)), markers)
    numbers = {
        "shear_modulus": 0.2,
        "poisson_ratio": 0.5,
        "friction_coefficient": 1e3,
        "radius": 15.0,
        "approach": 0.6,
        "stiffness_ratio": Unknown(K, 0.01, 10.0),
        "twist": Unknown(TWIST, 0.001, 0.6),
    }
    return model, numbers | changed, FieldData(np.zeros((1, 64, 3)))


def test_a_half_space_does_not_tell_softness_from_angle():
    model, numbers, data = experiment()
    # u_z tells 1 + k by the depth of the imprint; the twist's own field does not
    flat = data._replace(displacement=np.where([True, True, False], data.displacement, np.nan))
    found = identify(model, numbers, flat, design=("twist",))
    assert not found.determined.any()
    # nothing changes while θ/(1 + k) stays: dθ/θ = k/(1 + k) dk/k
    assert found.unseen == (f"stiffness_ratio +10.0 % with twist {10 * K / (1 + K):+.1f} %",)
    assert found.correlation[0, 1] > 0.999
    for name in ("stiffness_ratio", "twist"):
        best = found.helps[name][0]
        assert "from elsewhere" in best.what
        assert best.error < 0.1
    # with θ known to 1 %, k is known to 1 % (1 + k)/k = 3 %
    by_angle = {one.what: one.error for one in found.helps["stiffness_ratio"]}
    error = by_angle["twist from elsewhere, to 1 %"] * found.errors[0]
    assert error == pytest.approx(0.01 * (1 + K) / K, rel=0.02)  # the noise adds to it
    assert found.helps["twist"][-1].error == pytest.approx(1.0, abs=0.05)  # no twist helps


def test_a_plan_in_a_file_gives_numbers_and_a_page(tmp_path, monkeypatch):
    # the scene of the test above: it is compiled already
    monkeypatch.setattr(experiments, "press_and_move", lambda shape, **_: linear_twist)
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    said = CliRunner().invoke(app, ["design", "--experiment", str(path), "--out", str(tmp_path)])
    assert said.exit_code == 0, said.output
    assert "all unknown numbers are determined" in said.output
    written = json.loads((tmp_path / "design.json").read_text())
    assert [row["name"] for row in written["numbers"]] == ["stiffness_ratio", "twist"]
    page = (tmp_path / "report.html").read_text()
    assert "data:image/png;base64" in page
    assert "best improvements" in page


@pytest.mark.parametrize(("poisson_ratio", "covered"), [("0.48", True), ("0.3", False)])
def test_a_plan_outside_the_range_of_the_corrections_is_reported(tmp_path, poisson_ratio, covered):
    path = tmp_path / "plan.toml"
    path.write_text(f"""
format_version = 1
finite_strain = true
shape = "sphere"
cells = 12
size_mm = 11.0
frames = [0]
markers = {{ pitch_mm = 1.0, count = 7 }}
[numbers]
shear_modulus_mpa = 0.2
poisson_ratio = {poisson_ratio}
friction_coefficient = 0.5
thickness_mm = 8.0
radius_mm = 15.0
approach_mm = 0.6
twist_deg = {{ start = 8.6, low = 0.05, high = 25.0 }}
""")
    said = CliRunner().invoke(app, ["design", "--experiment", str(path), "--out", str(tmp_path)])
    assert said.exit_code == 0, said.output
    assert ("outside the range of the corrections" in said.output) != covered
    assert bool(json.loads((tmp_path / "design.json").read_text())["warnings"]) != covered
