"""Pressing alone gives k where closed forms say how two bodies share the approach."""

import numpy as np
import pytest

from calibration.softness.choices import Pressing
from calibration.softness.squeeze import (
    Bodies,
    read_travel,
    squeeze_by_curvature,
    squeeze_by_travel,
)
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot

KNOWN = Bodies(0.48, (0.48, 0.48))


def test_travel_gives_k_and_poissons_ratio_widens_it():
    rng = np.random.default_rng(0)
    depth = np.linspace(0.1, 1.0, 20)
    travel = 3.0 + 2.0 * 1.5 * depth + 1e-3 * rng.normal(size=20)
    found = squeeze_by_travel(travel, depth, KNOWN)
    assert found.low < 0.5 < found.high
    assert found.high - found.low < 0.01  # 1 µm over 0.9 mm, 20 readings
    wide = squeeze_by_travel(travel, depth, Bodies(0.48, (0.3, 0.5)))
    assert wide.low < found.low * 0.52 / 0.7 * 1.001
    assert wide.high > found.high
    backed = squeeze_by_travel(travel, depth, KNOWN, Pressing(rigid_slope=1.1))
    assert backed.stiffness_ratio == pytest.approx(found.stiffness_ratio - 0.1)


def test_curvature_of_a_sphere_gives_k():
    # [Johnson1985] (4.22): a² = R(δ_S + δ_B). The elastomer's share of the approach is told to the
    # model, so R follows from k; a sphere's pad takes 1/(1+k) of its curvature.
    for k in (0.0, 0.5):
        model = PivotModel(stiffness_ratio=k, approach=0.8, noise=1e-3)
        radius = model.contact_radius**2 / (model.approach * (1.0 + k))
        recording, _ = simulate_pivot(
            model, angles_deg=(0.0, 0.1), frames=(30,), timing=Timing(dropped=0.0)
        )
        found = squeeze_by_curvature(recording, radius, KNOWN)
        assert found.low <= k <= found.high
        assert found.high - found.low < 0.15
        assert found.stiffness_ratio == pytest.approx(k, abs=0.03)  # finite strain


def test_bad_pressings(tmp_path):
    depth = np.linspace(0.1, 1.0, 10)
    with pytest.raises(ValueError, match="cannot be negative"):
        squeeze_by_travel(depth, depth, KNOWN)
    with pytest.raises(ValueError, match="close the gripper over"):
        squeeze_by_travel(depth[:3], depth[:3], KNOWN)
    with pytest.raises(ValueError, match="lower end first"):
        Bodies(0.6)
    path = tmp_path / "travel.csv"
    path.write_text("travel,indentation\n1,2\n")
    with pytest.raises(ValueError, match="lacks the columns travel_mm, indentation_mm"):
        read_travel(path)
    path.write_text("travel_mm,indentation_mm\n3,1,1,0\n")
    with pytest.raises(ValueError, match=r"travel\.csv, line 2, has 4 cells"):
        read_travel(path)
    recording, _ = simulate_pivot(angles_deg=(0.0, 0.1), frames=(2,), pressing=1)
    with pytest.raises(ValueError, match="press deeper"):
        squeeze_by_curvature(recording.head(9), 20.0, KNOWN)
