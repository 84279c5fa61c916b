"""One step of a contact: what it remembers, what is solved for, and what follows from that.

Above the elastomer's point X, where the slip is s and the object has turned by R, is the object's
point X − R⁻¹ s. Where the object's shape goes along as it slides, a step takes the heights from
there, with the slip of the step before.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from contactmodel.common.turning import to_space, turn
from contactmodel.elasticity.compliance import Compliance
from contactmodel.friction import AbstractFriction
from contactmodel.grid import Grid, make_points
from contactmodel.indenters import AbstractIndenter
from contactmodel.pose import Pose
from contactmodel.solver.alternating import Tractions
from contactmodel.solver.friction import find_sliding
from contactmodel.solver.linear import Iterations
from contactmodel.solver.normal import guess_pressure
from contactmodel.solver.results import RESULTS
from contactmodel.solver.tangent import Load


class Earlier(NamedTuple):
    """The step before the last."""

    pose: Pose
    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]


class Memory(NamedTuple):
    """What a step needs of the one before; `earlier` is used to guess where it leads.

    Attributes:
        begun: whether there was one; else the object rests before it touches.
    """

    begun: Bool[Array, ""]
    pose: Pose
    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    slip: Float[Array, "2 nx ny"]
    dissipated_energy: Float[Array, ""]
    earlier: Earlier


class Step(NamedTuple):
    """What a step adds to a solution; the names are those of `ContactSolution`."""

    pose: Pose
    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    gap: Float[Array, "nx ny"]
    sliding: Bool[Array, "nx ny"]
    slip: Float[Array, "2 nx ny"]
    slip_increment: Float[Array, "2 nx ny"]
    dissipated_energy: Float[Array, ""]
    result: RESULTS  # pyright: ignore[reportInvalidTypeForm]
    normal: Iterations
    friction: Iterations


class Problem(NamedTuple):
    """A step before it is solved: what its solution can be differentiated by.

    Attributes:
        compliance: of the pair.
        friction: between the bodies.
        height: of the object's shape on the grid [mm].
        pose: of the object.
        last: the step before.
    """

    compliance: Compliance
    friction: AbstractFriction
    height: Float[Array, "nx ny"]
    pose: Pose
    last: Memory


class How(NamedTuple):
    """How a step is solved.

    Attributes:
        grid: cells.
        smooth: whether there is no friction.
        coarse_first: whether the pressure begins on a coarser grid, not with that before.
        rtol: tolerance on the residuals [-].
        max_steps: of each of the solvers.
    """

    grid: Grid
    smooth: bool
    coarse_first: bool
    rtol: Float[Array, ""]
    max_steps: Int[Array, ""]


def rest(pose: Pose, grid: Grid) -> Memory:
    """What there is before the first of some poses: nothing."""
    dtype = pose.approach.dtype
    zero, none = jnp.zeros((), dtype), jnp.zeros(grid.shape, dtype)
    still = jnp.zeros((2, *grid.shape), dtype)
    centre = pose.centre.reshape(-1, 2)[0]
    parts = (zero, jnp.zeros(2, dtype), zero, centre)  # not by `Pose`, which would check them
    before = eqx.tree_at(lambda p: (p.approach, p.shift, p.twist, p.centre), pose, parts)
    earlier = Earlier(before, none, still)
    return Memory(jnp.zeros((), bool), before, none, still, still, zero, earlier)


def remember(step: Step, last: Memory | None = None) -> Memory:
    """What the next step needs of one.

    Args:
        step: that one.
        last: what there was before it; without, the next step begins where this one ended.
    """
    before = step if last is None else last
    earlier = Earlier(before.pose, before.pressure, before.traction)
    return Memory(
        jnp.ones((), bool),
        step.pose,
        step.pressure,
        step.traction,
        step.slip,
        step.dissipated_energy,
        jax.lax.stop_gradient(earlier),
    )


def find_heights(
    indenter: AbstractIndenter, grid: Grid, dtype: np.dtype, slid_by: Memory | None
) -> Float[Array, "nx ny"]:
    """The object's shape on the grid [mm].

    Args:
        indenter: that shape.
        grid: cells.
        dtype: precision.
        slid_by: the step before, by whose slip the shape has gone along; None where it stays.
    """
    points = make_points(grid, dtype)
    if slid_by is None:
        return indenter.height(points)
    pose, slip = slid_by.pose, slid_by.slip
    if pose.corotated:
        moved = to_space(points, -slip, -jnp.flip(slip, (-2, -1)), jnp.zeros_like(pose.twist))
        return indenter.slid_height(points, points + moved)
    return indenter.slid_height(points, points - turn(slip, -pose.twist))


def make_load(problem: Problem, grid: Grid) -> Load:
    """What a step is solved for at the problem's pose."""
    pose, last = problem.pose, problem.last
    points = make_points(grid, last.pressure.dtype)
    gap = _leave_out_rounding(problem.height - pose.approach)
    if pose.corotated:  # its slip is a sum
        _, carried = problem.compliance.displace(last.pressure, last.traction)
    else:
        carried = last.pose.displacement(points) - last.slip  # u_S − u_B at the pose before
    motion = carried + pose.increment(last.pose, carried, points)
    return Load(gap, motion, problem.friction)


def start(problem: Problem, how: How) -> tuple[tuple[Array, Array], Iterations | None]:
    """Pressure and traction to begin with [MPa], and what finding them took."""
    gap = make_load(problem, how.grid).gap
    touching = jnp.any(gap < 0.0)  # else nothing is left of what was before
    pressure, traction = (jnp.where(touching, old, 0.0) for old in _extrapolate(problem, how.grid))
    if not how.coarse_first:
        return (pressure, traction), None
    guess, done = guess_pressure(problem.compliance, gap)
    return (guess, traction), done


def complete(problem: Problem, end: Tractions, how: How) -> Step:
    """What follows from pressure and traction, differentiable by all."""
    grid, last, pose = how.grid, problem.last, problem.pose
    points = make_points(grid, last.pressure.dtype)
    load, pressure, traction = make_load(problem, grid), end.pressure, end.traction
    compliance = problem.compliance
    if how.smooth:
        w, moved = compliance.press(pressure), compliance.pull(pressure)
    else:
        w, moved = compliance.displace(pressure, traction)
    slip = load.motion - moved
    limit = problem.friction.limit(pressure)
    friction_law = (compliance, traction, load.motion, slip, pressure, limit)
    return Step(
        pose=pose,
        pressure=pressure,
        traction=traction,
        gap=load.gap + w,
        sliding=find_sliding(*friction_law, how.rtol),
        slip=last.slip + slip if pose.corotated else pose.displacement(points) - moved,
        slip_increment=slip,
        dissipated_energy=last.dissipated_energy + jnp.sum(traction * slip) * grid.cell_area,
        result=_judge(end, how),
        normal=end.normal,
        friction=end.tangential,
    )


def _leave_out_rounding(gap: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
    """The gap at p = 0 [mm], without an overlap that is no more than the rounding of the gap.

    Bodies that just touch overlap by an ulp or not; no pressure can be solved for that.
    """
    rounding = 4.0 * jnp.finfo(gap.dtype).eps * jnp.max(jnp.abs(gap))
    return jnp.where(jnp.min(gap) < -rounding, gap, jnp.maximum(gap, 0.0))


def _extrapolate(problem: Problem, grid: Grid) -> tuple[Array, Array]:
    """Pressure and traction as they were, or farther as the object moves on.

    Not where it moves another way than in the step before, or presses: the contact's edge moves.
    """
    last, earlier = problem.last, problem.last.earlier

    def move(new: Pose, old: Pose) -> tuple[Array, Array]:
        turn = 0.5 * min(grid.size) * (new.twist - old.twist)
        return jnp.stack([*(new.shift - old.shift), turn]), new.approach - old.approach

    (now, press), (before, pressed) = move(problem.pose, last.pose), move(last.pose, earlier.pose)
    square = jnp.sum(before**2) + press**2 + pressed**2
    share = jnp.clip(jnp.sum(now * before) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return (
        jnp.maximum(last.pressure + share * (last.pressure - earlier.pressure), 0.0),
        last.traction + share * (last.traction - earlier.traction),
    )


def _judge(end: Tractions, how: How):
    """How a step ended; the gravest first."""
    contact = end.pressure > 0.0
    inside = jnp.any(contact[1:-1, 1:-1])
    edge = jnp.sum(contact) > jnp.sum(contact[1:-1, 1:-1])
    result = RESULTS.where(inside, RESULTS.successful, RESULTS.no_contact)
    apart = ~(end.normal.residual <= how.rtol)
    result = RESULTS.where(apart, RESULTS.coupling_max_turns, result)
    result = RESULTS.where(~end.rubbed, RESULTS.friction_max_steps, result)
    result = RESULTS.where(~end.pressed, RESULTS.normal_max_steps, result)
    return RESULTS.where(edge, RESULTS.at_the_edge, result)
