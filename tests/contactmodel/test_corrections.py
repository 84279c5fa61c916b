"""Corrections of force and moment: finite strain and the pad's free side."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    AbstractIndenter,
    Contact,
    ContactSolution,
    Ellipsoid,
    Grid,
    HalfSpace,
    Layer,
    Pad,
    Placed,
    Pose,
    Resultants,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
    make_body,
    make_path,
    solve_contact,
    solve_path,
)
from contactmodel.common.inputs import RangeWarning
from contactmodel.elasticity.corrections import Loading, measure_loading, narrow

GRID = Grid((32, 32), (10.0, 10.0))
OVAL = Ellipsoid((7.5, 5.0, 5.0))
BALL, POSE = Sphere(12.0), Pose(0.5, twist=0.12, corotated=True)
NAMES = ("G", "ν", "h", "W", "R", "δ", "θ", "μ")
VALUES = jnp.asarray([0.2, 0.47, 5.0, 8.0, 12.0, 0.5, 0.12, 0.6])


def make_gel(radius: float | None = 8.0, *, neo_hookean=True, thickness=5.0, nu=0.47) -> Layer:
    return Layer(0.2, nu, thickness, radius=radius, neo_hookean=neo_hookean)


def solve(gel, indenter: AbstractIndenter = BALL, pose=POSE, friction=0.6) -> ContactSolution:
    return solve_contact(Contact(gel, Rigid(), indenter, GRID, friction), pose)


@jax.jit
def outputs(values, tangent):
    """Corrected force and moment and their factors, with a derivative by a tangent."""

    def of(values):
        g, nu, h, width, radius, approach, twist, mu = values
        gel = Layer(g, nu, h, radius=width, neo_hookean=True)
        contact = Contact(gel, Rigid(), Sphere(radius), GRID, mu)
        pose = Pose(approach, twist=twist, corotated=True)
        solution = solve_contact(contact, pose, rtol=1e-11)
        factors = solution.correction
        return jnp.stack([solution.force[2], solution.moment, factors.force, factors.moment])

    return jax.jvp(of, (values,), (tangent,))


def test_derivatives_of_corrected_force_and_moment_meet_central_differences():
    for i, name in enumerate(NAMES):
        unit, still = jnp.zeros_like(VALUES).at[i].set(1.0), jnp.zeros_like(VALUES)
        values, forward = outputs(VALUES, unit)
        step = 1e-6 * VALUES[i]
        above, below = (outputs(VALUES + s * unit, still)[0] for s in (step, -step))
        # the solver's 1e-11 over the step of 1e-6, and curvature; sets of cells stay
        difference = (above - below) / (2.0 * step)
        np.testing.assert_allclose(forward, difference, rtol=2e-4, atol=2e-5, err_msg=name)
        if name == "G":  # it scales all tractions, and no factor depends on it
            np.testing.assert_allclose(forward[:2], values[:2] / VALUES[0], rtol=1e-8)
            np.testing.assert_allclose(forward[2:], 0.0, atol=1e-8)


def test_the_loss_at_the_side_falls_with_a_power_of_the_pads_radius():
    one = jnp.ones(())
    loading = Loading(*[0.5 * one] * len(Loading._fields))._replace(
        simple=one > 0.0, even=one > 0.0
    )

    def factor(radius):
        return narrow(loading, 0.48 * one, 5.0 * one, radius).force

    value, slope = jax.value_and_grad(factor)(8.0 * one)
    expected = -3.002 * value * jnp.log(value) / 8.0  # ln f = −C W^−β: f' = −β f ln f / W
    assert float(slope) == pytest.approx(float(expected), rel=1e-6)


@pytest.mark.parametrize("exponent", [-0.25, 0.5, 1.0])
def test_radius_and_exponent_of_a_pressure_are_found(exponent):
    """Means of r² under (1 − r²/a²)^k, in closed form; the tilt of a cone is that of its side."""
    points = jnp.asarray(Grid((400, 400), (10.0, 10.0)).points)
    square = jnp.sum((points - 0.3) ** 2, axis=0) / 4.0**2
    pressure = jnp.where(square < 1.0, jnp.maximum(1.0 - square, 1e-9) ** exponent, 0.0)
    slope = jnp.stack([0.3 * jnp.ones_like(pressure), 0.4 * jnp.ones_like(pressure)])
    x, y = points - 0.3
    traction = 0.2 * pressure * jnp.stack([-y, x]) / jnp.sqrt(x**2 + y**2)
    found = measure_loading(points, slope, pressure, traction, 0.5 * pressure)
    # 3 %: cells of a/160 at a singular edge
    assert float(found.radius) == pytest.approx(4.0, rel=3e-2)
    assert float(found.exponent) == pytest.approx(exponent, abs=0.06)
    assert float(found.reach**2) == pytest.approx(16.0 / (exponent + 2.0), rel=1e-2)
    assert float(found.slope) == pytest.approx(0.5, rel=1e-9)
    assert float(found.tilt) == pytest.approx(np.sqrt(1.25) - 1.0, rel=1e-9)
    assert float(found.used) == pytest.approx(0.4**2, rel=1e-9)
    assert float(found.friction) == pytest.approx(0.5, rel=1e-9)
    assert bool(found.simple)


def test_without_corotated_poses_only_force_and_moment_change_and_both_corrections_multiply():
    pose = Pose(0.5, twist=0.09)
    off = solve(make_gel(None, neo_hookean=False), pose=pose)
    assert float(off.correction.force) == float(off.correction.moment) == 1.0
    assert bool(off.correction.covered)
    both, side, strain = (
        solve(gel, pose=pose) for gel in (make_gel(), make_gel(neo_hookean=False), make_gel(None))
    )
    for name in ("pressure", "traction", "slip", "stick"):
        np.testing.assert_array_equal(getattr(both, name), getattr(off, name))
    np.testing.assert_array_equal(both.elastomer_displacement(), off.elastomer_displacement())
    assert float(side.correction.force) < 1.0 < float(strain.correction.force)
    for name in ("force", "moment"):
        factor = getattr(both.correction, name)
        parts = getattr(side.correction, name) * getattr(strain.correction, name)
        assert float(factor) == pytest.approx(float(parts), rel=1e-12)
        np.testing.assert_allclose(
            getattr(both, name), getattr(off, name) * factor, rtol=1e-12, atol=1e-15
        )


def test_the_place_of_the_contact_and_the_number_of_steps_do_not_matter():
    here = solve(make_gel(), pose=Pose(0.5, twist=0.09)).correction
    cell = GRID.spacing[0]
    pose = Pose(0.5, twist=0.09, centre=(2.0 * cell, -cell))
    placed = solve(make_gel(), Placed(BALL, (2.0 * cell, -cell)), pose=pose)
    assert float(placed.correction.force) == pytest.approx(float(here.force), abs=1e-3)
    assert float(placed.correction.moment) == pytest.approx(float(here.moment), abs=1e-3)
    path = make_path([Pose(0.0, corotated=True), POSE], [2])
    steps = solve_path(Contact(make_gel(), Rigid(), BALL, GRID, 0.6), path)
    assert steps.correction.force.shape == (2,)
    last = steps.at_step(-1)
    assert float(last.correction.moment) == pytest.approx(float(steps.correction.moment[-1]))
    np.testing.assert_allclose(last.force, steps.force[-1], rtol=1e-12, atol=1e-12)


def test_without_depth_or_side_nothing_is_corrected():
    gel = make_gel(5e3, thickness=500.0)
    correction = solve(gel, Sphere(1200.0), Pose(0.004, corotated=True)).correction
    assert float(correction.force) == pytest.approx(1.0, abs=1e-3)  # slope 1e-3
    assert float(correction.moment) == pytest.approx(1.0, abs=1e-3)
    apart = solve(gel, pose=Pose(-0.1, corotated=True))
    assert float(apart.correction.force) == 1.0
    assert bool(apart.correction.covered)


def test_square_and_short_elliptic_contacts_are_covered():
    for gel, indenter in (
        (make_gel(None), OVAL),
        (make_gel(None), SquarePunch(5.0, 1.0)),
        (make_gel(None), SquarePunch(5.6, 1.0)),
    ):
        assert bool(solve(gel, indenter, Pose(0.3)).correction.covered)


def test_the_range_is_checked():
    for gel, indenter, pose, friction in (
        (make_gel(thickness=1.9, radius=None), BALL, POSE, 0.6),  # deep
        (make_gel(nu=0.3), BALL, POSE, 0.6),
        (make_gel(), BALL, POSE, 0.1),
        (make_gel(), BALL, Pose(0.5, twist=0.2), 0.6),  # plain
        (make_gel(), BALL, Pose(0.5, shift=(0.05, 0.0)), 0.6),
        (make_gel(), RoundPunch(2.0), Pose(0.2), 0.6),  # sharp
        (make_gel(), OVAL, Pose(0.3), 0.6),  # long, on a narrow pad
        (make_gel(None), Ellipsoid((12.0, 2.0, 5.0)), Pose(0.2), 0.6),  # too long
        (make_gel(radius=2.5), BALL, POSE, 0.6),
    ):
        with pytest.warns(RangeWarning, match="corrected outside the fitted range"):
            solution = solve(gel, indenter, pose, friction)
        assert not bool(solution.correction.covered)
        assert np.isfinite(float(solution.moment))
    path = Pose(jnp.array([0.2, 0.5]), corotated=True)
    thin = Contact(make_gel(None, thickness=1.9), Rigid(), BALL, GRID, 0.6)
    with pytest.warns(RangeWarning, match="corrected at step 1 outside"):
        solve_path(thin, path)


def test_soft_objects_resultants_and_half_spaces_are_refused():
    with pytest.raises(ValueError, match="rigid objects only"):
        Contact(make_gel(), HalfSpace(1.0, 0.3), BALL, GRID, 0.6)
    with pytest.raises(ValueError, match="only the elastomer can be corrected"):
        Contact(HalfSpace(1.0, 0.3), make_gel(), BALL, GRID, 0.6)
    contact = Contact(make_gel(), Rigid(), BALL, GRID, 0.6)
    with pytest.raises(ValueError, match="resultants cannot be combined with corrections"):
        solve_contact(contact, Pose(0.5), Resultants(normal_force=1.0))
    for pad in (Pad(0.2, 0.48, radius=12.0), Pad(0.2, 0.48, neo_hookean=True)):
        with pytest.raises(ValueError, match="requires a finite thickness_mm"):
            make_body(pad)
    gel = make_body(Pad(0.2, 0.48, 8.0, radius=12.0, neo_hookean=True))
    assert isinstance(gel, Layer)
    assert gel.neo_hookean
    assert gel.radius is not None
    assert float(gel.radius) == 12.0
    with pytest.raises(ValueError, match="must be above 0"):
        make_gel(-1.0)
