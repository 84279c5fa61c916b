"""Surface fields of neo-Hookean gels: where their points are, and what the object prescribes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Coulomb,
    Grid,
    Layer,
    Pose,
    Rigid,
    Sphere,
    solve_contact,
    solve_path,
)
from contactmodel.elasticity.corrections import press_gain, stick_gain
from contactmodel.elasticity.reading import Reading, ReadNearby, ReadOnGrid, raise_limit, read_field
from contactmodel.grid import interpolate
from contactmodel.indenters import measure_shape

GRID, RADIUS, TWIST = Grid((32, 32), (10.0, 10.0)), 15.0, 0.2
APPROACH = np.array([0.3, 0.6, 0.6])


def make_contact(*, neo_hookean=True) -> Contact:
    gel = Layer(0.2, 0.48, 6.0, neo_hookean=neo_hookean)
    return Contact(gel, Rigid(), Sphere(RADIUS), GRID, 0.6)


@pytest.fixture(scope="module")
def turned():
    """Pressed on and turned, with the correction and without."""
    path = Pose(APPROACH, twist=np.array([0.0, 0.0, TWIST]), corotated=True)
    return [solve_path(make_contact(neo_hookean=on), path) for on in (True, False)]


def polar(moved, points):
    """u_r, the angle and u_z of points that moved [mm, rad, mm]."""
    at = points + moved[:2]
    cross = points[0] * at[1] - points[1] * at[0]
    angle = jnp.arctan2(cross, jnp.sum(points * at, axis=0))
    return jnp.hypot(*at) - jnp.hypot(*points), angle, moved[2]


def test_sticking_points_turn_as_the_object_and_touching_points_lie_on_it(turned):
    """The linear field violates the second: the gel's points have moved out on the sphere."""
    points, gap = jnp.asarray(GRID.points), []
    for path in turned:
        last = path.at_step(-1)
        outward, angle, height = polar(last.elastomer_displacement(), points)
        inside = np.asarray(last.stick & (jnp.hypot(*points) < 1.2))
        assert np.count_nonzero(inside) > 20
        np.testing.assert_allclose(angle[inside], TWIST, atol=1e-3)  # small slip while pressed
        radius = jnp.hypot(*points) + outward
        sphere = RADIUS - jnp.sqrt(RADIUS**2 - radius**2) - APPROACH[-1]
        touches = np.asarray(last.contact & (jnp.hypot(*points) < 2.9))
        gap.append(float(jnp.max(jnp.abs(height - sphere)[touches])))
    cell = GRID.spacing[0]
    assert gap[0] < cell**2 / (4.0 * RADIUS)  # bilinear in both directions, on a sphere
    assert gap[1] > 2.0 * gap[0]


def test_the_corrected_gel_reaches_less_far_outward_and_turns_more_far_away(turned):
    points = jnp.asarray(GRID.points)
    corrected, linear = (polar(p.at_step(-1).elastomer_displacement(), points) for p in turned)
    edge = np.asarray(jnp.abs(jnp.hypot(*points) - 3.4) < 0.3)
    assert np.all(np.asarray(corrected[0] < linear[0])[edge])
    far = np.array([[12.0, 0.0], [0.0, 12.0]])
    angles = [
        polar(path.elastomer_displacement_at(far)[-1].T, jnp.asarray(far.T))[1] for path in turned
    ]
    assert 1.01 < float(angles[0][0] / angles[1][0]) < 1.12


def test_points_between_the_cells_are_those_of_the_grid(turned):
    path, points = turned[0], GRID.points[:, 16:28, 16]
    on_grid = np.asarray(path.elastomer_displacement())[-1][:, 16:28, 16]
    anywhere = np.asarray(path.elastomer_displacement_at(points.T))[-1].T
    np.testing.assert_allclose(anywhere, on_grid, atol=4e-3)  # both linear within a cell


def test_without_corotated_poses_and_below_the_surface_the_field_is_linear(turned):
    fields = [
        solve_contact(make_contact(neo_hookean=on), Pose(0.5, twist=0.05)).elastomer_displacement()
        for on in (True, False)
    ]
    np.testing.assert_array_equal(fields[0], fields[1])
    pressed = turned[0].at_step(0)
    below = pressed.elastomer_displacement(0.5)
    bare = turned[1].at_step(0).elastomer_displacement(0.5)
    np.testing.assert_allclose(below, bare, atol=2e-3)  # friction alone differs


def test_a_field_is_read_where_its_points_are():
    """Angle r⁻³ and deflection r², both in closed form."""
    r = jnp.array([1.0, 2.5, 4.0])
    one = jnp.ones(())
    reading = Reading(2.0 * one, 0.1 * one, 0.5, 0.06 * one)

    def read(turned, deep):
        return (r * turned) ** -3.0, (r * deep) ** 2

    stretch, angle, deflection = read_field(reading, r, jnp.full(3, 1.04), read)
    inward = jnp.array([0.1 / 4.0, 0.1 * 0.8**3, 0.1 / 8.0])
    np.testing.assert_allclose(stretch, 1.04 - inward / r, rtol=1e-12)
    np.testing.assert_allclose(deflection, (r * stretch) ** 2, rtol=1e-12)
    grown = jnp.array([1.0, 1.0 + 0.06 * 0.2, 1.03])
    followed = r * (1.0 + 0.5 * (stretch - 1.0))
    np.testing.assert_allclose(angle, grown * followed**-3, rtol=1e-12)
    x, y = GRID.points
    at = jnp.array([[0.3, -1.1], [0.7, 9.0]])
    plane = ReadOnGrid(GRID, jnp.asarray(2.0 * x - y), jnp.asarray(x))
    near = ReadNearby(plane, jnp.array([[2.0, 10.0], [1.0, 0.0]]), jnp.zeros(2), jnp.ones(2))
    rim = 5.0 - 2.0 * GRID.spacing[0]  # beyond it the change falls like r⁻³
    moved = near(jnp.full(2, 1.1), jnp.full(2, 0.9))
    np.testing.assert_allclose(moved[0], [0.3, 0.2 * rim**4 / 1e3], rtol=1e-6)
    np.testing.assert_allclose(moved[1], [0.8, 1.0 - 0.1 * rim**4 / 1e3], rtol=1e-6)
    found = interpolate(GRID, jnp.asarray(1.0 + 2.0 * x - y), at)
    np.testing.assert_allclose(found, [0.9, 1.0 - 2.2 - GRID.y[-1]], rtol=1e-6)


def test_derivatives_of_the_field_meet_differences_and_a_closed_form():
    """Points that stick: d(R r)/dθ; a point that slides and one outside: differences."""
    contact = make_contact()
    before = solve_contact(contact, Pose(0.3, corotated=True), rtol=1e-11)
    at = np.array([GRID.points[:, 18, 17], [2.6, 0.3], [4.2, -0.5]])

    @jax.jit
    def seen(values, tangent):
        def field(values):
            pose = Pose(values[0], twist=values[1], corotated=True)
            end = solve_contact(contact, pose, previous=before, rtol=1e-11, throw=False)
            grid = end.elastomer_displacement()[:, 16, 20:22]
            return end.elastomer_displacement_at(at).ravel(), grid.ravel()

        return jax.jvp(field, (values,), (tangent,))

    values, step = jnp.array([0.5, 0.12]), 1e-6
    for i in range(2):
        unit = jnp.zeros(2).at[i].set(1.0)
        (here, _), slopes = seen(values, unit)
        above, below = (seen(values + s * unit, 0.0 * unit)[0] for s in (step, -step))
        for slope, up, down in zip(slopes, above, below, strict=True):
            # the solver's 1e-11 over the step, and curvature; sets of cells stay
            np.testing.assert_allclose(slope, (up - down) / (2.0 * step), rtol=1e-4, atol=3e-5)
        if i == 1:
            x, y = at[0] + here.reshape(3, 3)[0, :2]
            turns = slopes[0].reshape(3, 3)[0, :2]
            np.testing.assert_allclose(turns, [-y, x], rtol=2e-3)  # read between cells


def test_the_limit_of_friction_under_a_flat_face_in_closed_form():
    """Without slopes (1 − c₄ e x + c₅ e μ²)/(1 + g₂ e x): its value and its slope by approach."""
    gel, mu, c = Layer(0.2, 0.48, 10.0, neo_hookean=True), 0.5, (0.3, 0.6)
    points = jnp.asarray(GRID.points)
    inside = jnp.hypot(*points) < 3.0
    shape = jnp.where(inside, 0.0, 1e3), jnp.zeros_like(points)
    pressure = jnp.full(GRID.shape, 0.1)

    def limit(approach):
        law = raise_limit(Coulomb(mu), gel, shape, points, approach, c)
        return law.limit(pressure)[4, 5], law.slope(pressure)[4, 5]

    (value, by_pressure), (slope, _) = jax.jvp(limit, (jnp.array(2.0),), (jnp.ones(()),))
    x = float(jnp.sqrt(jnp.sum(points**2 * inside) / jnp.sum(inside))) / 10.0
    above, below = -c[0] * x + c[1] * mu**2, -0.441 * x
    assert float(value) == pytest.approx(0.05 * (1.0 + 0.2 * above) / (1.0 + 0.2 * below), rel=1e-9)
    assert float(by_pressure) == pytest.approx(float(value) / 0.1, rel=1e-9)
    by_depth = 0.05 * (above - below) / (1.0 + 0.2 * below) ** 2 / 10.0
    assert float(slope) == pytest.approx(by_depth, rel=1e-9)
    assert float(limit(jnp.array(-1.0))[0]) == pytest.approx(0.05, rel=1e-12)  # apart


def test_the_limit_of_friction_from_the_shape_is_that_from_the_pressure(turned):
    """The pressed sphere: 0.002, and the derivative by its radius meets differences."""
    gel, points = Layer(0.2, 0.48, 6.0, neo_hookean=True), jnp.asarray(GRID.points)

    def gain(radius):
        shape = measure_shape(Sphere(radius), points)
        return raise_limit(Coulomb(0.6), gel, shape, points, jnp.array(0.6), (0.0, 0.0)).gain

    pressed = jax.tree.map(lambda part: part[1], turned[0].loading)
    grown = press_gain(pressed, gel.poisson_ratio, gel.thickness) + pressed.tilt
    stuck = stick_gain(pressed, jnp.array(0.6), gel.thickness)
    assert float(gain(RADIUS)) == pytest.approx(float((1.0 + grown) / (1.0 + stuck)), abs=2e-3)
    slope, step = jax.grad(gain)(RADIUS), 1e-5
    ends = gain(RADIUS + step) - gain(RADIUS - step)
    assert float(slope) == pytest.approx(float(ends) / (2.0 * step), rel=1e-3)
