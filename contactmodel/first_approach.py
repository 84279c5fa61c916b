"""How deep to press for a given normal force, before any contact is solved.

[Hertz1882] H. Hertz, "Über die Berührung fester elastischer Körper". A round contact of radius a
gets stiffer as 2E*a. On half-spaces the bodies touch where the undeformed surfaces overlap, on
half of that area for a paraboloid; here the overlap is counted in cells, for any shape.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.bodies import AbstractBody
from contactmodel.compliance import cell_integrals
from contactmodel.grid import Grid, make_points
from contactmodel.indenters import AbstractIndenter


def estimate_approach(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    grid: Grid,
    normal_force: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Approach at which the bodies first touch, and an estimate of that under a force.

    The estimate is Hertz's for a paraboloid on half-spaces, too small by up to a third under a flat
    face and too large on a layer that is thin beside the contact.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape.
        grid: cells.
        normal_force: pressing the bodies together, 0 or more [N].

    Returns:
        Both approaches [mm].
    """
    heights = jnp.sort(jnp.ravel(indenter.height(make_points(grid, normal_force.dtype))))
    cell = cell_integrals(jnp.zeros(()), jnp.zeros(()), grid.spacing)
    sunk = sum(body.coefficients(cell, grid.spacing).zz for body in (elastomer, object_))
    modulus = (cell.xx + cell.yy + cell.zz) / (jnp.pi * sunk)  # E*
    overlap = grid.cell_area * jnp.arange(1, heights.size + 1)
    stiffness = 2.0 * modulus * jnp.sqrt(overlap / (2.0 * jnp.pi))
    gained = jnp.cumsum(stiffness[:-1] * jnp.diff(heights))
    force = jnp.concatenate([jnp.zeros(1), gained])
    last = jnp.searchsorted(force, normal_force, side="right") - 1
    estimate = heights[last] + (normal_force - force[last]) / stiffness[last]
    return heights[0], estimate.astype(normal_force.dtype)
