"""The angle by the outline: what it counts from, when it takes over, and its error."""

import numpy as np
import pytest

from estimation.estimators.outlined import OutlinedTurn
from estimation.fields.outline import Axis

NOWHERE = Axis(np.nan, np.nan, np.nan, np.nan)


def seen(angle, error=0.01):
    return Axis(angle, error, 2.0, 1.0)


def follow(gel, outline):
    """An outline followed beside the gel [rad], eight frames being the mature age."""
    turn = OutlinedTurn(mature_age=8, memory=60, slip=np.radians(2.0), shape_change=0.3, gain=1.0)
    for by_gel, axis in zip(gel, outline, strict=True):
        turn.add(turn.follow(seen(axis)), by_gel, 0.001)
    return turn


def test_the_angle_counts_from_where_the_gel_stuck_and_its_error_is_that_of_two_readings():
    angles = np.linspace(0.0, 0.3, 31)
    turn = follow(angles, 0.7 + angles)  # the contact lies at 40° to x
    now = turn.follow(seen(0.7 + 0.5))  # off the line of those before, beyond their errors
    counted = turn.count(now)
    assert counted is not None
    angle, error = counted
    assert angle == pytest.approx(0.5)
    assert error == pytest.approx(np.hypot(0.01 * np.sqrt(2.0), 0.001))  # not averaged
    assert turn.count(NOWHERE) is None
    assert follow([np.nan] * 3, [0.7] * 3).count(seen(0.7)) is None
    turn.clear()
    assert turn.count(seen(0.7)) is None


def test_readings_of_a_light_touch_hardly_count():
    # the outline of the first contact is ten times less certain, and off by as much
    coarse = [seen(off, error=0.03) for off in (0.06, 0.04, 0.02, -0.02)]
    turn = OutlinedTurn(mature_age=8, memory=60, slip=np.radians(2.0), shape_change=0.3, gain=1.0)
    for axis in [*coarse, *(seen(0.0, error=0.003) for _ in range(3))]:
        turn.add(turn.follow(axis), 0.0, 0.0)
    counted = turn.count(turn.follow(seen(0.0, error=0.003)))
    assert counted is not None
    assert abs(counted[0]) < 0.003


def read_with_noise(true, draws):
    """Angles by the outline and by its last reading alone, after the gel has stuck for 24 frames.

    The outline follows the true angles with independent errors of 0.01 rad.
    """
    read = []
    for seed in range(draws):
        outline = true + 0.01 * np.random.default_rng(seed).normal(size=len(true))
        turn = follow([0.0] * 24 + [np.nan] * (len(true) - 25), outline[:-1])
        counted = turn.count(seen(outline[-1]))
        assert counted is not None
        read.append((counted[0], outline[-1]))
    return np.array(read).T


def test_in_macro_slip_several_readings_give_the_angle():
    true = np.concatenate([np.zeros(24), 0.01 * np.arange(12.0)])
    several, single = read_with_noise(true, draws=100)
    # a line through eight readings has 0.65 of one reading's error at its end, and the mean of 16
    # a quarter, but one line in twenty does not explain its readings
    assert np.std(several) < 0.8 * np.std(single)


def test_an_object_that_changes_its_rate_is_followed_at_once():
    true = np.concatenate([np.zeros(24), 0.05 * np.arange(8.0), 0.35 - 0.05 * np.arange(1.0, 4.0)])
    several, _ = read_with_noise(true, draws=20)
    assert abs(np.mean(several) - true[-1]) < 0.01  # the error of a reading; the line is 0.05 off


def test_one_or_two_readings_are_no_evidence():
    turn = follow([0.0] * 20 + [np.nan] * 8, [0.0] * 20 + [np.nan] * 8)
    for known in (False, False, True):
        axis = turn.follow(seen(0.1))
        assert (turn.count(axis) is not None) is known
        turn.add(axis, np.nan, np.nan)


@pytest.mark.parametrize("error_deg", [0.1, 2.0])
def test_gel_that_counts_on_from_a_wrong_reading_is_corrected_by_the_next(error_deg):
    error = np.radians(error_deg)
    turn = OutlinedTurn(8, 60, np.radians(2.0), 0.3, 1.0)
    for gel in [0.0] * 24 + [np.nan] * 3:
        turn.add(turn.follow(seen(0.0, error)), gel, 0.001)
    assert turn.lead(seen(0.1, error), 0.0) == 0.0  # the gel's angle is not from the outline
    turn.resume(seen(0.0, error))
    wrong = 2.0 * error  # of the angle from which the gel counts on
    angles = 0.001 * np.arange(1.0, 40.0)
    leads = [turn.lead(seen(angle, error), angle + wrong) for angle in angles]
    # the variance of the first reading over that of it, sixteen readings and 0.5° of lag
    share = 1.0 / (1.0 + 1.0 / 16.0 + (0.5 / error_deg) ** 2)
    assert leads[15] == pytest.approx(-wrong * share)
    assert leads[-1] == leads[15]  # later the gel is more exact
    turn.add(seen(0.0), np.nan, np.nan)  # until the gel is lost
    assert turn.lead(seen(0.1), 0.0) == 0.0


def test_it_overtakes_gel_that_lags_but_not_gel_that_leads():
    angles = np.radians(np.arange(20.0))
    slow = 0.5 * angles
    turn = follow(slow, angles)
    assert turn.overtakes(seen(np.radians(20.0)), np.radians(10.0))  # 5° apart over ten frames
    assert not turn.overtakes(seen(np.radians(20.0), np.radians(3.0)), np.radians(10.0))
    turn = follow(angles, slow)
    assert not turn.overtakes(seen(np.radians(10.0)), np.radians(20.0))


def test_the_object_may_be_as_far_ahead_as_the_outline_in_a_contacts_first_frames():
    angles = np.radians(-1.0 * np.arange(6.0))
    turn, now = follow(np.zeros(6), angles), np.radians(-6.0)
    error = np.radians(0.3)
    # since the median of the first three frames, and by an error of two readings
    expected = -5.0 - 1.96 * np.degrees(np.hypot(error, 0.01))
    assert np.degrees(turn.reach(seen(now, error), 0.0)) == pytest.approx(expected, abs=0.01)
    assert turn.reach(seen(now, np.radians(3.0)), 0.0) == 0.0  # the errors explain it
    assert turn.reach(NOWHERE, 0.0) == 0.0
    assert follow(angles, angles).reach(seen(now), now) == 0.0
    assert follow(angles, np.zeros(6)).reach(seen(0.0), now) == 0.0  # the gel leads
    later = follow(np.zeros(11), np.radians(-1.0 * np.arange(11.0)))
    assert later.reach(seen(np.radians(-11.0)), 0.0) == 0.0  # `overtakes` judges it
    assert later.overtakes(seen(np.radians(-11.0)), 0.0)


def test_gel_turns_along_within_a_degree():
    turn = follow(np.zeros(20), np.radians(np.arange(20.0)))
    now = seen(np.radians(20.0), np.radians(0.1))
    assert turn.turns_along(now, np.radians(8.5), 7)  # the outline has turned by 8°
    assert not turn.turns_along(now, np.radians(6.0), 7)
    assert not turn.turns_along(now, np.radians(20.0), 20)  # before the first reading


def test_a_coarse_outline_proves_only_turns_beyond_its_error():
    coarse = np.radians(1.5)  # of one reading; a turn is known to ±4.2° (two errors)
    for turned, proven in ((0.0, False), (8.0, True)):
        angles = np.radians(np.linspace(0.0, turned, 9))
        turn = OutlinedTurn(8, 60, np.radians(2.0), 0.3, 1.0)
        for angle in angles:
            turn.add(turn.follow(seen(angle, coarse)), np.nan, np.nan)
        now = turn.follow(seen(angles[-1], coarse))
        assert turn.turns_along(now, angles[-1], 8) is proven


def test_half_turns_and_other_faces_are_no_turn():
    turn = follow([0.0], [1.5])
    assert turn.follow(seen(-1.6)).angle == pytest.approx(np.pi - 1.6)
    other = seen(1.5)._replace(curvature=1.5)
    assert np.isnan(turn.follow(other).angle)
