"""Pressure and traction at once, by Newton's method from a start that is near.

Each step takes what touches, sticks and slides from the present pressure and traction and solves
the equations of `tangent` roughly. It may lead away a little, since cells that change their state
on the way often change it back. There is no energy that both make least, hence no promise: from
afar, and where a step leads far away, `alternating` solves them in turn.
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

_FORCING = 0.05  # each step solves its linear system to this; tighter buys nothing
_LINEAR_STEPS = 6  # of that solver at most
_NEWTON_STEPS = 12
_RISE = 2.0  # of the residual in a step at most


class Joint(NamedTuple):
    """Pressure and traction, and how far they are from both laws.

    Attributes:
        pressure: p [MPa].
        traction: τ [MPa].
        normal: residual of `normal` [-].
        tangential: Newton steps; applications of the compliance to pressure and traction at once
            or, as long, of its rough inverse; residual of `friction`.
    """

    pressure: Float[Array, "nx ny"]
    traction: Float[Array, "2 nx ny"]
    normal: Float[Array, ""]
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
    """Come nearer to pressure and traction that fulfil both laws. Derivatives stop here.

    Args:
        compliance: of the pair.
        load: shape, motion and friction.
        start: pressure and traction to begin with [MPa].
        near: whether that is worth while; else no step is taken.
        rtol: tolerance on both residuals [-].

    Returns:
        What was found; the start if that is not nearer.
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
    none = _State(pressure, traction, load.gap, load.motion, inf, inf)
    first = _Search(none, (pressure, traction), inf, zero, zero + 1, ~near)
    end = jax.lax.while_loop(go_on, task.step, first)
    best = end.best
    done = Iterations(end.steps, end.applications, best.tangential)
    return Joint(best.pressure, best.traction, best.normal, done)


class _Task(NamedTuple):
    """What is solved, and what the residuals are relative to."""

    compliance: Compliance
    load: Load
    undeformed: Float[Array, "nx ny"]
    drive: Float[Array, "2 nx ny"]
    rtol: ArrayLike

    def assess(self, pressure: Array, traction: Array) -> _State:
        """How far a pressure and a traction are from both laws."""
        load, limit = self.load, self.load.friction.limit(pressure)
        w, u = self.compliance.displace(pressure, traction)
        gap, slip = load.gap + w, load.motion - u
        normal = gap_residual(pressure, gap, self.undeformed)
        tangential = friction_residual(self.compliance, traction, slip, limit, self.drive)
        return _State(pressure, traction, gap, slip, normal, tangential)

    def step(self, search: _Search) -> _Search:
        """Judge the next pressure and traction, and take a Newton step from them."""
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
