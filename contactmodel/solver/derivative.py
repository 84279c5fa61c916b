"""The derivative of pressure and traction, by the implicit function theorem on the converged sets.

Conjugate residuals solve the equations of `tangent` for pressure and traction at once.
`jax.lax.custom_linear_solve` derives forward and reverse mode from this solve.
"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.elasticity.compliance import Compliance
from contactmodel.grid import dot
from contactmodel.solver.friction import Sets, find_sets
from contactmodel.solver.linear import Operator, conjugate_gradients, conjugate_residuals
from contactmodel.solver.tangent import Load, Tangent


def attach_derivative(
    pressure: Float[Array, "nx ny"],
    traction: Float[Array, "2 nx ny"],
    compliance: Compliance,
    load: Load,
    *,
    smooth: bool,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
    """The solution, differentiable with respect to the compliance and the load.

    Args:
        pressure: the solution [MPa].
        traction: the solution [MPa].
        compliance: compliance of the pair.
        load: shape, motion and friction.
        smooth: whether there is no friction; then only the pressure changes.
        rtol: tolerance of the linear solve [-].
        max_steps: largest number of iterations of the linear solve.
    """
    p, t = jax.lax.stop_gradient((pressure, traction))
    if smooth:
        return _attach_smooth(p, compliance, load.gap, rtol, max_steps), t
    return _attach_both(p, t, compliance, load, rtol, max_steps)


def _attach_both(
    p: Array,
    t: Array,
    compliance: Compliance,
    load: Load,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> tuple[Array, Array]:
    """Attach the derivative of pressure and traction, by conjugate residuals."""
    fixed, law = jax.lax.stop_gradient((compliance, load.friction))
    sets = _find_sets(p, t, fixed, jax.lax.stop_gradient(load.motion), law.limit(p))
    limit = load.friction.limit(p)
    carried = t + (limit - jax.lax.stop_gradient(limit)) * sets.normal  # acts on sliding cells
    w, u = compliance.displace(p, carried)
    tangent = Tangent(fixed, p > 0.0, sets, law.slope(p))
    defect = tangent.restrict(w + load.gap, u - load.motion)
    change = jax.lax.stop_gradient(defect) - defect  # 0, but its derivative is not
    precondition = tangent.make_preconditioner()

    def solve(operator: Operator, rhs: Array) -> Array:
        return conjugate_residuals(operator, rhs, precondition, rtol=rtol, max_steps=max_steps)[0]

    def solve_transposed(_: Operator, rhs: Array) -> Array:  # JAX's transpose takes longer
        return solve(tangent.apply_transposed, rhs)

    unknown = jax.lax.custom_linear_solve(tangent.apply, change, solve, solve_transposed)
    dp, dt = tangent.changes(unknown)
    return p + dp, carried + dt


def _attach_smooth(
    p: Array, compliance: Compliance, gap: Array, rtol: ArrayLike, max_steps: ArrayLike
) -> Array:
    """Attach the derivative of the pressure without friction, by conjugate gradients."""
    fixed = jax.lax.stop_gradient(compliance)
    contact, inverse = p > 0.0, fixed.inverse()
    gap = compliance.press(p) + gap
    change = jnp.where(contact, jax.lax.stop_gradient(gap) - gap, 0.0)

    def on_contact(press: Operator) -> Operator:  # the identity outside the contact
        return lambda field: jnp.where(contact, press(jnp.where(contact, field, 0.0)), field)

    def solve(operator: Operator, rhs: Array) -> Array:
        rough = on_contact(inverse.press)
        return conjugate_gradients(operator, rhs, rough, rtol=rtol, max_steps=max_steps)[0]

    return p + jax.lax.custom_linear_solve(on_contact(fixed.press), change, solve, symmetric=True)


def _find_sets(
    pressure: Array, traction: Array, compliance: Compliance, motion: Array, limit: Array
) -> Sets:
    """The sets of the solution; cells in contact without friction slide along their slip."""
    slip = motion - compliance.displace(pressure, traction)[1]
    sets = find_sets(traction, slip, limit, compliance.stiffest)
    square = dot(slip, slip)
    smooth = (pressure > 0.0) & (limit <= 0.0) & (square > 0.0)
    ahead = slip / jnp.sqrt(jnp.where(smooth, square, 1.0))
    return sets._replace(normal=jnp.where(smooth, ahead, sets.normal))
