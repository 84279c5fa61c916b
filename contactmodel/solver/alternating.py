"""Pressure and traction together, if each depends on the other.

Pressing pulls the surfaces of dissimilar bodies past each other, and friction lifts them. Newton's
method finds pressure and traction at once (`newton`), but needs a near start. For a given traction
the pressure minimises one convex energy, and for a given pressure the traction minimises another
(`normal`, `friction`). Solving these two in turn approaches the solution from any start, but
slowly, because both together do not minimise one energy. A turn therefore precedes each attempt of
Newton's method that has no start or has stalled. Bodies with the same (1−2ν)/G need only one turn.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.elasticity.compliance import Compliance
from contactmodel.solver.derivative import attach_derivative
from contactmodel.solver.friction import solve_traction
from contactmodel.solver.linear import Iterations
from contactmodel.solver.newton import solve_jointly
from contactmodel.solver.normal import pressure_residual, solve_pressure
from contactmodel.solver.tangent import Load

MAX_TURNS = 60
_FORCING = 0.03  # tolerance of both solvers over the residual of the previous turn
_FLOOR = 0.5  # smallest, over rtol: at 1, the residual of one can keep the other above rtol


class Tractions(NamedTuple):
    """Pressure and traction, and the solvers' iterations."""

    pressure: Float[Array, "nx ny"]  # p [MPa]
    traction: Float[Array, "2 nx ny"]  # τ [MPa]
    normal: Iterations  # pressure iterations of all turns; residual under the last traction
    tangential: Iterations  # traction iterations of all turns, joint Newton steps included
    turns: Int[Array, ""]  # number of turns; each solves the pressure and then the traction
    pressed: Bool[Array, ""]  # whether the pressure converged in the last turn
    rubbed: Bool[Array, ""]  # whether the traction converged in the last turn


def solve_tractions(
    compliance: Compliance,
    load: Load,
    *,
    start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    smooth: bool,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    """Solve for pressure and traction that satisfy the laws of contact and friction.

    Args:
        compliance: compliance of the pair.
        load: shape, motion and friction.
        start: initial pressure and traction [MPa].
        smooth: whether there is no friction; then only the pressure is solved for.
        rtol: tolerance of the residuals of `normal` and `friction` [-].
        max_steps: largest number of iterations of each solver in each turn.

    Returns:
        Pressure and traction, differentiable with respect to the compliance and the load.
    """
    return _solve((compliance, load), start, smooth, rtol, max_steps)


@eqx.filter_custom_jvp
def _solve(
    task: tuple[Compliance, Load],
    start: tuple[Array, Array],
    smooth: bool,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    return find_tractions(*task, start=start, smooth=smooth, rtol=rtol, max_steps=max_steps)


@_solve.def_jvp
def _solve_jvp(primals, tangents):
    """The derivative of the solution; that by the start is 0."""
    task, _, smooth, rtol, max_steps = primals
    end = _solve(*primals)

    def attach(task: tuple[Compliance, Load]) -> tuple[Array, Array]:
        how = {"smooth": smooth, "rtol": rtol, "max_steps": max_steps}
        return attach_derivative(end.pressure, end.traction, *task, **how)

    _, (dpressure, dtraction) = eqx.filter_jvp(attach, (task,), (tangents[0],))
    still = jax.tree.map(lambda _: None, end)
    return end, still._replace(pressure=dpressure, traction=dtraction)


def find_tractions(
    compliance: Compliance,
    load: Load,
    *,
    start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    smooth: bool,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    """Solve like `solve_tractions` without a derivative: jointly, and in turn if that fails."""
    if smooth:
        return _press(compliance, load, start, rtol, max_steps)
    coupled = compliance.coupling is not None
    acts = jnp.any(compliance.coupling != 0.0) if coupled else jnp.zeros((), bool)

    def tolerance(last: Tractions) -> Array:
        before = jnp.minimum(last.normal.residual, _FORCING)
        return jnp.where(acts, jnp.maximum(_FORCING * before, _FLOOR * rtol), rtol)

    def turn(last: Tractions) -> Tractions:
        how = {"rtol": tolerance(last), "max_steps": max_steps}
        gap = load.gap + compliance.lift(last.traction)
        pressure, normal = solve_pressure(compliance, gap, start=last.pressure, **how)
        drive = load.motion - compliance.pull(pressure)
        traction, tangential = solve_traction(
            compliance, drive, load.friction.limit(pressure), start=last.traction, **how
        )
        pressed, rubbed = (
            end.residual <= jnp.maximum(how["rtol"], rtol) for end in (normal, tangential)
        )
        if coupled:
            gap = load.gap + compliance.lift(traction)
            normal = normal._replace(residual=pressure_residual(compliance, gap, pressure))
        normal = normal.after(last.normal)
        tangential = tangential.after(last.tangential)
        return Tractions(pressure, traction, normal, tangential, last.turns + 1, pressed, rubbed)

    def converged(state: Tractions) -> Array:
        return (state.normal.residual <= rtol) & (state.tangential.residual <= rtol)

    def attempt(state: Tractions) -> Tractions:
        near = acts & jnp.any(state.pressure > 0.0)
        start = state.pressure, state.traction
        end = solve_jointly(compliance, load, start=start, near=near, rtol=rtol)
        joint = state._replace(
            pressure=end.pressure,
            traction=end.traction,
            normal=state.normal._replace(residual=end.normal),
            tangential=end.tangential.after(state.tangential),
        )
        state = jax.tree.map(lambda a, b: jnp.where(near, a, b), joint, state)
        return jax.lax.cond(converged(state), lambda: state, lambda: turn(state))

    def go_on(state: Tractions) -> Array:
        more = (state.turns < MAX_TURNS) & state.pressed & state.rubbed
        return ~converged(state) & more

    begin = begin_with(start)
    return jax.lax.while_loop(go_on, attempt, begin) if coupled else turn(begin)


def _press(
    compliance: Compliance,
    load: Load,
    start: tuple[Array, Array],
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    """Solve for the pressure alone, without friction."""
    how = {"rtol": rtol, "max_steps": max_steps}
    pressure, normal = solve_pressure(compliance, load.gap, start=start[0], **how)
    begin = begin_with(start)
    still = begin.tangential._replace(residual=jnp.zeros_like(normal.residual))
    return begin._replace(
        pressure=pressure,
        traction=jnp.zeros_like(start[1]),
        normal=normal,
        tangential=still,
        turns=begin.turns + 1,
        pressed=normal.residual <= rtol,
    )


def begin_with(start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]) -> Tractions:
    """The state before any iteration, with the initial pressure and traction [MPa]."""
    zero, true = jnp.zeros((), jnp.int32), jnp.ones((), bool)
    begin = Iterations(zero, zero, jnp.full((), jnp.inf, start[0].dtype))
    return Tractions(*start, begin, begin, zero, true, true)
