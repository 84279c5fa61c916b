"""Pace of the markers that stuck last, where macro slip is suspected."""

import numpy as np

from estimation.estimators.result import MOVES_ON, UNSEEN_TURN, State
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.slip.pace import PaceWatch
from tests.cases import domed_pad, frame_of

HOLDS, SLIPS = (State.INCIPIENT, ""), (State.MACRO_SLIP, "few")
LOST = State.UNKNOWN, UNSEEN_TURN


def move(points, axis_mm):
    """A small shift of some points, or a turn by 0.4° about an axis [mm]."""
    if axis_mm is None:
        return np.array([0.02, 0.0, 0.0])
    x, y = (points[:, :2] - points[:, :2].mean(axis=0) - [axis_mm, 0.0]).T
    return np.radians(0.4) * np.stack([-y, x, 0.0 * x], axis=1)


def judge(paces, noise=1e-3, stuck=5, holding=HOLDS, axis_mm=None):
    """States of ten frames in which some markers stick, and of those after it.

    Args:
        paces: motion of the stuck markers in each later frame, over that before [-].
        noise: noise of the markers [mm].
        stuck: number of these markers.
        holding: state and reason of the first ten frames.
        axis_mm: distance of the object's axis from the contact's middle; None for a mere shift.
    """
    layout = domed_pad((8, 8))
    stencils, rng = make_stencils(layout), np.random.default_rng(1)
    stick = np.arange(64) < stuck
    watch, positions, states = PaceWatch(stencils, Noise.from_std(noise)), layout.reference, []
    for number, pace in enumerate([1.0] * 10 + list(paces)):
        step = np.where(stick, pace, 0.3)[:, None] * move(layout.reference, axis_mm)
        positions = positions + step
        seen = positions + noise * rng.normal(size=positions.shape) * [1.0, 1.0, 0.0]
        fields = measure_fields(stencils, frame_of(seen, contact=np.ones(64, dtype=bool)))
        holds = number < 10
        state, reason = holding if holds else SLIPS
        sticking = stick if holds else ~stick & stick
        states.append(watch.judge(state, reason, sticking, fields, number / 30))
    assert states[:10] == [holding] * 10
    return states[10:]


def test_markers_that_go_on_may_stick():
    assert judge([1.0] * 6) == [(State.UNKNOWN, MOVES_ON)] * 6
    assert judge([1.0] * 6, stuck=2) == [SLIPS] * 6


def test_markers_that_moved_as_one_while_the_angle_was_lost_may_stick():
    assert judge([1.0] * 6, holding=LOST) == [(State.UNKNOWN, MOVES_ON)] * 6
    assert judge([0.5] * 6, holding=LOST)[1:] == [SLIPS] * 5


def test_markers_that_fall_behind_slip_within_two_frames():
    assert judge([0.5] * 6)[1:] == [SLIPS] * 5
    assert judge([1.0, 1.0, 0.0, 0.0])[2:] == [SLIPS] * 2


def test_coarse_noise_hides_the_pace():
    assert judge([1.0] * 3, noise=3e-2) == [SLIPS] * 3


def test_pace_does_not_delay_the_slip_of_an_object_that_turns_on_the_spot():
    assert judge([1.0] * 6, axis_mm=0.2) == [SLIPS] * 6
    assert judge([1.0] * 6, axis_mm=1.5) == [(State.UNKNOWN, MOVES_ON)] * 6
