"""Contacts solved in a frame that turns with the object: sticking points exact, moments closed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Resultants, Rigid, solve_path
from contactmodel.analytic import reissner_sagoci_moment
from contactmodel.common.turning import on_circles, to_space, turn
from contactmodel.solve import solve_contact

RADIUS, APPROACH, MODULUS = 20.0, 0.45, 0.2  # contact radius 3 mm
GRID = Grid((24, 24), (9.0, 9.0))


def contact(friction):
    return Contact(HalfSpace(MODULUS, 0.5), Rigid(), Paraboloid(RADIUS), GRID, friction)


@pytest.fixture(scope="module")
def carried():
    """Full stick by far: pressed, twisted, shifted, twisted back and on."""
    twist = np.array([0.0, 0.3, 0.3, -0.2])
    shift = np.array([[0.0, 0.0], [0.0, 0.0], [0.3, -0.1], [0.3, -0.1]])
    path = Pose(APPROACH, shift, twist, (0.5, 0.2), corotated=True)
    return solve_path(contact(1e3), path, rtol=1e-10)


def test_sticking_points_go_where_the_object_goes(carried):
    points, pose = jnp.asarray(GRID.points), carried.pose
    for step in range(1, 4):
        one = carried.at_step(step)
        moved = one.elastomer_displacement()[:2]
        inside = np.asarray(one.stick & (jnp.hypot(*points) < 2.5))
        expected = jax.tree.map(lambda leaf, i=step: leaf[i], pose).displacement(points)
        # the solver's tolerance, by the displacement
        np.testing.assert_allclose(moved[:, inside], expected[:, inside], atol=1e-7)
    at = np.array([[1.0, 0.5], [0.0, 0.0]])
    moved = carried.elastomer_displacement_at(at)[-1, :, :2]
    last = jax.tree.map(lambda leaf: leaf[-1], pose)
    np.testing.assert_allclose(moved, last.displacement(jnp.asarray(at).T).T, atol=2e-3)


def test_force_and_moment_are_those_in_space(carried):
    """A shift pulls along itself, whatever the object has turned; the moment is Reissner's."""
    twist, centre = carried.pose.twist, carried.pose.centre[0]
    middle = carried.pose.shift.T - turn(centre[:, None], twist) + centre[:, None]
    x, y, _ = carried.force.T
    scale = float(jnp.max(jnp.hypot(x, y)))
    assert scale > 0.1
    np.testing.assert_allclose(x * middle[1], y * middle[0], atol=1e-9 * scale)
    assert np.all(np.asarray(x * middle[0] + y * middle[1])[1:] > 0.0)
    pulled = turn(jnp.stack([x, y]), -twist)  # on the turned arm
    about_middle = carried.moment + centre[0] * pulled[1] - centre[1] * pulled[0]
    slope = about_middle[1:] / twist[1:]
    np.testing.assert_allclose(slope, slope[0], rtol=1e-8)
    radius = np.sqrt(RADIUS * APPROACH)
    expected = reissner_sagoci_moment(1.0, radius, MODULUS)
    assert slope[0] == pytest.approx(expected, rel=0.04)  # 16 cells across the contact


def test_gel_that_does_not_stick_turns_on_circles():
    points = jnp.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    arc = 0.4 * jnp.stack([-points[1], points[0]]) + 0.1 * points
    shift = jnp.array([[0.2], [0.1]])
    moved = to_space(points, arc, -arc, jnp.array(0.7))
    radius = jnp.hypot(*(points + moved))
    np.testing.assert_allclose(radius, 1.1 * jnp.hypot(*points), rtol=1e-12)
    at = points + moved
    angle = jnp.arctan2(points[0] * at[1] - points[1] * at[0], jnp.sum(points * at, axis=0))
    np.testing.assert_allclose(angle[:2], 0.4 / 1.1, rtol=1e-12)  # arcs of the wider circle
    both = to_space(points, arc + shift, -arc + shift, jnp.array(0.7))
    np.testing.assert_allclose(both - moved, turn(jnp.tile(shift, 3), jnp.array(0.7)), atol=1e-12)
    np.testing.assert_allclose(on_circles(points, arc + shift * 0.0), 1.1 * points, rtol=1e-12)


def test_derivatives_by_the_twist():
    """Of a point that sticks d(R r)/dθ, of the moment and a point that slides differences."""

    def seen(twist):
        end = solve_contact(contact(5.0), Pose(APPROACH, twist=twist, corotated=True), rtol=1e-11)
        moved = end.elastomer_displacement()
        return jnp.stack([*moved[:2, 14, 12], *moved[:2, 12, 20], end.moment])

    step, twist = 1e-5, 0.25
    ends, slope = jax.jvp(seen, (jnp.array(twist),), (jnp.ones(()),))
    about = (seen(jnp.array(twist + step)) - seen(jnp.array(twist - step))) / (2 * step)
    np.testing.assert_allclose(slope, about, rtol=1e-4, atol=1e-5)  # differences
    assert ends[-1] > 0.0
    x, y = GRID.points[:, 14, 12]
    c, s = np.cos(twist), np.sin(twist)
    np.testing.assert_allclose(slope[:2], [-s * x - c * y, c * x - s * y], rtol=1e-6)


def test_what_a_corotated_motion_does_not_take():
    with pytest.raises(ValueError, match="both linear and corotated"):
        Pose(0.1, linear=True, corotated=True)
    with pytest.raises(ValueError, match="leave out resultants or corotated"):
        solve_contact(contact(0.6), Pose(0.1, corotated=True), Resultants(normal_force=1.0))
