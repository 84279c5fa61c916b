"""The solution of a contact: tractions, displacements, slip and the solver's result."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Real

from contactmodel.common.arrays import AnyArray, is_traced
from contactmodel.common.turning import Circles, on_circles, to_circles, turn
from contactmodel.contact import Contact, check_depth
from contactmodel.elasticity.bodies import AbstractBody, Layer
from contactmodel.elasticity.cells import Coefficients, cell_integrals
from contactmodel.elasticity.compliance import convolve, grid_coefficients, transform
from contactmodel.elasticity.corrections import (
    Correction,
    Loading,
    measure_loading,
    narrow,
    stiffen,
)
from contactmodel.elasticity.reading import (
    ReadNearby,
    ReadOnGrid,
    find_reading,
    is_read,
    raise_limit,
    read_field,
)
from contactmodel.grid import Grid, length
from contactmodel.indenters import measure_shape
from contactmodel.pose import Pose
from contactmodel.solver.linear import Iterations
from contactmodel.solver.results import RESULTS

_PLAIN_TURN, _LARGEST_TURN = 0.1, 0.45  # rad; to these the corrections were checked


class ContactSolution(eqx.Module):
    """A solved contact of an elastomer S with an object B, or a path of such contacts.

    The component is the first axis of a vector: `traction[0]` is τ_x. For a path, the steps are the
    first axis of every array; properties and methods apply to all steps.

    Attributes:
        problem: the contact that was solved: bodies, shape, grid and friction.
        pose: motion of the object.
        pressure: p on both bodies [MPa].
        traction: τ on the elastomer; the object carries −τ [MPa].
        gap: distance between the deformed surfaces [mm].
        sliding: cells in contact that slide in the last step; none while the object rests.
        slip: s of Eq. 1, the relative displacement of points that faced each other at the start of
            the path, inside and outside the contact [mm].
        slip_increment: motion of B's surface in the last step relative to the points of S that it
            faced. For sticking points and for small twists, the increments of all steps sum to s
            [mm].
        dissipated_energy: energy dissipated since the start of the path [N·mm].
        result: how the solve ended.
        normal: iterations of the pressure solver.
        friction: iterations of the traction solver and of the joint solver.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, solve_contact
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, 0.5)
        >>> solution = solve_contact(contact, Pose(approach=1.0, twist=0.15))
        >>> print(f"{solution.moment:.3f} N·mm, {100 * solution.stick_ratio:.0f} % of it sticks")
        5.674 N·mm, 18 % of it sticks
        >>> solution.elastomer_displacement().shape
        (3, 24, 24)
    """

    problem: Contact
    pose: Pose
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
        """The contact at one step of a path."""
        return self.map_steps(lambda leaf: leaf[index])

    def map_steps(self, function: Callable[[Array], Array]) -> "ContactSolution":
        """Apply a function to every array except those of `problem`, which all steps share."""
        bare = jax.tree.map(function, eqx.tree_at(_problem, self, None))
        return eqx.tree_at(_problem, bare, self.problem, is_leaf=lambda leaf: leaf is None)

    @property
    def grid(self) -> Grid:
        """Cells on which the fields are given."""
        return self.problem.grid

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
        """Fraction of the contact area that sticks; 0 without contact [-].

        In a round contact it is (c/a)², the square of the closed forms' stick ratio.
        """
        area = jnp.sum(self.contact, axis=(-2, -1))
        return jnp.sum(self.stick, axis=(-2, -1)) / jnp.maximum(area, 1)

    @property
    def force(self) -> Float[Array, "*path 3"]:
        """Force of the object on the elastomer, with the corrections of its `Layer` [N]."""
        normal = -jnp.sum(self.pressure, axis=(-2, -1))[..., None]
        shear = jnp.sum(self.traction, axis=(-2, -1))
        if self.pose.corotated:
            shear = jnp.moveaxis(turn(jnp.moveaxis(shear, -1, 0), self.pose.twist), 0, -1)
        force = jnp.concatenate([shear, normal], axis=-1) * self.grid.cell_area
        return (
            force * self.correction.force[..., None]
            if self.problem.elastomer.is_corrected
            else force
        )

    @property
    def moment(self) -> Float[Array, "*path"]:
        """Moment of the object on the elastomer about z through the pose's centre [N·mm].

        It includes the corrections of the `Layer`.
        """
        place = self.grid.points
        if self.pose.corotated:
            place = self._placed(jnp.asarray(place))
        x, y = jnp.moveaxis(place - self.pose.centre[..., None, None], -3, 0)
        tau_x, tau_y = jnp.moveaxis(self.traction, -3, 0)
        moment = jnp.sum(x * tau_y - y * tau_x, axis=(-2, -1)) * self.grid.cell_area
        return moment * self.correction.moment if self.problem.elastomer.is_corrected else moment

    @property
    def correction(self) -> Correction:
        """Factors in `force` and `moment`, which the elastomer's `Layer` selects.

        Pressure, traction, slip and energy stay those of linear elasticity, but for the limit of
        friction under corotated poses (see `reading`). Press
        in four steps or more: in one step, friction carries too much of the press. Poses that are
        not corotated are covered up to twists of 0.1 rad. Outside the range, `solve_contact` and
        `solve_path` give a `RangeWarning`, inside `jit` only `covered` shows it.
        """
        if self.problem.elastomer.is_corrected:
            return self._correct()
        one = jnp.ones_like(self.pose.twist)
        return Correction(one, one, one > 0.0)

    @property
    def loading(self) -> Loading:
        """The numbers of the linear contact from which the corrections follow."""
        points = jnp.asarray(self.grid.points, self.pressure.dtype)
        shape = measure_shape(self.problem.indenter, points)
        law, gel, raised = self.problem.friction_coefficient, self.problem.elastomer, None
        if is_read(gel, self.pose.corotated):
            law_at = raise_limit(law, gel, shape, points, self.pose.approach)
            raised = law_at.limit(self.pressure)
        limit = law.limit(self.pressure)
        return measure_loading(points, shape[1], self.pressure, self.traction, limit, raised)

    @eqx.filter_jit
    def _correct(self) -> Correction:
        gel, pose, loading = self.problem.elastomer, self.pose, self.loading
        assert isinstance(gel, Layer)
        nu, h = gel.poisson_ratio, gel.thickness
        parts = [stiffen(loading, pose.approach, nu, h)] if gel.neo_hookean else []
        parts += [] if gel.radius is None else [narrow(loading, nu, h, gel.radius)]
        turned = jnp.abs(pose.twist) <= (_LARGEST_TURN if pose.corotated else _PLAIN_TURN)
        return Correction(
            math.prod([part.force for part in parts], start=jnp.ones(())),
            math.prod([part.moment for part in parts], start=jnp.ones(())),
            math.prod([part.covered for part in parts], start=turned),
        )

    def elastomer_displacement(
        self, depth: ArrayLike | None = None
    ) -> Float[Array, "*path 3 nx ny"]:
        """Displacement of the elastomer at the centres of the cells [mm].

        At the surface of a neo-Hookean layer under a corotated pose it is corrected (`reading`).

        Args:
            depth: depth below its surface; None at the surface [mm].
        """
        if not self.pose.corotated:
            u, v, w = self._on_grid(*self._of_elastomer(depth))
            return jnp.stack([u, v, -w], axis=-3)
        circles, w = self._circles_on_grid(depth)
        read = ReadOnGrid(self.grid, circles.angle, w) if self._is_read(depth) else None
        u, v, w = self._in_space(jnp.asarray(self.grid.points), circles, w, read)
        return jnp.stack([u, v, -w], axis=-3)

    def object_displacement(self, depth: ArrayLike | None = None) -> Float[Array, "*path 3 nx ny"]:
        """Displacement of the object at the centres of the cells by its deformation alone [mm].

        Args:
            depth: depth below its surface; None at the surface [mm].
        """
        components = self._on_grid(*self._of_object(depth))
        return jnp.stack(components, axis=-3)

    def elastomer_displacement_at(
        self, points: Real[AnyArray, "n 2"], depth: ArrayLike | None = None
    ) -> Float[Array, "*path n 3"]:
        """Displacement of points of the elastomer, for example of markers [mm].

        It is corrected like `elastomer_displacement`.

        Args:
            points: undeformed positions, inside or outside the grid [mm].
            depth: depth of the points below the surface; None at the surface [mm].
        """
        points = jnp.asarray(points, self.pressure.dtype)
        if not self.pose.corotated:
            u, v, w = self._at(*self._of_elastomer(depth), points)
            return jnp.stack([u, v, -w], axis=-1)
        circles, w = self._circles_at(points, depth)
        read = None
        if self._is_read(depth):
            on_grid, deflection = self._circles_on_grid(None)
            field = ReadOnGrid(self.grid, on_grid.angle, deflection)
            read = ReadNearby(field, points.T, circles.angle, w)
        u, v, w = self._in_space(points.T, circles, w, read)
        return jnp.stack([u, v, -w], axis=-1)

    def object_displacement_at(
        self, points: Real[AnyArray, "n 2"], depth: ArrayLike | None = None
    ) -> Float[Array, "*path n 3"]:
        """Displacement of points of the object by its deformation alone, without the pose [mm].

        Args:
            points: undeformed positions, inside or outside the grid [mm].
            depth: depth of the points below the surface; None at the surface [mm].
        """
        points = jnp.asarray(points, self.pressure.dtype)
        components = self._at(*self._of_object(depth), points)
        return jnp.stack(components, axis=-1)

    def elastomer_rotation(self) -> Float[Array, "*path nx ny"]:
        """Rotation φ = ½ rot u_S at the centres of the cells, exact for their tractions [rad]."""
        return _rotation(self.problem.elastomer.uncorrected, self.grid, self.traction)

    def object_rotation(self) -> Float[Array, "*path nx ny"]:
        """Rotation ½ rot u_B by the object's deformation alone [rad]."""
        return _rotation(self.problem.object_.uncorrected, self.grid, -self.traction)

    def _is_read(self, depth: ArrayLike | None) -> bool:
        """Whether the field at a depth is corrected for finite strain: only at the surface."""
        corrected = is_read(self.problem.elastomer, self.pose.corotated)
        return corrected and check_depth(depth) is None

    def _circles(self, points: Array, moved: Sequence[Array], opposite: Sequence[Array]) -> Circles:
        """Motion on circles, from displacements of points and opposite points in the frame."""
        points = points[(slice(None), *[None] * self.pose.twist.ndim)]
        return to_circles(points, jnp.stack(moved), jnp.stack(opposite))

    def _circles_at(self, points: Array, depth: ArrayLike | None) -> tuple[Circles, Array]:
        """Motion of points on circles, and their deflection [mm]."""
        body = self._of_elastomer(depth)
        u, v, w = self._at(*body, points)
        return self._circles(points.T, [u, v], self._at(*body, -points)[:2]), w

    def _circles_on_grid(self, depth: ArrayLike | None) -> tuple[Circles, Array]:
        """The same at the centres of the cells."""
        u, v, w = self._on_grid(*self._of_elastomer(depth))
        opposite = [jnp.flip(part, (-2, -1)) for part in (u, v)]
        return self._circles(jnp.asarray(self.grid.points), [u, v], opposite), w

    @eqx.filter_jit
    def _in_space(
        self, points: Array, circles: Circles, w: Array, read: ReadOnGrid | ReadNearby | None
    ) -> tuple[Array, Array, Array]:
        """Displacement in space and deflection [mm]; corrected if `read` reads the field."""
        steps, axes = self.pose.twist.ndim, points.ndim - 1
        points = points[(slice(None), *[None] * steps)]
        if read is not None:
            gel = self.problem.elastomer
            assert isinstance(gel, Layer)
            reading = find_reading(self.loading, self.pose.approach, gel.thickness)
            distance = jnp.broadcast_to(length(points), circles.stretch.shape)
            stretch, angle, w = read_field(reading, distance, circles.stretch, read)
            circles = circles._replace(stretch=stretch, angle=angle)
        u, v = circles.displacement(points, self.pose.twist[(..., *[None] * axes)])
        return u, v, w

    def _placed(self, points: Float[Array, "2 nx ny"]) -> Float[Array, "*path 2 nx ny"]:
        """Present positions of the contact's points in the frame of the object [mm]."""
        moved = jnp.stack(self._on_grid(*self._of_elastomer(None))[:2])
        odd = 0.5 * (moved - jnp.flip(moved, (-2, -1)))
        steps = self.pose.twist.ndim
        return jnp.moveaxis(on_circles(points[(slice(None), *[None] * steps)], odd), 0, -3)

    def _of_elastomer(self, depth: ArrayLike | None) -> tuple[AbstractBody, Array, Array | None]:
        """The elastomer, the traction on it, and the checked depth below its surface."""
        below = check_depth(depth)
        return self.problem.elastomer.checked(self.grid.spacing, below), self.traction, below

    def _of_object(self, depth: ArrayLike | None) -> tuple[AbstractBody, Array, Array | None]:
        """The object, the traction on it, and the checked depth below its surface."""
        below = check_depth(depth)
        return self.problem.object_.checked(self.grid.spacing, below), -self.traction, below

    def _on_grid(self, body: AbstractBody, traction: Array, depth: Array | None) -> list[Array]:
        return _move_cells(body.uncorrected, self.grid, (self.pressure, traction), depth)

    def _at(
        self, body: AbstractBody, traction: Array, depth: Array | None, points: Array
    ) -> list[Array]:
        return _move_points(body.uncorrected, self.grid, (self.pressure, traction), depth, points)


def stack_steps(steps: Sequence[ContactSolution]) -> ContactSolution:
    """Join the contacts of one problem to a path."""
    bare = [eqx.tree_at(_problem, step, None) for step in steps]
    path = jax.tree.map(_stack, *bare)
    return eqx.tree_at(_problem, path, steps[0].problem, is_leaf=lambda leaf: leaf is None)


def _stack(*leaves: Array) -> Array:
    """Stack arrays, by NumPy outside `jit`: JAX compiles a program for each number of steps."""
    traced = any(map(is_traced, leaves))
    return jnp.stack(leaves) if traced else jnp.asarray(np.stack(leaves))


def _problem(solution: Any) -> Any:
    return solution.problem


@eqx.filter_jit  # of the numbers it needs, so that one program serves all shapes and laws
def _move_cells(
    body: AbstractBody, grid: Grid, loads: tuple[Array, Array], depth: Array | None
) -> list[Array]:
    """u_x, u_y and w of the centres of the cells under a pressure and a traction [mm]."""
    coefficients = _in_precision(grid_coefficients(body, grid, depth), loads[0])
    spectra = Coefficients(*map(transform, coefficients, Coefficients._fields))
    return _displacement(spectra, *loads, convolve)


@eqx.filter_jit
def _move_points(
    body: AbstractBody,
    grid: Grid,
    loads: tuple[Array, Array],
    depth: Array | None,
    points: Array,
) -> list[Array]:
    """The same of points anywhere [mm]."""
    z = 0.0 if depth is None else depth

    def add_up(coefficient: Array, field: Array) -> Array:
        return jnp.sum(coefficient * field, axis=(-2, -1))

    def at_point(point: Array) -> list[Array]:
        x, y = point[:, None, None] - jnp.asarray(grid.points, point.dtype)
        cell = cell_integrals(x, y, grid.spacing, z)
        return _displacement(body.coefficients(cell, grid.spacing), *loads, add_up)

    each = jax.lax.map(at_point, points, batch_size=16)
    return [jnp.moveaxis(component, 0, -1) for component in each]


@eqx.filter_jit
def _rotation(body: AbstractBody, grid: Grid, traction: Array) -> Array:
    c = _in_precision(grid_coefficients(body, grid), traction)
    spectra = jnp.stack([transform(c.turn_x, "turn_x"), transform(c.turn_y, "turn_y")])
    return jnp.sum(convolve(spectra, traction), axis=-3)


def _in_precision(coefficients: Coefficients, field: Array) -> Coefficients:
    """Coefficients in the field's precision, which may be single while the body is in double."""
    return jax.tree.map(lambda c: c.astype(field.dtype), coefficients)


def _displacement(c: Coefficients, pressure: Array, traction: Array, apply) -> list[Array]:
    """u_x, u_y and w (into the body) under a pressure and the traction on the body."""
    tau_x, tau_y = jnp.moveaxis(traction, -3, 0)
    return [
        apply(c.xx, tau_x) + apply(c.xy, tau_y) + apply(c.xz, pressure),
        apply(c.xy, tau_x) + apply(c.yy, tau_y) + apply(c.yz, pressure),
        apply(c.zz, pressure) + apply(c.zx, tau_x) + apply(c.zy, tau_y),
    ]
