import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactmodel.equations import (
    clockwise_object_angle,
    line_element_rotations,
    mean_line_rotation,
    object_rotation,
    polar_rotation,
    slip_curl_difference,
    small_rotation,
)

angles = st.floats(-1.2, 1.2)
stretches = st.floats(0.7, 1.4)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@given(angles)
def test_a_rotation_of_any_size_is_read_exactly(angle):
    f = rotation(angle)
    # rounding of sine and cosine only
    assert mean_line_rotation(f) == pytest.approx(angle, abs=1e-15)
    assert polar_rotation(f) == pytest.approx(angle, abs=1e-15)
    assert small_rotation(f - np.eye(2)) == pytest.approx(np.sin(angle), abs=1e-15)


@given(angles, stretches, stretches, angles)
def test_polar_rotation_ignores_the_stretch(angle, a, b, axis):
    stretch = rotation(axis) @ np.diag([a, b]) @ rotation(-axis)
    assert polar_rotation(rotation(angle) @ stretch) == pytest.approx(angle, abs=1e-14)


@given(angles, stretches, stretches)
def test_mean_over_all_pairs_of_lines_is_the_polar_rotation(angle, a, b):
    directions = np.linspace(0.0, np.pi / 2, 64, endpoint=False)
    f = rotation(angle) @ np.diag([a, b])
    pairs = np.array([rotation(-d) @ f @ rotation(d) for d in directions])
    # the mean over a period of a smooth function converges exponentially
    assert mean_line_rotation(pairs).mean() == pytest.approx(angle, abs=1e-9)
    # and single pairs do differ, which is why both are offered
    if abs(a - b) > 0.1:
        assert np.ptp(mean_line_rotation(pairs)) > 1e-4


def test_line_elements_turn_as_their_shear_says():
    along_x, along_y = line_element_rotations(np.array([[1.0, 0.3], [0.0, 1.0]]))
    assert along_x == 0.0
    assert along_y == pytest.approx(-np.arctan(0.3), abs=1e-15)


def test_jax_in_jax_out():
    f = jnp.array(rotation(0.3))
    assert isinstance(polar_rotation(f), type(f))
    assert isinstance(mean_line_rotation(f), type(f))


def test_equation_13_and_its_signs():
    assert clockwise_object_angle(0.2) == -0.2  # Eq. (14)
    assert clockwise_object_angle(0.2, 0.5, 0.1) == pytest.approx(-0.3 + 0.05)
    assert object_rotation(0.2, 0.5, 0.1) == pytest.approx(0.3 - 0.05)


def test_equation_11():
    # a marker that turned 0.1 less than one that sticks: the object's face went on without it
    assert slip_curl_difference(np.array(0.2), 0.3, 0.5) == pytest.approx(2 * 1.5 * 0.1)
