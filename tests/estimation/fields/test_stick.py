import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.fields.measure import Fields
from estimation.fields.stick import grow_stick_region, normalized_difference
from estimation.frames.neighbours import grid_neighbours, list_neighbours

FLOOR = np.radians(0.5)
rotations = st.floats(-0.5, 0.5)


def test_equation_15_where_it_has_a_value():
    assert normalized_difference(0.2, 0.3, FLOOR) == pytest.approx(0.1 / np.sqrt(0.06))
    assert normalized_difference(-0.2, -0.3, FLOOR) == pytest.approx(0.1 / np.sqrt(0.06))


@pytest.mark.parametrize(("rotation", "mean"), [(0.0, 0.0), (0.0, 0.3), (0.2, -0.3), (-1e-9, 1e-9)])
def test_equation_15_where_it_has_none(rotation, mean):
    assert normalized_difference(rotation, mean, FLOOR) == abs(rotation - mean) / FLOOR


@given(rotations, rotations)
def test_equation_15_is_symmetric_and_continuous_across_the_floor(a, b):
    value = normalized_difference(a, b, FLOOR)
    assert value == normalized_difference(b, a, FLOOR) == normalized_difference(-a, -b, FLOOR)
    assert 0.0 <= value <= abs(a - b) / FLOOR


def fields_with(rotation, contact, centre):
    n = len(rotation)
    nothing = np.zeros((n, 3))
    return Fields(
        positions=nothing,
        displacement=nothing,
        indentation=np.zeros(n),
        normals=nothing,
        rotation=np.asarray(rotation, dtype=float),
        contact=np.asarray(contact),
        centre=centre,
    )


def test_growth_stops_at_slip_and_at_the_contact_edge():
    rotation = np.full((7, 7), 0.2)
    rotation[:, 5:] = 0.05  # slips
    contact = np.ones((7, 7), dtype=bool)
    contact[0] = False
    fields = fields_with(rotation.ravel(), contact.ravel(), 24)
    region = grow_stick_region(
        fields, list_neighbours(grid_neighbours((7, 7))), threshold=0.4, floor=FLOOR
    )
    expected = np.ones((7, 7), dtype=bool)
    expected[:, 5:] = False
    expected[0] = False
    assert (region.reshape(7, 7) == expected).all()


def test_growth_does_not_jump_a_gap_of_slip():
    rotation = np.array([0.2, 0.2, 0.0, 0.2, 0.2])
    fields = fields_with(rotation, np.ones(5, dtype=bool), 0)
    region = grow_stick_region(
        fields, list_neighbours(grid_neighbours((1, 5))), threshold=0.4, floor=FLOOR
    )
    assert region.tolist() == [True, True, False, False, False]


def test_the_mean_moves_with_every_marker_taken():
    # each step is within 20 % of its neighbour, the last ones are far from the first
    rotation = 0.1 * 1.2 ** np.arange(9)
    fields = fields_with(rotation, np.ones(9, dtype=bool), 0)
    region = grow_stick_region(
        fields, list_neighbours(grid_neighbours((1, 9))), threshold=0.4, floor=FLOOR
    )
    mean = rotation[0]
    for count in range(1, 9):
        if normalized_difference(rotation[count], mean, FLOOR) >= 0.4:
            break
        mean = rotation[: count + 1].mean()
    assert region.sum() == count
    assert 2 < count < 9


@given(st.integers(0, 10_000), st.floats(0.05, 0.8))
def test_numbering_of_the_markers_does_not_matter(seed, threshold):
    rng = np.random.default_rng(seed)
    rotation = 0.2 + 0.05 * rng.normal(size=64)
    contact = rng.random(64) < 0.9
    contact[27] = True
    neighbours = grid_neighbours((8, 8))
    region = grow_stick_region(
        fields_with(rotation, contact, 27),
        list_neighbours(neighbours),
        threshold=threshold,
        floor=FLOOR,
    )
    order = rng.permutation(64)
    place = np.argsort(order)
    renamed = np.where(neighbours[order] >= 0, place[neighbours[order]], -1)
    renamed = renamed[:, rng.permutation(4)]
    again = grow_stick_region(
        fields_with(rotation[order], contact[order], int(place[27])),
        list_neighbours(renamed),
        threshold=threshold,
        floor=FLOOR,
    )
    assert (again == region[order]).all()


@given(st.integers(0, 10_000))
def test_a_region_is_connected_and_has_no_neighbour_left_to_take(seed):
    rng = np.random.default_rng(seed)
    rotation = 0.2 + 0.04 * rng.normal(size=49)
    neighbours = grid_neighbours((7, 7))
    fields = fields_with(rotation, np.ones(49, dtype=bool), 24)
    region = grow_stick_region(fields, list_neighbours(neighbours), threshold=0.2, floor=FLOOR)
    assert region[24]
    mean = rotation[region].mean()
    around = {j for i in np.nonzero(region)[0] for j in neighbours[i] if j >= 0 and not region[j]}
    assert all(normalized_difference(rotation[j], mean, FLOOR) > 0.2 * (1 - 1e-9) for j in around)
