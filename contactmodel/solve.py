"""Solve a contact for one pose or along a path of poses, pressure and friction together."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.arrays import is_traced
from contactmodel.bodies import AbstractBody, Rigid
from contactmodel.checks import non_negative
from contactmodel.compliance import Compliance, pair_compliance
from contactmodel.coupling import Tractions, solve_smooth, solve_tractions
from contactmodel.friction import find_sliding
from contactmodel.grid import Grid, make_points
from contactmodel.indenters import AbstractIndenter
from contactmodel.joint import Load
from contactmodel.linear import Iterations
from contactmodel.normal import guess_pressure, is_large
from contactmodel.pose import Pose
from contactmodel.solution import RESULTS, ContactSolution

_SINGLE_PRECISION_FLOOR = 1e-5  # of the residuals; rounding leaves them at 1e-6 to 5e-6


def solve_contact(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    pose: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    previous: ContactSolution | None = None,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Press an object onto an elastomer, then shift and twist it.

    Pressure and friction act on each other unless the bodies have the same (1−2ν)/G, a rigid
    object on an incompressible half-space among them; both are solved together (`coupling`).

    Derivatives are first ones, on the cells that touch, stick and slide: a second derivative misses
    what their change adds, and so does a first one where only the contact's edge moves, as of the
    moment with respect to the approach under full stick.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape.
        pose: how B has moved since it touched.
        grid: cells, more than cover the contact.
        friction_coefficient: μ, a number or a map of the grid [-].
        previous: the contact before this step; the friction depends on it. Without it, the object
            is pressed and moved from rest in one step. To press first and move then, solve both
            in turn: it differs if pressing causes slip.
        rtol: on the residuals of pressure and traction (see `normal`, `friction`) [-].
        max_steps: of each of the two solvers.
        throw: whether a failure raises; else it is only told by `result`.

    Raises:
        ValueError: shapes that do not fit, or a tolerance below what the precision can reach.
        RuntimeError: a failure.
    """
    friction = non_negative(friction_coefficient)
    solution = find_contact(
        elastomer, object_, indenter, pose, grid, friction, previous, rtol, max_steps
    )
    return raise_failure(solution) if throw else solution


def find_contact(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    pose: Pose,
    grid: Grid,
    friction: Float[Array, "..."],
    previous: ContactSolution | None,
    rtol: float,
    max_steps: int,
) -> ContactSolution:
    """`solve_contact` for friction coefficients that have been checked; failures are in `result`.

    Compiled programs of it call nothing on the host, as checks of unknown numbers would, so that
    JAX's compilation cache keeps them.

    Raises:
        ValueError: shapes that do not fit, or a tolerance below what the precision can reach.
    """
    _check(elastomer, object_, pose, grid, friction, rtol, path=False)
    task = _prepare(elastomer, object_, grid, friction, rtol, max_steps)
    last = _remember(previous, pose, grid)
    height = _find_heights(indenter, grid, pose.approach.dtype)
    step = _solve_one(task, height, pose, last, is_large(grid) and previous is None)
    return _gather(elastomer, object_, task, step)


def solve_path(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    path: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    previous: ContactSolution | None = None,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Solve a contact along a path of poses, each step starting from the one before.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape.
        path: poses, the steps along the first axis (`make_path`).
        grid: cells, more than cover the contact.
        friction_coefficient: μ, a number or a map of the grid [-].
        previous: the contact before the path; without it, the path starts from rest.
        rtol: as for `solve_contact`.
        max_steps: as for `solve_contact`.
        throw: as for `solve_contact`.

    Returns:
        The contacts; every array has the steps as its first axis, materials and μ excepted.

    Raises:
        ValueError: as for `solve_contact`.
        RuntimeError: a failure in any step.
    """
    friction = non_negative(friction_coefficient)
    _check(elastomer, object_, path, grid, friction, rtol, path=True)
    task = _prepare(elastomer, object_, grid, friction, rtol, max_steps)
    height = _find_heights(indenter, grid, path.approach.dtype)
    steps = _solve_all(task, height, path, _remember(previous, path, grid))
    solution = _gather(elastomer, object_, task, steps)
    return raise_failure(solution) if throw else solution


class _Earlier(NamedTuple):
    """The step before the last."""

    pose: Pose
    pressure: Array
    traction: Array


class _Memory(NamedTuple):
    """What the next step needs of the one before; `earlier` is used to guess where it leads."""

    pose: Pose
    pressure: Array
    traction: Array
    slip: Array
    dissipated_energy: Array
    earlier: _Earlier | None = None


class _Step(NamedTuple):
    """What a step adds to a solution; the names are those of `ContactSolution`."""

    pose: Pose
    pressure: Array
    traction: Array
    gap: Array
    sliding: Array
    slip: Array
    slip_increment: Array
    dissipated_energy: Array
    result: RESULTS  # pyright: ignore[reportInvalidTypeForm]
    normal: Iterations
    friction: Iterations


class _Task(NamedTuple):
    """What all steps have in common; `smooth` without friction."""

    compliance: Compliance
    friction: Array
    grid: Grid
    smooth: bool
    rtol: float
    max_steps: int


def _prepare(
    elastomer: AbstractBody,
    object_: AbstractBody,
    grid: Grid,
    friction: Float[Array, "..."],
    rtol: float,
    max_steps: int,
) -> _Task:
    smooth = not is_traced(friction) and not np.any(np.asarray(friction))
    compliance = pair_compliance(elastomer, object_, grid, smooth=smooth)
    return _Task(compliance, friction, grid, smooth, rtol, max_steps)


@eqx.filter_jit
def _find_heights(indenter: AbstractIndenter, grid: Grid, dtype: np.dtype) -> Float[Array, "nx ny"]:
    """The object's shape on the grid [mm], apart from the solver: one program solves all shapes."""
    return indenter.height(make_points(grid, dtype))


@eqx.filter_jit
def _solve_one(
    task: _Task, height: Float[Array, "nx ny"], pose: Pose, last: _Memory, guess: bool
) -> _Step:
    return _step(task, height, pose, last, guess)


@eqx.filter_jit
def _solve_all(task: _Task, height: Float[Array, "nx ny"], path: Pose, last: _Memory) -> _Step:
    def advance(last: _Memory, pose: Pose) -> tuple[_Memory, _Step]:
        step = _step(task, height, pose, last, guess=False)
        earlier = jax.lax.stop_gradient(_Earlier(last.pose, last.pressure, last.traction))
        return _recall(step)._replace(earlier=earlier), step

    none = jnp.zeros_like
    still = _Earlier(last.pose, none(last.pressure), none(last.traction))
    return jax.lax.scan(advance, last._replace(earlier=still), path)[1]


def _recall(step: "_Step | ContactSolution") -> _Memory:
    """What the next step needs of this one."""
    return _Memory(step.pose, step.pressure, step.traction, step.slip, step.dissipated_energy)


def _gather(
    elastomer: AbstractBody, object_: AbstractBody, task: _Task, step: _Step
) -> ContactSolution:
    """The solution of a step, or of many."""
    return ContactSolution(
        grid=task.grid,
        elastomer=elastomer,
        object_=object_,
        friction_coefficient=task.friction,
        **step._asdict(),
    )


def _step(
    task: _Task, height: Float[Array, "nx ny"], pose: Pose, last: _Memory, guess: bool
) -> _Step:
    """The contact at a pose, from the one before; the pressure from a guess or the last one."""
    grid, rtol = task.grid, task.rtol
    compliance, friction = _in_precision_of((task.compliance, task.friction), pose)
    points = make_points(grid, last.pressure.dtype)
    undeformed = _leave_out_rounding(_in_precision_of(height - pose.approach, pose))
    carried = last.pose.displacement(points) - last.slip  # u_S − u_B at the pose before
    motion = carried + pose.increment(last.pose, carried, points)
    how = {"rtol": rtol, "max_steps": task.max_steps}
    touching, before = jnp.any(undeformed < 0.0), None  # else nothing is left of what was carried
    start, rubbed = (jnp.where(touching, old, 0.0) for old in _extrapolate(last, pose, grid))
    if guess:
        start, before = guess_pressure(compliance, undeformed)
    if task.smooth:
        end = solve_smooth(compliance, undeformed, start=start, **how)
    else:
        load = Load(undeformed, motion, friction)
        end = solve_tractions(compliance, load, start=(start, rubbed), **how)
    pressure, traction = end.pressure, end.traction
    if task.smooth:
        w, moved = compliance.press(pressure), compliance.pull(pressure)
    else:
        w, moved = compliance.displace(pressure, traction)
    increment = motion - moved
    sliding = find_sliding(
        compliance, traction, motion, increment, pressure, friction * pressure, rtol
    )
    return _Step(
        pose=pose,
        pressure=pressure,
        traction=traction,
        gap=undeformed + w,
        sliding=sliding,
        slip=pose.displacement(points) - moved,
        slip_increment=increment,
        dissipated_energy=last.dissipated_energy + jnp.sum(traction * increment) * grid.cell_area,
        result=_judge(end, rtol),
        normal=end.normal if before is None else end.normal.after(before),
        friction=end.tangential,
    )


def _leave_out_rounding(gap: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
    """The gap at p = 0 [mm], without an overlap that is no more than the rounding of the gap.

    Bodies that just touch overlap by an ulp or not; no pressure can be solved for that.
    """
    rounding = 4.0 * jnp.finfo(gap.dtype).eps * jnp.max(jnp.abs(gap))
    return jnp.where(jnp.min(gap) < -rounding, gap, jnp.maximum(gap, 0.0))


def _extrapolate(last: _Memory, pose: Pose, grid: Grid) -> tuple[Array, Array]:
    """Pressure and traction to begin with: as they were, or farther as the object moves on.

    Not where it moves another way than in the step before, or presses: the contact's edge moves.
    """
    if last.earlier is None:
        return last.pressure, last.traction

    def move(new: Pose, old: Pose) -> tuple[Array, Array]:
        turn = 0.5 * min(grid.size) * (new.twist - old.twist)
        return jnp.stack([*(new.shift - old.shift), turn]), new.approach - old.approach

    (now, press), (before, pressed) = move(pose, last.pose), move(last.pose, last.earlier.pose)
    square = jnp.sum(before**2) + press**2 + pressed**2
    share = jnp.clip(jnp.sum(now * before) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return (
        jnp.maximum(last.pressure + share * (last.pressure - last.earlier.pressure), 0.0),
        last.traction + share * (last.traction - last.earlier.traction),
    )


def _in_precision_of(tree: Any, pose: Pose) -> Any:
    """The arrays of a tree in the precision of the pose, which is that of the solution."""
    return jax.tree.map(lambda leaf: leaf.astype(pose.approach.dtype), tree)


def _judge(end: Tractions, rtol: float):
    """How a step ended; the gravest first."""
    contact = end.pressure > 0.0
    inside = jnp.any(contact[1:-1, 1:-1])
    edge = jnp.sum(contact) > jnp.sum(contact[1:-1, 1:-1])
    result = RESULTS.where(inside, RESULTS.successful, RESULTS.no_contact)
    apart = ~(end.normal.residual <= rtol)
    result = RESULTS.where(apart, RESULTS.coupling_max_turns, result)
    result = RESULTS.where(~end.rubbed, RESULTS.friction_max_steps, result)
    result = RESULTS.where(~end.pressed, RESULTS.normal_max_steps, result)
    return RESULTS.where(edge, RESULTS.at_the_edge, result)


def raise_failure(solution: ContactSolution) -> ContactSolution:
    """Raise what `result` says, now or, inside `jit`, when the program runs."""
    result = solution.result
    failed = (result != RESULTS.successful) & (result != RESULTS.no_contact)
    if not is_traced(failed) and not np.any(failed):
        return solution
    first = jnp.argmax(failed)
    worst = jax.tree.map(lambda value: jnp.reshape(value, -1)[first], result)
    if is_traced(failed):
        dynamic, static = eqx.partition(solution, eqx.is_inexact_array)
        return eqx.combine(worst.error_if(dynamic, jnp.any(failed)), static)
    step = f"step {int(first)} of the path: " if failed.ndim else ""
    raise RuntimeError(step + RESULTS[worst])


def _remember(previous: ContactSolution | None, pose: Pose, grid: Grid) -> _Memory:
    """What is left of the contact before; nothing if there was none."""
    if previous is None:
        dtype = pose.approach.dtype
        none, still = jnp.zeros(grid.shape, dtype), jnp.zeros((2, *grid.shape), dtype)
        zero = jnp.zeros((), dtype)
        first = jnp.asarray(pose.centre, dtype).reshape(-1, 2)[0]
        parts = (zero, jnp.zeros(2, dtype), zero, first)
        rest = eqx.tree_at(lambda p: (p.approach, p.shift, p.twist, p.centre), pose, parts)
        return _Memory(rest, none, still, still, zero)
    if previous.grid != grid:
        raise ValueError(f"the contact before has the {previous.grid}, this one the {grid}")
    if previous.pressure.ndim != 2:
        raise ValueError("previous is a path; take its last step: jax.tree.map(lambda x: x[-1], …)")
    if previous.pose.linear != pose.linear:
        raise ValueError("this pose and the one before must both be linear, or neither")
    return _recall(previous)


def _check(
    elastomer: AbstractBody,
    object_: AbstractBody,
    pose: Pose,
    grid: Grid,
    friction: Float[Array, "..."],
    rtol: float,
    *,
    path: bool,
) -> None:
    """Shapes and precision, known before anything runs."""
    if isinstance(elastomer, Rigid) and isinstance(object_, Rigid):
        raise ValueError("both bodies are rigid; one has to give way")
    if not 0.0 < rtol < 1.0:
        raise ValueError(f"rtol is relative: it must lie between 0 and 1, got {rtol}")
    if pose.approach.ndim != int(path) or not pose.approach.size:
        wanted = "a path of poses (make_path)" if path else "one pose; solve_path takes a path"
        raise ValueError(f"expected {wanted}, got an approach of shape {pose.approach.shape}")
    if friction.shape not in ((), grid.shape):
        raise ValueError(f"μ must be a number or a map of shape {grid.shape}, got {friction.shape}")
    if pose.approach.dtype == jnp.float32 and rtol < _SINGLE_PRECISION_FLOOR:
        raise ValueError(
            f"single precision reaches a residual of {_SINGLE_PRECISION_FLOOR:g}, not {rtol:g}: "
            'call jax.config.update("jax_enable_x64", True) first, or ask for a larger rtol'
        )
