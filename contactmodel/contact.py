"""The problem that is solved: two bodies, their shape, the grid and the friction between them."""

import equinox as eqx
import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import is_traced
from contactmodel.common.checks import Numbers, non_negative
from contactmodel.elasticity.bodies import AbstractBody, Rigid
from contactmodel.friction import AbstractFriction, as_friction
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter


class Contact(eqx.Module):
    """A contact of an elastomer S with an object B, before anything has moved.

    Made once, it is solved for one pose after the other (`solve_contact`) or along a path
    (`solve_path`). Derivatives go to all of its numbers.

    Attributes:
        elastomer: the body S.
        object_: the body B, what it is made of.
        indenter: the shape of B.
        grid: cells, more than cover the contact.
        friction_coefficient: μ, a number or a map of the grid [-], or a law of friction; it is kept
            as a law.
        marker_depth: of the elastomer's markers below its surface; None on the surface [mm].

    Raises:
        ValueError: two rigid bodies, numbers of the friction that are no map of the grid, a layer
            thinner than a cell, or markers below the base of one.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, solve_contact
        >>> gel, ball = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5), Sphere(radius=20.0)
        >>> grid = Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), ball, grid, friction_coefficient=0.5)
        >>> for depth in (0.5, 1.0):
        ...     solution = solve_contact(contact, Pose(approach=depth))
        ...     print(f"{depth} mm deep takes {-solution.force[2]:.2f} N")
        0.5 mm deep takes 1.70 N
        1.0 mm deep takes 4.75 N
    """

    elastomer: AbstractBody
    object_: AbstractBody
    indenter: AbstractIndenter
    grid: Grid = eqx.field(static=True)
    friction_coefficient: AbstractFriction
    marker_depth: Float[Array, ""] | None

    def __init__(
        self,
        elastomer: AbstractBody,
        object_: AbstractBody,
        indenter: AbstractIndenter,
        grid: Grid,
        friction_coefficient: Numbers | AbstractFriction,
        marker_depth: ArrayLike | None = None,
    ) -> None:
        """Check the parts against each other, and keep them."""
        if isinstance(elastomer, Rigid) and isinstance(object_, Rigid):
            raise ValueError("both bodies are rigid; at least one must be elastic")
        friction = as_friction(friction_coefficient)
        for leaf in jax.tree.leaves(friction):
            if leaf.shape not in ((), grid.shape):
                raise ValueError(
                    f"μ must be a number or a map of shape {grid.shape}, got {leaf.shape}"
                )
        self.marker_depth = check_depth(marker_depth)
        self.elastomer = elastomer.checked(grid.spacing, self.marker_depth)
        self.object_ = object_.checked(grid.spacing)
        self.indenter = indenter
        self.grid = grid
        self.friction_coefficient = friction


def check_depth(depth: ArrayLike | None) -> Float[Array, ""] | None:
    """A depth below the surface [mm]; None on the surface, where more is known."""
    if depth is None or (not is_traced(depth) and not np.any(np.asarray(depth))):
        return None
    return non_negative(depth)
