"""Motion of the object against the elastomer, or the force and moment that move it."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel.common.arrays import refuse
from contactmodel.common.checks import Numbers, known, number
from contactmodel.common.turning import on_circles, turn


class Pose(eqx.Module):
    """Motion of the object since it first touched at the origin; with a step axis, a path.

    Positions refer to the undeformed surface. The contact region stays on the same points of the
    elastomer, as it does while points stick. If the object slides over more than a small part of
    the contact, solve with `sliding`, which moves its shape along.

    Attributes:
        approach: δ, overlap of the undeformed bodies [mm].
        shift: displacement along x and y [mm].
        twist: rotation θ about the centre, less than a radian per step [rad, counter-clockwise].
        centre: point that the twist leaves in place [mm].
        linear: whether the twist moves points by θ × r, as in the closed forms of linear
            elasticity. Otherwise points move by the finite rotation (R − I) r, as sticking points
            do.
        corotated: whether the contact is solved in a frame that turns with the object about the
            origin, where it first touched. Friction is then loaded correctly, and the gel turns
            on circles, at twists of tens of degrees (see `turning`). Tractions and slip refer to
            this frame.

    Examples:
        >>> import jax.numpy as jnp
        >>> import numpy as np
        >>> from contactmodel import Pose
        >>> pose = Pose(approach=0.4, shift=(0.1, 0.0), twist=np.radians(90.0))
        >>> print(pose.displacement(jnp.array([[2.0], [0.0]])).round(2))  # (2, 0) goes to (0.1, 2)
        [[-1.9]
         [ 2. ]]
    """

    approach: Float[Array, "*path"]
    shift: Float[Array, "*path 2"]
    twist: Float[Array, "*path"]
    centre: Float[Array, "*path 2"]
    linear: bool = eqx.field(static=True)
    corotated: bool = eqx.field(static=True)

    def __init__(
        self,
        approach: Numbers,
        shift: Numbers = (0.0, 0.0),
        twist: Numbers = 0.0,
        centre: Numbers = (0.0, 0.0),
        linear: bool = False,
        corotated: bool = False,
    ) -> None:
        """Store the motion; a single value holds for the whole path.

        Raises:
            ValueError: a number is not finite, the shapes do not match, or the motion is both
                linear and corotated.
        """
        if linear and corotated:
            raise ValueError("a motion cannot be both linear and corotated; leave out one of them")
        heights, angles = number(approach), number(twist)
        vectors = [_vector(shift, "shift"), _vector(centre, "centre")]
        shapes = [heights.shape, angles.shape, *(vector.shape[:-1] for vector in vectors)]
        try:
            path = jnp.broadcast_shapes(*shapes)
        except ValueError as error:
            raise ValueError(
                "approach, twist, shift and centre of a path must have the same number of steps, "
                f"or a single value; got the shapes {shapes}"
            ) from error
        precision = jnp.result_type(heights, angles, *vectors)
        self.approach = jnp.broadcast_to(heights, path).astype(precision)
        self.shift = jnp.broadcast_to(vectors[0], (*path, 2)).astype(precision)
        self.twist = jnp.broadcast_to(angles, path).astype(precision)
        self.centre = jnp.broadcast_to(vectors[1], (*path, 2)).astype(precision)
        self.linear, self.corotated = linear, corotated

    def displacement(self, points: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
        """In-plane displacement of the rigid object at points, for a single pose [mm]."""
        ones = [1] * (points.ndim - 1)
        arm = points - self.centre.reshape(2, *ones)
        return self.shift.reshape(2, *ones) + _turn(arm, self.twist, self.linear)

    def increment(
        self, last: "Pose", moved: Float[Array, "2 ..."], points: Float[Array, "2 ..."]
    ) -> Float[Array, "2 ..."]:
        """In-plane displacement of the rigid object since the previous pose, for one pose [mm].

        The object turns about the present position of its centre. The displacement of a point
        therefore depends on its present position: the twist has carried a sticking point round,
        and a sliding point has stayed behind.

        Args:
            last: the previous pose.
            moved: displacement of the object's surface at `points` between first touch and the
                previous pose, without the object's own deformation [mm].
            points: points of the undeformed surface [mm].
        """
        if self.linear:
            return self.displacement(points) - last.displacement(points)
        if self.corotated:
            ones = (2, *[1] * (points.ndim - 1))
            now, before = (pose._shift_in_frame().reshape(ones) for pose in (self, last))
            x, y = on_circles(points, moved - before)
            return now - before + (self.twist - last.twist) * jnp.stack([-y, x])
        centre = self.centre.reshape(2, *[1] * (points.ndim - 1))
        centre_moved = last.displacement(centre)
        arm = points + moved - centre - centre_moved
        turned = _turn(arm, self.twist - last.twist, linear=False)
        return turned + self.displacement(centre) - centre_moved

    def _shift_in_frame(self) -> Float[Array, "2"]:
        """Displacement of the object's middle in the frame that turns with the object [mm]."""
        moved = self.displacement(jnp.zeros(2, self.twist.dtype))
        return turn(moved, -self.twist)


class Resultants(eqx.Module):
    """Force and moment that replace parts of the motion; with a step axis, for each step of a path.

    Attributes:
        normal_force: force that presses the bodies together, in place of the approach; at 0 N the
            bodies almost touch [N].
        shear_force: force on the elastomer along x and y, in place of the shift [N].
        moment: moment on the elastomer about z through the pose's centre, in place of the twist
            [N·mm].

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Resultants, Rigid, Sphere
        >>> from contactmodel import solve_contact
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, 0.0)
        >>> solution = solve_contact(contact, Pose(approach=1.0), Resultants(normal_force=3.0))
        >>> print(f"3 N press {solution.pose.approach:.3f} mm deep")
        3 N press 0.733 mm deep
    """

    normal_force: Float[Array, "*path"] | None
    shear_force: Float[Array, "..."] | None
    moment: Float[Array, "*path"] | None

    def __init__(
        self,
        normal_force: Numbers | None = None,
        shear_force: Numbers | None = None,
        moment: Numbers | None = None,
    ) -> None:
        """Store the resultants.

        Raises:
            ValueError: no resultant is given, a number is not finite, or the normal force is
                negative.
        """
        if normal_force is None and shear_force is None and moment is None:
            raise ValueError("give at least one of normal_force, shear_force and moment")
        self.normal_force = None
        if normal_force is not None:
            pressing = number(normal_force)
            message = "the normal force presses the bodies together, so it must not be below 0 N"
            self.normal_force = refuse(pressing, known(pressing) < 0.0, message)
        self.shear_force = None if shear_force is None else number(shear_force)
        self.moment = None if moment is None else number(moment)

    @property
    def given(self) -> tuple[bool, bool, bool, bool]:
        """Whether approach, shift along x, shift along y and twist are replaced."""
        normal, shear, turn = (
            value is not None for value in (self.normal_force, self.shear_force, self.moment)
        )
        return normal, shear, shear, turn

    def in_place_of(self, pose: Pose) -> Float[Array, "*path 4"]:
        """Resultants for each pose; 0 where the motion is given [N, N, N, N·mm].

        Raises:
            ValueError: the shapes do not match those of the pose.
        """
        shape, dtype = pose.approach.shape, pose.approach.dtype

        def spread(name: str, shape: tuple[int, ...]) -> Array:
            resultant = getattr(self, name)
            value = jnp.zeros(()) if resultant is None else resultant
            try:
                return jnp.broadcast_to(value, shape).astype(dtype)
            except ValueError as error:
                raise ValueError(
                    f"{name} of the {'path' if pose.approach.ndim else 'pose'} must have the shape "
                    f"{shape}, or be the same in every step; got the shape {value.shape}"
                ) from error

        shear = spread("shear_force", (*shape, 2))
        parts = [
            spread("normal_force", shape)[..., None],
            shear,
            spread("moment", shape)[..., None],
        ]
        return jnp.concatenate(parts, axis=-1)


def make_path(poses: Sequence[Pose], steps: Sequence[int]) -> Pose:
    """A path along straight legs between poses; it leaves out the first pose.

    Args:
        poses: start of the first leg, then the end of each leg.
        steps: number of steps of each leg.

    Raises:
        ValueError: there are fewer than two poses, or not one whole number from 1 for each leg.

    Examples:
        >>> from contactmodel import Pose, make_path
        >>> path = make_path([Pose(0.0), Pose(0.4), Pose(0.4, twist=0.06)], steps=[2, 3])
        >>> print(path.approach, path.twist)
        [0.2 0.4 0.4 0.4 0.4] [0.   0.   0.02 0.04 0.06]
    """
    if np.ndim(steps) != 1:
        raise ValueError(f"steps: expected a list with a number for each leg, got {steps!r}")
    if len(poses) < 2 or len(steps) != len(poses) - 1:
        raise ValueError(
            "a path needs at least two poses, and a number of steps for each leg between them; "
            f"got {len(poses)} poses and {len(steps)} numbers of steps"
        )
    for count in steps:
        if not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(
                f"the number of steps of a leg must be a whole number from 1, got {count!r}"
            )
    legs = []
    for start, end, count in zip(poses[:-1], poses[1:], steps, strict=True):
        share = jnp.arange(1, count + 1) / count
        legs.append(jax.tree.map(lambda a, b, t=share: _between(a, b, t), start, end))
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *legs)


def _turn(
    arm: Float[Array, "2 ..."], twist: Float[Array, ""], linear: bool
) -> Float[Array, "2 ..."]:
    """In-plane displacement of points at `arm` from the axis [mm] by a twist about it [rad]."""
    s, versine = twist, jnp.zeros_like(twist)
    if not linear:
        s, versine = jnp.sin(twist), 2.0 * jnp.sin(0.5 * twist) ** 2
    turn = jnp.array([[-versine, -s], [s, -versine]])  # a matrix is computed once for all points
    return jnp.einsum("ij,j...->i...", turn, arm, precision="highest")


def _vector(value: Numbers, name: str) -> Array:
    vector = number(value)
    if vector.shape[-1:] != (2,):
        raise ValueError(f"the {name} of a pose has two components, x and y; got {value!r}")
    return vector


def _between(start: Array, end: Array, share: Float[Array, " steps"]) -> Array:
    share = share.astype(start.dtype).reshape(-1, *[1] * start.ndim)
    return start + share * (end - start)
