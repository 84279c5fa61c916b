import base64
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.progress import Progress

from estimation.estimators.grasp import compare_fingers
from estimation.estimators.result import State
from estimation.run import Input, run_all
from estimation.settings import Settings
from estimation.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, simulate_pivot

PATH = (0.0, 8.0, 8.0, -6.0)


@pytest.fixture(scope="module")
def fingers():
    """Two fingers on one object: the second sees it turn the other way, 0.4 s later."""
    model = PivotModel(friction_ratio=0.3)
    legs = {"frames": (30, 12, 50), "pressing": 10}
    first, truth = simulate_pivot(model, angles_deg=PATH, seed=1, **legs)
    mirrored = tuple(-angle for angle in PATH)
    second, _ = simulate_pivot(
        model._replace(offset=(-0.1, 0.4)), angles_deg=mirrored, seed=2, unloaded=22, **legs
    )
    second = replace(second, time=second.time + 1e4, name="other")
    return first, second, truth


def test_clock_sign_and_difference_are_found(fingers):
    first, second, truth = fingers
    grasp = compare_fingers(estimate_angles(first), estimate_angles(second))
    late = 12 / 30  # its first frame comes 12 frames earlier in the motion
    start = (first.source_index[0] - second.source_index[0]) / 30
    assert grasp.fixed.clock_offset == pytest.approx(-late - start, abs=0.01)
    assert abs(np.degrees(grasp.fixed.angle_offset)) < 0.1
    assert np.degrees(grasp.fixed.rms) < 0.1  # jitter of 2 ms at 8°/s, 0.02° of noise
    assert grasp.free.slope == pytest.approx(1.0, abs=4 * grasp.free.errors[0] + 0.002)
    error = np.degrees(np.abs(grasp.joint - truth.angle))[grasp.holds]
    assert error.mean() < 0.05
    assert np.isfinite(grasp.joint).sum() >= np.isfinite(grasp.first).sum()


def test_a_slope_is_seen_and_the_clock_not_confused_with_it(fingers):
    first, second, _ = fingers
    soft = estimate_angles(second)
    soft = replace(soft, angle=0.9 * soft.angle, low=0.9 * soft.low, high=0.9 * soft.high)
    grasp = compare_fingers(estimate_angles(first), soft)
    assert grasp.free.slope == pytest.approx(0.9, abs=0.005)
    assert np.degrees(grasp.fixed.rms) > 3 * np.degrees(grasp.free.rms)
    assert abs(grasp.free.correlation) < 1.0


def test_fingers_that_never_hold_together_are_refused(fingers):
    first, second, _ = fingers
    one, other = estimate_angles(first), estimate_angles(second)
    slipping = replace(other, state=(State.MACRO_SLIP,) * len(other.state))
    with pytest.raises(ValueError, match="fewer than 10 frames without macro slip"):
        compare_fingers(one, slipping)


def test_different_lengths_and_rates(fingers):
    first, second, _ = fingers
    half = estimate_angles(second).take(slice(None, None, 2))
    grasp = compare_fingers(estimate_angles(first), half)
    assert len(grasp.joint) == len(first)
    assert np.degrees(grasp.fixed.rms) < 0.1


def test_command_writes_the_comparison(fingers, tmp_path):
    first, second, _ = fingers
    inputs = [Input(first), Input(second)]
    outcome = run_all(inputs, tmp_path, Settings(grasp=True), Progress(disable=True))
    assert {"comparison.csv", "grasp.json", "grasp.png", "moment.png"} <= {
        p.name for p in tmp_path.iterdir()
    }
    figures = json.loads((tmp_path / "grasp.json").read_text())
    assert figures["slope_fixed"]["slope"] == 1.0
    assert figures["slope_free"]["slope_standard_error"] > 0
    assert any("rms before macro slip" in line for line in outcome.lines)
    rows = (tmp_path / "comparison.csv").read_text().splitlines()
    assert len(rows) == len(first) + 1
    page = (tmp_path / "report.html").read_text()
    picture = base64.b64encode((tmp_path / "grasp.png").read_bytes()).decode()
    assert f'src="data:image/png;base64,{picture}"' in page
    for column in ("joint_deg", "joint_low_deg", "joint_high_deg", "second_deg"):
        last = rows[-1].split(",")[rows[0].split(",").index(column)]
        assert f"{float(last):.2f}" in page
    free = figures["slope_free"]
    assert f"{free['slope']:.3f} ± {free['slope_standard_error']:.3f}" in page
    assert f"<td>{figures['slope_fixed']['rms_difference_deg']:.3f}</td>" in page
    with pytest.raises(ValueError, match="two fingers, not 1"):
        run_all(inputs[:1], tmp_path, Settings(grasp=True), Progress(disable=True))


def test_no_overlap_is_said_and_the_rest_is_kept(fingers, tmp_path):
    first, second, _ = fingers
    inputs = [Input(first), Input(second.head(12))]
    outcome = run_all(inputs, tmp_path, Settings(grasp=True), Progress(disable=True))
    assert any(line.startswith("no comparison") for line in outcome.lines)
    assert "no comparison: the two recordings share" in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "comparison.csv").exists()
