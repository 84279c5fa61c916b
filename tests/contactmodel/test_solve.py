"""What users get from `solve_contact` and `solve_path`, and what they are told when it fails."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    RESULTS,
    AbstractIndenter,
    Contact,
    Cylinder,
    Domed,
    Ellipsoid,
    Grid,
    HalfSpace,
    HeightMap,
    Layer,
    Paraboloid,
    Placed,
    Pose,
    Resultants,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
    make_path,
    solve_contact,
    solve_path,
    stiffness_ratio,
)

GRID = Grid((32, 32), (10.0, 10.0))
PAD = HalfSpace(1.0, 0.45)
STEEL = Rigid()
BALL = Paraboloid(30.0)
CONTACT = Contact(PAD, STEEL, BALL, GRID, 0.5)
COARSE = Contact(PAD, STEEL, BALL, Grid((16, 16), (10.0, 10.0)), 0.5)
PRESSED = Pose(0.3, twist=0.05, shift=(0.01, 0.02))


def solve(indenter=BALL, pose=PRESSED, mu=0.5, grid=GRID, object_=STEEL, **how):
    return solve_contact(Contact(PAD, object_, indenter, grid, mu), pose, **how)


def test_a_path_is_its_steps_one_after_the_other():
    path = make_path(
        [Pose(0.0), Pose(0.3), Pose(0.3, twist=0.06), Pose(0.3, twist=-0.06)], [1, 2, 3]
    )
    together = solve_path(CONTACT, path)
    last = None
    for i in range(6):
        pose = jax.tree.map(lambda leaf, i=i: leaf[i], path)
        last = solve(pose=pose, previous=last)
        step = together.at_step(i)
        np.testing.assert_allclose(step.traction, last.traction, atol=1e-8)  # solver's tolerance
        assert float(step.moment) == pytest.approx(float(together.moment[i]), rel=1e-12)
    rest = jax.tree.map(lambda leaf: leaf[3:], path)
    resumed = solve_path(CONTACT, rest, previous=together.at_step(2))
    np.testing.assert_allclose(resumed.moment, together.moment[3:], atol=1e-8)


def test_non_square_grid_and_cells():
    wide = solve(grid=Grid((48, 32), (15.0, 10.0)))  # the same cells, more of them
    assert float(wide.moment) == pytest.approx(float(solve().moment), rel=1e-6)  # tolerance
    flat = solve(grid=Grid((32, 64), (10.0, 10.0)))
    assert float(flat.moment) == pytest.approx(float(solve().moment), rel=1e-2)  # other cells


@pytest.mark.parametrize(
    ("shape", "like"),
    [
        (Sphere(2e4), Paraboloid(2e4)),  # they differ by r⁴/8R³, below 1e-9 mm here
        (Ellipsoid((30.0, 30.0, 30.0)), Sphere(30.0)),
        (Placed(BALL, (0.0, 0.0), 0.7), BALL),
        (Domed(Sphere(4e4), 4e4), Sphere(2e4)),
        (RoundPunch(3.0, 1.0), Placed(RoundPunch(3.0, 1.0), angle=0.3)),
        (SquarePunch(5.0, 0.5), Placed(SquarePunch(5.0, 0.5), angle=-np.pi / 2)),
        (HeightMap(BALL.height(jnp.asarray(GRID.points)), GRID.spacing), BALL),
    ],
)
def test_shapes_that_are_the_same_have_the_same_heights(shape, like):
    points = jnp.asarray(GRID.points)
    # 1e-9: the side of a punch is 1000 mm/mm steep, and magnifies rounding
    np.testing.assert_allclose(shape.height(points), like.height(points), atol=1e-9)


def test_rounded_edges():
    x = jnp.asarray([[0.0, 2.0, 2.6, 2.9], [0.0, 0.0, 0.0, 0.0]])
    arc = [0.0, 0.0, 1.0 - 0.8, 1.0 - np.sqrt(1.0 - 0.81)]
    np.testing.assert_allclose(RoundPunch(3.0, 1.0).height(x), arc, atol=1e-12)
    np.testing.assert_allclose(SquarePunch(6.0, 1.0).height(x), arc, atol=1e-12)
    assert float(SquarePunch(6.0).height(jnp.asarray([3.01, 0.0]))) > 9.0
    assert float(SquarePunch(6.0).height(jnp.asarray([2.99, 2.99]))) == 0.0


def test_turned_cylinder_is_the_cylinder_along_x():
    turned = Placed(Cylinder(8.0), angle=np.pi / 2)
    points = jnp.asarray(GRID.points)
    np.testing.assert_allclose(
        turned.height(points), Cylinder(8.0).height(points[::-1]), atol=1e-12
    )


def test_finite_rotation_moves_points_by_the_rotation():
    points = jnp.asarray([[1.0, 0.0], [0.0, 2.0]])
    pose = Pose(0.1, shift=(0.5, 0.0), twist=np.pi / 2, centre=(1.0, 0.0))
    np.testing.assert_allclose(
        points + pose.displacement(points), [[1.5, -0.5], [0.0, -1.0]], atol=1e-15
    )
    linear = Pose(0.1, twist=0.1, linear=True).displacement(points)
    np.testing.assert_allclose(linear, [[-0.0, -0.2], [0.1, 0.0]], atol=1e-15)


def test_displacement_at_points_is_that_of_the_grid_and_decays():
    solution = solve(object_=HalfSpace(3.0, 0.3))
    points = GRID.points.reshape(2, -1).T[::97]
    on_grid = solution.elastomer_displacement().reshape(3, -1).T[::97]
    np.testing.assert_allclose(solution.elastomer_displacement_at(points), on_grid, atol=1e-14)
    on_grid = solution.object_displacement().reshape(3, -1).T[::97]
    np.testing.assert_allclose(solution.object_displacement_at(points), on_grid, atol=1e-14)
    far = solution.elastomer_displacement_at(np.array([[1000.0, 0.0]]))[0]
    # Boussinesq's and Cerruti's point loads; the pull of a pressure falls like 1/r, too
    unit = 1.0 / (2.0 * np.pi * 1000.0)
    force = solution.force
    assert float(far[2]) == pytest.approx(
        float((0.55 * force[2] - 0.05 * force[0]) * unit), rel=1e-3
    )
    assert float(far[1]) == pytest.approx(
        float(0.55 * force[1] * unit), rel=2e-2
    )  # plus the moment's


def test_gap_is_what_the_displacements_leave():
    # ν = ½ on a rigid object: nothing couples, so the displacements close the gap exactly
    solution = solve_contact(Contact(HalfSpace(1.0, 0.5), STEEL, BALL, GRID, 0.5), PRESSED)
    height = BALL.height(jnp.asarray(GRID.points)) - 0.3
    gap = height - solution.elastomer_displacement()[2]
    np.testing.assert_allclose(solution.gap, gap, atol=1e-14)


def test_friction_map():
    smooth = np.full(GRID.shape, 0.5)
    smooth[16:] = 0.0
    solution = solve(mu=smooth)
    assert not np.any(solution.traction[:, 16:])
    assert np.all(solution.sliding[16:] == solution.contact[16:])
    assert 0 < float(solution.moment) < float(solve().moment)


def test_results_without_contact_and_at_the_edge():
    apart = solve(pose=Pose(-0.1, twist=0.1))
    assert bool(apart.result == RESULTS.no_contact)
    assert not np.any(apart.contact)
    assert float(apart.stick_ratio) == 0.0
    with pytest.raises(RuntimeError, match="edge of the grid"):
        solve(pose=Pose(5.0))
    assert bool(solve(pose=Pose(5.0), throw=False).result == RESULTS.at_the_edge)
    with pytest.raises(RuntimeError, match="edge of the grid"):
        solve(SquarePunch(12.0))


def test_an_infinite_height_is_a_failure():
    class Cap(AbstractIndenter):
        beside: float

        def height(self, points):
            square = jnp.sum(points**2, axis=0)
            return jnp.where(square < 9.0, square / 40.0, self.beside)

    assert float(solve(Cap(5.0)).force[2]) < -0.1
    assert bool(solve(Cap(np.inf), throw=False).result == RESULTS.no_height)  # not no_contact


@pytest.mark.usefixtures("unchecked")
def test_a_number_is_no_pose():
    with pytest.raises(ValueError, match=r"such as Pose\(approach=0.5\), got one of type float"):
        solve(pose=0.5)


def test_too_few_steps_are_told():
    short = solve(max_steps=2, throw=False)
    assert bool(short.result == RESULTS.normal_max_steps)
    with pytest.raises(RuntimeError, match="max_steps"):
        solve(max_steps=2)
    path = make_path([Pose(-1.0), Pose(2.0)], [3])
    with pytest.raises(RuntimeError, match="step 1 of the path"):
        solve_path(CONTACT, path)
    with pytest.raises(RuntimeError, match="edge of the grid"):
        jax.block_until_ready(jax.jit(lambda d: solve(pose=Pose(d)).moment)(5.0))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: HalfSpace(0.0, 0.3), "above 0, got 0.0"),
        (lambda: HalfSpace(1.0, 0.51), "Poisson's ratio"),
        (lambda: HalfSpace(1.0, -0.1), "Poisson's ratio"),
        (lambda: Sphere(-1.0), "above 0"),
        (lambda: RoundPunch(1.0, -0.1), "edge radius"),
        (lambda: Pose(np.nan), "finite"),
        (lambda: Pose(0.1, twist=np.inf), "finite"),
        (lambda: HeightMap(np.full((3, 3), np.nan), (1.0, 1.0)), "9 of 9 heights"),
        (lambda: HeightMap(np.zeros(3), (1.0, 1.0)), "2 × 2 heights"),
        (lambda: HeightMap(np.zeros((3, 3)), (0.0, 1.0)), "spacing"),
        (lambda: Grid((1, 8), (1.0, 1.0)), "at least 2 cells"),
        (lambda: Grid((8, 8), (1.0, -1.0)), "above 0 mm"),
        (lambda: solve(mu=-0.1), "friction coefficient"),
        (lambda: solve(mu=np.ones((3, 3))), "map of shape"),
        (lambda: solve(pose=make_path([Pose(0.0), Pose(0.1)], [2])), "solve_path"),
        (lambda: solve_path(CONTACT, Pose(0.1)), "make_path"),
        (lambda: solve_contact(Contact(STEEL, STEEL, BALL, GRID, 0.5), Pose(0.1)), "rigid"),
        (lambda: solve(previous=replace(solve(), problem=COARSE)), "the previous contact"),
    ],
)
def test_wrong_values_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()


def test_wrong_values_inside_jit():
    with pytest.raises(RuntimeError, match="above 0"):
        jax.block_until_ready(jax.jit(lambda g: HalfSpace(g, 0.3).softness)(-1.0))


def test_huge_and_no_friction():
    glued, smooth = solve(mu=1e9), solve(mu=0.0)
    assert float(glued.stick_ratio) == 1.0
    assert float(smooth.moment) == 0.0
    assert float(smooth.dissipated_energy) == 0.0


def test_single_precision_follows_a_reversal_when_asked_for():
    def single(value):
        return np.asarray(value, np.float32)

    def path(kind):
        still = kind([0.0, 0.0])
        turns = [(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.3, -0.1)]
        poses = [Pose(kind(a), still, kind(t), still) for a, t in turns]
        return make_path(poses, [1, 3, 6])

    pad, ball = HalfSpace(single(1.0), single(0.45)), Paraboloid(single(30.0))
    with pytest.raises(ValueError, match="single precision"):
        solve_path(Contact(pad, STEEL, ball, GRID, single(0.2)), path(single), rtol=1e-6)
    coarse = solve_path(Contact(pad, STEEL, ball, GRID, single(0.2)), path(single), rtol=1e-4)
    fine = solve_path(Contact(PAD, STEEL, BALL, GRID, 0.2), path(np.asarray))
    assert coarse.traction.dtype == jnp.float32
    assert int(jnp.max(coarse.friction.steps)) <= 10  # as in double precision; cells at the rim
    # hold so little that rounding once hid whether they slide, and the steps ran out
    np.testing.assert_allclose(coarse.moment, fine.moment, atol=1e-3 * float(fine.moment.max()))


def test_the_pose_alone_decides_about_single_precision():
    def solve_as(dtype):
        still = jnp.zeros(2, dtype)
        how = {"shift": still, "centre": still, "corotated": True}
        turns = [(0.0, 0.0), (0.3, 0.0), (0.3, 0.1)]
        poses = [Pose(jnp.asarray(a, dtype), twist=jnp.asarray(t, dtype), **how) for a, t in turns]
        return solve_path(Contact(PAD, STEEL, BALL, GRID, 0.2), make_path(poses, [1, 3]), rtol=1e-4)

    single, double = solve_as(jnp.float32), solve_as(jnp.float64)
    assert single.pressure.dtype == single.traction.dtype == jnp.float32
    names = ("elastomer_displacement", "object_displacement", "elastomer_rotation")
    for name in names:
        exact = getattr(double, name)()
        largest = float(jnp.abs(exact).max())
        np.testing.assert_allclose(getattr(single, name)(), exact, atol=1e-3 * largest)


def test_full_slip_under_a_finite_rotation_carries_what_friction_can():
    """Each point is dragged across the way that the object takes past where the point now is."""
    mu, poses = 0.1, [Pose(0.3), Pose(0.3, twist=np.radians(30.0)), Pose(0.3, twist=0.0)]
    path = solve_path(Contact(PAD, STEEL, BALL, GRID, mu), make_path(poses, [30, 30]))
    x, y = GRID.points
    arm = np.hypot(x, y)
    most = mu * np.sum(arm * np.asarray(path.pressure[-1])) * GRID.cell_area
    # a step of 1° is a chord that lags by half a degree: 1 − cos 0.5° is far below, and what the
    # elastic twist of the pad adds to the angle costs as little
    assert float(path.moment[29]) == pytest.approx(most, rel=2e-3)
    assert float(path.moment[-1]) == pytest.approx(-most, rel=2e-3)
    assert not path.stick[29].any()


@pytest.mark.parametrize("approach", [0.305, 0.31, 0.32])
def test_pressure_and_traction_settle_on_each_other_at_every_step(approach):
    """A traction within its tolerance must not keep the pressure just outside of its own."""
    poses = [Pose(approach), Pose(approach, twist=np.radians(30.0)), Pose(approach, twist=0.0)]
    path = solve_path(Contact(PAD, STEEL, BALL, GRID, 0.1), make_path(poses, [30, 30]))
    assert float(jnp.max(path.normal.residual)) <= 1e-8
    assert float(jnp.max(path.friction.residual)) <= 1e-8


def test_at_rest_everything_sticks():
    poses = [PRESSED, PRESSED]
    turned = solve_contact(Contact(PAD, STEEL, BALL, GRID, 0.1), poses[0])
    held = solve_contact(Contact(PAD, STEEL, BALL, GRID, 0.1), poses[1], previous=turned)
    assert bool(turned.sliding.any())
    assert not bool(held.sliding.any())
    np.testing.assert_allclose(held.traction, turned.traction, atol=1e-9)


def test_stiffness_ratio():
    assert float(stiffness_ratio(PAD, HalfSpace(4.0, 0.2))) == 0.25
    assert float(stiffness_ratio(PAD, STEEL)) == 0.0


@pytest.mark.parametrize("ulps", [-1, 0, 1, 2])
def test_bodies_that_just_touch_are_not_pressed(ulps):
    lowest = float(BALL.height(jnp.asarray(GRID.points)).min())
    touching = solve(pose=Pose(lowest + ulps * np.spacing(lowest), twist=0.05, shift=(0.01, 0.02)))
    assert bool(touching.result == RESULTS.no_contact)
    assert not np.asarray(touching.pressure).any()
    lifted = solve(pose=touching.pose, previous=solve())
    assert bool(lifted.result == RESULTS.no_contact)
    assert not np.asarray(lifted.pressure).any()


@pytest.mark.parametrize("body", [PAD, Layer(1.0, 0.45, 4.0)])
def test_compiled_programs_call_nothing_on_the_host(body):
    """JAX's compilation cache keeps only programs without callbacks."""
    contact = Contact(body, Rigid(), Domed(BALL, 30.0), GRID, 0.5)
    given = Resultants(moment=1.0)  # checked here: numbers that are not known are on the host

    def search(pose, friction):
        rubbing = eqx.tree_at(lambda c: c.friction_coefficient.coefficient, contact, friction)
        solution = solve_contact(rubbing, pose, given, throw=False)
        moved = solution.elastomer_displacement_at(GRID.points[:, 0].T)
        return moved, solution.elastomer_displacement(), solution.elastomer_rotation()

    program = str(jax.make_jaxpr(search)(PRESSED, jnp.asarray(0.5)))
    assert "while" in program
    assert "callback" not in program
