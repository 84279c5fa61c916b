"""The derivative of pressure and traction, by the implicit function theorem on the converged sets.

Conjugate residuals solve the equations of `tangent` for both at once, and
`jax.lax.custom_linear_solve` makes forward and reverse mode of it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.compliance import Compliance
from contactmodel.friction import Sets, find_sets
from contactmodel.grid import dot
from contactmodel.linear import Operator, conjugate_gradients, conjugate_residuals
from contactmodel.tangent import Tangent


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
    sets = _find_sets(p, t, fixed, jax.lax.stop_gradient(motion), mu)

    limit = friction * p
    carried = t + (limit - jax.lax.stop_gradient(limit)) * sets.normal  # μ acts on what slides
    w, u = compliance.displace(p, carried)
    tangent = Tangent(fixed, p > 0.0, sets, mu)
    defect = tangent.restrict(w + gap, u - motion)
    change = jax.lax.stop_gradient(defect) - defect  # 0, but its derivative is not
    precondition = tangent.make_preconditioner()

    def solve(operator: Operator, rhs: Array) -> Array:
        how = {"rtol": rtol, "max_steps": max_steps}
        return conjugate_residuals(operator, rhs, precondition, **how)[0]

    def solve_transposed(_: Operator, rhs: Array) -> Array:  # JAX's transpose takes longer
        return solve(tangent.apply_transposed, rhs)

    unknown = jax.lax.custom_linear_solve(tangent.apply, change, solve, solve_transposed)
    dp, dt = tangent.changes(unknown)
    return p + dp, carried + dt


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
    square = dot(slip, slip)
    smooth = (pressure > 0.0) & (limit <= 0.0) & (square > 0.0)
    ahead = slip / jnp.sqrt(jnp.where(smooth, square, 1.0))
    return sets._replace(normal=jnp.where(smooth, ahead, sets.normal))
