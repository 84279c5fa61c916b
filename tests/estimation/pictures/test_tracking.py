"""Identities: kept through gaps and jumps, never swapped without a word."""

import numpy as np
import pytest

from estimation.pictures.dots.matching import match_dots
from estimation.pictures.dots.tracking import DotTracker
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.lattice import (
    continue_rows,
    find_rows,
    fit_lattice,
    index_lattice,
    make_reference,
)
from tests.estimation.pictures.scenes import GRID, PITCH, RADIUS, REST, picture, twisted

SIZE = (320, 240)


def shuffled(points, seed):
    order = np.random.default_rng(seed).permutation(len(points))
    return points[order], order


def reference_and_identity():
    """A reference from the dots at rest, and the true number of each of its points."""
    reference = make_reference(REST, SIZE)
    distance = np.linalg.norm(reference.position[:, None] - REST, axis=-1)
    assert distance.min(axis=1).max() < 1e-9
    return reference, distance.argmin(axis=1)


def test_lattice_coordinates_are_those_of_the_grid():
    lattice = index_lattice(REST)
    assert len(lattice.dot) == len(REST)
    index = lattice.coordinates - lattice.coordinates.min(axis=0)
    assert np.array_equal(index, GRID[lattice.dot] - GRID.min(axis=0))


def test_lattice_is_fitted_to_what_rests():
    points = twisted(20.0)
    lattice = index_lattice(points)
    fitted = fit_lattice(lattice, points)
    place = fitted.place(lattice.coordinates)
    # the twist is small, not zero, where dots still count as resting: 0.06 pitches
    assert np.abs(place - REST[lattice.dot]).max() < 0.06 * PITCH
    assert "starts loaded" in make_reference(points, SIZE).note


@pytest.mark.parametrize("degrees", [10.0, 30.0, -30.0])
def test_a_jump_keeps_every_identity(degrees):
    reference, identity = reference_and_identity()
    for angle in (0.0, degrees, -degrees):
        points, order = shuffled(twisted(angle), 3)
        match = match_dots(reference, points)
        assert (match >= 0).all()
        assert np.array_equal(order[match], identity)


def test_lock_is_regained_after_a_gap():
    reference, identity = reference_and_identity()
    tracker = DotTracker(reference)
    tracker.update(REST)
    match, flaw = tracker.update(np.zeros((0, 2)))
    assert (match == -1).all()
    assert "recognised" in flaw
    points, order = shuffled(twisted(25.0), 4)
    match, flaw = tracker.update(points)
    assert not flaw
    assert np.array_equal(order[match], identity)


def test_too_much_strain_is_told_without_a_frame_before_and_followed_with_one():
    reference, identity = reference_and_identity()
    alone, steady = DotTracker(reference), DotTracker(reference)
    points, order = shuffled(twisted(30.0, rigid=50.0), 6)  # beside it rows shear by a whole pitch
    assert alone.update(points)[1]
    for angle in np.arange(0.0, 30.0):
        match, flaw = steady.update(twisted(angle, rigid=50.0))
        assert not flaw
    match, flaw = steady.update(points)
    seen = match >= 0
    assert not flaw
    assert np.array_equal(order[match[seen]], identity[seen])


def test_a_last_frame_in_the_wrong_column_is_not_followed():
    """Three rows were taken for the next column, as after a fast slip."""
    reference, identity = reference_and_identity()
    tracker = DotTracker(reference)
    tracker.update(REST)
    row, column = GRID[identity].T
    wrong = (row < row.min() + 3) & (column > column.min() + 2)
    shifted = reference.position + np.array([PITCH, 0.0])
    lost = np.abs(shifted[:, None] - reference.position).max(axis=-1).min(axis=1) > 1.0
    shifted[lost] = np.nan
    tracker.last = np.where(wrong[:, None], shifted, reference.position)
    tracker.update(REST)
    match, flaw = tracker.update(REST)
    assert not flaw
    assert np.array_equal(match, identity)


def test_missing_and_extra_dots_harm_no_other():
    reference, identity = reference_and_identity()
    rng = np.random.default_rng(5)
    points = np.delete(twisted(15.0), [20, 50, 51], axis=0)
    true = np.delete(np.arange(len(REST)), [20, 50, 51])
    extra = rng.uniform([10, 10], [310, 230], (6, 2))
    points = np.concatenate([points, extra])
    number = np.concatenate([true, np.full(6, -1)])
    match = match_dots(reference, points)
    seen = match >= 0
    wrong = seen & (number[match] != identity) & (number[match] >= 0)
    assert not wrong.any()
    assert seen.sum() >= len(REST) - 6


def test_too_few_dots_are_refused():
    with pytest.raises(ValueError, match="at least 9"):
        make_reference(REST[:5], SIZE)


def test_rows_go_on_where_a_dot_is_not_detected():
    """Dots that the edge cuts or that noise hides are no print of an object."""
    reference, _ = reference_and_identity()
    place = reference.position.copy()
    hidden = np.linalg.norm(place - REST[40], axis=1).argmin()
    place[hidden] = np.nan
    missed = continue_rows(place, find_rows(reference))
    inside = ((missed > 0.0) & (missed < SIZE)).all(axis=1)
    beyond = np.abs(missed - [160.0, 120.0]) > [146.0, 100.0]
    away = np.linalg.norm(missed[inside & ~beyond.any(axis=1)] - REST[40], axis=1)
    assert len(away) == 4
    assert away.max() < 1e-6
    image = picture(REST, np.random.default_rng(0))
    seen = place[np.isfinite(place[:, 0])]
    near = reference.position[[hidden]]
    print_around = paint_out(image, seen, RADIUS).level(near, PITCH)
    bare = paint_out(image, seen, RADIUS, missed=missed).level(near, PITCH)
    assert print_around > 10.0
    assert bare < 2.0
