"""Punches that are pressed into a bonded layer."""

import numpy as np
import pytest

from contactmodel import Contact, Grid, Layer, Pose, Rigid, RoundPunch, solve_contact
from contactmodel.analytic import hertz_indentation, press_layer_punch

R = np.array([0.0, 0.4, 0.8, 1.0, 1.1, 1.5, 3.0, 6.0])


def press(thickness, flat, **how):
    (punch,) = press_layer_punch(R, thickness, np.array([flat]), **how)
    return punch.indentation


@pytest.mark.parametrize("thickness", [np.inf, 1e4])
def test_a_paraboloid_on_a_half_space_is_hertz(thickness):
    hertz = np.asarray(hertz_indentation(R, 1.0, 1.0, 1.0))
    # a layer lacks the half-space's motion far away, (1 − ν)/h of it
    np.testing.assert_allclose(press(thickness, 0.0), hertz / hertz[0], atol=1e-4)


def test_a_thin_compressible_layer_is_a_row_of_springs():
    # each spring is pressed by the face alone, and those beyond the edge are free
    near = R < 3.0  # 30 thicknesses
    indentation = press(0.1, 0.0, poisson_ratio=0.2)[near]
    # the edge's own shear reaches about a third of the thickness
    np.testing.assert_allclose(indentation, np.maximum(1.0 - R**2, 0.0)[near], atol=0.04)


def test_a_thin_incompressible_layer_bulges_around_the_contact():
    assert press(0.5, 0.0, poisson_ratio=0.5)[3:6].max() < 0.0
    assert press(np.inf, 0.0)[3:].min() > 0.0


def test_it_is_the_solver_s_indentation_of_a_rounded_punch():
    layer, size, cells = Layer(0.2, 0.48, 4.0), 12.0, 64
    contact = Contact(layer, Rigid(), RoundPunch(5.0, 3.0), Grid((cells, cells), (size, size)), 0.0)
    solution = solve_contact(contact, Pose(0.3))
    area = float((np.asarray(solution.pressure) > 0.0).sum()) * (size / cells) ** 2
    radius = np.sqrt(area / np.pi)
    x = np.asarray(solution.grid.x)
    line = -np.asarray(solution.elastomer_displacement())[2][:, cells // 2]
    distance = np.hypot(x, x[cells // 2]) / radius
    # the solver's rounding is an arc, the closed form's a parabola; a cell is 5 % of the radius
    (punch,) = press_layer_punch(distance, 4.0 / radius, np.array([2.0]) / radius)
    np.testing.assert_allclose(line / 0.3, punch.indentation, atol=0.02)


def test_the_sum_follows_the_face():
    for punch in press_layer_punch(R, 0.5, np.array([0.0, 0.5, 0.9])):
        assert punch.misfit < 0.01


@pytest.mark.parametrize(("thickness", "flat"), [(0.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (1.0, -0.1)])
def test_impossible_punches_are_rejected(thickness, flat):
    with pytest.raises(ValueError, match=r"thickness|flat parts"):
        press(thickness, flat)


def test_the_arm_is_that_of_known_pressures():
    ball, flat = press_layer_punch(R, np.inf, np.array([0.0, 0.98]), terms=40)
    assert ball.arm == pytest.approx(3.0 * np.pi / 16.0, rel=1e-6)  # Hertz
    assert flat.arm == pytest.approx(np.pi / 4.0, rel=0.03)  # Boussinesq's flat end
    (springs,) = press_layer_punch(R, 0.1, np.array([0.0]), poisson_ratio=0.2)
    assert springs.arm == pytest.approx(8.0 / 15.0, rel=0.02)  # p ~ 1 − r²
    np.testing.assert_allclose(ball.pressure(np.array([0.6, 1.2])), [0.8 * ball.series[0], 0.0])
