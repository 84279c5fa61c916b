"""Pace of the markers that stuck last, where macro slip is suspected."""

import numpy as np

from estimation.estimators.measurement import Measurement
from estimation.estimators.result import (
    MOVES_ON,
    RESTS_OR_SLIDES,
    TOO_FEW_STICK,
    UNSEEN_TURN,
    State,
)
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.slip.pace import PaceWatch
from estimation.sources import find_recordings, read_recording
from estimation.tracking.tracker import estimate_angles
from tests.cases import domed_pad, find_published, frame_of, turn_about_z

HOLDS, SLIPS = (State.INCIPIENT, ""), (State.MACRO_SLIP, "few")
LOST = State.UNKNOWN, UNSEEN_TURN
RESTS = State.UNKNOWN, RESTS_OR_SLIDES


def move(points, axis_mm):
    """A small shift of some points, or a turn by 0.4° about an axis [mm]."""
    if axis_mm is None:
        return np.array([0.02, 0.0, 0.0])
    x, y = (points[:, :2] - points[:, :2].mean(axis=0) - [axis_mm, 0.0]).T
    return np.radians(0.4) * np.stack([-y, x, 0.0 * x], axis=1)


def press(points, long_axis):
    """Indentation under a face of 2:1 whose long axis has some direction [mm]."""
    arms = turn_about_z(points - points.mean(axis=0), -long_axis)
    return 1.0 - 0.01 * arms[:, 0] ** 2 - 0.04 * arms[:, 1] ** 2


def judge(
    paces,
    noise=1e-3,
    stuck=5,
    found=None,
    holding=HOLDS,
    after=SLIPS,
    axis_mm=None,
    outline_deg=None,
    seed=1,
):
    """States of ten frames in which some markers stick, and of those after it.

    Args:
        paces: motion of the stuck markers in each later frame, over that before [-], one for each
            of them or for all; NaN for markers that are not visible any more.
        noise: noise of the markers [mm].
        stuck: number of these markers.
        found: number of those found in the tenth frame; None for all.
        holding: state and reason of the first ten frames.
        after: those of the later ones.
        axis_mm: distance of the object's axis from the contact's middle; None for a mere shift.
        outline_deg: turn of the contact's outline in each later frame, which gives the angle.
        seed: seed of the noise.
    """
    layout = domed_pad((8, 8))
    stencils, rng = make_stencils(layout), np.random.default_rng(seed)
    stick = np.arange(64) < stuck
    known = Noise.from_std(noise) if noise else None
    watch, positions, states = PaceWatch(stencils, known), layout.reference, []
    for number, pace in enumerate([1.0] * 10 + list(paces)):
        paces_now = np.full(64, 0.3)
        paces_now[stick] = pace
        step = paces_now[:, None] * move(layout.reference, axis_mm)
        positions = positions + step
        seen = positions + noise * rng.normal(size=positions.shape) * [1.0, 1.0, 0.0]
        fields = measure_fields(stencils, frame_of(seen, contact=np.ones(64, dtype=bool)))
        holds = number < 10
        if outline_deg is not None:
            turned = np.radians(outline_deg) * max(number - 9, 0)
            fields = fields._replace(indentation=press(positions, turned))
        state, reason = holding if holds else after
        last = np.arange(64) < (stuck if found is None or number < 9 else found)
        gel = Measurement.none(stick & last if holds else ~stick & stick)
        gel = gel if outline_deg is None else gel._replace(angle=0.0)
        states.append(watch.judge(state, reason, gel, fields, number / 30))
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
    assert judge([1.0] * 3, noise=3e-2) == [(State.UNKNOWN, MOVES_ON)] * 3
    assert judge([1.0] * 3, noise=3e-2, axis_mm=0.2) == [SLIPS] * 3


def test_unknown_noise_judges_nothing():
    assert judge([1.0] * 3, noise=0.0) == [SLIPS] * 3


def test_markers_out_of_view_may_stick():
    assert judge([[np.nan, 1.0, 1.0, 1.0, 1.0]] * 3) == [(State.UNKNOWN, MOVES_ON)] * 3


def test_noise_slows_no_marker_down():
    for seed in range(20):
        assert judge([1.0] * 3, noise=4e-3, seed=seed) == [(State.UNKNOWN, MOVES_ON)] * 3


def test_markers_that_the_last_fit_missed_may_stick():
    assert judge([[0.3, 0.3, 0.3, 1.0, 1.0, 1.0]] * 4, stuck=6, found=3)[1:] == (
        [(State.UNKNOWN, MOVES_ON)] * 3
    )


def test_object_that_one_marker_goes_on_with_does_not_rest():
    alone, none = [[1.0, 0.3, 0.3, 0.3, 0.3]] * 6, [0.0] * 6
    assert judge(alone, after=RESTS)[2:] == [(State.MACRO_SLIP, TOO_FEW_STICK)] * 4
    assert judge(none, after=RESTS) == [RESTS] * 6
    assert judge([1.0] * 6, after=RESTS) == [RESTS] * 6


def test_pace_does_not_delay_the_slip_of_an_object_that_turns_on_the_spot():
    assert judge([1.0] * 6, axis_mm=0.2) == [SLIPS] * 6
    assert judge([1.0] * 6, axis_mm=1.5) == [(State.UNKNOWN, MOVES_ON)] * 6


def test_outline_that_turns_ahead_of_all_gel_shows_the_slip():
    ahead = judge([1.0] * 6, stuck=64, outline_deg=0.5)
    assert ahead[2:] == [SLIPS] * 4
    along = judge([1.0] * 6, stuck=64, axis_mm=1.5, outline_deg=0.4)
    assert along == [(State.UNKNOWN, MOVES_ON)] * 6


def test_outline_that_turns_ahead_of_all_gel_but_three_markers_shows_no_slip():
    held = [[1.0] * 3 + [0.0] * 61] * 6
    assert judge(held, stuck=64, axis_mm=1.5, outline_deg=0.4) == [(State.UNKNOWN, MOVES_ON)] * 6


def test_first_slide_of_the_published_grasp_is_reported_until_the_object_rests():
    """The outline turns by 3.8° in its first 12 frames, rests for four, and then turns back."""
    second = find_recordings(find_published("tac3d-pivot"))[1]
    slips = np.flatnonzero(estimate_angles(read_recording(second)).slipping[:60])
    assert slips[0] == 11
    assert slips[-1] < 16
