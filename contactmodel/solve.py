"""Solve a contact for one pose or along a path, given the motion or force and moment."""

import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel.common.arrays import is_traced
from contactmodel.common.checks import check_type
from contactmodel.common.inputs import RangeWarning
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import Layer, Rigid
from contactmodel.elasticity.compliance import pair_compliance
from contactmodel.elasticity.corrections import RANGE
from contactmodel.elasticity.reading import is_read, raise_limit
from contactmodel.friction import AbstractFriction, is_smooth
from contactmodel.grid import make_points
from contactmodel.indenters import measure_shape
from contactmodel.pose import Pose, Resultants
from contactmodel.solution import ContactSolution, stack_steps
from contactmodel.solver.alternating import solve_tractions
from contactmodel.solver.normal import is_large
from contactmodel.solver.resultants import Target, solve_resultants
from contactmodel.solver.results import RESULTS
from contactmodel.solver.step import (
    How,
    Memory,
    Problem,
    Step,
    complete,
    find_heights,
    make_load,
    remember,
    rest,
    start,
)

_SINGLE_PRECISION_FLOOR = 1e-5  # smallest rtol; rounding keeps residuals at 1e-6 to 5e-6


def solve_contact(
    contact: Contact,
    pose: Pose,
    resultants: Resultants | None = None,
    *,
    previous: ContactSolution | None = None,
    sliding: bool = False,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Press an object onto an elastomer, then shift and twist it.

    Pressure and friction are solved together. They are independent only between half-spaces of the
    same (1−2ν)/G, for example a rigid object on an incompressible half-space. On a `Layer`, even
    an incompressible one, they depend on each other.

    Gradients are exact for fixed sets of touching, sticking and sliding cells. They omit the change
    of these sets. Second derivatives therefore lack a part, and so do first derivatives that
    depend only on the motion of the contact's edge (the moment's by the approach, in full stick).

    Args:
        contact: bodies, shape, grid and friction.
        pose: motion of the object since first touch. The parts that resultants replace are first
            guesses, and any approach will do. With `previous`, the guess is that solution's motion.
        resultants: force and moment that replace parts of the motion. The solution's pose then
            holds the motion that produces them.
        previous: solution of the previous step, because friction depends on history. Without it,
            the object is pressed and moved in a single step from rest. To press first and move
            second, call twice; the result differs if pressing causes slip.
        sliding: whether the object's shape moves by the slip up to the previous step.
        rtol: tolerance of the residuals of pressure and traction (see `normal`, `friction`) [-].
            The resultants have ten times this tolerance, relative to the largest force and moment
            that friction can carry.
        max_steps: largest number of iterations of each solver.
        throw: whether a failure raises an error; if False, only `result` reports it.

    Raises:
        ValueError: shapes do not match, the twist changes by a radian or more (linear poses may),
            resultants are given with a corotated pose or a corrected layer or, but for the normal
            force, without friction, or rtol is too small.
        RuntimeError: the solve failed. If friction cannot carry the resultants, the message states
            the largest force and moment; with `throw=False`, the solution holds them.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, solve_contact
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> pressed = solve_contact(contact, Pose(approach=1.0))
        >>> twisted = solve_contact(contact, Pose(approach=1.0, twist=0.15), previous=pressed)
        >>> print(f"{-pressed.force[2]:.3f} N, then {twisted.moment:.3f} N·mm")
        4.750 N, then 5.674 N·mm
    """
    _check(contact, pose, resultants, previous, rtol, path=False)
    task = _prepare(contact, pose, sliding, (rtol, max_steps))
    target = _find_target(resultants, pose)
    how = task.how._replace(coarse_first=previous is None and is_large(contact.grid))
    step = _advance(task._replace(how=how), _recall(previous, contact, pose), pose, target)
    solution = _warn(_flag_motion(_gather(contact, step), resultants, previous))
    return raise_failure(solution) if throw else solution


def solve_path(
    contact: Contact,
    path: Pose,
    resultants: Resultants | None = None,
    *,
    previous: ContactSolution | None = None,
    sliding: bool = False,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Solve a contact along a path; each step starts from the previous one.

    Args:
        contact: bodies, shape, grid and friction.
        path: poses, with the steps along the first axis (`make_path`). If resultants are given,
            the first pose is a first guess.
        resultants: force and moment for each step, or one value for all steps.
        previous: solution before the path. Without it, the path starts from rest.
        sliding: whether the object's shape moves with the slip, one step later.
        rtol: as for `solve_contact`.
        max_steps: as for `solve_contact`.
        throw: as for `solve_contact`.

    Returns:
        The solutions of all steps. They are the first axis of all arrays but those of `problem`.

    Raises:
        ValueError: as for `solve_contact`, or the numbers of steps differ.
        RuntimeError: a step failed.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere
        >>> from contactmodel import make_path, solve_path
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(1.0), Pose(1.0, twist=0.2), Pose(1.0)], steps=[2, 2])
        >>> print(solve_path(contact, path).moment.round(3))  # N·mm; friction keeps some of it
        [ 4.966  5.992 -0.768 -3.915]
    """
    _check(contact, path, resultants, previous, rtol, path=True)
    task = _prepare(contact, path, sliding, (rtol, max_steps))
    begin = _recall(previous, contact, path)
    steps = path, _find_target(resultants, path)

    def advance(last: Memory, step: tuple[Pose, Target | None]) -> tuple[Memory, Step]:
        done = _advance(task, last, *step)
        return remember(done, last), done

    if any(map(is_traced, jax.tree.leaves((contact, steps, previous)))):
        solution = _gather(contact, jax.lax.scan(advance, begin, steps)[1])
        solution = _flag_motion(solution, resultants, previous)
        return raise_failure(solution) if throw else solution
    contacts: list[ContactSolution] = []
    for index in range(len(path.approach)):  # a loop, so that one program serves all lengths
        begin, done = advance(begin, jax.tree.map(lambda leaf, i=index: _take(leaf, i), steps))
        contacts.append(_gather(contact, done))
        if throw:
            raise_failure(contacts[-1], f"step {index} of the path: ")
    return _warn(stack_steps(contacts))


class _Task(NamedTuple):
    """Data common to all steps; the height is None if it changes as the object slides."""

    contact: Contact
    problem: tuple[Any, Any]
    height: Float[Array, "nx ny"] | None
    how: How


def _prepare(contact: Contact, pose: Pose, sliding: bool, how: tuple[float, int]) -> _Task:
    smooth, dtype = is_smooth(contact.friction_coefficient), pose.approach.dtype
    pair = contact.elastomer, contact.object_
    compliance = pair_compliance(*pair, contact.grid, smooth=smooth)
    law = contact.friction_coefficient
    in_precision = jax.tree.map(lambda leaf: leaf.astype(dtype), (compliance, law))
    still = None if sliding else _find_heights(contact.indenter, contact.grid, dtype, None)
    rtol, max_steps = jnp.asarray(how[0], dtype), jnp.asarray(how[1])
    return _Task(contact, in_precision, still, How(contact.grid, smooth, False, rtol, max_steps))


def _advance(task: _Task, last: Memory, pose: Pose, target: Target | None) -> Step:
    """Solve one step; heights are computed outside, so that one program solves all shapes."""
    height = task.height
    if height is None:
        dtype = pose.approach.dtype
        height = _find_heights(task.contact.indenter, task.contact.grid, dtype, last)
    compliance, law = task.problem
    if is_read(task.contact.elastomer, pose.corotated):
        law = _raise(task.contact, law, pose)
    return _solve(Problem(compliance, law, height, pose, last), target, task.how)


@eqx.filter_jit
def _raise(contact: Contact, law: AbstractFriction, pose: Pose) -> AbstractFriction:
    """The friction law of the gel at finite strain."""
    points = make_points(contact.grid, pose.approach.dtype)
    gel = contact.elastomer
    assert isinstance(gel, Layer)
    return raise_limit(law, gel, measure_shape(contact.indenter, points), points, pose.approach)


_find_heights = eqx.filter_jit(find_heights)


@eqx.filter_jit
def _solve(problem: Problem, target: Target | None, how: How) -> Step:
    if target is not None:
        return solve_resultants(problem, target, how)
    begin, before = start(problem, how)
    solver = {"smooth": how.smooth, "rtol": how.rtol, "max_steps": how.max_steps}
    load = make_load(problem, how.grid)
    end = solve_tractions(problem.compliance, load, start=begin, **solver)
    if before is not None:
        end = end._replace(normal=end.normal.after(before))
    return complete(problem, end, how)


def _find_target(resultants: Resultants | None, pose: Pose) -> Target | None:
    if resultants is None:
        return None
    value = resultants.in_place_of(pose)
    return Target(jnp.broadcast_to(jnp.asarray(resultants.given), value.shape), value)


def _take(leaf: Array, index: int) -> Array:
    """An entry of an array, taken by NumPy, because JAX would compile a program for it."""
    return jnp.asarray(np.asarray(leaf)[index])


def _gather(contact: Contact, step: Step) -> ContactSolution:
    """The solution of one step or of all steps."""
    return ContactSolution(problem=contact, **step._asdict())


def _recall(previous: ContactSolution | None, contact: Contact, pose: Pose) -> Memory:
    """State before the first step: that of the previous contact, else rest."""
    if previous is None:
        return rest(pose, contact.grid)
    if previous.grid != contact.grid:
        raise ValueError(
            f"the previous contact has the {previous.grid}, this contact the {contact.grid}: use "
            "the same grid for both"
        )
    if previous.pressure.ndim != 2:
        raise ValueError("previous is a path; take its last step: at_step(-1)")
    for kind in ("linear", "corotated"):
        if getattr(previous.pose, kind) != getattr(pose, kind):
            raise ValueError(f"this pose and the previous pose must both be {kind}, or neither")
    return remember(Step(**{name: getattr(previous, name) for name in Step._fields}))


def raise_failure(solution: ContactSolution, where: str = "") -> ContactSolution:
    """Raise the failure that `result` reports, now or, inside `jit`, when the program runs."""
    result = solution.result
    failed = (result != RESULTS.successful) & (result != RESULTS.no_contact)
    if not is_traced(failed) and not np.any(failed):
        return solution
    first = jnp.argmax(failed)
    worst = jax.tree.map(lambda value: jnp.reshape(value, -1)[first], result)
    if is_traced(failed):
        dynamic, static = eqx.partition(solution, eqx.is_inexact_array)
        return eqx.combine(worst.error_if(dynamic, jnp.any(failed)), static)
    limit = ""
    if bool(worst == RESULTS.beyond_friction):
        x, y, _ = solution.force.tolist()
        limit = (
            f"; it carries at most a shear force of ({x:.4g}, {y:.4g}) N together with a moment of "
            f"{float(solution.moment):.4g} N·mm in this direction"
        )
    raise RuntimeError(where + RESULTS[worst] + limit)


def _warn(solution: ContactSolution) -> ContactSolution:
    """Warn of steps whose correction is not covered, unless the program is traced."""
    if not solution.problem.elastomer.is_corrected:
        return solution
    covered = solution.correction.covered
    if not is_traced(covered) and not np.all(covered):
        at = "" if covered.ndim == 0 else f" at step {int(np.argmin(covered))}"
        warnings.warn(f"force and moment are corrected{at} outside {RANGE}", RangeWarning, 3)
    return solution


def _check(
    contact: Contact,
    pose: Pose,
    resultants: Resultants | None,
    previous: ContactSolution | None,
    rtol: float,
    *,
    path: bool,
) -> None:
    """Check types, shapes and precision before a program runs."""
    check_type("the problem", contact, Contact, "Contact(gel, Rigid(), Sphere(20.0), grid, 0.5)")
    one = "make_path([Pose(0.0), Pose(0.5)], [4])" if path else "Pose(approach=0.5)"
    check_type("the object's motion", pose, Pose, one)
    if resultants is not None:
        check_type("force and moment", resultants, Resultants, "Resultants(normal_force=2.0)")
    if not 0.0 < rtol < 1.0:
        raise ValueError(f"rtol is relative: it must lie between 0 and 1, got {rtol}")
    if pose.approach.ndim != int(path) or not pose.approach.size:
        wanted = "a path of poses (make_path)" if path else "one pose; solve_path takes a path"
        raise ValueError(f"expected {wanted}, got an approach of shape {pose.approach.shape}")
    if pose.approach.dtype == jnp.float32 and rtol < _SINGLE_PRECISION_FLOOR:
        raise ValueError(
            f"single precision reaches a residual of {_SINGLE_PRECISION_FLOOR:g}, not {rtol:g}: "
            'call jax.config.update("jax_enable_x64", True) first, or use a larger rtol'
        )
    _check_turn(pose, resultants, previous)
    if resultants is None:
        _check_base(contact, pose)
    elif contact.elastomer.is_corrected:
        raise ValueError(
            "resultants cannot be combined with corrections of force and moment: leave out "
            "resultants, or the layer's radius and neo_hookean"
        )
    if resultants is not None and pose.corotated:
        raise ValueError(
            "resultants cannot be combined with a corotated pose: leave out resultants or corotated"
        )
    sheared = resultants is not None and any(resultants.given[1:])
    if sheared and is_smooth(contact.friction_coefficient):
        raise ValueError(
            "without friction a contact carries no shear force and no moment: use a friction "
            "coefficient above 0, or leave out shear_force and moment"
        )


def _find_base(contact: Contact) -> Float[Array, ""] | None:
    """Thickness of a layer under a rigid object [mm], which then cannot be pressed in further."""
    gel = contact.elastomer
    return gel.thickness if isinstance(gel, Layer) and isinstance(contact.object_, Rigid) else None


def _check_base(contact: Contact, pose: Pose) -> None:
    """Check that a rigid object stays above a layer's base; `_flag_motion` does if traced."""
    thickness, approach = _find_base(contact), pose.approach
    if thickness is None or is_traced(thickness) or is_traced(approach):
        return
    deepest = float(np.max(approach))
    if deepest >= float(thickness):
        raise ValueError(
            f"an approach of {deepest:g} mm reaches the rigid base of a layer {thickness:g} mm "
            "thick: use a smaller approach or a thicker layer, both in mm"
        )


def _check_turn(
    path: Pose, resultants: Resultants | None, previous: ContactSolution | None
) -> None:
    """Reject steps of a radian or more, often degrees; `_flag_motion` does if traced."""
    if previous is not None:
        check_type("previous", previous, ContactSolution, "solve_contact(contact, Pose(0.5))")
    given = resultants is None or resultants.moment is None
    before = 0.0 if previous is None else previous.pose.twist
    if path.linear or not given or is_traced(path.twist) or is_traced(before):
        return
    steps = np.abs(np.diff(np.atleast_1d(path.twist), prepend=np.asarray(before)))
    if steps.max() >= 1.0:
        raise ValueError(
            f"the twist changes by {steps.max():.4g} rad in one step, and must change by less than "
            "1 rad: divide it into a path of smaller steps (make_path), and convert degrees with "
            "np.radians"
        )


def _flag_motion(
    solution: ContactSolution, resultants: Resultants | None, previous: ContactSolution | None
) -> ContactSolution:
    """Report in `result` what `_check_turn` and `_check_base` cannot see in a traced program."""
    pose, base, found = solution.pose, _find_base(solution.problem), []
    if not any(map(is_traced, jax.tree.leaves((pose, base, previous)))):
        return solution
    if not pose.linear and (resultants is None or resultants.moment is None):
        before = jnp.zeros_like(pose.twist) if previous is None else previous.pose.twist
        steps = jnp.diff(jnp.atleast_1d(pose.twist), prepend=jnp.ravel(before)[:1])
        found += [(RESULTS.beyond_turn, jnp.abs(steps).reshape(pose.twist.shape) >= 1.0)]
    if resultants is None and base is not None:
        found += [(RESULTS.beyond_base, pose.approach >= base)]
    result = solution.result
    for new, at in found:
        result = jax.tree.map(lambda one, other, at=at: jnp.where(at, one, other), new, result)
    return eqx.tree_at(lambda part: part.result, solution, result)
