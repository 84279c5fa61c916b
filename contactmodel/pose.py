"""How the object is moved against the elastomer, or which force and moment move it."""

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
    """Motion of the object since it touched at the origin, or a path: a batch of such motions.

    Positions are those of the undeformed surface. The region where the object is pressed on stays
    on the same points of the elastomer, as points that stick do; where the object slides over more
    than a small part of the contact, solve with `sliding`, which takes its shape along.

    Attributes:
        approach: δ, by which the undeformed bodies would overlap [mm].
        shift: along x and y [mm].
        twist: θ about the centre; by less than a radian in a step [rad, counter-clockwise].
        centre: point that the twist leaves where it is [mm].
        linear: whether the twist moves points by θ × r, as the closed forms of linear elasticity
            have it, and not by the rotation (R − I) r that sticking points really follow.
        corotated: whether the contact is solved in a frame that turns with the object about the
            origin, where it touched first, so that twists of tens of degrees load friction truly
            and the gel turns on circles (see `turning`). Tractions and slip are the frame's.

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
        """Keep the motion; what is given once holds for the whole path.

        Raises:
            ValueError: numbers that are not finite, shapes that do not fit each other, or a motion
                both linear and corotated.
        """
        if linear and corotated:
            raise ValueError("a motion is linear or corotated, not both; leave out one of them")
        heights, angles = number(approach), number(twist)
        vectors = [_vector(shift, "shift"), _vector(centre, "centre")]
        shapes = [heights.shape, angles.shape, *(vector.shape[:-1] for vector in vectors)]
        try:
            path = jnp.broadcast_shapes(*shapes)
        except ValueError as error:
            raise ValueError(
                "approach, twist, shift and centre of a path need the same number of steps, or "
                f"one value for all; got the shapes {shapes}"
            ) from error
        precision = jnp.result_type(heights, angles, *vectors)
        self.approach = jnp.broadcast_to(heights, path).astype(precision)
        self.shift = jnp.broadcast_to(vectors[0], (*path, 2)).astype(precision)
        self.twist = jnp.broadcast_to(angles, path).astype(precision)
        self.centre = jnp.broadcast_to(vectors[1], (*path, 2)).astype(precision)
        self.linear, self.corotated = linear, corotated

    def displacement(self, points: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
        """In-plane displacement of the rigid object at points [mm]; for one pose."""
        ones = [1] * (points.ndim - 1)
        arm = points - self.centre.reshape(2, *ones)
        return self.shift.reshape(2, *ones) + _turn(arm, self.twist, self.linear)

    def increment(
        self, last: "Pose", moved: Float[Array, "2 ..."], points: Float[Array, "2 ..."]
    ) -> Float[Array, "2 ..."]:
        """In-plane displacement of the rigid object since the pose before [mm]; for one pose.

        The object turns about where its centre has come to. What counts is therefore where a
        point of the object is now: a point that sticks was carried round by the twist, a point
        that slides stayed behind.

        Args:
            last: the pose before.
            moved: by how much the object's surface at `points` has moved since it touched, its
                own deformation left out, at the pose before [mm].
            points: of the undeformed surface [mm].
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
        """By how much the object's middle has moved, in the frame that turns with it [mm]."""
        moved = self.displacement(jnp.zeros(2, self.twist.dtype))
        return turn(moved, -self.twist)


class Resultants(eqx.Module):
    """Force and moment in place of motion, or those of each step of a path.

    Attributes:
        normal_force: pressing the bodies together, in place of the approach; under 0 N they just
            do not touch [N].
        shear_force: on the elastomer along x and y, in place of the shift [N].
        moment: on the elastomer about z through the pose's centre, in place of the twist [N·mm].

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
        """Keep what is given.

        Raises:
            ValueError: nothing is, a number that is not finite, or a normal force below 0.
        """
        if normal_force is None and shear_force is None and moment is None:
            raise ValueError("give at least one of normal_force, shear_force and moment")
        self.normal_force = None
        if normal_force is not None:
            pressing = number(normal_force)
            message = "the normal force presses, so it must not be below 0 N"
            self.normal_force = refuse(pressing, known(pressing) < 0.0, message)
        self.shear_force = None if shear_force is None else number(shear_force)
        self.moment = None if moment is None else number(moment)

    @property
    def given(self) -> tuple[bool, bool, bool, bool]:
        """Which are given in place of approach, shift along x and y, and twist."""
        normal, shear, turn = (
            value is not None for value in (self.normal_force, self.shear_force, self.moment)
        )
        return normal, shear, shear, turn

    def in_place_of(self, pose: Pose) -> Float[Array, "*path 4"]:
        """What is given for each pose, 0 elsewhere [N, N, N, N·mm].

        Raises:
            ValueError: shapes that do not fit those of the pose.
        """
        shape, dtype = pose.approach.shape, pose.approach.dtype

        def spread(name: str, shape: tuple[int, ...]) -> Array:
            given = getattr(self, name)
            value = jnp.zeros(()) if given is None else given
            try:
                return jnp.broadcast_to(value, shape).astype(dtype)
            except ValueError as error:
                raise ValueError(
                    f"{name} of the {'path' if pose.approach.ndim else 'pose'} must have the shape "
                    f"{shape}, or be the same in every step; got {value.shape}"
                ) from error

        shear = spread("shear_force", (*shape, 2))
        parts = [
            spread("normal_force", shape)[..., None],
            shear,
            spread("moment", shape)[..., None],
        ]
        return jnp.concatenate(parts, axis=-1)


def make_path(poses: Sequence[Pose], steps: Sequence[int]) -> Pose:
    """A path that runs straight from pose to pose, without the first.

    Args:
        poses: where the legs begin and end.
        steps: poses of each leg.

    Raises:
        ValueError: fewer than two poses, or steps that are not one whole number from 1 per leg.

    Examples:
        >>> from contactmodel import Pose, make_path
        >>> path = make_path([Pose(0.0), Pose(0.4), Pose(0.4, twist=0.06)], steps=[2, 3])
        >>> print(path.approach, path.twist)
        [0.2 0.4 0.4 0.4 0.4] [0.   0.   0.02 0.04 0.06]
    """
    if len(poses) < 2 or len(steps) != len(poses) - 1:
        raise ValueError(
            "a path runs between two poses or more, with a number of steps for each leg between "
            f"them; got {len(poses)} poses and {len(steps)} numbers of steps"
        )
    for count in steps:
        if not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(f"the steps of a leg must be a whole number from 1, got {count!r}")
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
    turn = jnp.array([[-versine, -s], [s, -versine]])  # a product finds it once for all points
    return jnp.einsum("ij,j...->i...", turn, arm, precision="highest")


def _vector(value: Numbers, name: str) -> Array:
    vector = number(value)
    if vector.shape[-1:] != (2,):
        raise ValueError(f"the {name} of a pose has two components, x and y; got {value!r}")
    return vector


def _between(start: Array, end: Array, share: Float[Array, " steps"]) -> Array:
    share = share.reshape(-1, *[1] * start.ndim)
    return start + share * (end - start)
