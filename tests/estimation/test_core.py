"""The stick core, finer than the markers."""

import numpy as np
import pytest

from estimation.core import CoreTracker, disc_motion
from estimation.fields import measure_fields
from estimation.stencils import make_stencils
from estimation.virtual.recording import PivotModel, simulate_pivot

POINTS = np.array([0.3 + 0.2j, -0.6j, 1.7 - 0.4j, 30.0 + 40.0j])
DISC = np.array([0.01, -0.02, 0.05, 0.1, -0.2, 1.3, 0.0])


def test_a_disc_turns_what_is_on_it_and_little_far_away():
    turning = np.where(np.arange(7) < 2, 0.0, DISC)
    motion, _ = disc_motion(turning, POINTS)
    arm = POINTS - (0.1 - 0.2j)
    np.testing.assert_allclose(motion[:2], 0.05j * arm[:2], rtol=1e-12)
    far = 4.0 / (3.0 * np.pi) * (1.3 / abs(arm[3])) ** 3  # first term of Reissner and Sagoci's
    np.testing.assert_allclose(motion[3], 0.05j * far * arm[3], rtol=1e-3)  # the next, (c/r)²


def test_derivatives_meet_central_differences():
    parameters = DISC + np.array([0, 0, 0, 0, 0, 0, 0.3])
    _, slope = disc_motion(parameters, POINTS)
    for i in range(7):
        step = 1e-6 * (np.arange(7) == i)
        ends = (disc_motion(parameters + sign * step, POINTS)[0] for sign in (1, -1))
        difference = np.subtract(*ends) / 2e-6
        np.testing.assert_allclose(slope[:, i], difference, atol=1e-8)  # rounding by the step


@pytest.fixture(scope="module")
def followed():
    """Frames around the beginning of macro slip: frames after it, true and fitted radius, turns."""
    recording, truth = simulate_pivot(PivotModel(friction_ratio=0.17), seed=3)
    stencils = make_stencils(recording.layout)
    begin = int(np.argmax(truth.macro_slip))
    tracker = CoreTracker(stencils, 1e-3)
    rows = []
    for i, frame in enumerate(recording):
        if not begin - 30 <= i < begin + 4:
            continue
        core = tracker.update(measure_fields(stencils, frame), truth.sticking[min(i, begin - 1)])
        if core is not None:
            turned = truth.angle[i] - truth.angle[i - 12]
            known = truth.sticking[i].sum(), core.markers.sum()
            rows.append((truth.stick_radius[i], core.radius, core.turn / turned, *known))
    return np.array(rows)


def test_its_radius_turn_and_markers_are_found(followed):
    true, found, turn, sticking, counted = followed.T
    assert len(followed) > 12
    assert true.min() < 1.0  # a third of it in a cell of the markers: they cannot tell themselves
    assert np.abs(found - true).max() < 0.2  # a fifth of the pitch; 0.06 rms over many pivots
    np.testing.assert_allclose(turn, 1.0, atol=0.06)  # least where three markers are left
    assert np.median(np.abs(counted - sticking)) <= 1


def test_an_object_at_rest_tells_nothing():
    recording, truth = simulate_pivot(angles_deg=(0.0, 12.0, 12.0), frames=(40, 20), seed=1)
    stencils = make_stencils(recording.layout)
    tracker = CoreTracker(stencils, 1e-3)
    still = np.nonzero(truth.angle >= np.radians(12.0) - 1e-9)[0][-15:]
    answers = [
        tracker.update(measure_fields(stencils, frame), truth.sticking[i])
        for i, frame in enumerate(recording)
        if i in still
    ]
    assert len(answers) == 15
    assert all(answer is None for answer in answers)
