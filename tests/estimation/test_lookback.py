"""Angles that were given while a round object slid unseen are taken back, others are not."""

from functools import cache

import numpy as np
import pytest

from estimation.lookback import FIRM_SHARE, RESTS_OR_SLIDES, find_slips, withdraw
from estimation.noise import Noise
from estimation.result import UNSEEN_TURN, State
from estimation.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, simulate_pivot

MICRON = Noise.given(1e-3)
LEGS = {"angles_deg": (0.0, 10.0, 10.0, 0.0), "frames": (40, 15, 30)}


@cache
def estimate(friction):
    model = PivotModel(friction_ratio=friction, grid_angle=0.3)
    recording, truth = simulate_pivot(model, dropped=0.0, **LEGS)
    live = estimate_angles(recording, noise=MICRON)
    return truth, live, find_slips(recording, live, MICRON)


def look_back(friction, outline=np.nan):
    truth, live, slips = estimate(friction)
    return truth, live, slips, withdraw(live, slips, np.full(len(live.time), outline))


def test_gel_that_rests_under_a_sliding_object():
    truth, live, slips, back = look_back(friction=0.02)
    first = int(np.argmax(truth.macro_slip))
    assert live.answered[first:].all()  # what makes it necessary: the live tracker sees no slip
    assert slips
    assert back.answered[: first - 2].sum() == live.answered[: first - 2].sum()
    assert not back.answered[first + 1 :].any()
    reasons = {back.reason[i] for i in range(first + 1, len(back.time))}
    assert {RESTS_OR_SLIDES, UNSEEN_TURN} <= reasons
    assert np.isnan(back.low[~back.answered]).all()
    # what the answers of frame by frame were is not touched
    assert live.answered[first:].all()


def test_a_dated_slip():
    truth, _, slips, back = look_back(friction=0.04)
    first = int(np.argmax(truth.macro_slip))
    assert slips[0].certain
    state = np.array(back.state)
    slides = slice(first + 3, 65)  # until it turns back
    assert (state[slides] == State.MACRO_SLIP).all()
    assert not back.stick[slides].any()
    assert (state[-5:] == State.UNKNOWN).all()


@pytest.mark.parametrize("friction", [0.12, 0.2])
def test_a_rest_with_little_grip_keeps_its_angle(friction):
    truth, live, slips, back = look_back(friction)
    assert not truth.macro_slip.any()
    grip = live.stick[60].sum() / live.contact[60].sum()  # while the object rests
    assert grip < FIRM_SHARE  # it might have been doubted
    assert slips == []
    np.testing.assert_array_equal(back.angle, live.angle)


def test_with_an_outline_in_sight_the_tracker_is_believed():
    _, live, slips, back = look_back(friction=0.04, outline=0.0)
    assert slips
    np.testing.assert_array_equal(back.angle, live.angle)
