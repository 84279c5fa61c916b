"""The curl of the slip counts what has slipped since the angle is counted, not what sticks now."""

import numpy as np
import pytest

from estimation.frames.noise import Noise
from estimation.slip.motion import (
    accumulate_slip,
    follow_gel,
    gel_ends,
    slip_curl,
    turned_since_counted,
)
from estimation.softness import ScalarSoftness
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import simulate_pivot

MICRON = Noise.from_std(1e-3)
# φ over 2 mm scatters by 0.5 mrad for 1 µm, the curl by twice that: four standard deviations.
STUCK = 4e-3


@pytest.fixture(scope="module")
def pivot():
    recording, truth = simulate_pivot(frames=(30, 5, 60), seed=0)
    return recording, truth, estimate_angles(recording, noise=MICRON)


def find_slip_curl(result, frame: int) -> np.ndarray:
    """rot(s) of all markers since the frame that the angle counts from."""
    softness = float(result.stiffness_ratio[frame]), float(result.load_term[frame])
    turned = turned_since_counted(result.take(slice(frame + 1)))[frame]
    return slip_curl(turned, result.contact[frame], float(result.angle[frame]), softness)


def always_stuck(recording, truth, frame: int) -> np.ndarray:
    """Markers that have never slipped and whose difference stencils reach none that has."""
    neighbours = recording.layout.neighbours
    stick = truth.stick[frame]
    return stick & np.where(neighbours >= 0, stick[neighbours], False).all(axis=1)


def test_after_a_reversal_what_has_always_stuck_shows_no_curl(pivot):
    recording, truth, result = pivot
    reversed_at = int(np.nanargmax(truth.angle))
    checked = 0
    for frame in range(reversed_at, len(recording)):
        stuck = always_stuck(recording, truth, frame)
        if stuck.sum() >= 3 and result.answered[frame]:
            assert np.abs(find_slip_curl(result, frame)[stuck]).max() < STUCK
            # the case that misleads: most of what sticks now has slipped before
            checked += result.stick[frame].sum() > 2 * truth.stick[frame].sum()
    assert checked


def test_softness_leaves_the_curl_of_what_sticks_at_zero(pivot):
    recording, truth, _ = pivot
    soft = ScalarSoftness(0.3, 0.02)
    result = estimate_angles(recording, noise=MICRON, softness=soft)
    frame = int(np.nanargmax(truth.angle))
    curl = find_slip_curl(result, frame)
    assert np.abs(curl[always_stuck(recording, truth, frame)]).max() < 1.3 * STUCK


def test_a_contact_first_seen_slipped_is_counted_from_there(pivot):
    recording, truth, _ = pivot
    start = int(np.flatnonzero(truth.macro_slip)[0]) + 2
    late = recording.head(start + 1)
    rows = slice(start, start + 1)
    one = type(recording)(
        layout=late.layout,
        positions=late.positions[rows],
        valid=late.valid[rows],
        time=late.time[rows],
        source_index=late.source_index[rows],
    )
    result = estimate_angles(one, "incremental", noise=MICRON)
    assert result.angle[0] == 0.0
    curl = find_slip_curl(result, 0)
    np.testing.assert_array_equal(curl[result.contact[0]], 0.0)
    assert np.isnan(curl[~result.contact[0]]).all()


def test_nothing_has_slipped_in_all_while_something_has_always_stuck(pivot):
    _, truth, result = pivot
    gel, slip = follow_gel(result), accumulate_slip(result)
    firm = np.flatnonzero(truth.stick.sum(axis=1) >= 10)
    assert (firm > int(np.nanargmax(truth.angle))).any()  # after the reversal too
    # twice the noise of φ, 0.03°, and what the stencils lose to the slip around a small core
    assert np.abs(gel[firm] - truth.angle[firm]).max() < np.radians(0.5)
    assert np.abs(slip[firm]).max() < np.radians(0.5)


def test_markers_that_have_always_stuck_show_no_slip_where_the_curl_reaches_beyond_them(pivot):
    _, truth, result = pivot
    held = truth.stick.sum(axis=1)
    few = np.flatnonzero((held >= 4) & (held <= 9) & result.answered)
    assert len(few) >= 5
    np.testing.assert_array_equal(accumulate_slip(result)[few], 0.0)
    ends = gel_ends(np.full(9, 0.1), np.ones(9, dtype=bool), 0.2)
    assert ends == (0.1, 0.2)


def test_softness_turns_the_object_further_than_its_gel(pivot):
    recording, truth, _ = pivot
    soft = ScalarSoftness(0.3, 0.02)
    result = estimate_angles(recording.head(30), noise=MICRON, softness=soft)
    firm = np.flatnonzero(truth.stick[:30].sum(axis=1) >= 10)
    np.testing.assert_allclose(accumulate_slip(result)[firm], 0.0, atol=np.radians(0.5))
    np.testing.assert_allclose(follow_gel(result)[firm], truth.angle[firm], atol=np.radians(0.5))


def test_the_larger_turn_of_the_gel_stands_where_the_object_is_lost(pivot):
    _, truth, result = pivot
    last = int(np.flatnonzero(truth.macro_slip)[-1])
    gel = follow_gel(result)
    assert np.isnan(result.angle[last])
    # it stands still where it held last
    held = gel[np.flatnonzero(result.answered)[-1]]
    assert gel[last] == pytest.approx(held, abs=np.radians(1.0))  # what the last core gave back
