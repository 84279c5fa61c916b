"""What users hold after solving: tractions, displacements, slip, and how the solver fared."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Real

from contactmodel.arrays import AnyArray
from contactmodel.bodies import AbstractBody
from contactmodel.checks import non_negative
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
    coupling_max_turns = (
        "pressure and traction did not settle on each other: take the path in smaller steps, or a "
        "smaller friction coefficient (above about 2, dissimilar bodies may have no solution)"
    )
    out_of_touch = (
        "the bodies do not touch, and carry no force and no moment: give a larger approach, or a "
        "normal force"
    )
    beyond_friction = "friction cannot carry the force or moment asked for"
    resultant_max_steps = (
        "no motion was found for the force or moment asked for: give a first guess nearer to it, "
        "or go there in smaller steps"
    )


class ContactSolution(eqx.Module):
    """A contact of an elastomer S with an object B, or a path of such contacts.

    Vectors have their component first: `traction[0]` is τ_x. Along a path, every array has the
    steps as its first axis; properties and methods work on it.

    Attributes:
        grid: where the fields are given.
        elastomer: S.
        object_: B.
        pose: of the object.
        friction_coefficient: μ [-].
        pressure: p on both bodies [MPa].
        traction: τ on the elastomer; the object carries −τ [MPa].
        gap: between the deformed surfaces [mm].
        sliding: cells in contact that slide in the last step; none while the object rests.
        slip: s of Eq. 1, of points that lay on each other when the path began; beyond the contact
            as well [mm].
        slip_increment: what B's surface moved in the last step past the points of S where it then
            was; the sum over the steps is s where a point sticks, and for small twists [mm].
        dissipated_energy: since the path began [N·mm].
        result: how the solve ended.
        normal: iterations of the pressure.
        friction: iterations of the traction, and those of both at once.
    """

    grid: Grid = eqx.field(static=True)
    elastomer: AbstractBody
    object_: AbstractBody
    pose: Pose
    friction_coefficient: Float[Array, "..."]
    pressure: Float[Array, "*path nx ny"]
    traction: Float[Array, "*path 2 nx ny"]
    gap: Float[Array, "*path nx ny"]
    sliding: Bool[Array, "*path nx ny"]
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

    def elastomer_displacement(self, depth: ArrayLike = 0.0) -> Float[Array, "*path 3 nx ny"]:
        """Displacement of the elastomer at the centres of the cells [mm].

        Args:
            depth: below its surface [mm].
        """
        u, v, w = self._on_grid(self.elastomer, self.traction, self._below(self.elastomer, depth))
        return jnp.stack([u, v, -w], axis=-3)

    def object_displacement(self, depth: ArrayLike = 0.0) -> Float[Array, "*path 3 nx ny"]:
        """The same of the object, by its deformation alone, without the pose [mm]."""
        components = self._on_grid(self.object_, -self.traction, self._below(self.object_, depth))
        return jnp.stack(components, axis=-3)

    def elastomer_displacement_at(
        self, points: Real[AnyArray, "n 2"], depth: ArrayLike = 0.0
    ) -> Float[Array, "*path n 3"]:
        """Displacement of points of the undeformed elastomer, markers for example [mm].

        Args:
            points: anywhere, on the grid or beyond [mm].
            depth: of the points below the surface [mm].
        """
        points = jnp.asarray(points, self.pressure.dtype)
        below = self._below(self.elastomer, depth)
        u, v, w = self._at(self.elastomer, self.traction, points, below)
        return jnp.stack([u, v, -w], axis=-1)

    def object_displacement_at(
        self, points: Real[AnyArray, "n 2"], depth: ArrayLike = 0.0
    ) -> Float[Array, "*path n 3"]:
        """The same of the object, by its deformation alone [mm]."""
        points = jnp.asarray(points, self.pressure.dtype)
        below = self._below(self.object_, depth)
        components = self._at(self.object_, -self.traction, points, below)
        return jnp.stack(components, axis=-1)

    @eqx.filter_jit
    def elastomer_rotation(self) -> Float[Array, "*path nx ny"]:
        """φ = ½ rot u_S at the centres of the cells, exact for their tractions [rad]."""
        return self._rotation(self.elastomer, self.traction)

    @eqx.filter_jit
    def object_rotation(self) -> Float[Array, "*path nx ny"]:
        """½ rot u_B by the object's deformation alone [rad]."""
        return self._rotation(self.object_, -self.traction)

    def _below(self, body: AbstractBody, depth: ArrayLike) -> Array | None:
        """A depth below the surface, checked; None at the surface, where more is known."""
        if isinstance(depth, int | float) and depth == 0:
            return None
        checked = non_negative(depth)
        body.check(self.grid.spacing, checked)
        return checked

    @eqx.filter_jit
    def _on_grid(self, body: AbstractBody, traction: Array, depth: Array | None) -> list[Array]:
        coefficients = grid_coefficients(body, self.grid, depth)
        spectra = Coefficients(*map(transform, coefficients, Coefficients._fields))
        return _displacement(spectra, self.pressure, traction, convolve)

    def _rotation(self, body: AbstractBody, traction: Array) -> Array:
        c = grid_coefficients(body, self.grid)
        spectra = jnp.stack([transform(c.turn_x, "turn_x"), transform(c.turn_y, "turn_y")])
        return jnp.sum(convolve(spectra, traction), axis=-3)

    @eqx.filter_jit
    def _at(
        self, body: AbstractBody, traction: Array, points: Array, depth: Array | None
    ) -> list[Array]:
        z = 0.0 if depth is None else depth

        def add_up(coefficient: Array, field: Array) -> Array:
            return jnp.sum(coefficient * field, axis=(-2, -1))

        def at_point(point: Array) -> list[Array]:
            x, y = point[:, None, None] - jnp.asarray(self.grid.points, point.dtype)
            cell = cell_integrals(x, y, self.grid.spacing, z)
            c = body.coefficients(cell, self.grid.spacing)
            return _displacement(c, self.pressure, traction, add_up)

        each = jax.lax.map(at_point, points, batch_size=16)
        return [jnp.moveaxis(component, 0, -1) for component in each]


def stack_steps(steps: Sequence[ContactSolution]) -> ContactSolution:
    """Contacts of the same bodies one after the other, as a path."""
    path = jax.tree.map(lambda *leaves: jnp.stack(leaves), *steps)
    return eqx.tree_at(_constants, path, _constants(steps[0]))


def _constants(solution: Any) -> tuple[Any, Any, Any]:
    """What does not change along a path."""
    return solution.elastomer, solution.object_, solution.friction_coefficient


def _displacement(c: Coefficients, pressure: Array, traction: Array, apply) -> list[Array]:
    """u_x, u_y and w (into the body) by a pressure and the traction that the body carries."""
    tau_x, tau_y = jnp.moveaxis(traction, -3, 0)
    return [
        apply(c.xx, tau_x) + apply(c.xy, tau_y) + apply(c.xz, pressure),
        apply(c.xy, tau_x) + apply(c.yy, tau_y) + apply(c.yz, pressure),
        apply(c.zz, pressure) + apply(c.zx, tau_x) + apply(c.zy, tau_y),
    ]
