"""The error that a video's compression leaves in the angles of a print."""

import numpy as np
import pytest

from estimation.estimators.measurement import Z95
from estimation.pictures.imprint.lateness import Lateness
from estimation.pictures.imprint.settings import ImprintSettings

GROUP = 12  # pictures from one that is coded by itself to the next
STEP, SLOPE = 10.0, 60.0  # grey levels, and grey levels/rad
UNIT = (STEP - ImprintSettings().harmless) / SLOPE  # rad


def follow(lateness, true, dropped):
    """Stated errors and true ones of a print that lags by `dropped` units at most [rad]."""
    shown, stated, error = 0.0, [0.0], [0.0]
    lateness.begin()
    for i, angle in enumerate(true[1:], start=1):
        whole = i % GROUP == 0
        most = 0.0 if whole else dropped * UNIT
        shown = float(np.clip(shown, angle - most, angle + most))
        stated.append(lateness.update(shown, SLOPE, 0.0 if whole else STEP))
        error.append(shown - angle)
    return np.array(stated), np.array(error)


def turn_and_rest(pace):
    """A turn at an even pace, a rest, and the way back [rad]."""
    up = pace * np.arange(6 * GROUP)
    return np.concatenate([up, np.full(2 * GROUP, up[-1]), up[::-1]])


@pytest.mark.parametrize("dropped", [0.0, 0.03, 0.08])
@pytest.mark.parametrize("pace", [0.001, 0.01])
def test_jumps_tell_how_much_a_coder_drops(dropped, pace):
    settings = ImprintSettings()
    stated, error = follow(Lateness(settings), turn_and_rest(pace), dropped)
    number = np.arange(len(error))
    coded, resting = number % GROUP > 0, (number // GROUP >= 6) & (number // GROUP < 9)
    # until the first picture that is coded by itself, what coders mostly drop counts
    assert stated[1:GROUP] == pytest.approx(settings.dropped * UNIT)
    late, known = dropped * UNIT, number > 5 * GROUP
    turning = known & coded & ~resting
    assert (np.abs(error[turning]) <= Z95 * stated[turning] + 1e-4).all()
    assert Z95 * stated[known].max() <= max(late, Z95 * settings.dropped * UNIT) + 1e-9
    assert (stated[number % GROUP == 0] == 0.0).all()


@pytest.mark.parametrize("first", range(-2, 3))
def test_a_print_that_starts_and_stops_at_once_does_not_jump(first):
    at = 2 * GROUP * np.arange(1, 6)[:, None] + first + np.arange(3)  # turns of three frames
    turns = np.interp(np.arange(12 * GROUP), at.ravel(), 0.1 * np.arange(1, 16))
    settings = ImprintSettings()
    stated, _ = follow(Lateness(settings), turns, 0.0)
    assert stated.max() == pytest.approx(settings.dropped * UNIT)


def test_a_video_without_quantizers_states_no_error():
    late = Lateness(ImprintSettings())
    assert not any(late.update(angle, SLOPE, 0.0) for angle in turn_and_rest(0.01))
