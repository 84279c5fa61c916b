"""Force and moment in place of motion.

Newton's method solves for the motion, with the solution's own derivative of the resultants. From
rest it approaches from below, because friction yields as the motion grows. If everything slides and
the resultants are still too small, friction cannot carry them. For a normal force the search starts
at the given approach or, if that is far too small or too large, at an estimate.

The normal force is met before the others, so that these are compared with what it lets friction
carry, whatever the first guess.

The loop is our own: optimistix's root finders neither limit steps nor report why they fail. With
all four resultants given (24², five first guesses) this loop solves the contact 8 to 12 times. In
four such cases optimistix's Newton's method takes 10 to 14, Dogleg 12 to 16, Levenberg–Marquardt 24
to 50 solves. If friction cannot carry the resultants, this loop stops after 7 to 27 solves,
optimistix's Newton's method after 12 to 120, and the others after their largest number of steps.
Compiling takes as long.
From a guess at a third of the depth this loop takes half the time of optimistix's Newton's method,
from one nearby the same time (24², `tests.benchmarks.loops`).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from contactmodel.pose import Pose
from contactmodel.solver.alternating import Tractions, begin_with, find_tractions
from contactmodel.solver.derivative import attach_derivative
from contactmodel.solver.first_approach import estimate_approach
from contactmodel.solver.results import RESULTS
from contactmodel.solver.step import How, Problem, Step, complete, make_load, start

_RTOL = 10.0  # tolerance of the resultants over that of the solver
_FLOOR = 1e-9  # smallest slope, because it vanishes if everything slides
_SHARE = 1e-4  # the search stops if steps shortened to this share do not help
_LOOSE = 0.1  # sticking fraction below which a contact cannot carry more
_FAR = 8.0  # if the given depth differs from the estimate by this factor, the estimate is used
# Largest step as a share of the depth, as a share of the contact's radius, and as a twist [rad].
_APPROACH, _SHIFT, _TWIST = 0.5, 0.1, 0.1


class Target(NamedTuple):
    """Resultants that replace approach, shift along x, shift along y and twist."""

    given: Bool[Array, "4"]  # whether each of the four is replaced
    value: Float[Array, "4"]  # normal force, shear force and moment [N, N, N, N·mm]


class _State(NamedTuple):
    """State of Newton's method; `columns` are the changes of p and τ by each part of the motion."""

    motion: Float[Array, "4"]
    end: Tractions
    columns: tuple[Float[Array, "4 nx ny"], Float[Array, "4 2 nx ny"]]
    defect: Float[Array, "4"]
    slope: Float[Array, "4 4"]
    scale: Float[Array, "4"]
    limit: Float[Array, "4"]
    residual: Float[Array, ""]
    stick: Float[Array, ""]


class _Search(NamedTuple):
    """The next motion, the share of the step, and whether friction cannot carry more."""

    best: _State
    next: Float[Array, "4"]
    share: Float[Array, ""]
    trials: Int[Array, ""]
    beyond: Bool[Array, ""]


def solve_resultants(problem: Problem, target: Target, how: How) -> Step:
    """Solve a step for the motion that produces the given resultants.

    Args:
        problem: problem of the step; the replaced parts of its pose are a first guess.
        target: the resultants.
        how: tolerance and largest number of steps. The resultants have ten times that tolerance,
            relative to the largest force and moment that friction carries.
    """
    state, beyond = _search(problem, target, how)
    solved = problem._replace(pose=_replace_motion(problem.pose, state.motion))
    step = complete(solved, state.end, how)
    apart = step.result == RESULTS.no_contact
    failed = (step.result == RESULTS.successful) | apart
    failed &= ~(state.residual <= _RTOL * how.rtol)
    result = RESULTS.where(failed, RESULTS.resultant_max_steps, step.result)
    result = RESULTS.where(failed & beyond, RESULTS.beyond_friction, result)
    result = RESULTS.where(failed & apart, RESULTS.out_of_touch, result)
    return step._replace(result=result)


@eqx.filter_custom_jvp
def _search(problem: Problem, target: Target, how: How) -> tuple[_State, Bool[Array, ""]]:
    """Newton's method; each step is shortened until the resultants come nearer to the target.

    The normal force is met first, so that the others are compared with what it lets friction carry.
    """
    lowest, guess = _start(problem, target, how)
    here = problem._replace(pose=_replace_motion(problem.pose, guess))
    fields = start(here, how)[0]
    one, true = jnp.ones_like(guess), jnp.ones((), guess.dtype)
    columns = jax.tree.map(lambda field: jnp.zeros((4, *field.shape), field.dtype), fields)
    first = (0.0 * one, jnp.diag(one), one, one, jnp.inf * true, true)
    none = _State(guess, begin_with(fields), columns, *first)

    def meet(last: _State, given: Array) -> tuple[_State, Array]:
        begin = none._replace(motion=last.motion, end=last.end)
        return _meet(problem, target._replace(given=given), how, begin, lowest)

    normal = target.given & (jnp.arange(4) == 0) & jnp.any(target.given[1:])
    end, beyond = jax.lax.scan(meet, none, jnp.stack([normal, target.given]))
    return end, beyond[-1] | (end.stick < _LOOSE)


def _meet(
    problem: Problem, target: Target, how: How, none: _State, lowest: Array
) -> tuple[_State, Bool[Array, ""]]:
    """Newton's method from a state without a residual; without resultants, that state.

    Also returns whether friction cannot carry the resultants.
    """

    def step(search: _Search) -> _Search:
        before = search.best
        new = _assess(problem, target, search.next, before.end, how, lowest)
        better = (new.residual < before.residual) | (search.trials == 0)
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), new, before)
        along = jnp.sum(before.defect * new.defect / new.scale**2)  # > 0: still below the target
        share = jnp.where(better, jnp.minimum(2.0 * search.share, 1.0), 0.5 * search.share)
        move = jnp.linalg.solve(best.slope, best.defect)
        move = move / jnp.maximum(jnp.max(jnp.abs(move) / best.limit), 1.0)
        return _Search(
            best,
            best.motion + share * move,
            share,
            search.trials + 1,
            (before.stick + new.stick == 0.0) & (along > 0.0),
        )

    def go_on(search: _Search) -> Array:
        near = search.best.residual <= _RTOL * how.rtol
        apart = jnp.isinf(search.best.residual) & (search.trials > 0)
        lost = apart | (search.share < _SHARE) | (search.trials >= how.max_steps)
        return jnp.any(target.given) & ~near & ~lost & ~search.beyond

    still = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    one = jnp.ones((), none.motion.dtype)
    end = jax.lax.while_loop(go_on, step, _Search(none, none.motion, one, *still))
    return end.best, end.beyond


@_search.def_jvp
def _search_jvp(primals, tangents):
    """Implicit function theorem: the resultants keep their given values."""
    how = primals[2]
    state, beyond = _search(*primals)

    def attach(task: tuple[Problem, Target]) -> tuple[Array, tuple[Array, Array]]:
        problem, target = task
        motion = jnp.where(target.given, state.motion, _get_motion(problem.pose))
        fields, carried = _attach(problem, state.end, motion, how)
        defect = jnp.where(target.given, target.value - carried, 0.0)
        change = jnp.linalg.solve(state.slope, defect)
        moved = (jnp.tensordot(change, column, 1) for column in state.columns)
        pressure, traction = (a + b for a, b in zip(fields, moved, strict=True))
        return motion + change, (pressure, traction)

    _, (motion, (pressure, traction)) = eqx.filter_jvp(attach, (primals[:2],), (tangents[:2],))
    still, none = jax.tree.map(lambda _: None, (state, beyond))
    end = still.end._replace(pressure=pressure, traction=traction)
    return (state, beyond), (still._replace(motion=motion, end=end), none)


def _start(problem: Problem, target: Target, how: How) -> tuple[Array, Array]:
    """Approach at which the bodies first touch, and the initial motion.

    The unknown parts of the motion start at those of the previous step, if there is one.
    """
    given, pose, last = target.given, _get_motion(problem.pose), _get_motion(problem.last.pose)
    guess = jnp.where(given & problem.last.begun, last, pose)
    force = jnp.where(given[0], target.value[0], 0.0)
    lowest, estimate = estimate_approach(problem.compliance, problem.height, how.grid, force)
    depth, likely = guess[0] - lowest, estimate - lowest
    near = (depth > 0.0) & (depth * _FAR >= likely) & (depth <= _FAR * likely)
    return lowest, guess.at[0].set(jnp.where(near | ~given[0], guess[0], estimate))


def _assess(
    problem: Problem, target: Target, motion: Array, last: Tractions, how: How, lowest: Array
) -> _State:
    """Resultants at a motion, their derivatives by it, and their scales.

    Without contact no motion produces resultants, so the residual is infinite.
    """
    given = target.given
    placed = problem._replace(pose=_replace_motion(problem.pose, motion))
    load = make_load(placed, how.grid)
    solver = {"smooth": how.smooth, "rtol": how.rtol, "max_steps": how.max_steps}
    end = find_tractions(problem.compliance, load, start=(last.pressure, last.traction), **solver)
    _, push = jax.linearize(lambda moved: _attach(problem, end, moved, how), motion)
    columns, rows = jax.lax.map(push, jnp.diag(given.astype(motion.dtype)))
    carried = _resultants(placed.pose, (end.pressure, end.traction), how)
    scale, limit = _scales(placed, end, target, how, lowest)
    defect = jnp.where(given, target.value - carried, 0.0)
    residual = jnp.sqrt(jnp.sum((defect / scale) ** 2))
    contact = end.pressure > 0.0
    touching = jnp.any(contact)
    apart = jnp.where(jnp.any(given & (target.value != 0.0)), jnp.inf, 0.0)
    both = given[:, None] & given
    slope = jnp.where(both, rows.T, jnp.diag(jnp.where(given, 0.0, 1.0)))
    still = jnp.diag(jnp.full_like(motion, jnp.sqrt(jnp.finfo(motion.dtype).max)))
    sliding = complete(placed, end, how).sliding
    stick = jnp.sum(contact & ~sliding) / jnp.maximum(jnp.sum(contact), 1)
    return _State(
        motion=motion,
        end=end,
        columns=columns,
        defect=defect,
        slope=jnp.where(touching, slope + jnp.diag(_FLOOR * scale / limit), still),
        scale=scale,
        limit=limit,
        residual=jnp.where(touching, residual, apart),
        stick=jnp.where(jnp.any(given[1:]), stick, 1.0).astype(motion.dtype),
    )


def _attach(
    problem: Problem, end: Tractions, motion: Array, how: How
) -> tuple[tuple[Array, Array], Array]:
    """Pressure, traction and resultants, differentiable by the problem and the motion."""
    placed = problem._replace(pose=_replace_motion(problem.pose, motion))
    solver = {"smooth": how.smooth, "rtol": how.rtol, "max_steps": how.max_steps}
    fields = attach_derivative(
        end.pressure, end.traction, problem.compliance, make_load(placed, how.grid), **solver
    )
    return fields, _resultants(placed.pose, fields, how)


def _replace_motion(pose: Pose, motion: Array) -> Pose:
    parts = (motion[0], motion[1:3], motion[3])
    return eqx.tree_at(lambda p: (p.approach, p.shift, p.twist), pose, parts)


def _get_motion(pose: Pose) -> Array:
    """Approach, shift along x and y, and twist."""
    return jnp.stack([pose.approach, *pose.shift, pose.twist])


def _resultants(pose: Pose, fields: tuple[Array, Array], how: How) -> Array:
    """Resultants conjugate to approach, shift and twist: normal force, shear force and moment."""
    pressure, (tau_x, tau_y) = fields
    x, y = jnp.asarray(how.grid.points, pressure.dtype) - pose.centre[:, None, None]
    sums = [jnp.sum(part) for part in (pressure, tau_x, tau_y, x * tau_y - y * tau_x)]
    return jnp.stack(sums) * how.grid.cell_area


def _scales(
    placed: Problem, end: Tractions, target: Target, how: How, lowest: Array
) -> tuple[Array, Array]:
    """Scales of the resultants (the largest that friction carries) and largest steps of motion."""
    area, pressure = how.grid.cell_area, end.pressure
    force = jnp.sum(pressure) * area
    x, y = jnp.asarray(how.grid.points, pressure.dtype)
    weight = pressure * area / jnp.where(force > 0.0, force, 1.0)
    centre_x, centre_y = jnp.sum(weight * x), jnp.sum(weight * y)
    square = jnp.sum(weight * ((x - centre_x) ** 2 + (y - centre_y) ** 2))
    radius = jnp.sqrt(jnp.maximum(square, area))
    shear = jnp.maximum(jnp.sum(placed.friction.limit(pressure)) * area, 1e-30)
    normal = jnp.maximum(force, jnp.abs(target.value[0]))
    scale = jnp.stack([normal, shear, shear, shear * radius])
    approach = _APPROACH * jnp.abs(placed.pose.approach - lowest)
    shift = _SHIFT * radius
    limit = jnp.stack([approach, shift, shift, jnp.full_like(approach, _TWIST)])
    return jnp.where(target.given, scale, 1.0), jnp.where(target.given, limit, 1.0)
