"""The traction of one step with Coulomb friction, at a given pressure.

[Kalker1990] J. J. Kalker, "Three-Dimensional Elastic Bodies in Rolling Contact", Section 4.2.
[Vollebregt2010] E. A. H. Vollebregt, "Improving the speed and accuracy of the frictional rolling
contact model CONTACT" (TangCG: conjugate gradients on the sets of sticking and sliding cells).

The solver minimises ½ τ·Cτ − τ·b over tractions |τ| ≤ μp [MPa], the limit, 0 outside the contact.
The drive b is the rigid increment plus Cτ of the previous step [mm]. The remainder s = b − Cτ is
the increment of slip [mm]: 0 where a cell sticks, parallel to τ where it slides.

The loop is our own. Each iteration is a Newton step on the present sets: a sticking cell has two
unknowns, and a sliding cell moves along its circle, with the curvature s/μp. Newton's method alone
diverges for shifts and pivots. Here each step is shortened until the energy falls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.elasticity.compliance import Compliance
from contactmodel.grid import dot
from contactmodel.solver.linear import Iterations, Operator, conjugate_gradients

_FORCING = 0.05  # tolerance of a Newton step's linear system; a smaller one saves no steps
_NEWTON_STEPS = 25  # largest number of conjugate gradient iterations in a Newton step
_HALVINGS = 6
_STILL = 10.0  # slip below this many tolerances counts as 0
_SOFT = 4.0  # share of the shortest waves' compliance in sliding cells; 1 to 8 work as well
_NEAR_LIMIT = 1e-3  # a cell that is closer to μp may count as sliding


class Sets(NamedTuple):
    """The state of each cell, and the direction of the traction of sliding cells."""

    stick: Bool[Array, "nx ny"]  # cells in contact that stick
    slide: Bool[Array, "nx ny"]  # cells in contact that slide
    normal: Float[Array, "2 nx ny"]  # τ/|τ| of the sliding cells, 0 elsewhere
    stiffness: Float[Array, "nx ny"]  # |s|/μp of the sliding cells, 0 elsewhere [mm/MPa]

    def along(self, field: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """The free part of a field: all in sticking cells, along the circle in sliding cells."""
        across = dot(field, self.normal) * self.normal
        return jnp.where(self.stick | self.slide, field - across, 0.0)


class _State(NamedTuple):
    traction: Float[Array, "2 nx ny"]
    slip: Float[Array, "2 nx ny"]
    wrong: Float[Array, ""]  # `_violation`
    steps: Int[Array, ""]
    applications: Int[Array, ""]


def find_sets(
    traction: Float[Array, "2 nx ny"],
    slip: Float[Array, "2 nx ny"],
    limit: Float[Array, "nx ny"],
    stiffest: Float[Array, ""],
) -> Sets:
    """Find the sticking and sliding cells.

    A sliding cell carries μp, and its slip is not against τ. A cell just below μp also slides if
    the shortest step down the gradient would bring it to μp. At the rim μp is so small that
    rounding hides the gain of that step.

    The compliance is at most `stiffest` [mm/MPa].
    """
    contact = limit > 0.0
    margin = max(1e-9, 16.0 * float(jnp.finfo(limit.dtype).eps))
    square = dot(traction, traction)
    along = dot(traction, slip)
    size = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    short = limit - size
    at_limit = (short <= margin * limit) | (
        (short <= _NEAR_LIMIT * limit) & (short * size * stiffest <= along)
    )
    slide = contact & at_limit & (along >= 0.0) & (square > 0.0)
    bound = jnp.where(slide, limit, 1.0)
    return Sets(
        stick=contact & ~slide,
        slide=slide,
        normal=jnp.where(slide, traction / size, 0.0),
        stiffness=jnp.where(slide, along / (size * bound), 0.0),
    )


def find_sliding(
    compliance: Compliance,
    traction: Float[Array, "2 nx ny"],
    motion: Float[Array, "2 nx ny"],
    slip: Float[Array, "2 nx ny"],
    pressure: Float[Array, "nx ny"],
    limit: Float[Array, "nx ny"],
    rtol: ArrayLike,
) -> Bool[Array, "nx ny"]:
    """Cells in contact that slide by more than the residual slip of sticking cells.

    The motion is that of the rigid object plus the relative displacement before the step [mm]; rtol
    is that of the traction.
    """
    contact = pressure > 0.0
    at_limit = find_sets(traction, slip, limit, compliance.stiffest).slide | (limit <= 0.0)
    square = dot(motion, motion) + dot(motion - slip, motion - slip)
    typical = jnp.sum(jnp.where(contact, square, 0.0)) / jnp.maximum(jnp.sum(contact), 1)
    return contact & at_limit & (dot(slip, slip) > (_STILL * rtol) ** 2 * typical)


def solve_traction(
    compliance: Compliance,
    drive: Float[Array, "2 nx ny"],
    limit: Float[Array, "nx ny"],
    *,
    start: Float[Array, "2 nx ny"],
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> tuple[Float[Array, "2 nx ny"], Iterations]:
    """Solve for the traction on the elastomer: |τ| ≤ μp, without slip or parallel to it.

    Each Newton step on the present sets is shortened until the energy falls. Derivatives stop here;
    see `derivative`.

    The residual is the root mean square, over the cells in contact, of the slip of sticking cells
    and of the slip of sliding cells across τ and against τ, divided by the root mean square of the
    drive.

    Returns:
        Traction [MPa] and the solver's iterations.
    """
    compliance, drive, limit, start = jax.lax.stop_gradient((compliance, drive, limit, start))
    typical = _sum_of_squares(drive, limit)

    def residual(state: _State) -> Array:
        return jnp.sqrt(state.wrong / typical)

    def go_on(state: _State) -> Array:
        return (residual(state) > rtol) & (state.steps < max_steps)

    def step(state: _State) -> _State:
        sets = find_sets(state.traction, state.slip, limit, compliance.stiffest)

        def tangent(free: Array) -> Array:
            return sets.along(compliance.drag(free)) + sets.stiffness * free

        direction, inner = conjugate_gradients(
            tangent,
            sets.along(state.slip),
            make_preconditioner(compliance, sets),
            rtol=_FORCING,
            max_steps=_NEWTON_STEPS,
        )
        end, trials = _descend(compliance, drive, limit, state, sets, direction)
        return _State(*end, state.steps + 1, state.applications + 2 * inner + trials)

    start = confine(start, limit)
    one = jnp.ones((), jnp.int32)
    slip = drive - compliance.drag(start)
    state = _State(start, slip, _violation(compliance, start, slip, limit), 0 * one, one)
    end = jax.lax.while_loop(go_on, step, state)
    return end.traction, Iterations(end.steps, end.applications, residual(end))


def _descend(
    compliance: Compliance,
    drive: Array,
    limit: Array,
    state: _State,
    sets: Sets,
    direction: Array,
) -> tuple[tuple[Array, Array, Array], Array]:
    """Take a step along the direction, halved until the energy falls, else down the gradient.

    Returns:
        Traction, slip and their violation of the law; number of applications.
    """
    work = jnp.sum(jnp.abs(state.slip * state.traction))
    rounding = 100.0 * jnp.finfo(work.dtype).eps * work  # below it, only the residual decides
    origin = jnp.where(sets.slide, limit * sets.normal, state.traction)

    def attempt(move: Array) -> tuple[tuple[Array, Array, Array], Array]:
        traction = confine(origin + move, limit)
        slip = drive - compliance.drag(traction)
        gain = jnp.sum((state.slip + slip) * (traction - state.traction))
        promise = jnp.sum(state.slip * (traction - state.traction))
        wrong = _violation(compliance, traction, slip, limit)
        nearer = (gain >= -rounding) & (wrong < state.wrong)
        return (traction, slip, wrong), (gain > 1e-4 * jnp.abs(promise)) | nearer

    def go_on(carry) -> Array:
        *_, good, halvings = carry
        return ~good & (halvings <= _HALVINGS)

    def halve(carry):
        *_, halvings = carry
        last = halvings == _HALVINGS
        move = jnp.where(
            last,
            state.slip / compliance.stiffest,
            jnp.exp2(-halvings.astype(work.dtype)) * direction,
        )
        return *attempt(move), halvings + 1

    zero = jnp.zeros((), jnp.int32)
    first = ((state.traction, state.slip, state.wrong), jnp.zeros((), bool), zero)
    end, _, trials = jax.lax.while_loop(go_on, halve, first)
    return end, trials


def friction_residual(
    compliance: Compliance,
    traction: Float[Array, "2 nx ny"],
    slip: Float[Array, "2 nx ny"],
    limit: Float[Array, "nx ny"],
    drive: Float[Array, "2 nx ny"],
) -> Float[Array, ""]:
    """Residual of Coulomb's law for a traction [-]; see `solve_traction`."""
    wrong = _violation(compliance, traction, slip, limit)
    return jnp.sqrt(wrong / _sum_of_squares(drive, limit))


def _sum_of_squares(drive: Array, limit: Array) -> Array:
    """Sum of squares of the drive over the contact; above 0."""
    square = jnp.sum(jnp.where(limit > 0.0, drive, 0.0) ** 2)
    return jnp.maximum(square, jnp.finfo(square.dtype).tiny)


def _violation(compliance: Compliance, traction: Array, slip: Array, limit: Array) -> Array:
    """Sum of squares of the slip against Coulomb's law, and of sliding cells' lack of traction."""
    stiffest = compliance.stiffest
    sets = find_sets(traction, slip, limit, stiffest)
    lack = jnp.where(sets.slide, limit - dot(traction, sets.normal), 0.0)
    return jnp.sum(sets.along(slip) ** 2) + jnp.sum((stiffest * lack) ** 2)


def make_preconditioner(compliance: Compliance, sets: Sets) -> Operator:
    """Approximate inverse of the tangential system on the sets, for free parts of fields."""
    inverse = compliance.inverse()
    weight, local = blend(inverse, sets)

    def precondition(free: Array) -> Array:
        return sets.along(weight * inverse.drag(weight * free)) + local * free

    return precondition


def blend(inverse: Compliance, sets: Sets) -> tuple[Float[Array, "nx ny"], Float[Array, "nx ny"]]:
    """Weights that blend two approximate inverses of the tangential system.

    The inverse compliance is used where cells stick or slide little, the inverse of the cells'
    stiffness where this is larger. The inverse compliance alone needs more steps on finer grids:
    four times as many at 512².

    Returns:
        Weight on both sides of the inverse compliance [-]; local part of the inverse [MPa/mm].
    """
    diagonal = jnp.mean(0.5 * (inverse.shear[0] + inverse.shear[1]))  # of the inverse, all waves
    share = 1.0 / (1.0 + diagonal * sets.stiffness)
    return jnp.sqrt(share), (1.0 - share) / (_SOFT / diagonal + sets.stiffness)


def confine(
    traction: Float[Array, "2 nx ny"], limit: Float[Array, "nx ny"]
) -> Float[Array, "2 nx ny"]:
    """Scale a traction back to |τ| ≤ μp."""
    square = dot(traction, traction)
    beyond = square > limit**2
    return traction * jnp.where(beyond, limit / jnp.sqrt(jnp.where(beyond, square, 1.0)), 1.0)
