"""One step of a contact: its memory, its problem and its results.

If the slip is s and the object has turned by R, the object's point X − R⁻¹ s is above the
elastomer's point X. If the object's shape moves as it slides, a step takes the heights at these
points, with the slip of the previous step.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.common.arrays import declared_arrays
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
    """State after the previous step; `earlier` is used to extrapolate the initial guess.

    Attributes:
        begun: whether there was a previous step; otherwise the object is at rest, before contact.
    """

    begun: Bool[Array, ""]
    pose: Pose
    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    slip: Float[Array, "2 nx ny"]
    dissipated_energy: Float[Array, ""]
    earlier: Earlier


class Step(NamedTuple):
    """Results of a step; the names are those of `ContactSolution`."""

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
    """Problem of a step; its solution can be differentiated by all of these."""

    compliance: Compliance  # compliance of the pair
    friction: AbstractFriction  # friction law between the bodies
    height: Float[Array, "nx ny"]  # height of the object's shape on the grid [mm]
    pose: Pose  # pose of the object
    last: Memory  # state after the previous step


class How(NamedTuple):
    """Settings of a step's solvers."""

    grid: Grid  # cells
    smooth: bool  # whether there is no friction
    # whether the pressure starts from a solve on a coarser grid instead of the previous pressure
    coarse_first: bool
    rtol: Float[Array, ""]  # tolerance of the residuals [-]
    max_steps: Int[Array, ""]  # largest number of iterations of each solver


def rest(pose: Pose, grid: Grid) -> Memory:
    """State before the first pose: at rest, without pressure, traction or slip."""
    dtype = pose.approach.dtype
    zero, pressure = jnp.zeros((), dtype), jnp.zeros(grid.shape, dtype)
    still = jnp.zeros((2, *grid.shape), dtype)
    centre = pose.centre.reshape(-1, 2)[0]
    parts = (zero, jnp.zeros(2, dtype), zero, centre)  # not by `Pose`, which would check them
    before = eqx.tree_at(lambda p: (p.approach, p.shift, p.twist, p.centre), pose, parts)
    earlier = Earlier(before, pressure, still)
    return Memory(jnp.zeros((), bool), before, pressure, still, still, zero, earlier)


def remember(step: Step, last: Memory | None = None) -> Memory:
    """State after a step for the next one, which extrapolates if the state before is known too."""
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
    """Height of the object's shape on the grid [mm].

    Args:
        indenter: shape of the object.
        grid: cells.
        dtype: floating-point type of the result, whatever that of the shape.
        slid_by: state after the previous step, by whose slip the shape has moved; None if the
            shape does not move.

    Raises:
        ValueError: the shape does not give one height for each cell.
    """
    points = make_points(grid, dtype)
    _check_sizes(indenter)
    try:
        height = jnp.asarray(_height(indenter, points, slid_by), dtype)
    except (TypeError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(
            f"the height of the shape {type(indenter).__name__} cannot be computed: {reason}. "
            "Write `height(self, points)` with jax.numpy, not numpy, for points of shape "
            f"{points.shape}"
        ) from error
    if height.shape != grid.shape:
        raise ValueError(
            f"the shape {type(indenter).__name__} has heights of shape {height.shape} at points of "
            f"shape {points.shape}: return one for each, in the shape {grid.shape}"
        )
    return height


def _check_sizes(indenter: AbstractIndenter) -> None:
    """Reject several values of a size, which could also be taken for those of rows of cells."""
    for name, kind in declared_arrays(type(indenter)).items():
        shape = jnp.shape(getattr(indenter, name))
        if kind.dims == () and shape:
            raise ValueError(
                f"{name} of {type(indenter).__name__} has a value of shape {shape}, and a contact "
                "takes one number: solve several contacts by jax.vmap or jax.lax.map"
            )
    for part in vars(indenter).values():
        if isinstance(part, AbstractIndenter):
            _check_sizes(part)


def _height(
    indenter: AbstractIndenter, points: Float[Array, "2 nx ny"], slid_by: Memory | None
) -> ArrayLike:
    """Height of the shape at points [mm], after it has moved by the slip of a step before."""
    if slid_by is None:
        return indenter.height(points)
    pose, slip = slid_by.pose, slid_by.slip
    if pose.corotated:
        moved = to_space(points, -slip, -jnp.flip(slip, (-2, -1)), jnp.zeros_like(pose.twist))
    else:
        moved = -turn(slip, -pose.twist)
    return indenter.slid_height(points, points + moved)


def make_load(problem: Problem, grid: Grid) -> Load:
    """Load of a step at the problem's pose."""
    pose, last = problem.pose, problem.last
    points = make_points(grid, last.pressure.dtype)
    gap = _leave_out_rounding(problem.height - pose.approach)
    if pose.corotated:  # the slip is a sum of increments
        _, carried = problem.compliance.displace(last.pressure, last.traction)
    else:
        carried = last.pose.displacement(points) - last.slip  # u_S − u_B at the pose before
    motion = carried + pose.increment(last.pose, carried, points)
    return Load(gap, motion, problem.friction)


def start(problem: Problem, how: How) -> tuple[tuple[Array, Array], Iterations | None]:
    """Initial pressure and traction [MPa], and the iterations of the coarse solve, if any."""
    gap = make_load(problem, how.grid).gap
    touching = jnp.any(gap < 0.0)  # without overlap, start from 0
    pressure, traction = (jnp.where(touching, old, 0.0) for old in _extrapolate(problem, how.grid))
    if not how.coarse_first:
        return (pressure, traction), None
    guess, done = guess_pressure(problem.compliance, gap)
    return (guess, traction), done


def complete(problem: Problem, end: Tractions, how: How) -> Step:
    """Results of a step from its pressure and traction, differentiable by the problem."""
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
        result=_judge(problem.height, end, how),
        normal=end.normal,
        friction=end.tangential,
    )


def _leave_out_rounding(gap: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
    """The gap at p = 0, without overlaps within rounding [mm].

    Bodies that just touch may overlap by an ulp; no pressure can be solved for such an overlap.
    """
    rounding = 4.0 * jnp.finfo(gap.dtype).eps * jnp.max(jnp.abs(gap))
    return jnp.where(jnp.min(gap) < -rounding, gap, jnp.maximum(gap, 0.0))


def _extrapolate(problem: Problem, grid: Grid) -> tuple[Array, Array]:
    """Previous pressure and traction, extrapolated if the object continues its motion.

    They are not extrapolated if the direction changes, or if the approach changes, because then
    the contact's edge moves.
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


def _judge(height: Float[Array, "nx ny"], end: Tractions, how: How):
    """Result of a step; the most serious failure takes precedence."""
    contact = end.pressure > 0.0
    inside = jnp.any(contact[1:-1, 1:-1])
    edge = jnp.sum(contact) > jnp.sum(contact[1:-1, 1:-1])
    result = RESULTS.where(inside, RESULTS.successful, RESULTS.no_contact)
    apart = ~(end.normal.residual <= how.rtol)
    result = RESULTS.where(apart, RESULTS.coupling_max_turns, result)
    result = RESULTS.where(~end.rubbed, RESULTS.friction_max_steps, result)
    result = RESULTS.where(~end.pressed, RESULTS.normal_max_steps, result)
    result = RESULTS.where(edge, RESULTS.at_the_edge, result)
    return RESULTS.where(jnp.all(jnp.isfinite(height)), result, RESULTS.no_height)
