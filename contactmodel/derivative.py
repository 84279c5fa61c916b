"""The derivative of pressure and traction, by the implicit function theorem on the converged sets.

Where a cell touches, the gap stays 0; where it sticks, its slip too; where it slides, |τ| stays μp
and τ turns with the slip. These are linear equations for the changes of both: dp and, on sliding
cells with n = τ/|τ|, dτ = w + μ dp n, w along their circle. But for μ dp n they are symmetric.
GMRES solves them for dp and w at once, and `jax.lax.custom_linear_solve` makes forward and reverse
mode of it.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax.scipy.sparse.linalg import gmres
from jaxtyping import Array, Float

from contactmodel.compliance import Compliance
from contactmodel.friction import Sets, find_sets, make_preconditioner
from contactmodel.linear import Operator, conjugate_gradients

_RESTART = 20  # steps of GMRES whose directions are kept


def attach_derivative(
    pressure: Float[Array, "nx ny"],
    traction: Float[Array, "2 nx ny"],
    compliance: Compliance,
    gap: Float[Array, "nx ny"],
    motion: Float[Array, "2 nx ny"],
    friction: Float[Array, "..."],
    *,
    rtol: float,
    max_steps: int,
) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
    """The solution, differentiable with respect to compliance, gap, motion and friction.

    Args:
        pressure: the solution [MPa].
        traction: the solution [MPa].
        compliance: of the pair.
        gap: between the undeformed bodies [mm].
        motion: of the rigid object since the last step, with what was then left of the slip [mm].
        friction: μ [-].
        rtol: tolerance of the linear solve [-].
        max_steps: of the linear solve at most.
    """
    p, t = jax.lax.stop_gradient((pressure, traction))
    fixed, mu = jax.lax.stop_gradient((compliance, friction))
    contact = p > 0.0
    sets = _find_sets(p, t, fixed, jax.lax.stop_gradient(motion), mu)

    limit = friction * p
    carried = t + (limit - jax.lax.stop_gradient(limit)) * sets.normal  # μ acts on what slides
    w, u = compliance.displace(p, carried)
    defect = jnp.stack([jnp.where(contact, w + gap, 0.0), *sets.along(u - motion)])
    change = jax.lax.stop_gradient(defect) - defect  # 0, but its derivative is not
    press, rub = fixed.inverse().press, make_preconditioner(fixed, sets)

    def tangent(unknown: Array, *, transposed: bool = False) -> Array:
        dp, free = jnp.where(contact, unknown[0], 0.0), sets.along(unknown[1:])
        along = mu * sets.normal  # of dτ by dp
        w, u = fixed.displace(dp, free if transposed else free + along * dp)
        w = w + jnp.sum(along * u, axis=0) if transposed else w
        slip = sets.along(u) + sets.stiffness * free
        # the identity where nothing may change
        return jnp.stack([jnp.where(contact, w, unknown[0]), *(slip + unknown[1:] - free)])

    def precondition(defect: Array) -> Array:
        normal = press(jnp.where(contact, defect[0], 0.0))
        return jnp.stack([jnp.where(contact, normal, defect[0]), *rub(defect[1:])])

    def solve(operator: Operator, rhs: Array) -> Array:
        # preconditioned by hand: JAX would compare M r with the tolerance on r
        return gmres(
            lambda unknown: precondition(operator(unknown)),
            precondition(rhs),
            tol=rtol,
            restart=_RESTART,
            maxiter=-(-max_steps // _RESTART),
            solve_method="incremental",
        )[0]

    def solve_transposed(_: Operator, rhs: Array) -> Array:  # JAX's transpose takes longer
        return solve(partial(tangent, transposed=True), rhs)

    unknown = jax.lax.custom_linear_solve(tangent, change, solve, solve_transposed)
    dp, free = unknown[0], unknown[1:]
    return p + dp, carried + free + mu * dp * sets.normal


def attach_smooth(
    pressure: Float[Array, "nx ny"],
    compliance: Compliance,
    gap: Float[Array, "nx ny"],
    *,
    rtol: float,
    max_steps: int,
) -> Float[Array, "nx ny"]:
    """The same of the pressure without friction, by conjugate gradients.

    Args:
        pressure: the solution [MPa].
        compliance: of the pair.
        gap: between the undeformed bodies [mm].
        rtol: tolerance of the linear solve [-].
        max_steps: of the linear solve at most.
    """
    p, fixed = jax.lax.stop_gradient((pressure, compliance))
    contact, inverse = p > 0.0, fixed.inverse()
    gap = compliance.press(p) + gap
    change = jnp.where(contact, jax.lax.stop_gradient(gap) - gap, 0.0)

    def on_contact(press: Operator) -> Operator:  # the identity where nothing may change
        return lambda field: jnp.where(contact, press(jnp.where(contact, field, 0.0)), field)

    def solve(operator: Operator, rhs: Array) -> Array:
        rough = on_contact(inverse.press)
        return conjugate_gradients(operator, rhs, rough, rtol=rtol, max_steps=max_steps)[0]

    return p + jax.lax.custom_linear_solve(on_contact(fixed.press), change, solve, symmetric=True)


def _find_sets(
    pressure: Array, traction: Array, compliance: Compliance, motion: Array, friction: Array
) -> Sets:
    """The sets of the solution; where μ = 0, what touches slides along its slip."""
    slip = motion - compliance.displace(pressure, traction)[1]
    limit = friction * pressure
    sets = find_sets(traction, slip, limit, compliance.stiffest)
    square = jnp.sum(slip**2, axis=0)
    smooth = (pressure > 0.0) & (limit <= 0.0) & (square > 0.0)
    ahead = slip / jnp.sqrt(jnp.where(smooth, square, 1.0))
    return sets._replace(normal=jnp.where(smooth, ahead, sets.normal))
