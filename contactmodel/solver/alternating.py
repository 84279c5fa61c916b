"""Pressure and traction together, each bound to the other.

Pressing pulls the surfaces of dissimilar bodies past each other, and friction lifts them. From a
start that is near, Newton's method finds both at once (`newton`). It needs one: for a given
traction the pressure is the minimum of one convex energy, for a given pressure the traction that
of another (`normal`, `friction`), and solving these in turn comes nearer from anywhere, though
slowly, as the two together are not one minimum. So a turn goes before each attempt that has nothing
to start from or got stuck. Bodies with the same (1−2ν)/G need one turn only.
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
_FORCING = 0.03  # tolerance of both solvers by the residual of the turn before
_FLOOR = 0.5  # the least, by that of the whole: at 1, what one leaves can keep the other above it


class Tractions(NamedTuple):
    """What was found, and how.

    Attributes:
        pressure: p [MPa].
        traction: τ [MPa].
        normal: iterations of all turns; residual under the last traction.
        tangential: the same of the traction, and those of both at once.
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


def solve_tractions(
    compliance: Compliance,
    load: Load,
    *,
    start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    smooth: bool,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    """Pressure and traction that fulfil the laws of contact and of friction.

    Args:
        compliance: of the pair.
        load: shape, motion and friction.
        start: pressure and traction to begin with [MPa].
        smooth: whether there is no friction; then the pressure alone is solved for.
        rtol: tolerance on the residuals of `normal` and `friction` [-].
        max_steps: of each solver in each turn.

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
    """The derivative of what was found; that of the start is 0."""
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
    """The same, without a derivative: both at once, and in turn where that does not do."""
    if smooth:
        return _press(compliance, load, start, rtol, max_steps)
    coupled = compliance.coupling is not None
    acts = jnp.any(compliance.coupling != 0.0) if coupled else jnp.zeros((), bool)

    def tolerance(found: Tractions) -> Array:
        before = jnp.minimum(found.normal.residual, _FORCING)
        return jnp.where(acts, jnp.maximum(_FORCING * before, _FLOOR * rtol), rtol)

    def turn(found: Tractions) -> Tractions:
        how = {"rtol": tolerance(found), "max_steps": max_steps}
        gap = load.gap + compliance.lift(found.traction)
        pressure, normal = solve_pressure(compliance, gap, start=found.pressure, **how)
        drive = load.motion - compliance.pull(pressure)
        traction, tangential = solve_traction(
            compliance, drive, load.friction.limit(pressure), start=found.traction, **how
        )
        pressed, rubbed = (
            end.residual <= jnp.maximum(how["rtol"], rtol) for end in (normal, tangential)
        )
        if coupled:
            gap = load.gap + compliance.lift(traction)
            normal = normal._replace(residual=pressure_residual(compliance, gap, pressure))
        normal = normal.after(found.normal)
        tangential = tangential.after(found.tangential)
        return Tractions(pressure, traction, normal, tangential, found.turns + 1, pressed, rubbed)

    def settled(found: Tractions) -> Array:
        return (found.normal.residual <= rtol) & (found.tangential.residual <= rtol)

    def attempt(found: Tractions) -> Tractions:
        near = acts & jnp.any(found.pressure > 0.0)
        start = found.pressure, found.traction
        end = solve_jointly(compliance, load, start=start, near=near, rtol=rtol)
        together = found._replace(
            pressure=end.pressure,
            traction=end.traction,
            normal=found.normal._replace(residual=end.normal),
            tangential=end.tangential.after(found.tangential),
        )
        found = jax.tree.map(lambda a, b: jnp.where(near, a, b), together, found)
        return jax.lax.cond(settled(found), lambda: found, lambda: turn(found))

    def go_on(found: Tractions) -> Array:
        more = (found.turns < MAX_TURNS) & found.pressed & found.rubbed
        return ~settled(found) & more

    begin = begin_with(start)
    return jax.lax.while_loop(go_on, attempt, begin) if coupled else turn(begin)


def _press(
    compliance: Compliance,
    load: Load,
    start: tuple[Array, Array],
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> Tractions:
    """The pressure alone, without friction."""
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
    """Pressure and traction to begin with [MPa], before anything is solved."""
    zero, true = jnp.zeros((), jnp.int32), jnp.ones((), bool)
    none = Iterations(zero, zero, jnp.full((), jnp.inf, start[0].dtype))
    return Tractions(*start, none, none, zero, true, true)
