"""The contact problem: two bodies, the object's shape, the grid and the friction."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import is_traced
from contactmodel.common.checks import Numbers, check_type, non_negative
from contactmodel.elasticity.bodies import AbstractBody, Rigid
from contactmodel.friction import AbstractFriction, as_friction
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter


class Contact(eqx.Module):
    """A contact of an elastomer S with an object B, before any motion.

    One `Contact` can be solved for many poses (`solve_contact`) or along a path (`solve_path`).
    Results can be differentiated by all of its numbers.

    Attributes:
        elastomer: the elastomer S.
        object_: the material of the object B.
        indenter: the shape of the object B.
        grid: cells; they must extend beyond the contact.
        friction_coefficient: μ as a number or as a map on the grid [-], or a friction law. Stored
            as a friction law.
        marker_depth: depth of the markers below the elastomer's surface; None on the surface [mm].

    Raises:
        ValueError: a part has the wrong class, both bodies are rigid, a friction map does not have
            the grid's shape, a layer is thinner than a cell, the markers lie below a layer's base,
            or a corrected layer touches another object than a rigid one.

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
        """Check that the parts fit together, and store them."""
        check_type("the elastomer", elastomer, AbstractBody, "HalfSpace(0.2, poisson_ratio=0.48)")
        check_type("the object's material", object_, AbstractBody, "Rigid()")
        check_type("the indenter", indenter, AbstractIndenter, "Sphere(radius=20.0)")
        check_type("the grid", grid, Grid, "Grid((64, 64), (14.0, 14.0))")
        if isinstance(elastomer, Rigid) and isinstance(object_, Rigid):
            raise ValueError("both bodies are rigid; at least one must be elastic")
        _check_correction(elastomer, object_)
        for body in (elastomer, object_):
            _check_one(body)
        friction = as_friction(friction_coefficient)
        for leaf in jax.tree.leaves(friction):
            if leaf.shape not in ((), grid.shape):
                raise ValueError(
                    f"μ must be a number or a map of shape {grid.shape}, got the shape {leaf.shape}"
                )
        self.marker_depth = check_depth(marker_depth)
        self.elastomer = elastomer.checked(grid.spacing, self.marker_depth)
        self.object_ = object_.checked(grid.spacing)
        self.indenter = indenter
        self.grid = grid
        self.friction_coefficient = friction


def _check_one(body: AbstractBody) -> None:
    """Reject a body of several moduli or thicknesses."""
    for leaf in jax.tree.leaves(body):
        if shape := jnp.shape(leaf):
            raise ValueError(
                f"{type(body).__name__} has a value of shape {shape}, and a contact takes one "
                "number: solve several contacts by jax.vmap or jax.lax.map"
            )


def _check_correction(elastomer: AbstractBody, object_: AbstractBody) -> None:
    """Reject a soft object on a corrected layer, and a corrected object."""
    if object_.is_corrected:
        raise ValueError("only the elastomer can be corrected: leave out radius and neo_hookean")
    if elastomer.is_corrected and not isinstance(object_, Rigid):
        raise ValueError(
            "radius and neo_hookean of a layer correct contacts with rigid objects only: use "
            "Rigid() as the object, or leave out radius and neo_hookean"
        )


def check_depth(depth: ArrayLike | None) -> Float[Array, ""] | None:
    """Check a depth below the surface [mm]; None on the surface, where solving is faster."""
    if depth is None or (not is_traced(depth) and not np.any(np.asarray(depth))):
        return None
    return non_negative(depth)
