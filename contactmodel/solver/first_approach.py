"""First estimate of the approach for a normal force, before any contact is solved.

[Hertz1882] H. Hertz, "Über die Berührung fester elastischer Körper". The stiffness of a round
contact of radius a is 2E*a. A paraboloid on a half-space touches half of the area where the
undeformed surfaces overlap. This relation is applied here to the cells that overlap, for any shape.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.elasticity.cells import cell_integrals
from contactmodel.elasticity.compliance import Compliance
from contactmodel.grid import Grid


def estimate_approach(
    compliance: Compliance,
    heights: Float[Array, "nx ny"],
    grid: Grid,
    normal_force: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Approach at which the bodies first touch, and an estimate of the approach under a force.

    The estimate is Hertz's for a paraboloid on half-spaces. It is up to a third too small for a
    flat face, and too large for a layer that is thin relative to the contact.

    Args:
        compliance: compliance of the pair.
        heights: heights of the object's undeformed surface [mm].
        grid: cells.
        normal_force: force that presses the bodies together, from 0 [N].

    Returns:
        Approach at first touch and estimated approach [mm].
    """
    heights = jnp.sort(jnp.ravel(heights))
    cell = cell_integrals(jnp.zeros(()), jnp.zeros(()), grid.spacing)
    sunk = compliance.press(jnp.zeros(grid.shape, heights.dtype).at[0, 0].set(1.0))[0, 0]
    modulus = (cell.xx + cell.yy + cell.zz).astype(heights.dtype) / (jnp.pi * sunk)  # E*
    overlap = grid.cell_area * jnp.arange(1, heights.size + 1, dtype=heights.dtype)
    stiffness = 2.0 * modulus * jnp.sqrt(overlap / (2.0 * jnp.pi))
    gained = jnp.cumsum(stiffness[:-1] * jnp.diff(heights))
    force = jnp.concatenate([jnp.zeros_like(gained[:1]), gained])
    last = jnp.searchsorted(force, normal_force, side="right") - 1
    estimate = heights[last] + (normal_force - force[last]) / stiffness[last]
    return heights[0], estimate.astype(normal_force.dtype)
