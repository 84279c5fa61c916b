"""Surface field of a wide neo-Hookean gel in a frame that turns with the object.

Linear elasticity does not distinguish the first from the present position of a point. A pressed gel
moves outward, so a point near the edge of the contact is under another part of the object than at
first. Four corrections of the surface field follow, all for round contacts. With r the distance of
a point from the axis, h the thickness, δ the approach, a the radius of the contact, ρ the root of
the mean of r² under the pressure (all in mm), x = ρ/h and s₂ the mean slope of the object under
p r²:

1. The surface slopes, so it reaches less far outward: u_r is reduced by c₁ a (1 − x) s₂² (r/a)²
   inside the contact, and falls by (a/r)³ outside.
2. Linear fields hold at present positions: the deflection at r is read at r + u_r, and the angle ψ
   at r + c₂ u_r.
3. The gel is stiffer under the object than far away. The far field follows from the moment, which
   is larger by g₁ s₂ + g₂ x δ/h where all sticks (`corrections`), the near field from the object:
   ψ grows by c₃ (1 − a/r) times this outside the contact.
4. Friction grows with depth as the pressure and the inclined area do, and the gel's stiffness as
   the moment does where all sticks. The solution depends on their ratio, so the limit of friction
   is multiplied by (1 + y₀ + t − c₄ e x + c₅ e μ²)/(1 + g₁ s₂ + g₂ e x), with e = δ/h, and y₀ the
   force's growth before any twist and t that of the inclined area (`corrections`). They follow from
   the object's shape (`raise_limit`). The correction of the moment takes the factor out again.

The coefficients c₁ to c₅ are fitted to finite elements (`papers.finite_strain.fields`). Points
that stick since the press are not moved by 2 and 3.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeGuard

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.elasticity.bodies import AbstractBody, Layer
from contactmodel.elasticity.corrections import Loading, measure_loading, press_gain, stick_gain
from contactmodel.friction import AbstractFriction
from contactmodel.grid import Grid, interpolate

_NUMBERS = (0.192, 0.507, 1.412)
LIMIT = (0.38, 0.48)
"""c₄ and c₅ [-]."""


def is_read(body: AbstractBody, corotated: bool) -> TypeGuard[Layer]:
    """Whether the surface field of a body is corrected, under corotated poses."""
    return isinstance(body, Layer) and body.neo_hookean and corotated


class Reading(NamedTuple):
    """Numbers of the corrected field, by step."""

    radius: Float[Array, "*path"]  # a, radius of the contact; 1 without contact [mm]
    inward: Float[Array, "*path"]  # reduction of u_r at the edge of the contact [mm]
    follow: float  # c₂, share of u_r by which the angle is read further out [-]
    far: Float[Array, "*path"]  # relative growth of the angle far away [-]

    def narrow(self, distance: Float[Array, "..."]) -> Float[Array, "..."]:
        """Change of the stretch 1 + u_r/r at a distance from the axis; 0 on the axis [-]."""
        ratio, radius, inward = self._of(distance, self.inward)
        inside = ratio < 1.0
        outer = jnp.where(inside, 1.0, ratio)
        return -inward / radius * jnp.where(inside, ratio, outer**-4)

    def strengthen(self, distance: Float[Array, "..."]) -> Float[Array, "..."]:
        """Factor on the angle at a distance from the axis [-]."""
        ratio, _, far = self._of(distance, self.far)
        outer = jnp.where(ratio < 1.0, 1.0, ratio)
        return 1.0 + far * (1.0 - 1.0 / outer)

    def _of(self, distance: Array, number: Array) -> tuple[Array, Array, Array]:
        """The distance over a, a, and a number, with axes for the points."""
        axes = (..., *[None] * (distance.ndim - self.radius.ndim))
        return distance / self.radius[axes], self.radius[axes], number[axes]


def find_reading(
    loading: Loading, approach: Float[Array, "*path"], thickness: Float[Array, ""]
) -> Reading:
    """Numbers of the corrected field, from those of the linear contact."""
    touches = loading.radius > 0.0
    x = jnp.minimum(loading.reach / thickness, 1.0)
    inward = _NUMBERS[0] * loading.radius * (1.0 - x) * loading.rim_slope**2
    return Reading(
        jnp.where(touches, loading.radius, 1.0),
        jnp.where(touches, inward, 0.0),
        _NUMBERS[1],
        jnp.where(touches, _NUMBERS[2] * stick_gain(loading, approach, thickness), 0.0),
    )


def read_field(
    reading: Reading,
    distance: Float[Array, "..."],
    stretch: Float[Array, "..."],
    read: Callable[[Array, Array], tuple[Array, Array]],
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """Stretch, angle and deflection of points, corrected.

    Args:
        reading: numbers of the corrected field.
        distance: distance of the points from the axis [mm].
        stretch: 1 + u_r/r of the linear field [-].
        read: the angle and the deflection of the linear field, each read at the points times a
            factor.
    """
    narrowed = stretch + reading.narrow(distance)
    angle, deflection = read(1.0 + reading.follow * (narrowed - 1.0), narrowed)
    return narrowed, angle * reading.strengthen(distance), deflection


class ReadOnGrid(eqx.Module):
    """Reads a linear field between the cells of a grid."""

    grid: Grid = eqx.field(static=True)  # cells
    angle: Float[Array, "*path nx ny"]  # ψ [rad]
    deflection: Float[Array, "*path nx ny"]  # w [mm]

    def __call__(self, turned: Array, deep: Array) -> tuple[Array, Array]:
        """Angle and deflection, each at the cells' centres times a factor."""
        return self._at(self.angle, turned), self._at(self.deflection, deep)

    def _at(self, field: Array, scale: Array) -> Array:
        points, shape = jnp.asarray(self.grid.points, field.dtype), (-1, *self.grid.shape)
        read = jax.vmap(lambda one, factor: interpolate(self.grid, one, factor * points))
        return read(field.reshape(shape), scale.reshape(shape)).reshape(field.shape)


class ReadNearby(eqx.Module):
    """Reads a linear field near points: its values there, plus its change on the grid.

    Beyond the grid the change is that in the same direction at the rim, and falls like r⁻³.
    """

    grid: ReadOnGrid  # the field on the grid
    points: Float[Array, "2 n"]  # undeformed positions [mm]
    angle: Float[Array, "*path n"]  # ψ at the points [rad]
    deflection: Float[Array, "*path n"]  # w at the points [mm]

    def __call__(self, turned: Array, deep: Array) -> tuple[Array, Array]:
        """Angle and deflection, each at the points times a factor."""
        return (
            self.angle + self._change(self.grid.angle, turned),
            self.deflection + self._change(self.grid.deflection, deep),
        )

    def _change(self, field: Array, scale: Array) -> Array:
        """Change of a field on the grid from the points to the points times a factor."""
        cells = self.grid.grid
        rim = 0.5 * jnp.array(cells.size) - 2.0 * jnp.array(cells.spacing)
        beyond = jnp.maximum(jnp.max(jnp.abs(self.points) / rim[:, None], axis=0), 1.0)
        inner = self.points / beyond

        def change(field: Array, factor: Array) -> Array:
            return interpolate(cells, field, factor * inner) - interpolate(cells, field, inner)

        read = jax.vmap(change)(field.reshape(-1, *cells.shape), scale.reshape(-1, inner.shape[1]))
        return read.reshape(scale.shape) / beyond**3


class Raised(AbstractFriction):
    """A friction law times a factor."""

    law: AbstractFriction  # the friction law
    gain: Float[Array, "*path"]  # factor on its limit [-]

    def limit(self, pressure: Float[Array, "*path nx ny"]) -> Float[Array, "*path nx ny"]:
        """The law's limit times the factor [MPa]."""
        return self.gain[..., None, None] * self.law.limit(pressure)


def raise_limit(
    law: AbstractFriction,
    gel: Layer,
    shape: tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]],
    points: Float[Array, "2 nx ny"],
    approach: Float[Array, "*path"],
    numbers: tuple[float, float] = LIMIT,
) -> Raised:
    """The friction law whose limit grows with depth relative to the gel's stiffness in torsion.

    The contact is not known before the solve. It is taken from the object's shape, under a pressure
    p ∝ (κδ − height) cos α, α the angle of the slope. With κ = 0.65 + 0.82 ρ/h, ρ that for κ = 0.6,
    its reach is that of the pressure under spheres on layers.

    Args:
        law: the friction law.
        gel: the elastomer.
        shape: the object's height [mm], and its derivatives by x and y [-].
        points: centres of the cells [mm].
        approach: δ [mm].
        numbers: c₄ and c₅ [-].
    """
    (height, slope), thickness = shape, gel.thickness
    lean = 4.0 * gel.shear_modulus / thickness / jnp.sqrt(1.0 + jnp.sum(slope**2, axis=0))
    depth = jnp.maximum(approach, 0.0)
    still = jnp.zeros((*approach.shape, *points.shape), points.dtype)

    def press(share: Array | float) -> Loading:
        sunk = jnp.maximum((share * depth)[..., None, None] - height, 0.0)
        pressure = lean * sunk  # its size matters if friction depends on pressure
        return measure_loading(points, slope, pressure, still, law.limit(pressure))

    loading = press(0.65 + 0.82 * press(0.6).reach / thickness)
    e = depth / thickness
    grown = press_gain(loading, gel.poisson_ratio, thickness) + loading.tilt
    grown = grown - numbers[0] * e * loading.reach / thickness
    grown = grown + numbers[1] * e * loading.friction**2
    gain = (1.0 + grown) / (1.0 + stick_gain(loading, depth, thickness))
    return Raised(law, gain.astype(points.dtype))
