"""Angles that were given while a round object slid unseen are taken back, others are not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from estimation.estimators.result import UNSEEN_TURN, State
from estimation.frames.noise import Noise, estimate_noise
from estimation.output.missing import count_missing, describe_answers
from estimation.pictures.hold import HoldSettings
from estimation.slip.disc import SlipSettings
from estimation.slip.lookback import backdate, find_slips, withdraw
from estimation.slip.shear import Shear, ShearPath
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot
from tests.cases import slow_case

MICRON = Noise.from_std(1e-3)
LEGS = {"angles_deg": (0.0, 10.0, 10.0, 0.0), "frames": (40, 15, 30)}


@cache
def estimate(friction):
    model = PivotModel(friction_ratio=friction, grid_angle=0.3)
    recording, truth = simulate_pivot(model, timing=Timing(dropped=0.0), **LEGS)
    live = estimate_angles(recording, noise=MICRON)
    return truth, live, find_slips(recording, live, MICRON)


def look_back(friction, outline=np.nan):
    truth, live, slips = estimate(friction)
    return truth, live, slips, withdraw(live, slips, np.full(len(live.time), outline))


def test_gel_that_rests_under_a_sliding_object():
    truth, live, slips, back = look_back(friction=0.02)
    first = int(np.argmax(truth.macro_slip))
    assert live.answered[first]
    assert not live.answered[first + 2 :].any()  # live, the law of friction shows the slip
    ahead = np.maximum(live.low - truth.angle, truth.angle - live.high)[first:]
    assert np.nanmax(np.degrees(ahead)) < 1.0  # but reckoned with, until the angle is given up
    assert slips
    assert back.answered[: first - 2].sum() == live.answered[: first - 2].sum()
    assert not back.answered[first + 1 :].any()
    reasons = {back.reason[i] for i in range(first + 1, len(back.time))}
    assert UNSEEN_TURN in reasons
    assert np.isnan(back.low[~back.answered]).all()
    # what the answers of frame by frame were is kept
    doubtful = live.answered & ~back.answered
    np.testing.assert_array_equal(back.withdrawn.rows, doubtful)
    for name in ("angle", "low", "high", "stick_markers"):
        given, kept = getattr(live, name), getattr(back.withdrawn, name)
        np.testing.assert_array_equal(kept[doubtful], given[doubtful])
    assert [s for s in back.withdrawn.state if s] == [
        live.state[i] for i in np.flatnonzero(doubtful)
    ]


def test_withdrawn_answers_can_be_left_in():
    _, live, slips, back = look_back(friction=0.02)
    kept = withdraw(live, slips, np.full(len(live.time), np.nan), keep=True)
    np.testing.assert_array_equal(kept.angle, live.angle)
    np.testing.assert_array_equal(kept.stick, live.stick)
    assert kept.state == live.state
    np.testing.assert_array_equal(kept.withdrawn.angle, back.withdrawn.angle)
    assert kept.reason == back.reason  # says what speaks against them


def test_frames_without_an_angle_are_counted_by_their_reason():
    _, live, _, back = look_back(friction=0.02)
    counts = count_missing(back)
    assert sum(counts.values()) == (~back.answered).sum()
    assert counts["before contact"] == live.state.count(State.NO_CONTACT)
    assert counts["withdrawn after a pause"] > 0
    text = describe_answers(back)
    assert text.startswith(f"{back.answered.sum()} of {len(live.time)} frames answered (")
    assert f"{(~back.answered).sum()} without an angle: " in text
    assert f"{counts['before contact']} before contact" in text
    assert describe_answers(back, most=1).endswith(" for other reasons")
    lost = replace(live, state=(State.UNKNOWN,) * 2 + live.state[2:], angle=live.angle * np.nan)
    lost = replace(lost, reason=("no time stamp", *("",) * (len(live.time) - 1)))
    assert "; 1 frame: no time stamp" in describe_answers(lost, most=9)


def test_a_dated_slip():
    truth, _, slips, back = look_back(friction=0.04)
    first = int(np.argmax(truth.macro_slip))
    assert slips[0].certain
    state = np.array(back.state)
    slides = slice(first + 3, 65)  # until it turns back
    assert (state[first - 2 : slides.stop] == State.MACRO_SLIP).any()
    assert set(state[slides]) <= {State.MACRO_SLIP, State.UNKNOWN}  # gel at rest shows no slide
    assert not back.stick[slides].any()
    sticks_again = np.flatnonzero(truth.sticking_now.sum(axis=1)[90:] >= 6) + 90
    assert (state[sticks_again] == State.UNKNOWN).all()  # by an unknown angle
    assert not back.answered[first + 3 :].any()


@pytest.mark.parametrize("friction", [0.12, slow_case(0.18)])
def test_a_rest_with_little_grip_keeps_its_angle(friction):
    truth, live, slips, back = look_back(friction)
    assert not truth.macro_slip.any()
    grip = live.stick[60].sum() / live.contact[60].sum()  # while the object rests
    assert grip < SlipSettings().firm_share  # it might have been doubted
    assert slips == []
    np.testing.assert_array_equal(back.angle, live.angle)


def test_a_rest_on_a_few_markers_keeps_its_angle():
    """The disc has almost closed, but by the law of friction six markers hold throughout."""
    model = PivotModel(friction_ratio=0.1005, offset=(-0.3747, 0.2264), grid_angle=1.2446)
    recording, truth = simulate_pivot(model, seed=119)
    noise = estimate_noise(recording)
    live = estimate_angles(recording, noise=noise)
    back = withdraw(live, find_slips(recording, live, noise), np.full(len(live.time), np.nan))
    rests = (truth.angle == np.nanmax(truth.angle)) & ~truth.macro_slip
    held = truth.stick.sum(axis=1)[rests]
    assert rests.sum() > 10
    assert 5 <= held.min() <= held.max() <= 9
    assert back.answered[rests].all()
    doubts = find_slips(recording, live, noise, SlipSettings(held_markers=400))
    assert not all(slip.certain for slip in doubts)  # by the disc alone


def test_with_an_outline_in_sight_the_tracker_is_believed():
    _, live, slips, back = look_back(friction=0.04, outline=0.0)
    assert slips
    np.testing.assert_array_equal(back.angle, live.angle)


def test_a_rest_that_little_noise_shows_is_no_slip():
    # where a dot lies between the camera's pixels biases it by more than the noise: the disc's
    # misfit is then above the noise, and small beside the motion
    model = PivotModel(friction_ratio=0.3, noise=2e-4, normal_noise=7e-4)
    legs = {"angles_deg": (0.0, 15.0, 15.0, 12.0), "frames": (30, 18, 6)}
    recording, truth = simulate_pivot(
        model, timing=Timing(dropped=0.0, jitter=0.0), noise_window=1, **legs
    )
    plane = recording.positions[..., :2]
    biased = plane + 2e-3 * np.sin(2.0 * np.pi * plane / 0.045)
    positions = np.concatenate([biased, recording.positions[..., 2:]], axis=-1)
    recording = replace(recording, positions=positions)
    noise = estimate_noise(recording)
    live = estimate_angles(recording, noise=noise)
    assert truth.stick[60].sum() >= 20
    assert (
        live.stick[60].sum() < SlipSettings().firm_share * live.contact[60].sum()
    )  # it might have been doubted
    assert find_slips(recording, live, noise) == []


@pytest.mark.parametrize(("state", "begins"), [(State.INCIPIENT, 10), (State.STICK, 14)])
def test_a_macro_slip_is_dated_back_to_its_onset_unless_markers_stuck(state, begins):
    frame, reported = np.arange(24), 16
    fades = 0.1 * np.maximum(frame - 11, 0)  # a median of three frames, so it is a frame late
    path = ShearPath.of(
        *(
            Shear(min(row / 10.0, 1.0), print_correlation=1.0 - lost)
            for row, lost in zip(frame, fades, strict=True)
        )
    )
    states = [State.INCIPIENT] * reported + [State.MACRO_SLIP] * (len(frame) - reported)
    states[13] = state
    live = replace(estimate(0.3)[1].take(slice(-len(frame), None)), state=tuple(states))
    dated = backdate(live, path)
    assert dated.slipping.tolist() == (frame >= begins).tolist()
    since = dated.slipping & (frame < reported)
    assert not dated.stick_markers[since].any()
    assert not dated.stick[since].any()
    np.testing.assert_array_equal(dated.stick_markers[:begins], live.stick_markers[2 : begins + 2])
    np.testing.assert_array_equal(dated.angle, live.angle)


def test_states_from_a_print_are_dated_to_the_frames_they_confirm():
    live = ["no_contact"] * 3 + ["stick"] * 5 + ["incipient"] * 4 + ["unknown", "stick", "stick"]
    dates = ["no_contact"] * 3 + ["stick"] * 3 + ["incipient"] * 6 + ["unknown", "stick", "stick"]
    result = estimate(0.3)[1].take(slice(-len(live), None))
    result = replace(result, state=tuple(State(state) for state in live))
    path = ShearPath.of(*(Shear(0.1, print_correlation=0.9) for _ in live))
    dated = backdate(result, path)
    assert list(dated.state) == dates
    assert (dated.stick_markers <= dated.contact_markers).all()
    np.testing.assert_array_equal(dated.stick.sum(axis=1), dated.stick_markers)
    assert not (dated.stick & ~dated.contact).any()
    unprinted = path._replace(print_correlation=np.full(len(live), np.nan))
    assert list(backdate(result, unprinted).state) == live


@pytest.mark.parametrize("frames", [HoldSettings().lately - 1, HoldSettings().lately])
def test_partial_slip_is_none_if_a_later_print_is_that_from_before_it(frames):
    live = [State.STICK] * 3 + [State.INCIPIENT] * frames + [State.STICK] * 3
    result = replace(estimate(0.3)[1].take(slice(-len(live), None)), state=tuple(live))
    path = ShearPath.of(*(Shear(0.1, print_correlation=0.9) for _ in live))
    dated = backdate(result, path)
    slips = [state == State.INCIPIENT for state in dated.state]
    assert sum(slips) == (frames if frames >= HoldSettings().lately else 0)
    np.testing.assert_array_equal(dated.stick.sum(axis=1), dated.stick_markers)


@pytest.mark.parametrize(("frames", "correlation"), [(4, 0.1), (4, np.nan), (17, 0.1)])
def test_macro_slip_holds_in_the_frames_before_whose_markers_were_not_recognised(
    frames, correlation
):
    live = [State.STICK] * 3 + [State.UNKNOWN] * frames + [State.INCIPIENT]
    live += [State.MACRO_SLIP] * 2
    result = replace(estimate(0.3)[1].take(slice(-len(live), None)), state=tuple(live))
    seen, slipped = (Shear(0.1, print_correlation=value) for value in (0.9, correlation))
    shears = [seen] * 3 + [Shear()] * frames + [seen] + [slipped] * 2
    dated = backdate(result, ShearPath.of(*shears))
    printed = bool(np.isfinite(correlation))
    slips = frames <= 16 and printed
    assert dated.slipping.sum() == 2 + printed + frames * slips
    assert not dated.stick_markers[3 : 3 + frames].any() or not slips
