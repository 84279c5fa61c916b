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
    # a print that turns by less in each group is late by its turn
    assert Z95 * stated[known].max() <= min(late, pace * GROUP) + 1e-3
    assert (stated[number % GROUP == 0] == 0.0).all()


def test_a_print_that_starts_and_stops_at_once_does_not_jump():
    angles = np.repeat([0.0, 0.1, 0.3, 0.2, 0.5], GROUP)  # each step in a picture coded by itself
    late = Lateness(ImprintSettings())
    follow(late, np.repeat(angles, 2), 0.0)
    start = np.concatenate([np.zeros(GROUP), 0.01 * np.arange(3 * GROUP)])
    stated, _ = follow(late, np.concatenate([start, np.full(2 * GROUP, start[-1])]), 0.0)
    assert stated[-GROUP:].max() < 1e-12


def test_a_video_without_quantizers_states_no_error():
    late = Lateness(ImprintSettings())
    assert not any(late.update(angle, SLOPE, 0.0) for angle in turn_and_rest(0.01))
