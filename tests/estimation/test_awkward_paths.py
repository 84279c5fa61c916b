"""Recordings that a method for one lift does not expect: what they are answered with."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators.result import RESTS_OR_SLIDES, State
from estimation.frames.noise import Noise
from estimation.slip.lookback import find_slips
from estimation.slip.margin import follow_margin
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot

MICRON = Noise.from_std(1e-3)
WHOLE = Timing(dropped=0.0)
FIRM, LOOSE = PivotModel(friction_ratio=1.0), PivotModel(friction_ratio=0.05)


def follow(model, angles_deg, frames, **settings):
    recording, truth = simulate_pivot(
        model,
        angles_deg=angles_deg,
        frames=frames,
        unloaded=4,
        pressing=8,
        timing=WHOLE,
        **settings,
    )
    result = estimate_angles(recording, noise=MICRON)
    return recording, truth, result, np.degrees(np.abs(result.angle - truth.angle))


def test_sticking_from_start_to_end():
    recording, _, result, error = follow(FIRM, (0.0, 3.0, -3.0), (9, 18))
    assert result.answered[4:].all()
    assert State.MACRO_SLIP not in result.state
    assert np.nanmax(error) < 0.02  # 1 µm over some 60 markers: 0.003°
    assert find_slips(recording, result, MICRON) == []
    # what little has bent the moment is far from the end
    left = np.degrees(follow_margin(result).angle)
    assert np.nanmin(left, initial=np.inf) > 20.0


def test_hardly_ever_sticking():
    _, truth, result, error = follow(LOOSE, (0.0, 40.0), (50,))
    slipping = np.array([state == State.MACRO_SLIP for state in result.state])
    first = int(np.argmax(truth.macro_slip))
    assert abs(int(np.argmax(slipping)) - first) <= 9  # within the nine frames that README tells
    # gel that has come to rest does not show that the object slides on
    assert set(result.state[first + 10 :]) <= {State.MACRO_SLIP, State.UNKNOWN}
    assert not result.answered[first + 10 :].any()  # round: no outline to follow
    assert all(result.reason[i] for i in np.flatnonzero(slipping & ~result.answered))
    assert np.nanmax(error[: first - 1]) < 1.0  # a few markers 0.8 mm from the axis


def test_an_end_in_macro_slip_and_at_rest():
    _, truth, result, _ = follow(PivotModel(friction_ratio=0.05), (0.0, 20.0, 20.0), (40, 15))
    assert truth.macro_slip.any()
    # the gel rests, whether the object rests or slides on: no angle comes back
    assert result.slipping.any()
    assert result.state[-1] == State.UNKNOWN
    assert result.reason[-1] == RESTS_OR_SLIDES
    assert np.isnan(result.angle[-1])


@pytest.mark.parametrize("gap_s", [1.0, 5.0])
def test_a_gap_of_a_second(gap_s):
    """While no frames came the object went on turning: what held on shows by how much."""
    recording, truth = simulate_pivot(
        FIRM, angles_deg=(0.0, 15.0), frames=(60,), unloaded=4, pressing=8, timing=WHOLE
    )
    kept = np.r_[0:30, 60:72]
    late = np.where(np.arange(len(kept)) >= 30, gap_s - 1.0, 0.0)
    cut = replace(
        recording,
        positions=recording.positions[kept],
        valid=recording.valid[kept],
        time=recording.time[kept] + late,
        source_index=recording.source_index[kept],
        force=None,
        moment=None,
    )
    result = estimate_angles(cut, noise=MICRON)
    assert result.answered[30:].all()
    error = np.degrees(np.abs(result.angle - truth.angle[kept]))
    assert error[30:].max() < 0.1
    inside = (result.low <= truth.angle[kept]) & (truth.angle[kept] <= result.high)
    assert inside[30:].mean() > 0.7  # frames of one recording: few independent draws


def test_an_outline_that_runs_off_the_pad():
    """Half of the contact lies beyond the markers: what is seen of it still turns right."""
    model = FIRM._replace(grid_shape=(14, 8), offset=(4.5, 0.0))
    _, truth, result, error = follow(model, (0.0, 8.0), (24,))
    assert result.answered[4:].all()
    assert np.nanmax(error[12:]) < 0.1  # a part of a ring of markers, most of it to one side
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert inside[6:].mean() > 0.9  # its slip must not count as strain by the press
