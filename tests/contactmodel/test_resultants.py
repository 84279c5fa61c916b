"""Force and moment given in place of motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    RESULTS,
    Contact,
    Domed,
    Grid,
    HalfSpace,
    HeightMap,
    Paraboloid,
    Placed,
    Pose,
    Resultants,
    Rigid,
    Sphere,
    SquarePunch,
    make_path,
    solve_contact,
    solve_path,
)
from contactmodel.elasticity.compliance import pair_compliance
from contactmodel.solver.first_approach import estimate_approach

GRID = Grid((24, 24), (10.0, 10.0))
BODIES = HalfSpace(1.0, 0.4), HalfSpace(3.0, 0.3), Paraboloid(30.0)
CONTACT = Contact(*BODIES, GRID, 0.5)
TOUCHING = Pose(0.2)
MOVED = Pose(0.3, (0.02, 0.03), 0.04)


@pytest.fixture(scope="module")
def moved():
    return solve_contact(CONTACT, MOVED)


def carried_by(contact):
    return Resultants(-contact.force[2], contact.force[:2], contact.moment)


def test_given_resultants_reproduce_their_motion(moved):
    found = solve_contact(CONTACT, TOUCHING, carried_by(moved))
    # tolerance of the resultants, 1e-7 of what friction carries
    np.testing.assert_allclose(found.pose.approach, 0.3, rtol=1e-6)
    np.testing.assert_allclose(found.pose.shift, [0.02, 0.03], rtol=1e-5)
    np.testing.assert_allclose(found.pose.twist, 0.04, rtol=1e-5)
    np.testing.assert_allclose(found.force, moved.force, rtol=1e-6)


def test_history_and_reversal(moved):
    back = solve_contact(CONTACT, MOVED, Resultants(moment=-0.5 * moved.moment), previous=moved)
    assert float(back.moment) == pytest.approx(-0.5 * float(moved.moment), rel=1e-6)
    again = solve_contact(CONTACT, back.pose, previous=moved)
    assert float(again.moment) == pytest.approx(float(back.moment), rel=1e-7)
    assert float(back.pose.twist) < 0.03


def test_a_path_of_given_moments_reproduces_the_motion_and_its_history():
    """Through a reversal, at a given normal force: the same moments at another twist."""
    poses = [Pose(0.3), Pose(0.3, twist=0.06), Pose(0.3, twist=0.0)]
    path = make_path(poses, [2, 2])
    moved = solve_path(CONTACT, path)
    guess = Pose(jnp.full(4, 0.2))
    found = solve_path(
        CONTACT,
        guess,
        Resultants(normal_force=-moved.force[:, 2], moment=moved.moment),
    )
    assert abs(float(moved.moment[1] - moved.moment[2])) > 1e-2
    # tolerance of the resultants, 1e-7 of what friction carries, over their slope
    np.testing.assert_allclose(found.pose.twist, path.twist, atol=1e-6)
    np.testing.assert_allclose(found.pose.approach, path.approach, rtol=1e-6)
    np.testing.assert_allclose(found.pose.shift, 0.0)


@pytest.mark.parametrize("approach", [-3.0, 0.0, 1e-9, 10.0, 1e4])
def test_any_approach_will_do_to_begin_with(moved, approach):
    found = solve_contact(CONTACT, Pose(approach), carried_by(moved))
    assert bool(found.result == RESULTS.successful)
    np.testing.assert_allclose(found.pose.approach, 0.3, rtol=1e-6)  # as above
    np.testing.assert_allclose(found.pose.twist, 0.04, rtol=1e-5)


@pytest.mark.parametrize(
    "shape",
    [
        Domed(Placed(Sphere(20.0), (1.0, 1.0)), 30.0),  # touches first at 0.02 mm
        SquarePunch(4.0, 0.5),
        Paraboloid(30.0),
    ],
    ids=["domed", "punch", "paraboloid"],
)
@pytest.mark.parametrize("force", [1e-6, 1.0, 4.0])
def test_the_estimated_approach_is_near(shape, force):
    """The force there is of the right size; as maps, without friction, all are compiled once."""
    map_ = HeightMap(3.0 + shape.height(jnp.asarray(GRID.points)), GRID.spacing)
    pair = pair_compliance(*BODIES[:2], GRID, smooth=True)
    lowest, approach = estimate_approach(pair, map_.heights, GRID, jnp.asarray(force))
    assert 3.0 <= float(lowest) < float(approach)
    found = solve_contact(Contact(*BODIES[:2], map_, GRID, 0.0), Pose(approach))
    # exact for a paraboloid; a flat face, all of whose overlap touches, is √2 stiffer
    assert 0.7 * force < -float(found.force[2]) < 1.5 * force


def test_a_path_of_forces_begins_and_ends_out_of_touch():
    force = jnp.asarray([0.0, 3.0, 1.0, 0.0, 2.0])
    found = solve_path(
        CONTACT,
        Pose(jnp.zeros(5)),
        Resultants(normal_force=force, moment=jnp.zeros(5)),
    )
    np.testing.assert_allclose(-found.force[:, 2], force, rtol=1e-7)  # of the solver
    apart = np.asarray(found.result == RESULTS.no_contact)
    assert apart.tolist() == [True, False, False, True, False]
    with pytest.raises(RuntimeError, match=r"step 1 of the path: .*do not touch"):
        solve_path(
            CONTACT,
            Pose(jnp.zeros(2)),
            Resultants(normal_force=0.0, moment=jnp.arange(2.0)),
        )


def test_bodies_that_do_not_touch_carry_no_moment():
    pose = Pose(0.0, linear=True)
    short = solve_contact(CONTACT, pose, Resultants(moment=1.0), throw=False)
    assert bool(short.result == RESULTS.out_of_touch)
    with pytest.raises(RuntimeError, match="do not touch"):
        solve_contact(CONTACT, pose, Resultants(moment=1.0))


def test_more_force_and_moment_than_friction_carries_is_refused(moved):
    given = {"normal_force": -moved.force[2], "moment": 0.0}
    for shear in ((1e3, 0.0), -0.51 * moved.force[2] * jnp.asarray([0.6, 0.8])):
        with pytest.raises(RuntimeError, match="friction cannot carry"):
            solve_contact(CONTACT, Pose(0.0), Resultants(shear_force=shear, **given))
    with pytest.raises(ValueError, match="must not be below 0 N"):
        solve_contact(CONTACT, Pose(0.0), Resultants(normal_force=-1.0))


@pytest.mark.parametrize(
    ("path", "given", "words"),
    [
        (TOUCHING, {"moment": 1.0}, "expected a path"),
        (Pose(jnp.ones(3)), {"moment": jnp.ones(2)}, r"moment of the path must have the shape \(3"),
        (Pose(jnp.ones(3)), {"shear_force": jnp.ones(3)}, "shear_force of the path"),
        (Pose(jnp.ones(3)), {}, "at least one of"),
    ],
)
def test_wrong_paths_of_resultants_are_refused(path, given, words):
    with pytest.raises(ValueError, match=words):
        solve_path(CONTACT, path, Resultants(**given))


def test_more_than_friction_carries_says_how_much():
    pose = Pose(0.3, linear=True)
    largest = solve_contact(CONTACT, Pose(0.3, twist=3.0, linear=True)).moment
    short = solve_contact(CONTACT, pose, Resultants(moment=2.0 * largest), throw=False)
    assert bool(short.result == RESULTS.beyond_friction)
    assert float(short.moment) == pytest.approx(float(largest), rel=1e-4)  # all slides
    with pytest.raises(RuntimeError, match=f"moment of {float(short.moment):.4g}"):
        solve_contact(CONTACT, pose, Resultants(moment=2.0 * largest))
    nearly = solve_contact(CONTACT, pose, Resultants(moment=0.99 * largest))
    assert float(nearly.moment) == pytest.approx(0.99 * float(largest), rel=1e-6)


@pytest.mark.parametrize("approach", [0.05, 0.25, 3.0])  # 0.31 mm carry the force
def test_friction_is_judged_under_the_given_force(moved, approach):
    """A first guess at another load neither refuses what friction carries nor moves its limit."""
    force = -moved.force[2]
    largest = solve_contact(CONTACT, Pose(0.3, twist=0.5)).moment  # all slides
    for share in (0.8, 10.0):
        given = Resultants(normal_force=force, moment=share * largest)
        found = solve_contact(CONTACT, Pose(approach), given, throw=False)
        expected = RESULTS.successful if share < 1.0 else RESULTS.beyond_friction
        assert bool(found.result == expected)
        # unlike half-spaces: the force follows the slip by 2 %, and the moment as its 4/3 power
        assert float(-found.force[2]) == pytest.approx(float(force), rel=0.02)
        assert float(found.moment) == pytest.approx(min(share, 1.0) * float(largest), rel=0.03)


def test_derivatives_by_resultants_and_materials():
    @jax.jit
    @jax.value_and_grad  # one program for the differences as well
    def twist(values, start):
        modulus, moment, force = values
        bodies = HalfSpace(modulus, 0.5), Rigid(), Paraboloid(30.0)
        found = solve_contact(
            Contact(*bodies, GRID, 0.5),
            Pose(start),
            Resultants(moment=moment, normal_force=force),
            rtol=1e-10,
        )
        return found.pose.twist

    values = jnp.asarray([1.0, 2.0, 5.0])
    gradient = twist(values, 0.2)[1]
    np.testing.assert_allclose(twist(values, -1.0)[1], gradient, rtol=1e-6)  # it forgets its start
    for i in range(3):
        step = jnp.zeros(3).at[i].set(1e-5)
        difference = (twist(values + step, 0.2)[0] - twist(values - step, 0.2)[0]) / 2e-5
        # 1e-9 of the resultants over the step
        assert float(gradient[i]) == pytest.approx(float(difference), rel=2e-4)


@pytest.mark.parametrize(
    ("given", "mu", "words"),
    [
        ({}, 0.5, "at least one of"),
        ({"moment": 1.0}, 0.0, "without friction"),
        ({"shear_force": (1.0, 0.0)}, 0.0, "without friction"),
        ({"moment": np.nan}, 0.5, "finite"),
    ],
)
def test_wrong_resultants_are_refused(given, mu, words):
    with pytest.raises(ValueError, match=words):
        solve_contact(Contact(*BODIES, GRID, mu), TOUCHING, Resultants(**given))
