"""What users hold after solving: tractions, displacements, slip, and how the solver fared."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from contactmodel.arrays import AnyArray
from contactmodel.bodies import AbstractBody
from contactmodel.compliance import (
    Coefficients,
    cell_integrals,
    convolve,
    grid_coefficients,
    transform,
)
from contactmodel.grid import Grid
from contactmodel.linear import Iterations
from contactmodel.pose import Pose

_AT_LIMIT = 1e-6  # a cell slides if its traction is this close to μp, relative


class RESULTS(eqx.Enumeration):
    """How a solve ended. All but `successful` and `no_contact` are failures."""

    successful = ""
    no_contact = "the bodies do not touch: the approach is too small"
    at_the_edge = (
        "the contact reaches the edge of the grid: take a larger grid, or a smaller approach or "
        "indenter"
    )
    normal_max_steps = (
        "the pressure did not converge within max_steps: allow more, or a larger rtol"
    )
    friction_max_steps = (
        "the traction did not converge within max_steps: allow more, a larger rtol, or take the "
        "path in smaller steps"
    )


class ContactSolution(eqx.Module):
    """A contact of an elastomer S with an object B, or a path of such contacts.

    Vectors have their component first: `traction[0]` is τ_x. Along a path, every array has the
    steps as its first axis; the properties work on it, the methods take one contact (`jax.vmap`).

    Attributes:
        grid: where the fields are given.
        elastomer: S.
        object_: B.
        pose: of the object.
        friction_coefficient: μ [-].
        pressure: p on both bodies [MPa].
        traction: τ on the elastomer; the object carries −τ [MPa].
        gap: between the deformed surfaces [mm].
        slip: s, motion of B's surface against S's since the path began, the part of it that
            pressing dissimilar bodies causes left out; beyond the contact as well [mm].
        slip_increment: its share in the last step [mm].
        dissipated_energy: since the path began [N·mm].
        result: how the solve ended.
        normal: iterations of the pressure.
        friction: iterations of the traction.
    """

    grid: Grid = eqx.field(static=True)
    elastomer: AbstractBody
    object_: AbstractBody
    pose: Pose
    friction_coefficient: Float[Array, "..."]
    pressure: Float[Array, "*path nx ny"]
    traction: Float[Array, "*path 2 nx ny"]
    gap: Float[Array, "*path nx ny"]
    slip: Float[Array, "*path 2 nx ny"]
    slip_increment: Float[Array, "*path 2 nx ny"]
    dissipated_energy: Float[Array, "*path"]
    result: RESULTS  # pyright: ignore[reportInvalidTypeForm]
    normal: Iterations
    friction: Iterations

    def at_step(self, index: int) -> "ContactSolution":
        """One contact of a path."""
        constants = (self.elastomer, self.object_, self.friction_coefficient)
        one = jax.tree.map(lambda leaf: leaf[index], eqx.tree_at(_constants, self, (None,) * 3))
        return eqx.tree_at(_constants, one, constants, is_leaf=lambda leaf: leaf is None)

    @property
    def contact(self) -> Bool[Array, "*path nx ny"]:
        """Cells under pressure."""
        return self.pressure > 0.0

    @property
    def sliding(self) -> Bool[Array, "*path nx ny"]:
        """Cells in contact whose traction has reached μp."""
        limit = self.friction_coefficient * self.pressure
        square = jnp.sum(self.traction**2, axis=-3)
        return self.contact & (square >= ((1.0 - _AT_LIMIT) * limit) ** 2)

    @property
    def stick(self) -> Bool[Array, "*path nx ny"]:
        """Cells in contact that stick in the last step."""
        return self.contact & ~self.sliding

    @property
    def stick_ratio(self) -> Float[Array, "*path"]:
        """Share of the contact that sticks; 0 without contact [-]."""
        area = jnp.sum(self.contact, axis=(-2, -1))
        return jnp.sum(self.stick, axis=(-2, -1)) / jnp.maximum(area, 1)

    @property
    def force(self) -> Float[Array, "*path 3"]:
        """Force of the object on the elastomer [N]."""
        normal = -jnp.sum(self.pressure, axis=(-2, -1))[..., None]
        shear = jnp.sum(self.traction, axis=(-2, -1))
        return jnp.concatenate([shear, normal], axis=-1) * self.grid.cell_area

    @property
    def moment(self) -> Float[Array, "*path"]:
        """Moment of the object on the elastomer about z through the pose's centre [N·mm]."""
        x, y = jnp.moveaxis(self.grid.points - self.pose.centre[..., None, None], -3, 0)
        tau_x, tau_y = jnp.moveaxis(self.traction, -3, 0)
        return jnp.sum(x * tau_y - y * tau_x, axis=(-2, -1)) * self.grid.cell_area

    @eqx.filter_jit
    def elastomer_displacement(self) -> Float[Array, "3 nx ny"]:
        """Displacement of the elastomer's surface [mm]."""
        coefficients = grid_coefficients(self.elastomer, self.grid)
        return _below(self._on_grid(coefficients, self.traction))

    @eqx.filter_jit
    def object_displacement(self) -> Float[Array, "3 nx ny"]:
        """Displacement of the object's surface by its deformation alone, without the pose [mm]."""
        coefficients = grid_coefficients(self.object_, self.grid)
        return self._on_grid(coefficients, -self.traction)

    @eqx.filter_jit
    def elastomer_displacement_at(self, points: Float[AnyArray, "n 2"]) -> Float[Array, "n 3"]:
        """Displacement of points of the elastomer's undeformed surface, markers for example [mm].

        Args:
            points: anywhere, on the grid or beyond [mm].
        """
        return _below(self._at(self.elastomer, self.traction, points).T).T

    @eqx.filter_jit
    def object_displacement_at(self, points: Float[AnyArray, "n 2"]) -> Float[Array, "n 3"]:
        """The same of the object's surface, by its deformation alone [mm]."""
        return self._at(self.object_, -self.traction, points)

    @eqx.filter_jit
    def elastomer_rotation(self) -> Float[Array, "nx ny"]:
        """φ = ½ rot u_S at the centres of the cells, exact for their tractions [rad]."""
        return self._rotation(self.elastomer, self.traction)

    @eqx.filter_jit
    def object_rotation(self) -> Float[Array, "nx ny"]:
        """½ rot u_B by the object's deformation alone [rad]."""
        return self._rotation(self.object_, -self.traction)

    def _on_grid(self, coefficients: Coefficients, traction: Array) -> Array:
        spectra = jax.tree.map(transform, coefficients)
        return _displacement(spectra, self.pressure, traction, convolve)

    def _rotation(self, body: AbstractBody, traction: Array) -> Array:
        c = grid_coefficients(body, self.grid)
        return jnp.sum(convolve(transform(jnp.stack([c.turn_x, c.turn_y])), traction), axis=0)

    def _at(self, body: AbstractBody, traction: Array, points: AnyArray) -> Array:
        def at_point(point: Array) -> Array:
            x, y = point[:, None, None] - jnp.asarray(self.grid.points, point.dtype)
            c = body.coefficients(cell_integrals(x, y, self.grid.spacing))
            return _displacement(c, self.pressure, traction, lambda a, b: jnp.sum(a * b))

        return jax.lax.map(at_point, jnp.asarray(points), batch_size=16)


def stack_steps(steps: Sequence[ContactSolution]) -> ContactSolution:
    """Contacts of the same bodies one after the other, as a path."""
    path = jax.tree.map(lambda *leaves: jnp.stack(leaves), *steps)
    return eqx.tree_at(_constants, path, _constants(steps[0]))


def _constants(solution: Any) -> tuple[Any, Any, Any]:
    """What does not change along a path."""
    return solution.elastomer, solution.object_, solution.friction_coefficient


def _displacement(c: Coefficients, pressure: Array, traction: Array, apply) -> Array:
    """u_x, u_y and w (into the body) by a pressure and the traction that the body carries."""
    tau_x, tau_y = traction
    return jnp.stack(
        [
            apply(c.xx, tau_x) + apply(c.xy, tau_y) + apply(c.xz, pressure),
            apply(c.xy, tau_x) + apply(c.yy, tau_y) + apply(c.yz, pressure),
            apply(c.zz, pressure) - apply(c.xz, tau_x) - apply(c.yz, tau_y),
        ]
    )


def _below(displacement: Array) -> Array:
    """Of the elastomer, whose inside is towards −z."""
    return displacement.at[2].multiply(-1.0)
