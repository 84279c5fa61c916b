import numpy as np
import pytest

from estimation.choices import AlertSettings
from estimation.estimators.result import MOVES_ON, RESTS_OR_SLIDES, TOO_FEW_STICK, State
from estimation.slip.alert import Alert, AlertLevel, AlertWatch
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin

RATE = 0.2  # rad/s


NOTHING = (Margin(), Friction(), np.nan)


def update(watch, time, state, angle, margin, friction, slipped):
    watch.add(time, state, angle, friction.used)
    return watch.predict(state, "", margin, friction, slipped)


def turn(limit, frames, way=1.0):
    """Alerts to an object that turns steadily, with a margin known to 10 %."""
    watch, alerts = AlertWatch(), []
    for time in (np.arange(frames) / 25.0).tolist():
        left = limit - RATE * time
        margin = Margin(left, 0.9 * left, 1.1 * left)
        angle = float(way * RATE * time)
        alerts.append(update(watch, time, State.STICK, angle, margin, Friction(), np.nan))
    return alerts


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_time_to_slip_is_what_is_left_over_the_rate(way):
    alert = turn(0.5, 30, way)[-1]
    true = 0.5 / RATE - 29 / 25.0
    assert alert.time_to_slip == pytest.approx(true, rel=1e-6)
    assert (alert.low, alert.high) == pytest.approx((0.9 * true, 1.1 * true), rel=1e-6)


def test_levels_rise_as_the_slip_comes_nearer():
    levels = [alert.level for alert in turn(0.6, 70)]
    settings = AlertSettings()
    watch = levels.index(AlertLevel.WATCH)
    act = levels.index(AlertLevel.ACT)
    assert set(levels[:watch]) == {AlertLevel.NONE}
    assert set(levels[act:]) == {AlertLevel.ACT}
    assert 0.6 / RATE - watch / 25.0 == pytest.approx(settings.watch_s, abs=0.05)
    assert 0.6 / RATE - act / 25.0 == pytest.approx(settings.act_s, abs=0.05)


def test_shear_towards_a_known_friction_is_foreseen():
    watch, alert = AlertWatch(), Alert()
    for time in (np.arange(20) / 25.0).tolist():
        friction = Friction(0.2 * time, 0.4, 0.36, 0.44)
        alert = update(watch, time, State.STICK, np.nan, Margin(), friction, np.nan)
    assert alert.time_to_slip == pytest.approx(0.4 / 0.2 - 19 / 25.0, rel=1e-6)
    assert alert.high == np.inf  # a load levels off


@pytest.mark.parametrize("seconds", [0.4, 1.0])
def test_time_holds_for_a_load_that_has_just_begun_to_rise(seconds):
    # Cattaneo-Mindlin: an object moves steadily from rest, and slips when its shear reaches µP
    watch, friction, rested = AlertWatch(), 0.4, 0.5
    answered = 0
    for time in np.arange(0.0, rested + seconds, 0.04).tolist():
        moved = max(time - rested, 0.0) / seconds
        used = friction * (1.0 - (1.0 - moved) ** 1.5)
        known = Friction(used, friction, 0.9 * friction, 1.1 * friction)
        alert = update(watch, time, State.STICK, np.nan, Margin(), known, np.nan)
        if np.isfinite(alert.time_to_slip):
            answered += 1
            assert alert.low < rested + seconds - time < alert.high
    assert answered > 0.8 * seconds / 0.04 - 2


def test_at_rest_no_slip_is_foreseen():
    watch, alert, rng = AlertWatch(), Alert(), np.random.default_rng(0)
    for time in (np.arange(30) / 25.0).tolist():
        angle = 0.3 + 1e-4 * rng.standard_normal()
        friction = Friction(0.2, 0.4, 0.36, 0.44)
        margin = Margin(0.5, 0.4, 0.6)
        alert = update(watch, time, State.STICK, angle, margin, friction, np.nan)
    assert np.isnan(alert.time_to_slip)
    assert alert.level == AlertLevel.NONE


def test_word_follows_state_share_and_print():
    watch = AlertWatch()

    def level(state, *known):
        return update(watch, 0.1, state, np.nan, *known).level

    assert level(State.NO_CONTACT, *NOTHING) == AlertLevel.UNKNOWN
    assert level(State.STICK, *NOTHING) == AlertLevel.NONE
    assert level(State.INCIPIENT, *NOTHING) == AlertLevel.WATCH
    assert level(State.MACRO_SLIP, *NOTHING) == AlertLevel.SLIPS
    near = Friction(0.38, 0.4, 0.36, 0.44)
    assert level(State.STICK, Margin(), near, np.nan) == AlertLevel.ACT
    assert level(State.STICK, Margin(), Friction(), 0.4) == AlertLevel.ACT


def test_gripper_acts_where_the_object_may_slip():
    levels = [
        AlertWatch().predict(State.UNKNOWN, reason, *NOTHING).level
        for reason in (MOVES_ON, RESTS_OR_SLIDES, TOO_FEW_STICK)
    ]
    assert levels == [AlertLevel.ACT, AlertLevel.ACT, AlertLevel.UNKNOWN]


@pytest.mark.parametrize("wrong", [{"act_s": -1.0}, {"rate_frames": 3}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))} is"):
        AlertSettings(**wrong)
