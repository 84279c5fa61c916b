"""Slip that only many frames show."""

import numpy as np
import pytest

from estimation.frames.recording import layout_markers
from estimation.slip.slide import RECENT_FRAMES, SlideWatch
from estimation.slip.slow import SlowSlipWatch

REST = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).reshape(-1, 2)
MIDDLE = np.array([4.0, 4.0])
TOUCHED = np.linalg.norm(REST - MIDDLE, axis=1) < 3.5


def watch(places, rate=120.0):
    """Slow slip in each frame while the object goes along x over gel at rest [mm]."""
    slide, slow = SlideWatch(layout_markers(REST)), SlowSlipWatch()
    found = []
    for i, place in enumerate(places):
        point = (*MIDDLE, MIDDLE[0] + place, MIDDLE[1], 1e-4, 1e-4, 0.0)
        found.append(slow.update(slide.update(REST, TOUCHED, (0.0, 1e-4), point, i / rate)))
    return found


def slides(found):
    return [i for i, one in enumerate(found) if one is not None and one.slides]


@pytest.mark.parametrize("rate", [0.0015, 0.0022])
def test_a_slip_that_sixteen_frames_do_not_show_is_found_in_sixty_four(rate):
    assert rate * RECENT_FRAMES < 0.04
    found = watch(rate * np.arange(90.0))
    first = slides(found)[0]
    assert SlideWatch.slow_frames // 2 <= first < SlideWatch.slow_frames
    assert slides(found) == list(range(first, 90))
    assert found[-1].strayed[TOUCHED].all()


def test_slow_cameras_do_not_sum_up_the_drift_of_a_print():
    assert not slides(watch(0.002 * np.arange(150.0), rate=30.0))


def test_a_slow_slip_is_over_some_frames_after_it_ends():
    found = watch(np.minimum(0.002 * np.arange(120.0), 0.16))
    assert 80 <= slides(found)[-1] < 86
    assert all(one is None for one in found[90:])


def test_a_fast_slip_is_over_as_soon_as_without_the_long_span():
    path = np.concatenate([np.zeros(50), 0.2 * np.arange(1.0, 6.0), np.full(100, 1.0)])
    assert slides(watch(path))[-1] < 59


def test_a_rest_shows_no_slow_slip():
    noise = np.random.default_rng(3).normal(0.0, 0.003, 200)
    assert not slides(watch(np.cumsum(noise) * 0.1 + noise))
