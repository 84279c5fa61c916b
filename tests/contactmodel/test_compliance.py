"""Cell coefficients against quadrature, their own derivatives and the point loads."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import dblquad

from contactmodel import Grid, HalfSpace, Rigid
from contactmodel.elasticity.cells import cell_integrals
from contactmodel.elasticity.compliance import (
    convolve,
    grid_coefficients,
    pair_compliance,
    transform,
)

SPACING = (0.7, 0.4)
KERNELS = {
    "xx": lambda x, y, r: x * x / r**3,
    "yy": lambda x, y, r: y * y / r**3,
    "xy": lambda x, y, r: x * y / r**3,
    "x": lambda x, y, r: x / r**2,
    "y": lambda x, y, r: y / r**2,
    "turn_x": lambda x, y, r: y / r**3,
    "turn_y": lambda x, y, r: -x / r**3,
}


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("point", [(0.9, -0.7), (-1.3, 0.1), (0.0, 2.0)])
def test_integrals_meet_quadrature(name, point):
    x, y = (np.asarray(value) for value in point)
    value = getattr(cell_integrals(x, y, SPACING), name)
    a, b = 0.5 * SPACING[0], 0.5 * SPACING[1]

    def kernel(t, s):
        return KERNELS[name](x - s, y - t, np.hypot(x - s, y - t))

    exact, _ = dblquad(kernel, -a, a, -b, b, epsabs=1e-12)
    assert value == pytest.approx(exact, abs=1e-10)  # the quadrature's tolerance


BELOW = {
    "xx": lambda x, y, z, r: x * x / r**3,
    "xy": lambda x, y, z, r: x * y / r**3,
    "zz": lambda x, y, z, r: z * z / r**3,
    "yz": lambda x, y, z, r: y * z / r**3,
    "x": lambda x, y, z, r: x / (r * (r + z)),
    "flat_yy": lambda x, y, z, r: 1.0 / (r + z) - y * y / (r * (r + z) ** 2),
    "flat_xy": lambda x, y, z, r: -x * y / (r * (r + z) ** 2),
    "turn_x": lambda x, y, z, r: y / r**3,
}


@pytest.mark.parametrize("name", BELOW)
@pytest.mark.parametrize("point", [(0.0, 0.0, 0.3), (0.9, -0.7, 0.2), (0.35, 0.2, 0.5)])
def test_integrals_below_the_surface_meet_quadrature(name, point):
    x, y, z = (np.asarray(value) for value in point)
    value = getattr(cell_integrals(x, y, SPACING, z), name)
    a, b = 0.5 * SPACING[0], 0.5 * SPACING[1]

    def kernel(t, s):
        return BELOW[name](x - s, y - t, z, np.sqrt((x - s) ** 2 + (y - t) ** 2 + z**2))

    exact, _ = dblquad(kernel, -a, a, -b, b, epsabs=1e-12)
    assert value == pytest.approx(exact, abs=1e-10)  # the quadrature's tolerance


@pytest.mark.parametrize("point", [(0.35, 0.1), (0.35, 0.2), (-0.35, -0.2), (0.0, 0.2)])
def test_integrals_are_finite_and_continuous_on_the_rim(point):
    here = cell_integrals(*map(np.asarray, point), SPACING)
    near = cell_integrals(np.asarray(point[0] + 1e-9), np.asarray(point[1] - 1e-9), SPACING)
    for name in ("xx", "yy", "xy", "x", "y"):
        # 1e-9 away, the logarithm's slope is about 20
        assert getattr(here, name) == pytest.approx(getattr(near, name), abs=1e-7)


def test_centre_of_a_square_cell():
    cell = cell_integrals(jnp.asarray(0.0), jnp.asarray(0.0), (1.0, 1.0))
    exact = 4.0 * np.log(1.0 + np.sqrt(2.0))  # ∬1/r over the unit square
    assert float(cell.xx + cell.yy) == pytest.approx(exact, rel=1e-14)


def test_rotation_coefficient_is_half_the_curl_of_the_displacement():
    body = HalfSpace(1.3, 0.37)

    def field(point, tau):
        c = body.coefficients(cell_integrals(point[0], point[1], SPACING), SPACING)
        return jnp.stack([c.xx * tau[0] + c.xy * tau[1], c.xy * tau[0] + c.yy * tau[1]])

    for point in ([0.05, 0.1], [1.0, -0.6], [-3.0, 0.9]):
        point = jnp.asarray(point)
        c = body.coefficients(cell_integrals(point[0], point[1], SPACING), SPACING)
        for tau, turn in (([1.0, 0.0], c.turn_x), ([0.0, 1.0], c.turn_y)):
            gradient = jax.jacfwd(field)(point, jnp.asarray(tau))
            half_curl = 0.5 * (gradient[1, 0] - gradient[0, 1])
            assert float(turn) == pytest.approx(float(half_curl), rel=1e-11)  # rounding


def test_convolution_is_the_direct_sum_without_images():
    grid = Grid((6, 9), (3.0, 2.0))
    body = HalfSpace(0.8, 0.4)
    field = jax.random.normal(jax.random.key(1), grid.shape)
    fast = convolve(transform(grid_coefficients(body, grid).xz, "xz"), field)
    points = grid.points.reshape(2, -1)
    x, y = points[:, :, None] - points[:, None, :]
    cell = cell_integrals(jnp.asarray(x), jnp.asarray(y), grid.spacing)
    matrix = body.coefficients(cell, grid.spacing).xz
    direct = (matrix @ field.reshape(-1)).reshape(grid.shape)
    np.testing.assert_allclose(fast, direct, atol=1e-13)  # rounding


def test_far_away_a_cell_is_a_point_load():
    nu, modulus = 0.3, 2.0
    c = HalfSpace(modulus, nu).coefficients(
        cell_integrals(jnp.asarray(30.0), jnp.asarray(40.0), SPACING), SPACING
    )
    unit = SPACING[0] * SPACING[1] / (2.0 * np.pi * modulus * 50.0)
    # the next term of the expansion is (d/r)²/24 ≈ 1e-5
    assert float(c.zz) == pytest.approx((1 - nu) * unit, rel=2e-5)
    assert float(c.xx) == pytest.approx((1 - nu + nu * 0.36) * unit, rel=2e-5)
    assert float(c.xy) == pytest.approx(nu * 0.48 * unit, rel=2e-4)


def test_preconditioner_is_positive_and_near_the_inverse():
    grid = Grid((32, 24), (4.0, 3.0))
    pair = pair_compliance(HalfSpace(1.0, 0.5), Rigid(), grid)
    xx, yy, xy = pair.shear
    assert float(jnp.min(pair.normal)) > 0
    assert float(jnp.min(xx * yy - xy**2)) > 0
    field = jnp.zeros(grid.shape).at[16, 12].set(1.0)
    back = pair.inverse().press(pair.press(field))
    assert float(jnp.max(jnp.abs(back - field))) < 0.1  # what cutting at the grid's edge costs


def test_rows_at_a_time_are_the_convolution():
    grid = Grid((6, 300), (1.0, 50.0))
    pair = pair_compliance(HalfSpace(1.0, 0.3), Rigid(), grid)
    field = jax.random.normal(jax.random.key(2), grid.shape)
    whole = convolve(pair.normal, field)
    np.testing.assert_allclose(pair.press(field), whole, atol=1e-12)  # rounding
    both = convolve(1j * pair.coupling, jnp.stack([field, field]))
    np.testing.assert_allclose(pair.pull(field), both, atol=1e-12)
