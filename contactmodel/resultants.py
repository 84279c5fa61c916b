"""Force and moment given in place of motion.

Newton's method on the motion, with the derivative of the resultants that the solution itself has.
It starts from less than the resultants asked for; as friction gives way under growing motion, it
then approaches from below. Once everything slides, friction carries no more.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.bodies import AbstractBody
from contactmodel.checks import is_traced, non_negative, number
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter
from contactmodel.pose import Pose
from contactmodel.solution import RESULTS, ContactSolution
from contactmodel.solve import raise_failure, solve_contact

_RTOL = 10.0  # tolerance on the resultants, by that of the solver
_FLOOR = 1e-9  # of the slope, where everything slides and it vanishes
# A step is at most this share of the approach and of the contact's radius, and this twist [rad].
_APPROACH, _SHIFT, _TWIST = 0.5, 0.1, 0.1


class _Problem(NamedTuple):
    """What the derivative may be asked for."""

    elastomer: AbstractBody
    object_: AbstractBody
    indenter: AbstractIndenter
    pose: Pose
    friction: Array
    previous: ContactSolution | None
    target: Float[Array, " n"]


class _State(NamedTuple):
    """Where Newton's method is."""

    motion: Float[Array, " n"]
    defect: Float[Array, " n"]
    slope: Float[Array, "n n"]
    scale: Float[Array, " n"]
    limit: Float[Array, " n"]
    residual: Float[Array, ""]
    share: Float[Array, ""]
    trials: Int[Array, ""]
    slides: Bool[Array, ""]


def solve_resultant(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    pose: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    normal_force: ArrayLike | None = None,
    shear_force: ArrayLike | None = None,
    moment: ArrayLike | None = None,
    previous: ContactSolution | None = None,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Find the motion under which the contact carries a given force or moment.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape.
        pose: motion where no resultant is given, a first guess that touches where one is; the
            moment is about its centre.
        grid: cells, more than cover the contact.
        friction_coefficient: μ [-].
        normal_force: pressing the bodies together, in place of the approach [N].
        shear_force: on the elastomer along x and y, in place of the shift [N].
        moment: on the elastomer about z, in place of the twist [N·mm].
        previous: as for `solve_contact`.
        rtol: as for `solve_contact`; ten times as much on the resultants, by what friction carries.
        max_steps: as for `solve_contact`, and of the motion.
        throw: as for `solve_contact`.

    Returns:
        The contact; its pose is the motion found, differentiable with respect to everything.

    Raises:
        ValueError: nothing given in place of a motion, force or moment without friction, or what
            `solve_contact` refuses.
        RuntimeError: a failure, or more than friction can carry: the message, and the force and
            moment of the solution with `throw=False`, say how much that is.
    """
    shear = (None, None) if shear_force is None else tuple(jnp.asarray(shear_force))
    given = (normal_force, *shear, moment)
    which = tuple(i for i, value in enumerate(given) if value is not None)
    if not which:
        raise ValueError("give at least one of normal_force, shear_force and moment")
    smooth = not is_traced(friction_coefficient) and not np.any(friction_coefficient)
    if smooth and which != (0,):
        raise ValueError("without friction a contact carries no shear force and no moment")
    target = number(jnp.stack([jnp.asarray(given[i], pose.approach.dtype) for i in which]))
    problem = _Problem(
        elastomer, object_, indenter, pose, non_negative(friction_coefficient), previous, target
    )
    solution = _search(problem, grid, which, rtol, max_steps)
    if throw and not is_traced(solution.pressure):
        _raise_beyond(solution)
    return raise_failure(solution) if throw else solution


@eqx.filter_jit
def _search(
    problem: _Problem, grid: Grid, which: tuple[int, ...], rtol: float, max_steps: int
) -> ContactSolution:
    """Newton's method, and the derivative of its solution."""
    index = np.asarray(which)

    def solve(problem: _Problem, motion: Array) -> ContactSolution:
        return solve_contact(
            problem.elastomer,
            problem.object_,
            problem.indenter,
            _moved(problem.pose, motion, index),
            grid,
            problem.friction,
            previous=problem.previous,
            rtol=rtol,
            max_steps=max_steps,
            throw=False,
        )

    still = jax.tree.map(jax.lax.stop_gradient, problem)

    def carried(motion: Array) -> tuple[Array, ContactSolution]:
        solution = solve(still, motion)
        return _resultants(solution)[index], solution

    def assess(motion: Array) -> _State:
        slope, solution = jax.jacfwd(carried, has_aux=True)(motion)
        scale, limit = _scales(solution, still.target, index)
        defect = still.target - _resultants(solution)[index]
        residual = jnp.sqrt(jnp.sum((defect / scale) ** 2))
        return _State(
            motion=motion,
            defect=defect,
            slope=slope,
            scale=scale,
            limit=limit,
            residual=jnp.where(jnp.any(solution.contact), residual, jnp.inf),
            share=jnp.ones(()),
            trials=jnp.zeros((), jnp.int32),
            slides=bool(np.any(index > 0)) & (solution.stick_ratio == 0.0),
        )

    def exhausted(state: _State, new: _State) -> Array:
        along = jnp.sum(state.defect * new.defect / new.scale**2)
        return state.slides & new.slides & (along > 0.0)

    def go_on(carry: tuple[_State, Array]) -> Array:
        state, beyond = carry
        return ~(state.residual <= _RTOL * rtol) & (state.trials < max_steps) & ~beyond

    def step(carry: tuple[_State, Array]) -> tuple[_State, Array]:
        state, _ = carry
        floor = jnp.diag(_FLOOR * state.scale / state.limit)
        move = jnp.linalg.solve(state.slope + floor, state.defect)
        move = move / jnp.maximum(jnp.max(jnp.abs(move) / state.limit), 1.0)
        new = assess(state.motion + state.share * move)
        better = new.residual < state.residual
        share = jnp.where(better, jnp.minimum(2.0 * state.share, 1.0), 0.5 * state.share)
        kept = jax.tree.map(lambda a, b: jnp.where(better, a, b), new, state)
        return kept._replace(share=share, trials=state.trials + 1), exhausted(state, new)

    first = assess(_motion(still.pose)[index])
    end, beyond = jax.lax.while_loop(go_on, step, (first, jnp.zeros((), bool)))

    # the implicit function theorem: carried(motion; problem) = target
    values = _resultants(solve(problem, end.motion))[index]
    change = (problem.target - still.target) - (values - jax.lax.stop_gradient(values))
    floor = jnp.diag(_FLOOR * end.scale / end.limit)
    solution = solve(problem, end.motion + jnp.linalg.solve(end.slope + floor, change))
    failed = (solution.result == RESULTS.successful) & ~(end.residual <= _RTOL * rtol)
    result = RESULTS.where(failed, RESULTS.resultant_max_steps, solution.result)
    result = RESULTS.where(failed & beyond, RESULTS.beyond_friction, result)
    return eqx.tree_at(lambda s: s.result, solution, result)


def _motion(pose: Pose) -> Array:
    return jnp.stack([pose.approach, *pose.shift, pose.twist])


def _moved(pose: Pose, motion: Array, index: np.ndarray) -> Pose:
    """The pose with some of its motion replaced."""
    approach, shift_x, shift_y, twist = _motion(pose).at[index].set(motion)
    parts = (approach, jnp.stack([shift_x, shift_y]), twist)
    return eqx.tree_at(lambda p: (p.approach, p.shift, p.twist), pose, parts)


def _resultants(solution: ContactSolution) -> Array:
    """What works on approach, shift and twist: normal force, shear force and moment."""
    x, y, z = solution.force
    return jnp.stack([-z, x, y, solution.moment])


def _scales(solution: ContactSolution, target: Array, index: np.ndarray) -> tuple[Array, Array]:
    """Of the resultants: what friction carries; of the motion: the longest step."""
    area = solution.grid.cell_area
    force = jnp.sum(solution.pressure) * area
    x, y = solution.grid.points
    weight = solution.pressure * area / jnp.where(force > 0.0, force, 1.0)
    centre_x, centre_y = jnp.sum(weight * x), jnp.sum(weight * y)
    square = jnp.sum(weight * ((x - centre_x) ** 2 + (y - centre_y) ** 2))
    radius = jnp.sqrt(jnp.maximum(square, area))
    shear = jnp.maximum(jnp.sum(solution.friction_coefficient * solution.pressure) * area, 1e-30)
    scale = jnp.stack([force, shear, shear, shear * radius])[index]
    scale = jnp.where(index == 0, jnp.maximum(scale, jnp.abs(target)), scale)
    approach = _APPROACH * jnp.abs(solution.pose.approach)
    shift = _SHIFT * radius
    return scale, jnp.stack([approach, shift, shift, jnp.full((), _TWIST)])[index]


def _raise_beyond(solution: ContactSolution) -> None:
    """Say what friction carries, where more is asked for."""
    if bool(solution.result == RESULTS.beyond_friction):
        x, y, _ = solution.force.tolist()
        raise RuntimeError(
            f"{RESULTS[solution.result]}; sliding all over, it carries a shear force of "
            f"({x:.4g}, {y:.4g}) N and a moment of {float(solution.moment):.4g} N·mm"
        )
