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
    counted = turn.count(turn.follow(seen(0.7 + 0.5)))
    assert counted is not None
    angle, error = counted
    assert angle == pytest.approx(0.5)
    assert error == pytest.approx(np.hypot(0.01 * np.sqrt(2.0), 0.001))  # not averaged
    assert turn.count(NOWHERE) is None
    assert follow([np.nan] * 3, [0.7] * 3).count(seen(0.7)) is None
    turn.clear()
    assert turn.count(seen(0.7)) is None


def test_it_overtakes_gel_that_lags_but_not_gel_that_leads():
    angles = np.radians(np.arange(20.0))
    slow = 0.5 * angles
    turn = follow(slow, angles)
    assert turn.overtakes(seen(np.radians(20.0)), np.radians(10.0))  # 5° apart over ten frames
    assert not turn.overtakes(seen(np.radians(20.0), np.radians(3.0)), np.radians(10.0))
    turn = follow(angles, slow)
    assert not turn.overtakes(seen(np.radians(10.0)), np.radians(20.0))


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
