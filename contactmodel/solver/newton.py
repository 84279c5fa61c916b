"""Pressure and traction at once, by Newton's method from a near start.

Each step finds the touching, sticking and sliding cells from the present pressure and traction, and
solves the equations of `tangent` approximately. The residual may rise a little, because cells that
change their state often change it back. No energy is minimised by both, so convergence is not
guaranteed. From a far start, or after a step that leads far away, `alternating` solves in turn.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.elasticity.compliance import Compliance
from contactmodel.solver.friction import confine, find_sets, friction_residual
from contactmodel.solver.linear import Iterations, conjugate_residuals
from contactmodel.solver.normal import gap_residual
from contactmodel.solver.tangent import Load, Tangent

_FORCING = 0.05  # tolerance of a step's linear system; a smaller one saves no steps
_LINEAR_STEPS = 6  # largest number of iterations for the linear system
_NEWTON_STEPS = 12
_RISE = 2.0  # largest factor by which a step may raise the residual


class Joint(NamedTuple):
    """Pressure and traction with their residuals."""

    pressure: Float[Array, "nx ny"]  # p [MPa]
    traction: Float[Array, "2 nx ny"]  # τ [MPa]
    normal: Float[Array, ""]  # residual of `normal` [-]
    # number of Newton steps; number of applications of the compliance to pressure and traction at
    # once, or of its approximate inverse; residual of `friction`
    tangential: Iterations


class _State(NamedTuple):
    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    gap: Float[Array, "nx ny"]
    slip: Float[Array, "2 nx ny"]
    normal: Float[Array, ""]
    tangential: Float[Array, ""]

    @property
    def worst(self) -> Float[Array, ""]:
        return jnp.maximum(self.normal, self.tangential)


class _Search(NamedTuple):
    best: _State
    next: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]
    last: Float[Array, ""]
    steps: Int[Array, ""]
    applications: Int[Array, ""]
    ended: Bool[Array, ""]


def solve_jointly(
    compliance: Compliance,
    load: Load,
    *,
    start: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    near: Bool[Array, ""],
    rtol: ArrayLike,
) -> Joint:
    """Improve pressure and traction by joint Newton steps. Derivatives stop here.

    Args:
        compliance: compliance of the pair.
        load: shape, motion and friction.
        start: initial pressure and traction [MPa].
        near: whether the start is near enough; otherwise no step is taken.
        rtol: tolerance of both residuals [-].

    Returns:
        The pressure and traction with the smallest residuals; the start if no step improves them.
    """
    compliance, load, start = jax.lax.stop_gradient((compliance, load, start))
    pressure = jnp.maximum(start[0], 0.0)
    traction = confine(start[1], load.friction.limit(pressure))
    undeformed = load.gap + compliance.lift(traction)
    drive = load.motion - compliance.pull(pressure)
    task = _Task(compliance, load, undeformed, drive, rtol)

    def go_on(search: _Search) -> Array:
        return ~search.ended & (search.steps < _NEWTON_STEPS)

    zero, inf = jnp.zeros((), jnp.int32), jnp.full((), jnp.inf, load.gap.dtype)
    begin = _State(pressure, traction, load.gap, load.motion, inf, inf)
    first = _Search(begin, (pressure, traction), inf, zero, zero + 1, ~near)
    end = jax.lax.while_loop(go_on, task.step, first)
    best = end.best
    done = Iterations(end.steps, end.applications, best.tangential)
    return Joint(best.pressure, best.traction, best.normal, done)


class _Task(NamedTuple):
    """The problem, and the scales of the residuals."""

    compliance: Compliance
    load: Load
    undeformed: Float[Array, "nx ny"]
    drive: Float[Array, "2 nx ny"]
    rtol: ArrayLike

    def assess(self, pressure: Array, traction: Array) -> _State:
        """Residuals of a pressure and a traction."""
        load, limit = self.load, self.load.friction.limit(pressure)
        w, u = self.compliance.displace(pressure, traction)
        gap, slip = load.gap + w, load.motion - u
        normal = gap_residual(pressure, gap, self.undeformed)
        tangential = friction_residual(self.compliance, traction, slip, limit, self.drive)
        return _State(pressure, traction, gap, slip, normal, tangential)

    def step(self, search: _Search) -> _Search:
        """Assess the next pressure and traction, and take a Newton step from them."""
        new, best = self.assess(*search.next), search.best
        astray = ~(new.worst < _RISE * search.last)
        best = jax.tree.map(lambda a, b: jnp.where(new.worst < best.worst, a, b), new, best)
        ended = astray | (new.worst <= self.rtol)
        friction = self.load.friction
        limit = friction.limit(new.pressure)
        sets = find_sets(new.traction, new.slip, limit, self.compliance.stiffest)
        touching = (new.pressure > 0.0) | (new.gap < 0.0)
        tangent = Tangent(self.compliance, touching, sets, friction.slope(new.pressure))
        defect = tangent.restrict(-new.gap, new.slip)
        change, inner = conjugate_residuals(
            tangent.apply,
            jnp.where(ended, 0.0, defect),
            tangent.make_preconditioner(),
            rtol=jnp.maximum(_FORCING, 0.5 * self.rtol / new.worst),
            max_steps=_LINEAR_STEPS,
            kept=_LINEAR_STEPS,
        )
        dp, dt = tangent.changes(change)
        origin = jnp.where(sets.slide, limit * sets.normal, new.traction)
        pressure = jnp.maximum(new.pressure + dp, 0.0)
        return _Search(
            best=best,
            next=(pressure, confine(origin + dt, friction.limit(pressure))),
            last=new.worst,
            steps=search.steps + 1,
            applications=search.applications + 2 * inner + 1,
            ended=ended,
        )
