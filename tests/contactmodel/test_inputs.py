"""Poses, paths, grids and shapes as users write them, right and wrong."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    RESULTS,
    AbstractIndenter,
    Contact,
    Domed,
    Ellipsoid,
    Grid,
    HalfSpace,
    HeightMap,
    Layer,
    Paraboloid,
    Placed,
    Pose,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
    make_path,
    plots,
    solve_contact,
    solve_path,
)

GRID = Grid((32, 32), (10.0, 10.0))
PAD = HalfSpace(1.0, 0.5)
BALL = Paraboloid(30.0)


def solve(indenter=BALL, pose=None, **how):
    pose = pose or Pose(0.3, twist=0.05)
    return solve_contact(Contact(PAD, Rigid(), indenter, GRID, 0.5), pose, **how)


class _Shell(AbstractIndenter):
    """A sphere that has no height beside it."""

    radius: float

    def height(self, points):
        """Height of the lower half of the sphere [mm]; NaN beside it."""
        return self.radius - jnp.sqrt(self.radius**2 - jnp.sum(points**2, axis=0))


def test_an_indenter_without_a_height_somewhere_is_named():
    with pytest.raises(RuntimeError, match="height is NaN or infinite in a cell"):
        solve(_Shell(3.0))


@pytest.fixture(scope="module")
def path():
    """Three steps, so that a mix-up of steps and components cannot pass."""
    poses = [Pose(0.0), Pose(0.3), Pose(0.3, shift=(0.01, 0.02), twist=0.05)]
    return solve_path(Contact(PAD, Rigid(), BALL, GRID, 0.5), make_path(poses, [1, 2]))


def test_methods_of_a_path_are_those_of_its_steps(path):
    points = np.array([[0.3, -0.2], [6.0, 1.0]])
    fields = {
        "on the grid": lambda s: s.elastomer_displacement(),
        "at points": lambda s: s.elastomer_displacement_at(points),
        "rotation": lambda s: s.elastomer_rotation(),
    }
    for name, field in fields.items():
        steps = jnp.stack([field(path.at_step(i)) for i in range(3)])
        # rounding of sums over 32² cells in another order
        np.testing.assert_allclose(field(path), steps, atol=1e-13, err_msg=name)


def test_points_may_be_whole_numbers(path):
    last = path.at_step(-1)
    whole = last.elastomer_displacement_at(np.array([[1, -2], [0, 3]]))
    real = last.elastomer_displacement_at(np.array([[1.0, -2.0], [0.0, 3.0]]))
    np.testing.assert_array_equal(whole, real)


def test_what_is_given_once_holds_for_the_whole_path():
    held = Pose(0.3, twist=np.linspace(0.0, 0.1, 3), centre=(1.0, 0.0))
    np.testing.assert_array_equal(held.approach, [0.3, 0.3, 0.3])
    np.testing.assert_array_equal(held.centre, [[1.0, 0.0]] * 3)
    assert held.shift.shape == (3, 2)


def test_single_precision_only_if_every_number_is():
    assert Pose(jnp.float32(0.3), twist=0.1).approach.dtype == jnp.float64
    two = jnp.zeros(2, jnp.float32)
    single = Pose(jnp.float32(0.3), two, jnp.float32(0.1), two)
    assert single.approach.dtype == single.centre.dtype == jnp.float32


@pytest.mark.usefixtures("unchecked")
def test_a_grid_takes_lists():
    shape: Any = [32, 32]
    size: Any = [10, 10.0]
    assert Grid(shape, size) == GRID
    assert hash(Grid(shape, size)) == hash(GRID)


def refused() -> dict[str, tuple[Any, str]]:
    start, end = Pose(0.0), Pose(1.0)
    return {
        "fractional steps": (lambda n: make_path([start, end], [n]), "whole number from 1"),
        "steps from 1": (lambda _: make_path([start, end], [0]), "whole number from 1, got 0"),
        "no leg": (lambda _: make_path([start], []), "at least two poses"),
        "one leg too many": (lambda _: make_path([start, end], [1, 1]), "2 numbers of steps"),
        "shift": (lambda _: Pose(1.0, shift=(0.1,)), "two components"),
        "centre": (lambda _: Pose(1.0, centre=(0.0, 0.0, 0.0)), "two components"),
        "shapes": (lambda _: Pose(np.ones(3), twist=np.ones(2)), "same number of steps"),
        "no steps": (
            lambda _: solve_path(Contact(PAD, Rigid(), BALL, GRID, 0.5), Pose(np.ones(0))),
            "path",
        ),
        "base": (
            lambda depth: solve_path(
                Contact(Layer(0.2, poisson_ratio=0.5, thickness=2.0), Rigid(), BALL, GRID, 0.5),
                Pose(np.array([0.1, depth])),
            ),
            "an approach of 2.5 mm reaches the rigid base of a layer 2 mm thick",
        ),
        "cells": (lambda n: Grid((n, 8), (1.0, 1.0)), "whole numbers"),
        "three lengths": (lambda n: Grid((8, 8, *[8] * int(n)), (1.0, 1.0)), "x and y"),
        "round edge": (lambda _: RoundPunch(2.0, 5.0), "edge radius"),
        "square edge": (lambda _: SquarePunch(3.0, 1.6), "edge radius"),
        "two semi-axes": (lambda axis: Ellipsoid((axis, axis)), r"three semi-axes.* got \(2,\)"),
        "one spacing": (lambda step: HeightMap(np.zeros((3, 3)), step), "along x and y .* got 2.5"),
        "text": (lambda depth: Pose(str(depth)), "must be a finite number, got '2.5'"),
        "texts": (lambda depth: Pose([str(depth)]), "must be a finite number"),
        "text as radius": (lambda radius: Sphere(str(radius)), "must be a finite number"),
        "truth value": (lambda depth: Pose(depth > 0), "must be a finite number, got True"),
        "complex": (lambda depth: Pose(depth * 1j), "must be a finite number"),
        "none": (lambda _: Pose(None), "must be a finite number, got None"),
        "radius as shape": (
            lambda radius: Contact(PAD, Rigid(), radius, GRID, 0.5),
            r"the indenter: expected .* Sphere\(radius=20.0\), got one of type float",
        ),
        "moduli": (
            lambda G: Contact(HalfSpace([G, 1.0], poisson_ratio=0.5), Rigid(), BALL, GRID, 0.5),
            r"HalfSpace has a value of shape \(2,\).* by jax.vmap",
        ),
        "cells as grid": (
            lambda _: Contact(PAD, Rigid(), BALL, (8, 8), 0.5),
            "the grid: expected .* got one of type tuple",
        ),
        "force as number": (lambda force: solve(resultants=force), "such as Resultants"),
        "degrees": (lambda depth: solve(pose=Pose(depth, twist=10.0)), "changes by 10 rad"),
        "degrees in a path": (
            lambda depth: solve_path(
                Contact(PAD, Rigid(), BALL, GRID, 0.5),
                make_path([Pose(depth), Pose(depth, twist=90.0)], [45]),
            ),
            "changes by 2 rad in one step",
        ),
        "loose rtol": (lambda _: solve(rtol=10.0), "between 0 and 1, got 10"),
        "no rtol": (lambda _: solve(rtol=0.0), "between 0 and 1"),
        "NaN rtol": (lambda _: solve(rtol=np.nan), "between 0 and 1"),
    }


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("case", refused())
def test_wrong_inputs_are_refused(case):
    act, words = refused()[case]
    with pytest.raises(ValueError, match=words):
        act(2.5)


def test_wrong_values_inside_jit_keep_their_words():
    height = eqx.filter_jit(lambda edge: RoundPunch(2.0, edge).height(jnp.zeros(2)))
    assert float(height(1.0)) == 0.0
    with pytest.raises(RuntimeError, match="edge radius must not be above"):
        height(3.0)


@pytest.mark.parametrize("punch", [lambda e: RoundPunch(3.0, e), lambda e: SquarePunch(6.0, e)])
def test_a_sharp_edge_has_the_derivative_of_a_hardly_rounded_one(punch):
    """On the flat and on the side; the arc itself is 0 wide."""
    points = jnp.asarray([[0.0, 1.0, 2.9, 4.0], [0.0, 2.0, 0.0, 0.0]])
    slope = jax.jacfwd(lambda e: punch(e).height(points))(0.0)
    change = (punch(1e-3).height(points) - punch(0.0).height(points)) / 1e-3
    np.testing.assert_allclose(slope, change, atol=1e-9)  # both are linear there


@pytest.mark.parametrize("punch", [RoundPunch(3.0), SquarePunch(6.0), Sphere(20.0)])
def test_the_lowest_point_is_0(punch):
    assert float(punch.height(jnp.zeros(2))) == 0.0


def turned(twist, **how):
    return solve(pose=Pose(0.3, twist=twist), throw=False, **how)


def test_turns_in_degrees_are_reported_in_a_traced_program():
    far = jax.vmap(lambda twist: turned(twist).result == RESULTS.beyond_turn)
    assert far(jnp.array([0.5, 5.0])).tolist() == [False, True]
    assert jax.jit(far)(jnp.array([0.5, 5.0])).tolist() == [False, True]
    with pytest.raises(Exception, match="twist changes by 1 rad or more in one step"):
        eqx.filter_jit(lambda twist: solve(pose=Pose(0.3, twist=twist)))(5.0)
    with pytest.raises(RuntimeError, match="twist changes by 1 rad or more in one step"):
        jax.grad(lambda twist: solve(pose=Pose(0.3, twist=twist)).moment)(5.0)


def test_a_traced_path_reports_its_far_turn():
    def follow(end, previous=None):
        path = make_path([Pose(0.3, twist=0.8), Pose(0.3, twist=end)], [1])
        contact = Contact(PAD, Rigid(), BALL, GRID, 0.5)
        return (
            solve_path(contact, path, previous=previous, throw=False).result == RESULTS.beyond_turn
        )

    assert jax.jit(follow)(1.6).tolist() == [True]
    assert jax.jit(lambda end: follow(end, turned(0.8)))(1.6).tolist() == [False]


def test_a_traced_approach_to_the_base_is_reported():
    def press(approach):
        gel, grid = Layer(1.0, 0.48, thickness=2.0), Grid((24, 24), (40.0, 40.0))
        contact = Contact(gel, Rigid(), Sphere(20.0), grid, 0.5)
        return solve_contact(contact, Pose(approach), throw=False).result == RESULTS.beyond_base

    assert jax.vmap(press)(jnp.array([0.5, 2.5])).tolist() == [False, True]


class _Own(AbstractIndenter):
    kind: str = "numpy"

    def height(self, points):
        """Height in the wrong type or shape [mm]."""
        if self.kind == "numpy":
            return np.asarray(points[0]) ** 2
        return 0.3 if self.kind == "number" else jnp.ravel(points[0] ** 2)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("indenter", "words"),
    [
        (
            lambda: Sphere([20.0, 30.0]),
            r"radius of Sphere has a value of shape \(2,\), and",
        ),
        (lambda: Sphere(np.full(32, 20.0)), r"radius of Sphere has a value of shape \(32,\)"),
        (lambda: Domed(BALL, [9.0, 8.0]), "pad_radius of Domed has"),
        (lambda: Placed(Sphere([9.0, 8.0])), "radius of Sphere has"),
        (lambda: _Own(), "shape _Own cannot be computed.* with jax.numpy, not numpy"),
        (lambda: _Own("number"), r"heights of shape \(\) at points of shape \(2, 32, 32\)"),
        (lambda: _Own("flat"), r"heights of shape \(1024,\) at points"),
    ],
)
def test_a_shape_without_one_height_for_each_cell_is_refused(indenter, words):
    with pytest.raises(ValueError, match=words):
        solve(indenter())


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: make_path([Pose(0.0), Pose(1.0)], 5), "a list with a number for each leg, got 5"),
        (lambda: solve(previous=Pose(0.3)), "previous: expected an object such as solve_contact"),
        (
            lambda: solve_path(Contact(PAD, Rigid(), BALL, GRID, 0.5), [Pose(0.3)]),
            "such as make_path",
        ),
    ],
)
def test_other_objects_than_paths_and_solutions_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_figures_of_one_step_and_of_a_path_are_not_mixed_up(path):
    with pytest.raises(ValueError, match=r"this is a path: .*at_step\(-1\)"):
        plots.plot_states(path)
    with pytest.raises(ValueError, match="this is a single solution"):
        plots.plot_path(path.at_step(-1))
    assert plots.plot_states(path.at_step(-1)).axes
    assert plots.plot_path(path).axes
