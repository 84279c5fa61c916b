"""The rotation of gel around a face that turns and slips."""

import numpy as np
import pytest

from contactmodel.analytic import hertz_density, lubkin_twist, torsion_displacement
from estimation.fields import torsion
from estimation.fields.torsion import TurningFace, prepare_faces

HERTZ_SCALE = np.pi**2 / 4.0 / (16.0 / 3.0)
"""Limit π²/4 over stiffness 16/3 of a Hertz contact, both over μp0/2G* = 1 and a = 1 [rad]."""


@pytest.mark.parametrize("stick_ratio", [0.9, 0.6, 0.3])
def test_hertz_on_a_half_space_meets_the_closed_form(stick_ratio):
    distance = np.linspace(0.05, 1.45, 60)
    density = hertz_density(1.0, 1.0)
    exact = [float(torsion_displacement(r, density, stick_ratio, 1.0)) / r for r in distance]
    twist = float(lubkin_twist(stick_ratio, 1.0))
    face = TurningFace(0.0, 0.0)
    turned = face.turn(twist / HERTZ_SCALE, distance)
    assert face.stick_ratio(twist / HERTZ_SCALE) == pytest.approx(stick_ratio, abs=2e-3)
    # the table is linear between its points, also across the edge of the disc that sticks
    assert turned.value * HERTZ_SCALE == pytest.approx(exact, abs=7e-3 * twist)


@pytest.mark.parametrize("twist", [0.1, 0.5, 1.5])
def test_derivatives_meet_differences(twist):
    distance, step = np.linspace(0.05, 1.4, 30), 1e-4
    at = TurningFace(0.41, 0.55).turn(twist, distance)
    further = [
        (TurningFace(0.41, 0.55).turn(twist + step, distance), at.share),
        (TurningFace(0.41 + step, 0.55).turn(twist, distance), at.by_thinness),
        (TurningFace(0.41, 0.55 + step).turn(twist, distance), at.by_flat),
    ]
    for moved, slope in further:
        difference = (moved.value - at.value) / step
        # the value is linear between the table's twists, the derivative is that of the solution
        assert np.abs(difference - slope).max() < 0.2 * np.abs(difference).max() + 0.01


def test_what_sticks_turns_with_the_face_and_gel_far_away_rests():
    turned = TurningFace(0.3, 0.6).turn(0.8, np.array([0.0, 0.3, 2.9]))
    assert turned.value[:2] == pytest.approx(0.8, rel=1e-6)
    assert 0.0 < turned.value[2] < 0.05
    assert turned.share[0] == pytest.approx(1.0)


def test_prepared_faces_are_solved_once():
    prepare_faces()
    solved = torsion._solve.cache_info().misses
    TurningFace(0.1, 0.9)
    prepare_faces()
    assert torsion._solve.cache_info().misses == solved == 42
