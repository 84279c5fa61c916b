"""Derivatives of a contact that sticks and slips, and at the corners."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Paraboloid,
    Pose,
    SquarePunch,
    analytic,
    make_path,
    solve_contact,
    solve_path,
)
from contactmodel.verify.rows import RADIUS, hertz_case, solve_hertz

GRID = Grid((32, 32), (10.0, 10.0))
NAMES = ("G_S", "ν_S", "G_B", "ν_B", "R", "δ", "s_x", "s_y", "θ", "μ", "c_x", "c_y")
VALUES = jnp.asarray([1.0, 0.45, 3.0, 0.3, 30.0, 0.3, 0.01, 0.02, 0.05, 0.5, 0.3, -0.2])


def solve(values, grid=GRID):
    g_s, nu_s, g_b, nu_b, radius, approach, s_x, s_y, twist, mu, c_x, c_y = values
    return solve_contact(
        Contact(HalfSpace(g_s, nu_s), HalfSpace(g_b, nu_b), Paraboloid(radius), grid, mu),
        Pose(approach, jnp.stack([s_x, s_y]), twist, jnp.stack([c_x, c_y])),
        rtol=1e-11,
    )


def moment(values):
    return solve(values).moment


GRADIENT = jax.jit(jax.grad(moment))
FORWARD = jax.jit(lambda values, tangent: jax.jvp(moment, (values,), (tangent,)))


def known_moment(values):
    """By the program of the forward mode: one less to compile."""
    return FORWARD(values, jnp.zeros_like(values))[0]


def central(function, values, i, step=1e-6):
    change = jnp.zeros_like(values).at[i].set(step * max(abs(float(values[i])), 0.01))
    return (function(values + change) - function(values - change)) / (2.0 * change[i])


def test_reverse_and_forward_mode_meet_central_differences():
    reverse = GRADIENT(VALUES)
    tangent = jax.random.normal(jax.random.key(2), VALUES.shape)
    _, forward = FORWARD(VALUES, tangent)
    assert float(forward) == pytest.approx(float(reverse @ tangent), rel=1e-8)  # rtol 1e-11
    for i, name in enumerate(NAMES):
        # the solver's 1e-11 over the step of 1e-6, and curvature
        difference = float(central(known_moment, VALUES, i))
        assert float(reverse[i]) == pytest.approx(difference, rel=1e-5, abs=1e-7), name


@pytest.mark.slow  # gradients with history are shown by `test_layer` as well
def test_any_output_along_a_path_with_a_reversal():
    """Marker displacement, dissipation and slip after a reversal, by one parameter each."""
    points = np.array([[0.4, -0.3], [3.0, 4.5]])

    @jax.jit
    def outputs(values):
        g, mu, radius, twist = values
        poses = [Pose(0.0), Pose(0.3), Pose(0.3, twist=twist), Pose(0.3, twist=-0.5 * twist)]
        path = make_path(poses, [1, 2, 2])
        bodies = HalfSpace(g, 0.45), HalfSpace(3.0, 0.3)
        contacts = solve_path(Contact(*bodies, Paraboloid(radius), GRID, mu), path, rtol=1e-11)
        last = contacts.at_step(-1)
        fields = (
            last.elastomer_displacement_at(points),
            last.dissipated_energy,
            last.slip[:, 12, 17],
        )
        return jnp.concatenate([jnp.ravel(field) for field in fields])

    values = jnp.asarray([1.0, 0.5, 30.0, 0.06])
    jacobian = jax.jit(jax.jacrev(outputs))(values)
    for i in range(len(values)):
        difference = central(outputs, values, i)
        scale = float(jnp.max(jnp.abs(difference)))
        np.testing.assert_allclose(jacobian[:, i], difference, atol=2e-5 * scale)  # as above


def test_batches_meet_single_solves():
    twists = jnp.asarray([0.0, 0.02, 0.05, 0.9])
    batch = jnp.tile(VALUES, (4, 1)).at[:, 8].set(twists)
    together = jax.jit(jax.vmap(jax.grad(moment)))(batch)
    for values, gradient in zip(batch, together, strict=True):
        np.testing.assert_allclose(gradient, GRADIENT(values), rtol=1e-6, atol=1e-9)  # rtol


@pytest.mark.parametrize(
    "changes",
    [
        {8: 0.0, 6: 0.0, 7: 0.0},  # no motion
        {9: 1e6},  # full stick
        {8: 0.9},  # full slip
        {9: 0.0},  # no friction
        {5: 0.0},  # first touch
        {5: -0.1},  # apart
        {1: 0.5, 3: 0.5},  # incompressible
        {10: 0.0, 11: 0.0},
    ],
    ids=str,
)
def test_gradients_at_the_corners_meet_differences(changes):
    """Along a direction that leads from the corner into what is allowed."""
    values = VALUES
    for i, value in changes.items():
        values = values.at[i].set(value)
    into = jnp.asarray([1.0, -0.3, 0.6, -0.2, 0.5, 0.7, 0.4, -0.3, 0.8, 0.9, -0.6, 0.2])
    into = into * jnp.maximum(jnp.abs(values), 0.01)
    step = 1e-5
    here, near, far = (known_moment(values + n * step * into) for n in range(3))
    difference = float(4.0 * near - 3.0 * here - far) / (2.0 * step)  # one-sided, second order
    gradient = GRADIENT(values)
    assert bool(jnp.all(jnp.isfinite(gradient)))
    # cells that change state within the step; the solver's 1e-11 over it
    assert float(gradient @ into) == pytest.approx(difference, rel=1e-3, abs=1e-5)


def test_edge_radius_has_a_derivative():
    @jax.jit
    @jax.value_and_grad  # one program for the differences as well
    def force(radius):
        bodies = HalfSpace(1.0, 0.4), HalfSpace(3.0, 0.3)
        pose = Pose(0.2, twist=0.01)
        punch = SquarePunch(4.0, radius)
        return solve_contact(Contact(*bodies, punch, GRID, 0.5), pose, rtol=1e-11).force[2]

    radius = jnp.asarray(1.3)
    difference = (force(radius + 1e-6)[0] - force(radius - 1e-6)[0]) / 2e-6
    assert float(force(radius)[1]) == pytest.approx(float(difference), rel=1e-5)
    assert np.isfinite(float(force(0.0 * radius)[1]))


def test_slope_of_the_moment_is_that_of_the_stick_region():
    """dM/dθ = (16/3) G* c³, at the order of the grid: a row of `verify`."""
    case = hertz_case()
    twist = analytic.lubkin_twist(0.7, case.friction_ratio)
    gradient = jax.jit(jax.grad(lambda t: solve_hertz(64, twist=t).moment))
    slope = gradient(twist)
    exact = 16.0 / 3.0 * case.shear_modulus * (0.7 * RADIUS) ** 3
    assert float(slope) == pytest.approx(exact, rel=2e-2)  # cells counted whole, 3 % of the radius
    full = gradient(1e3 * twist)
    assert abs(float(full)) < 1e-6 * exact  # nothing sticks
