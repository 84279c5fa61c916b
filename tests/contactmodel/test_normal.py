"""Contacts without friction: fewer steps on large grids, and derivatives of their own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact
from contactmodel.elasticity.compliance import pair_compliance
from contactmodel.solver.normal import guess_pressure, solve_pressure

BALL = Paraboloid(30.0)
BODY = HalfSpace(1.0, 0.5)


def test_a_coarse_grid_saves_steps_and_changes_nothing():
    grid = Grid((256, 256), (10.0, 10.0))
    compliance = pair_compliance(BODY, Rigid(), grid, smooth=True)
    gap = BALL.height(jnp.asarray(grid.points)) - 0.3
    start, rough = guess_pressure(compliance, gap)
    how = {"rtol": 1e-8, "max_steps": 100}
    near, few = solve_pressure(compliance, gap, start=start, **how)
    far, many = solve_pressure(compliance, gap, start=jnp.zeros_like(gap), **how)
    assert int(few.steps) < 0.8 * int(many.steps)
    assert int(rough.steps + few.steps) <= 25
    np.testing.assert_allclose(near, far, atol=1e-5)  # the tolerance, by the stiffness of a cell


def test_stiffness_without_friction_is_that_of_hertz():
    grid = Grid((48, 48), (10.0, 10.0))

    def force(approach):
        return -solve_contact(Contact(BODY, Rigid(), BALL, grid, 0.0), Pose(approach)).force[2]

    slope = float(jax.grad(force)(0.3))
    difference = float(force(0.3 + 1e-6) - force(0.3 - 1e-6)) / 2e-6
    assert slope == pytest.approx(difference, rel=1e-5)  # 1e-8 of the solver over the step
    assert slope == pytest.approx(2.0 * 4.0 * 3.0, rel=2e-2)  # 2E*a; the rim moves by whole cells
