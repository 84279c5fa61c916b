"""The traction: one step of Coulomb friction at a given pressure.

[Kalker1990] J. J. Kalker, "Three-Dimensional Elastic Bodies in Rolling Contact", Section 4.2.
[Vollebregt2010] E. A. H. Vollebregt, "Improving the speed and accuracy of the frictional rolling
contact model CONTACT" (TangCG: conjugate gradients on the sets of sticking and sliding cells).

Minimise ½ τ·Cτ − τ·b over |τ| ≤ μp. The drive b is the rigid increment plus Cτ of the step before.
The remainder s = b − Cτ is the increment of slip: 0 where a cell sticks, along τ where it slides.

The loop is our own: each of its steps is a Newton step on the present sets. A sticking cell has
two unknowns; a sliding one moves along its circle, with the curvature s/μp. Newton's method alone
diverges on shifts and pivots; here each step is cut back until the energy falls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.elasticity.compliance import Compliance
from contactmodel.grid import dot
from contactmodel.solver.linear import Iterations, Operator, conjugate_gradients

_FORCING = 0.05  # each Newton step solves its linear system to this; tighter buys nothing
_NEWTON_STEPS = 25  # conjugate gradients within it at most
_HALVINGS = 6
_STILL = 10.0  # slip below this many tolerances is none
_SOFT = 4.0  # share of the shortest waves' compliance in what slides; 1 to 8 do as well
_NEAR_LIMIT = 1e-3  # short of μp by less, a cell may be taken for sliding


class Sets(NamedTuple):
    """The state of each cell, and the frame in which a sliding one moves.

    Attributes:
        stick: cells in contact that stick.
        slide: cells in contact that slide.
        normal: τ/|τ| of the sliding cells, 0 elsewhere.
        stiffness: |s|/μp of the sliding cells, 0 elsewhere [mm/MPa].
    """

    stick: Bool[Array, "nx ny"]
    slide: Bool[Array, "nx ny"]
    normal: Float[Array, "2 nx ny"]
    stiffness: Float[Array, "nx ny"]

    def along(self, field: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """The part of a field in which cells are free: all that stick, or along their circle."""
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
    """What sticks and what slides: the latter carries μp, and its slip does not pull it back.

    A cell short of μp slides if its slip would take it there by the shortest step down the
    gradient. At the rim μp is so small that rounding hides what that step gains.

    Args:
        traction: τ [MPa].
        slip: increment of slip s [mm].
        limit: μp [MPa].
        stiffest: bound on the compliance [mm/MPa].
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
    """Cells in contact that slide by more than the solver leaves to those that stick.

    Args:
        compliance: of the pair.
        traction: τ [MPa].
        motion: of the rigid object, with what was left of the slip before the step [mm].
        slip: increment of slip s [mm].
        pressure: p [MPa].
        limit: μp [MPa].
        rtol: tolerance that the traction was solved to [-].
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
    """Traction on the elastomer, |τ| ≤ μp, that sticks or slides along the slip.

    By Newton steps on the present sets, each cut back until the energy falls. Derivatives stop
    here; see `derivative`.

    The residual is the root mean square, over the cells in contact, of the slip that sticking
    cells have, of the slip across τ and of the slip against τ that sliding cells have, divided by
    the root mean square of the drive.

    Args:
        compliance: of the pair.
        drive: b [mm].
        limit: μp, 0 outside the contact [MPa].
        start: a traction to begin with [MPa].
        rtol: tolerance on the residual [-].
        max_steps: Newton steps at most.

    Returns:
        Traction [MPa], and what the solver did.
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
    """A step along the direction, halved until the energy falls; else one down the gradient.

    Returns:
        Traction, slip and what is wrong with them; applications.
    """
    work = jnp.sum(jnp.abs(state.slip * state.traction))
    rounding = 100.0 * jnp.finfo(work.dtype).eps * work  # below it, only the residual tells
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
    """How far a traction is from Coulomb's law [-]; see `solve_traction`.

    Args:
        compliance: of the pair.
        traction: τ [MPa].
        slip: increment of slip s [mm].
        limit: μp [MPa].
        drive: b [mm].
    """
    wrong = _violation(compliance, traction, slip, limit)
    return jnp.sqrt(wrong / _sum_of_squares(drive, limit))


def _sum_of_squares(drive: Array, limit: Array) -> Array:
    """Of the drive over the contact; above 0."""
    square = jnp.sum(jnp.where(limit > 0.0, drive, 0.0) ** 2)
    return jnp.maximum(square, jnp.finfo(square.dtype).tiny)


def _violation(compliance: Compliance, traction: Array, slip: Array, limit: Array) -> Array:
    """Sum of the squares of the slip that Coulomb's law forbids, and of what sliding cells lack."""
    stiffest = compliance.stiffest
    sets = find_sets(traction, slip, limit, stiffest)
    lack = jnp.where(sets.slide, limit - dot(traction, sets.normal), 0.0)
    return jnp.sum(sets.along(slip) ** 2) + jnp.sum((stiffest * lack) ** 2)


def make_preconditioner(compliance: Compliance, sets: Sets) -> Operator:
    """Roughly the inverse of the tangential system on the sets, for fields that are free there.

    Args:
        compliance: of the pair.
        sets: which cells are free, and how.
    """
    inverse = compliance.inverse()
    weight, local = blend(inverse, sets)

    def precondition(free: Array) -> Array:
        return sets.along(weight * inverse.drag(weight * free)) + local * free

    return precondition


def blend(inverse: Compliance, sets: Sets) -> tuple[Float[Array, "nx ny"], Float[Array, "nx ny"]]:
    """How much of the tangential system's inverse is the compliance's, and what else it is.

    The compliance's where cells stick or slide little, that of the stiffness where this is the
    larger. The first alone takes the more steps the finer the grid: at 512² four times as many.

    Args:
        inverse: of the compliance.
        sets: which cells are free, and how.

    Returns:
        Weight of the compliance's inverse, on both of its sides [-]; the rest, by cell [MPa/mm].
    """
    diagonal = jnp.mean(0.5 * (inverse.shear[0] + inverse.shear[1]))  # of the inverse, all waves
    share = 1.0 / (1.0 + diagonal * sets.stiffness)
    return jnp.sqrt(share), (1.0 - share) / (_SOFT / diagonal + sets.stiffness)


def confine(
    traction: Float[Array, "2 nx ny"], limit: Float[Array, "nx ny"]
) -> Float[Array, "2 nx ny"]:
    """The traction, drawn back to |τ| ≤ μp.

    Args:
        traction: τ [MPa].
        limit: μp [MPa].
    """
    square = dot(traction, traction)
    beyond = square > limit**2
    return traction * jnp.where(beyond, limit / jnp.sqrt(jnp.where(beyond, square, 1.0)), 1.0)
