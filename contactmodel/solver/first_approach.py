"""How deep to press for a given normal force, before any contact is solved.

[Hertz1882] H. Hertz, "Über die Berührung fester elastischer Körper". A round contact of radius a
gets stiffer as 2E*a. On half-spaces the bodies touch where the undeformed surfaces overlap, on
half of that area for a paraboloid; here the overlap is counted in cells, for any shape.
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
    """Approach at which the bodies first touch, and an estimate of that under a force.

    The estimate is Hertz's for a paraboloid on half-spaces, too small by up to a third under a flat
    face and too large on a layer that is thin beside the contact.

    Args:
        compliance: of the pair.
        heights: of the object's undeformed surface [mm].
        grid: cells.
        normal_force: pressing the bodies together, 0 or more [N].

    Returns:
        Both approaches [mm].
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
