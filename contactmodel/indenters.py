"""Shapes of the object: height of its undeformed surface above the elastomer's plane.

The height is 0 where the object first touches. The sides of a shape rise steeply, so that points
outside it never come into contact.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import is_traced, refuse
from contactmodel.common.checks import Numbers, non_negative, number, positive
from contactmodel.grid import length

_SIDE_SLOPE = 1e3


class AbstractIndenter(eqx.Module):
    """The shape of an object; its lowest point has the height 0 at the origin.

    The approach is measured from height 0, so a shape whose lowest point is higher is pressed in
    less. Heights must be finite: beside the shape let them rise, and not be NaN or inf.

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import AbstractIndenter, Contact, Grid, HalfSpace, Pose, Rigid
        >>> from contactmodel import solve_contact
        >>> class Cone(AbstractIndenter):
        ...     slope: float
        ...     def height(self, points):
        ...         return self.slope * jnp.hypot(*points)
        >>> grid = Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(HalfSpace(0.2, 0.5), Rigid(), Cone(0.2), grid, 0.5)
        >>> print(f"{-solve_contact(contact, Pose(approach=1.0)).force[2]:.2f} N")
        2.56 N
    """

    @abc.abstractmethod
    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Height of the undeformed surface above points of the elastomer's plane [mm]."""

    def slid_height(
        self, points: Float[Array, "2 ..."], slid: Float[Array, "2 ..."]
    ) -> Float[Array, "..."]:
        """Height above points of the plane after the shape has slid over them [mm].

        Args:
            points: points of the elastomer's plane [mm].
            slid: points of the shape that are now above them [mm].
        """
        return self.height(slid)


def measure_shape(
    indenter: AbstractIndenter, points: Float[Array, "2 ..."]
) -> tuple[Float[Array, "..."], Float[Array, "2 ..."]]:
    """Height [mm] of a shape above points of the elastomer's plane, and its slopes by x and y [-].

    Args:
        indenter: the shape.
        points: points of the elastomer's plane [mm].
    """
    height, pull = jax.vjp(indenter.height, points)
    return height, pull(jnp.ones_like(height))[0]


class Paraboloid(AbstractIndenter):
    """The paraboloid r²/2R of Hertz's theory.

    Attributes:
        radius: R [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Paraboloid
        >>> print(Paraboloid(radius=10.0).height(jnp.array([[0.0, 3.0], [0.0, 4.0]])))  # mm
        [0.   1.25]
    """

    radius: Float[Array, ""] = eqx.field(converter=positive)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """r²/2R [mm]."""
        return jnp.sum(points**2, axis=0) / (2.0 * self.radius)


class Sphere(AbstractIndenter):
    """A sphere, without the paraboloid's approximation for small r.

    Attributes:
        radius: R [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Sphere
        >>> print(Sphere(radius=10.0).height(jnp.array([[0.0, 3.0], [0.0, 4.0]])).round(3))  # mm
        [0.   1.34]
    """

    radius: Float[Array, ""] = eqx.field(converter=positive)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """R − √(R² − r²) [mm]."""
        return _arc(length(points), self.radius)


class Cylinder(AbstractIndenter):
    """A cylinder that lies along y, without ends.

    On a flat pad its contact always reaches the edge of the grid, which is a failure. Use it in
    `Domed`, or pass `throw=False` and read the middle of a long grid.

    Attributes:
        radius: R [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Cylinder
        >>> print(Cylinder(radius=10.0).height(jnp.array([[0.0, 6.0], [5.0, 0.0]])))  # mm
        [0. 2.]
    """

    radius: Float[Array, ""] = eqx.field(converter=positive)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """R − √(R² − x²) [mm]."""
        return _arc(jnp.abs(points[0]), self.radius)


class Ellipsoid(AbstractIndenter):
    """An ellipsoid with its axes along x, y and z.

    Attributes:
        semi_axes: half lengths along x, y and z [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Ellipsoid
        >>> egg = Ellipsoid(semi_axes=(10.0, 5.0, 4.0))
        >>> print(egg.height(jnp.array([[6.0, 0.0], [0.0, 3.0]])).round(3))  # mm
        [0.8 0.8]
    """

    semi_axes: Float[Array, "3"] = eqx.field(converter=positive)

    def __check_init__(self) -> None:
        """Reject another number of semi-axes."""
        shape = jnp.shape(self.semi_axes)
        if shape[-1:] != (3,):
            raise ValueError(f"an ellipsoid has three semi-axes, along x, y and z; got {shape}")

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """c[1 − √(1 − x²/a² − y²/b²)] [mm]."""
        a, b, c = self.semi_axes
        ratio = length(jnp.stack([points[0] / a, points[1] / b]))
        return c * _arc(ratio, jnp.ones(()))


class RoundPunch(AbstractIndenter):
    """A flat-ended cylinder with a rounded edge.

    Attributes:
        radius: radius of the cylinder [mm].
        edge_radius: radius of the rounded edge; 0 for a sharp edge [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import RoundPunch
        >>> punch = RoundPunch(radius=4.0, edge_radius=1.0)
        >>> print(punch.height(jnp.array([[0.0, 2.5, 4.0], [0.0, 0.0, 0.0]])))  # mm
        [0. 0. 1.]
    """

    radius: Float[Array, ""]
    edge_radius: Float[Array, ""]

    def __init__(self, radius: Numbers, edge_radius: Numbers = 0.0) -> None:
        """Store the sizes.

        Raises:
            ValueError: the edge radius is larger than the radius.
        """
        self.radius = positive(radius)
        self.edge_radius = _edge(edge_radius, self.radius)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """0 on the flat face, then the arc of the edge [mm]."""
        beyond = length(points) - (self.radius - self.edge_radius)
        return _arc(jnp.maximum(beyond, 0.0), self.edge_radius)


class SquarePunch(AbstractIndenter):
    """A cube that stands on a face with rounded edges.

    Attributes:
        width: width of the face, rounded edges included [mm].
        edge_radius: radius of the rounded edges; 0 for sharp edges [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import SquarePunch
        >>> cube = SquarePunch(width=8.0, edge_radius=1.0)
        >>> print(cube.height(jnp.array([[0.0, 2.5, 4.0], [0.0, 2.5, 0.0]])))  # mm
        [0. 0. 1.]
    """

    width: Float[Array, ""]
    edge_radius: Float[Array, ""]

    def __init__(self, width: Numbers, edge_radius: Numbers = 0.0) -> None:
        """Store the sizes.

        Raises:
            ValueError: the edge radius is larger than half the width.
        """
        self.width = positive(width)
        self.edge_radius = _edge(edge_radius, 0.5 * self.width)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """0 on the flat face, then the arc of the edges [mm]."""
        flat = 0.5 * self.width - self.edge_radius
        return _arc(length(jnp.maximum(jnp.abs(points) - flat, 0.0)), self.edge_radius)


class HeightMap(AbstractIndenter):
    """A shape given by heights at regular points, with bilinear interpolation.

    The approach is measured from height 0: subtract the lowest height of a scan, or an approach of
    1 mm presses a map that reaches down to −0.5 mm in by 1.5 mm.

    Attributes:
        heights: height `[i, j]` at x_i, y_j; the middle of the map is at the origin [mm].
        spacing: distance between the points along x and y [mm].

    Raises:
        ValueError: a height is not finite, the map is smaller than 2×2, or the spacing is not
            above 0.

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import HeightMap
        >>> heights = jnp.array([[1.0, 1.0], [0.0, 0.0], [1.0, 1.0]])
        >>> ridge = HeightMap(heights, spacing=(2.0, 2.0))
        >>> print(ridge.height(jnp.array([[0.0, 0.5, 2.0], [0.0, 0.0, 0.0]])))  # mm
        [0.   0.25 1.  ]
    """

    heights: Float[Array, "mx my"]
    spacing: tuple[float, float] = eqx.field(static=True)

    def __init__(self, heights: ArrayLike, spacing: tuple[float, float]) -> None:
        """Check and store the map."""
        shape = np.shape(heights)
        if len(shape) != 2 or min(shape) < 2:
            raise ValueError(f"a height map needs at least 2 × 2 heights, got the shape {shape}")
        if not is_traced(heights):
            missing = int(np.count_nonzero(~np.isfinite(np.asarray(heights))))
            if missing:
                raise ValueError(
                    f"{missing} of {np.size(heights)} heights are NaN or infinite; replace them, "
                    "for example by a height that never touches"
                )
        if np.shape(spacing) != (2,) or min(spacing) <= 0:
            raise ValueError(
                f"the spacing of a height map along x and y must be above 0 mm, got {spacing}"
            )
        self.heights = number(heights)
        self.spacing = (float(spacing[0]), float(spacing[1]))

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Interpolated height; outside the map, a steep side [mm]."""
        step = jnp.asarray(self.spacing).reshape(2, *[1] * (points.ndim - 1))
        count = jnp.asarray(self.heights.shape).reshape(step.shape)
        index = points / step + 0.5 * (count - 1)
        inside = jnp.clip(index, 0.0, count - 1.0)
        beyond = jnp.sum(jnp.abs(index - inside) * step, axis=0)
        height = jax.scipy.ndimage.map_coordinates(self.heights, list(inside), order=1)
        return height + _SIDE_SLOPE * beyond


class Placed(AbstractIndenter):
    """A shape moved to another position and turned about it.

    Attributes:
        indenter: the shape.
        position: position of the shape's origin, where it first touches [mm].
        angle: rotation of the shape [rad, counter-clockwise].

    Examples:
        >>> import jax.numpy as jnp
        >>> import numpy as np
        >>> from contactmodel import Cylinder, Placed
        >>> rod = Placed(Cylinder(radius=10.0), position=(1.0, 0.0), angle=np.radians(90.0))
        >>> print(rod.height(jnp.array([[5.0, 1.0], [0.0, 6.0]])).round(3))  # mm
        [0. 2.]
    """

    indenter: AbstractIndenter
    position: Float[Array, "2"] = eqx.field(converter=number, default=(0.0, 0.0))
    angle: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Height of the moved and turned shape [mm]."""
        x, y = points - self.position.reshape(2, *[1] * (points.ndim - 1))
        c, s = jnp.cos(self.angle), jnp.sin(self.angle)
        return self.indenter.height(jnp.stack([c * x + s * y, c * y - s * x]))


class Domed(AbstractIndenter):
    """A shape on a domed pad. The dome widens the gap: 1/R = 1/R_pad + 1/R_object for spheres.

    Attributes:
        indenter: the shape.
        pad_radius: radius of the pad's surface, whose top is at the origin [mm].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Domed, Paraboloid
        >>> points = jnp.array([[0.0, 3.0], [0.0, 0.0]])
        >>> print(Domed(Paraboloid(radius=10.0), pad_radius=30.0).height(points).round(2))  # mm
        [0.  0.6]
        >>> print(Paraboloid(radius=7.5).height(points).round(2))
        [0.  0.6]
    """

    indenter: AbstractIndenter
    pad_radius: Float[Array, ""] = eqx.field(converter=positive)

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Height of the shape above the pad's domed surface [mm]."""
        return self.slid_height(points, points)

    def slid_height(
        self, points: Float[Array, "2 ..."], slid: Float[Array, "2 ..."]
    ) -> Float[Array, "..."]:
        """Height after the shape has slid; the pad's dome stays in place [mm]."""
        shape = self.indenter.slid_height(points, slid)
        return shape + _arc(length(points), self.pad_radius)


def _edge(edge_radius: Numbers, half_width: Float[Array, ""]) -> Float[Array, ""]:
    """Check that an edge radius fits the face."""
    edge = non_negative(edge_radius)
    message = "an edge radius must not be above the radius or half the width of the punch"
    return refuse(edge, edge > half_width, message)


def _arc(distance: Float[Array, "..."], radius: Float[Array, ""]) -> Float[Array, "..."]:
    """R − √(R² − d²), continued by a steep side from d = R."""
    inside = distance < radius
    square = jnp.where(inside, radius**2 - distance**2, 1.0)
    rise = distance**2 / jnp.where(inside, radius + jnp.sqrt(square), 1.0)
    side = radius + _SIDE_SLOPE * (distance - radius)
    return jnp.where(inside, rise, jnp.where(distance > 0.0, side, 0.0))
