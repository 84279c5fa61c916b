"""Dissimilar bodies: pressing makes them slip, and friction lifts them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    RESULTS,
    Contact,
    Grid,
    HalfSpace,
    Layer,
    Paraboloid,
    Pose,
    Rigid,
    make_path,
    solve_contact,
    solve_path,
)

GRID = Grid((32, 32), (10.0, 10.0))
BALL = Paraboloid(30.0)
SOFT, HARD, STEEL = HalfSpace(1.0, 0.3), HalfSpace(2.0, 0.45), Rigid()
REST = Pose(0.0, linear=True)
PRESSED = Pose(0.3, linear=True)
TURNED = Pose(0.3, (0.03, 0.0), 0.04, linear=True)


def test_pressing_alone_causes_radial_slip():
    solution = solve_contact(Contact(SOFT, STEEL, BALL, GRID, 0.2), PRESSED)
    x, y = GRID.points
    ring = np.asarray(solution.sliding)
    assert 0.02 < float(solution.stick_ratio) < 0.5
    along = (x * solution.slip[0] + y * solution.slip[1])[ring]
    across = (x * solution.slip[1] - y * solution.slip[0])[ring]
    # the elastomer is drawn inwards under the object, which then moves outwards against it
    assert np.all(along > 0)
    assert np.abs(across).max() < 0.1 * along.max()  # a square grid of 32
    assert abs(float(solution.moment)) < 1e-12
    alike = solve_contact(Contact(HalfSpace(1.0, 0.5), STEEL, BALL, GRID, 0.2), PRESSED)
    assert not np.any(alike.slip)


def test_friction_stiffens_the_pressing():
    """A glued contact is stiffer than a smooth one, by some 3 % at ν = 0.3."""
    glued, smooth = (
        solve_contact(Contact(SOFT, STEEL, BALL, GRID, mu), PRESSED) for mu in (2.0, 0.0)
    )
    assert 1.01 < float(glued.force[2] / smooth.force[2]) < 1.08


def test_turning_while_pressing_differs_from_pressing_first():
    first = solve_path(
        Contact(SOFT, STEEL, BALL, GRID, 0.2), make_path([REST, PRESSED, TURNED], [4, 4])
    )
    together = solve_path(Contact(SOFT, STEEL, BALL, GRID, 0.2), make_path([REST, TURNED], [8]))
    ratio = float(together.moment[-1] / first.moment[-1])
    assert 0.5 < ratio < 0.98


def test_swapping_the_bodies_changes_nothing():
    back = Pose(0.3, (-0.03, 0.0), -0.04, linear=True)
    one = solve_contact(Contact(SOFT, HARD, BALL, GRID, 0.5), TURNED)
    other = solve_contact(Contact(HARD, SOFT, BALL, GRID, 0.5), back)
    np.testing.assert_allclose(other.pressure, one.pressure, atol=1e-14)  # rounding
    np.testing.assert_allclose(other.traction, -one.traction, atol=1e-14)
    np.testing.assert_allclose(other.slip, -one.slip, atol=1e-14)


def energies(steps, bodies):
    """Work of the object, energy stored, energy dissipated."""
    path = make_path([REST, PRESSED, TURNED], [steps, steps])
    contacts = solve_path(Contact(*bodies, BALL, GRID, 0.3), path)
    effort = np.column_stack([-contacts.force[:, 2], contacts.force[:, :2], contacts.moment])
    motion = np.column_stack([path.approach, path.shift, path.twist])
    start = np.zeros((1, 4))
    effort, motion = np.vstack([start, effort]), np.vstack([start, motion])
    work = np.sum(0.5 * (effort[1:] + effort[:-1]) * np.diff(motion, axis=0))
    last = contacts.at_step(-1)
    s, b = last.elastomer_displacement(), last.object_displacement()
    density = last.pressure * (b[2] - s[2]) + jnp.sum(last.traction * (s - b)[:2], axis=0)
    return work, 0.5 * float(jnp.sum(density)) * GRID.cell_area, float(last.dissipated_energy)


def test_energy_balance_at_the_order_of_the_steps():
    errors = []
    for steps in (4, 8):
        work, stored, lost = energies(steps, (SOFT, HARD))
        assert lost > 0.02 * work
        errors.append((work - stored - lost) / work)
    assert abs(errors[1]) < 4e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)  # trapezoids


def test_gradients_meet_central_differences():
    @jax.jit
    @jax.value_and_grad  # one program for the differences as well
    def outputs(values):
        modulus, nu, mu, twist, approach = values
        path = make_path([Pose(0.0), Pose(approach), Pose(approach, twist=twist)], [1, 1])
        last = solve_path(
            Contact(HalfSpace(modulus, nu), HARD, BALL, GRID, mu), path, rtol=1e-11
        ).at_step(-1)
        return last.moment + last.force[2] + 10.0 * last.dissipated_energy

    values = jnp.asarray([1.0, 0.2, 0.5, 0.05, 0.3])
    gradient = outputs(values)[1]
    for i in range(5):
        step = jnp.zeros(5).at[i].set(1e-6)
        difference = (outputs(values + step)[0] - outputs(values - step)[0]) / 2e-6
        # the solver's 1e-11 over the step, and curvature
        assert float(gradient[i]) == pytest.approx(float(difference), rel=2e-5)


@pytest.mark.parametrize("thickness", [1.0, 0.32])
def test_an_incompressible_layer_couples_and_settles(thickness):
    """Pressed and then turned; the thinner one is about a cell thick."""
    layer = Layer(1.0, 0.5, thickness)
    pose = Pose(0.1, linear=True)
    pressed = solve_contact(Contact(layer, STEEL, BALL, GRID, 0.3), pose)
    assert np.abs(pressed.slip * np.asarray(pressed.contact)).max() > 1e-4
    pose = Pose(0.1, twist=0.02, linear=True)
    turned = solve_contact(Contact(layer, STEEL, BALL, GRID, 0.3), pose, previous=pressed)
    assert 0.05 < float(turned.stick_ratio) < 0.95
    for solution in (pressed, turned):
        assert float(solution.normal.residual) < 1e-8
        # at once; in turn, pressure and traction take three times as many
        assert int(solution.normal.applications + solution.friction.applications) < 200


def test_what_does_not_settle_is_told():
    soft = HalfSpace(1.0, 0.0)
    solution = solve_contact(Contact(soft, STEEL, BALL, GRID, 20.0), TURNED, throw=False)
    assert bool(solution.result == RESULTS.coupling_max_turns)
    with pytest.raises(RuntimeError, match="smaller friction coefficient"):
        solve_contact(Contact(soft, STEEL, BALL, GRID, 20.0), TURNED)
