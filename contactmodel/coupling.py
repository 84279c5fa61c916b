"""Pressure and traction together, each bound to the other.

Pressing pulls the surfaces of dissimilar bodies past each other, and friction lifts them. For a
given traction the pressure is the minimum of one convex energy, for a given pressure the traction
that of another (`normal`, `friction`), but the two together are not one minimum: they are solved in
turn until the pressure needs no more steps, with a secant step between turns [Anderson1965] and
less of the new traction if they do not approach.
Each turn solves both a little further than the turns have come. Bodies with the same (1−2ν)/G need
one turn.

[Anderson1965] D. G. Anderson, "Iterative procedures for nonlinear integral equations".
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from contactmodel.compliance import Compliance
from contactmodel.derivative import attach_derivative, attach_smooth
from contactmodel.friction import solve_traction
from contactmodel.linear import Iterations
from contactmodel.normal import pressure_residual, solve_pressure

MAX_TURNS = 60
_FORCING = 0.03  # tolerance of both solvers by the residual of the turn before
_FLOOR = 0.5  # the least, by that of the whole: at 1, what one leaves can keep the other above it
_APPROACH = 0.7  # residual after a turn by that before; above it, the next turn takes half as much


class Load(NamedTuple):
    """What a step of a contact is solved for.

    Attributes:
        gap: between the undeformed bodies, below 0 where they overlap [mm].
        motion: of the rigid object since the last step, with what was then left of the slip [mm].
        friction: μ [-].
    """

    gap: Float[Array, "nx ny"]
    motion: Float[Array, "2 nx ny"]
    friction: Float[Array, "..."]


class Tractions(NamedTuple):
    """What was found, and how.

    Attributes:
        pressure: p [MPa].
        traction: τ [MPa].
        normal: iterations of all turns; residual under the last traction.
        tangential: the same of the traction.
        turns: pressure solved and traction solved.
        pressed: whether the pressure converged in the last turn.
        rubbed: whether the traction did.
    """

    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    normal: Iterations
    tangential: Iterations
    turns: Int[Array, ""]
    pressed: Bool[Array, ""]
    rubbed: Bool[Array, ""]


class _State(NamedTuple):
    found: Tractions
    held: Float[Array, "2 nx ny"]  # the traction that the next pressure is found for
    share: Float[Array, ""]  # of the new traction in it
    miss: Float[Array, "2 nx ny"]  # traction found less held, of the turn before


def solve_tractions(
    compliance: Compliance,
    load: Load,
    *,
    start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    rtol: float,
    max_steps: int,
) -> Tractions:
    """Pressure and traction that fulfil the laws of contact and of friction.

    Args:
        compliance: of the pair.
        load: shape, motion and friction.
        start: pressure and traction to begin with [MPa].
        rtol: tolerance on the residuals of `normal` and `friction` [-].
        max_steps: of each solver in each turn.

    Returns:
        Pressure and traction, differentiable with respect to the compliance and the load.
    """
    return _take_turns((compliance, load), start, rtol, max_steps)


@eqx.filter_custom_jvp
def _take_turns(
    task: tuple[Compliance, Load], start: tuple[Array, Array], rtol: float, max_steps: int
) -> Tractions:
    """Pressure for the traction, traction for the pressure, until the pressure stays."""
    compliance, load = task
    coupled = jnp.any(compliance.coupling != 0.0)

    def tolerance(found: Tractions) -> Array:
        before = jnp.minimum(found.normal.residual, _FORCING)
        return jnp.where(coupled, jnp.maximum(_FORCING * before, _FLOOR * rtol), rtol)

    def turn(state: _State) -> _State:
        found, held, share, miss = state
        how = {"rtol": tolerance(found), "max_steps": max_steps}
        gap = load.gap + compliance.lift(held)
        pressure, normal = solve_pressure(compliance, gap, start=found.pressure, **how)
        drive = load.motion - compliance.pull(pressure)
        traction, tangential = solve_traction(
            compliance, drive, load.friction * pressure, start=found.traction, **how
        )
        pressed, rubbed = (
            end.residual <= jnp.maximum(how["rtol"], rtol) for end in (normal, tangential)
        )
        residual = pressure_residual(compliance, load.gap + compliance.lift(traction), pressure)
        normal = normal.after(found.normal)._replace(residual=residual)
        slow = residual > _APPROACH * found.normal.residual
        share = jnp.where(slow, 0.5 * share, jnp.minimum(1.2 * share, 1.0))
        before, miss = miss, traction - held
        ahead = jnp.where(slow | (found.turns == 0), 0.0, _secant(before, miss))
        held = held + share * miss - ahead * (traction - found.traction)
        tangential = tangential.after(found.tangential)
        return _State(
            Tractions(pressure, traction, normal, tangential, found.turns + 1, pressed, rubbed),
            held,
            share,
            miss,
        )

    def go_on(state: _State) -> Array:
        found = state.found
        settled = (found.normal.residual <= rtol) & (found.tangential.residual <= rtol)
        return ~settled & (found.turns < MAX_TURNS) & found.pressed & found.rubbed

    zero = jnp.zeros((), jnp.int32)
    none = Iterations(zero, zero, jnp.full((), jnp.inf, load.gap.dtype))
    true = jnp.ones((), bool)
    begin = Tractions(*start, none, none, zero, true, true)
    one = jnp.ones((), load.gap.dtype)
    first = _State(begin, begin.traction, one, jnp.zeros_like(begin.traction))
    return jax.lax.while_loop(go_on, turn, first).found


def _secant(before: Array, now: Array) -> Array:
    """Where between two turns what is amiss is least, as a share of the way back to the first.

    [Anderson1965] with the memory of one turn, not followed farther than half of that way.
    """
    change = now - before
    square = jnp.sum(change**2)
    share = jnp.sum(change * now) / jnp.where(square > 0.0, square, 1.0)
    return jnp.clip(share, -0.5, 0.5)


def solve_smooth(
    compliance: Compliance,
    gap: Float[Array, "nx ny"],
    *,
    start: Float[Array, "nx ny"],
    rtol: float,
    max_steps: int,
) -> Tractions:
    """The pressure alone, without friction; as `solve_tractions`."""
    pressure, normal = _press((compliance, gap), start, rtol, max_steps)
    zero, true = jnp.zeros((), jnp.int32), jnp.ones((), bool)
    still = Iterations(zero, zero, jnp.zeros((), gap.dtype))
    none = jnp.zeros((2, *gap.shape), gap.dtype)
    return Tractions(pressure, none, normal, still, zero + 1, normal.residual <= rtol, true)


@eqx.filter_custom_jvp
def _press(
    task: tuple[Compliance, Array], start: Array, rtol: float, max_steps: int
) -> tuple[Array, Iterations]:
    return solve_pressure(*task, start=start, rtol=rtol, max_steps=max_steps)


@_press.def_jvp
def _press_jvp(primals, tangents):
    """The derivative of the pressure; that of the start is 0."""
    task, start, rtol, max_steps = primals
    pressure, done = _press(task, start, rtol, max_steps)

    def attach(task: tuple[Compliance, Array]) -> Array:
        return attach_smooth(pressure, *task, rtol=rtol, max_steps=max_steps)

    _, change = eqx.filter_jvp(attach, (task,), (tangents[0],))
    return (pressure, done), (change, jax.tree.map(lambda _: None, done))


@_take_turns.def_jvp
def _take_turns_jvp(primals, tangents):
    """The derivative of what was found; that of the start is 0."""
    task, start, rtol, max_steps = primals
    end = _take_turns(task, start, rtol, max_steps)

    def attach(task: tuple[Compliance, Load]) -> tuple[Array, Array]:
        found = end.pressure, end.traction
        return attach_derivative(*found, task[0], *task[1], rtol=rtol, max_steps=max_steps)

    _, (dpressure, dtraction) = eqx.filter_jvp(attach, (task,), (tangents[0],))
    still = jax.tree.map(lambda _: None, end)
    return end, still._replace(pressure=dpressure, traction=dtraction)
