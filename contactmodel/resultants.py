"""Force and moment given in place of motion.

Newton's method on the motion, with the derivative of the resultants that the solution itself has.
From rest it approaches from below, as friction gives way under growing motion. Once everything
slides and the resultants are still short, friction carries no more. A normal force begins at the
approach that was given or, where that is far too small or too large, at an estimate of it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.arrays import is_traced
from contactmodel.bodies import AbstractBody
from contactmodel.checks import Numbers, non_negative, number, refuse
from contactmodel.first_approach import estimate_approach
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter
from contactmodel.pose import Pose
from contactmodel.solution import RESULTS, ContactSolution
from contactmodel.solve import find_contact, raise_failure

_RTOL = 10.0  # tolerance on the resultants, by that of the solver
_FLOOR = 1e-9  # of the slope, where everything slides and it vanishes
_SHARE = 1e-4  # of a step, if less brings the resultants no nearer
_LOOSE = 0.1  # sticking share of a contact that cannot carry more
_FAR = 8.0  # times the estimated depth, or one by that: then the estimate is the better start
# A step is at most this share of the depth and of the contact's radius, and this twist [rad].
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
    """Where Newton's method is, and where it looks next."""

    motion: Float[Array, " n"]
    defect: Float[Array, " n"]
    slope: Float[Array, "n n"]
    scale: Float[Array, " n"]
    limit: Float[Array, " n"]
    residual: Float[Array, ""]
    stick: Float[Array, ""]


class _Search(NamedTuple):
    best: _State
    next: Float[Array, " n"]
    share: Float[Array, ""]
    trials: Int[Array, ""]
    beyond: Bool[Array, ""]


class _Found(NamedTuple):
    motion: Float[Array, " n"]
    slope: Float[Array, "n n"]
    residual: Float[Array, ""]
    beyond: Bool[Array, ""]


def solve_resultant(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    pose: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    normal_force: ArrayLike | None = None,
    shear_force: Numbers | None = None,
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
        pose: motion where no resultant is given, a first guess where one is (of the approach any
            will do); the moment is about its centre.
        grid: cells, more than cover the contact.
        friction_coefficient: μ [-].
        normal_force: pressing the bodies together, in place of the approach; under 0 they just
            do not touch [N].
        shear_force: on the elastomer along x and y, in place of the shift [N].
        moment: on the elastomer about z, in place of the twist [N·mm].
        previous: as for `solve_contact`.
        rtol: as for `solve_contact`; ten times as much on the resultants, by what friction carries.
        max_steps: as for `solve_contact`, and of the motion.
        throw: as for `solve_contact`.

    Returns:
        The contact; its pose is the motion found, differentiable with respect to everything.

    Raises:
        ValueError: nothing given in place of a motion, force or moment without friction, a normal
            force below 0, or what `solve_contact` refuses.
        RuntimeError: the resultants are not met: a failure, a shear force or moment on bodies that
            do not touch, or more than friction can carry. In the last case the message, and the
            force and moment of the solution with `throw=False`, give the limit.
    """
    shear = (None, None) if shear_force is None else tuple(jnp.asarray(shear_force))
    given = (normal_force, *shear, moment)
    which = find_given(normal_force, shear_force, moment)
    smooth = not is_traced(friction_coefficient) and not np.any(np.asarray(friction_coefficient))
    if smooth and which != (0,):
        raise ValueError("without friction a contact carries no shear force and no moment")
    target = number(jnp.stack([jnp.asarray(given[i], pose.approach.dtype) for i in which]))
    if which[0] == 0:
        pulls = (target if is_traced(target) else np.asarray(target))[0] < 0.0
        target = refuse(target, pulls, "a normal force presses: it must not be below 0 N")
    problem = _Problem(
        elastomer, object_, indenter, pose, non_negative(friction_coefficient), previous, target
    )
    solution = _solve(problem, grid, which, rtol, max_steps)
    if throw and not is_traced(solution.pressure):
        _raise_beyond(solution)
    return raise_failure(solution) if throw else solution


def find_given(
    normal_force: ArrayLike | None, shear_force: Numbers | None, moment: ArrayLike | None
) -> tuple[int, ...]:
    """Which of the resultants are given, by their place among normal, shear and moment."""
    given = (normal_force, shear_force, shear_force, moment)
    which = tuple(i for i, value in enumerate(given) if value is not None)
    if not which:
        raise ValueError("give at least one of normal_force, shear_force and moment")
    return which


@eqx.filter_jit
def _solve(
    problem: _Problem, grid: Grid, which: tuple[int, ...], rtol: float, max_steps: int
) -> ContactSolution:
    how = _How(grid, which, rtol, max_steps)
    found = _search(problem, how)
    solution = _contact(problem, found.motion, how)
    apart = solution.result == RESULTS.no_contact
    solved = (solution.result == RESULTS.successful) | apart
    failed = solved & ~(found.residual <= _RTOL * rtol)
    result = RESULTS.where(failed, RESULTS.resultant_max_steps, solution.result)
    result = RESULTS.where(failed & found.beyond, RESULTS.beyond_friction, result)
    result = RESULTS.where(failed & apart, RESULTS.out_of_touch, result)
    return eqx.tree_at(lambda s: s.result, solution, result)


class _How(NamedTuple):
    """What is known before anything runs; `which` of the resultants are given."""

    grid: Grid
    which: tuple[int, ...]
    rtol: float
    max_steps: int


@eqx.filter_custom_jvp
def _search(problem: _Problem, how: _How) -> _Found:
    """Newton's method, each step cut back until the resultants come nearer."""
    size = len(how.which)
    lowest, guess = _start(problem, how)

    def step(search: _Search) -> _Search:
        before = search.best
        new = _assess(problem, search.next, how, lowest)
        better = new.residual < before.residual
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), new, before)
        along = jnp.sum(before.defect * new.defect / new.scale**2)  # still short of the target
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
        return ~near & ~lost & ~search.beyond

    one, inf = jnp.ones(size), jnp.asarray(jnp.inf)
    none = _State(guess, 0.0 * one, jnp.eye(size), one, one, inf, jnp.ones(()))
    start = _Search(none, guess, jnp.ones(()), jnp.zeros((), jnp.int32), jnp.zeros((), bool))
    end = jax.lax.while_loop(go_on, step, start)
    beyond = end.beyond | (end.best.stick < _LOOSE)
    return _Found(end.best.motion, end.best.slope, end.best.residual, beyond)


@_search.def_jvp
def _search_jvp(primals, tangents):
    """Implicit function theorem: the resultants stay where they are asked to be."""
    (problem, how), (dproblem, _) = primals, tangents
    found = _search(problem, how)

    def defect(problem: _Problem) -> Array:
        solution = _contact(problem, found.motion, how)
        return problem.target - _resultants(solution)[np.asarray(how.which)]

    _, change = eqx.filter_jvp(defect, (problem,), (dproblem,))
    still = jax.tree.map(lambda _: None, found)
    return found, still._replace(motion=jnp.linalg.solve(found.slope, change))


def _start(problem: _Problem, how: _How) -> tuple[Array, Array]:
    """Approach at which the bodies first touch, and the motion to begin with."""
    guess = get_motion(problem.pose)[np.asarray(how.which)]
    bodies = (problem.elastomer, problem.object_, problem.indenter)
    force = problem.target[0] if how.which[0] == 0 else jnp.zeros_like(problem.target[0])
    lowest, estimate = estimate_approach(*bodies, how.grid, force)
    if how.which[0] != 0:
        return lowest, guess
    depth, likely = guess[0] - lowest, estimate - lowest
    near = (depth > 0.0) & (depth * _FAR >= likely) & (depth <= _FAR * likely)
    return lowest, guess.at[0].set(jnp.where(near, guess[0], estimate))


def _contact(problem: _Problem, motion: Array, how: _How) -> ContactSolution:
    """The contact with some of the motion replaced."""
    return find_contact(
        problem.elastomer,
        problem.object_,
        problem.indenter,
        replace_motion(problem.pose, how.which, motion),
        how.grid,
        problem.friction,
        problem.previous,
        how.rtol,
        how.max_steps,
    )


def _assess(problem: _Problem, motion: Array, how: _How, lowest: Array) -> _State:
    """Resultants at a motion, how they change with it, and their scales.

    Out of touch every motion carries nothing: no nearer to what is asked for than another.
    """
    index = np.asarray(how.which)

    def carried(motion: Array) -> tuple[Array, ContactSolution]:
        solution = _contact(problem, motion, how)
        return _resultants(solution)[index], solution

    slope, solution = jax.jacfwd(carried, has_aux=True)(motion)
    scale, limit = _scales(solution, problem.target, index, lowest)
    defect = problem.target - _resultants(solution)[index]
    residual = jnp.sqrt(jnp.sum((defect / scale) ** 2))
    touching = jnp.any(solution.contact)
    apart = jnp.where(jnp.any(problem.target != 0.0), jnp.inf, 0.0)
    still = jnp.diag(jnp.full_like(motion, np.sqrt(jnp.finfo(motion.dtype).max)))
    return _State(
        motion=motion,
        defect=defect,
        slope=jnp.where(touching, slope + jnp.diag(_FLOOR * scale / limit), still),
        scale=scale,
        limit=limit,
        residual=jnp.where(touching, residual, apart),
        stick=solution.stick_ratio if np.any(index > 0) else jnp.ones(()),
    )


def replace_motion(pose: Pose, which: tuple[int, ...], motion: Array) -> Pose:
    """The pose with some of its motion replaced."""
    approach, shift_x, shift_y, twist = get_motion(pose).at[np.asarray(which)].set(motion)
    parts = (approach, jnp.stack([shift_x, shift_y]), twist)
    return eqx.tree_at(lambda p: (p.approach, p.shift, p.twist), pose, parts)


def get_motion(pose: Pose) -> Array:
    """Approach, shift along x and y, and twist."""
    return jnp.stack([pose.approach, *pose.shift, pose.twist])


def _resultants(solution: ContactSolution) -> Array:
    """What works on approach, shift and twist: normal force, shear force and moment."""
    x, y, z = solution.force
    return jnp.stack([-z, x, y, solution.moment])


def _scales(
    solution: ContactSolution, target: Array, index: np.ndarray, lowest: Array
) -> tuple[Array, Array]:
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
    approach = _APPROACH * jnp.abs(solution.pose.approach - lowest)
    shift = _SHIFT * radius
    return scale, jnp.stack([approach, shift, shift, jnp.full((), _TWIST)])[index]


def _raise_beyond(solution: ContactSolution) -> None:
    """Say what friction carries, where more is asked for."""
    if bool(solution.result == RESULTS.beyond_friction):
        x, y, _ = solution.force.tolist()
        raise RuntimeError(
            f"{RESULTS[solution.result]}; at most a shear force of ({x:.4g}, "
            f"{y:.4g}) N and a moment of {float(solution.moment):.4g} N·mm, together, on this way"
        )
