"""A disc that turns on a bonded layer."""

import numpy as np
import pytest

from contactmodel import Contact, Grid, Layer, Paraboloid, Pose, Rigid, make_path, solve_path
from contactmodel.analytic import (
    layer_torsion_curve,
    press_layer_punch,
    punch_displacement,
    torsion_curve,
    turn_layer_disc,
)

R = np.array([0.3, 1.0, 1.0 + 1e-9, 1.2, 2.0, 5.0])
ETA_3 = 0.9015426773696957  # Σ (−1)ⁿ⁺¹/n³


def test_a_thick_layer_is_a_half_space():
    disc = turn_layer_disc(R, 1e3)
    np.testing.assert_allclose(disc.displacement, punch_displacement(R, 1.0), atol=1e-9)


def test_the_moment_grows_with_the_cube_of_radius_over_thickness():
    # the first term of the kernel's series in kc; the next is of fifth order
    disc = turn_layer_disc(R, 10.0)
    first = ETA_3 / (3.0 * np.pi * 10.0**3)
    assert disc.moment - 1.0 == pytest.approx(first, rel=0.02)


def test_a_thin_layer_shears_under_the_disc_and_a_little_beyond():
    # simple shear up to the rim, moved outward by that of a strip, (2 ln 2/π) h
    h = 0.25
    rim = 1.0 + 2.0 * np.log(2.0) / np.pi * h
    shear = np.pi * rim**4 / (2.0 * h) / (16.0 / 3.0)
    assert turn_layer_disc(R, h).moment == pytest.approx(shear, rel=0.01)


@pytest.mark.parametrize("thickness", [0.25, 0.5, 2.0])
def test_gel_at_the_rim_turns_with_the_disc(thickness):
    # inside it does so by construction, outside by the solution alone
    displacement = turn_layer_disc(R, thickness).displacement
    assert displacement[2] == pytest.approx(1.0, abs=1e-4)
    assert np.all(np.diff(displacement[2:]) < 0.0)


def test_its_points_suffice():
    r = np.array([1.0, 1.02, 1.2, 2.0])
    few, many = (turn_layer_disc(r, 0.25, points).displacement for points in (64, 256))
    np.testing.assert_allclose(few, many, atol=1e-6)


@pytest.mark.parametrize("thickness", [0.0, -1.0, np.nan])
def test_a_layer_has_a_thickness(thickness):
    with pytest.raises(ValueError, match="thickness must be positive"):
        turn_layer_disc(R, thickness)


def press(thickness, flat):
    (punch,) = press_layer_punch(np.zeros(1), thickness, np.array([flat]))
    return punch.pressure


@pytest.mark.parametrize("flat", [0.0, 0.65])
def test_torsion_on_a_half_space_is_jaeger_s(flat):
    pressure = press(np.inf, flat)
    exact, curve = torsion_curve(pressure, 0.1), layer_torsion_curve(pressure, np.inf)
    for values, known in ((curve.twist, exact.twist), (curve.moment, exact.moment)):
        there = np.interp(-curve.stick_ratio, -exact.stick_ratio, known)
        np.testing.assert_allclose(values, there, atol=2e-4)  # the table of the exact curve


def test_torsion_on_a_thin_layer_slips_where_its_simple_shear_exceeds_friction():
    # each point is a spring: it holds up to μp = Gθr/h, so that θ = μp(c)h/(Gc)
    def pressure(r):
        return np.maximum(1.0 - r**2, 0.0)

    curve = layer_torsion_curve(pressure, 0.05, 0.3, nodes=60)
    c = curve.stick_ratio
    stiffness, limit = np.pi / 2.0 / 0.05, 2.0 * np.pi * (1.0 / 3.0 - 1.0 / 5.0)
    twist = pressure(c) * 0.05 / c * stiffness / limit
    # the layer is a twentieth of the radius thick, and gel at the edge is held from beyond it
    np.testing.assert_allclose(curve.twist[20:], twist[20:], rtol=0.1)


def test_it_is_the_torsion_that_the_solver_finds_on_a_layer():
    thickness, shear, friction, nu = 3.0, 0.2, 0.5, 0.4
    grid = Grid((48, 48), (9.0, 9.0))
    contact = Contact(Layer(shear, nu, thickness), Rigid(), Paraboloid(100.0), grid, friction)
    pressed = Pose(0.05)
    path = solve_path(
        contact, make_path([Pose(0.0), pressed, Pose(0.05, twist=np.radians(2.4))], [1, 8])
    )
    pressure, cell = np.asarray(path.pressure[0]), (9.0 / 48) ** 2
    radius = np.sqrt((pressure > 0.0).sum() * cell / np.pi)
    limit = friction * np.sum(pressure * np.hypot(*np.asarray(grid.points))) * cell
    h = thickness / radius
    (punch,) = press_layer_punch(np.zeros(1), h, np.zeros(1), poisson_ratio=nu)
    curve = layer_torsion_curve(punch.pressure, h)
    stiffness = 16.0 / 3.0 * shear * radius**3 * turn_layer_disc(R, h).moment
    twist = np.radians(0.3) * np.arange(1, 9)
    moment = limit * np.interp(twist * stiffness / limit, curve.twist, curve.moment)
    # cells are a fifteenth of the radius; pressing leaves radial tractions, which take friction up
    np.testing.assert_allclose(np.abs(np.asarray(path.moment)[1:]), moment, rtol=0.03)
