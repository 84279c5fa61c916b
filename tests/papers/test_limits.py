"""Cramér–Rao bounds of an object that turns back, against closed forms and least squares."""

import numpy as np
import pytest

from estimation.fields.profile import share_around
from papers.limits import angle_limit, contact_limit, turned_contact_limits, turned_limits

NOISE = 2e-3
INNER, OUTER = 1.0, 3.0
PAIRS = np.array([[INNER, 0.0], [-INNER, 0.0], [0.0, OUTER], [0.0, -OUTER]])
HELD = np.array([True, True, False, False])


def test_all_frames_since_the_turn_determine_the_angle():
    frames = 6
    held = np.tile(HELD, (frames, 1))
    limits = turned_limits(PAIRS, held, np.ones_like(held), NOISE)
    # each earlier frame compares the outer pair, whose place is unknown, with the inner one
    inner, outer = 2.0 * INNER**2, 2.0 * OUTER**2
    place = np.arange(1, frames) / (1.0 / inner + 1.0 / outer)
    information = inner + 1.0 / (1.0 / outer + 1.0 / place)
    np.testing.assert_allclose(limits[1:], NOISE / np.sqrt(information), rtol=1e-6)
    assert limits[0] == pytest.approx(angle_limit(PAIRS, HELD, NOISE))
    assert limits[-1] > angle_limit(PAIRS, np.ones(4, bool), NOISE)


def test_a_marker_that_slips_again_loses_its_place():
    frames = 6
    held, stick = np.tile(HELD, (frames, 1)), np.ones((frames, 4), bool)
    stick[3, 2:] = False  # the outer pair
    limits = turned_limits(PAIRS, held, stick, NOISE)
    whole = turned_limits(PAIRS, held, np.ones_like(held), NOISE)
    assert limits[3] == pytest.approx(angle_limit(PAIRS, HELD, NOISE))
    np.testing.assert_allclose(limits[3:], whole[:3], rtol=1e-6)


def test_without_markers_that_never_slipped_the_angle_is_unknown():
    held, stick = np.zeros((3, 4), bool), np.ones((3, 4), bool)
    assert np.isinf(turned_limits(PAIRS, held, stick, NOISE)).all()


def test_all_markers_of_a_contact_that_turns_back():
    points, thickness = np.random.default_rng(0).uniform(-4.0, 4.0, (40, 2)), 5.0
    radii = np.array([1.0, 3.0, 2.5, 2.0])
    limits = turned_contact_limits(points, radii, thickness, NOISE)
    assert limits[0] == pytest.approx(contact_limit(points, 1.0, thickness, NOISE))
    # in all frames together: displacements by the angle of each frame, the first of the turn
    distance = np.hypot(*points.T)
    moved = [
        distance * share_around(np.minimum(radius / distance, 1.0), radius / thickness).value
        for radius in radii
    ]
    design = np.zeros((4, 40, 4))
    for frame, now in enumerate(moved):
        design[frame, :, 0] = moved[0] - now
        design[frame, :, frame] += now
    for frame in range(4):
        seen = design[: frame + 1, :, : frame + 1].reshape(-1, frame + 1)
        variance = np.linalg.inv(seen.T @ seen)[-1, -1]
        assert limits[frame] == pytest.approx(NOISE * np.sqrt(variance))
