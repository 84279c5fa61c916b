"""How the object is moved against the elastomer."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.checks import number


class Pose(eqx.Module):
    """Motion of the object since it touched at the origin, or a path: a batch of such motions.

    Positions are those of the undeformed surface. The region where the object is pressed on stays
    on the same points of the elastomer, as points that stick do; sliding over more than a small
    part of the contact needs a new start from where the object then is (`Placed`).

    Attributes:
        approach: δ, by which the undeformed bodies would overlap [mm].
        shift: along x and y [mm].
        twist: θ about the centre [rad, counter-clockwise].
        centre: point that the twist leaves where it is [mm].
        linear: whether the twist moves points by θ × r, as the closed forms of linear elasticity
            have it, and not by the rotation (R − I) r that sticking points really follow.
    """

    approach: Float[Array, "*path"] = eqx.field(converter=number)
    shift: Float[Array, "*path 2"] = eqx.field(converter=number, default=(0.0, 0.0))
    twist: Float[Array, "*path"] = eqx.field(converter=number, default=0.0)
    centre: Float[Array, "*path 2"] = eqx.field(converter=number, default=(0.0, 0.0))
    linear: bool = eqx.field(static=True, default=False)

    def displacement(self, points: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
        """In-plane displacement of the rigid object at points [mm]; for one pose."""
        ones = [1] * (points.ndim - 1)
        x, y = points - self.centre.reshape(2, *ones)
        if self.linear:
            turned = self.twist * jnp.stack([-y, x])
        else:
            s, versine = jnp.sin(self.twist), 2.0 * jnp.sin(0.5 * self.twist) ** 2
            turned = jnp.stack([-versine * x - s * y, s * x - versine * y])
        return self.shift.reshape(2, *ones) + turned

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
        centre = self.centre.reshape(2, *[1] * (points.ndim - 1))
        centre_moved = last.displacement(centre)
        still = jnp.zeros_like(self.shift)
        turn = Pose(self.approach, still, self.twist - last.twist, still)
        turned = turn.displacement(points + moved - centre - centre_moved)
        return turned + self.displacement(centre) - centre_moved


def make_path(poses: Sequence[Pose], steps: Sequence[int]) -> Pose:
    """A path that runs straight from pose to pose, without the first.

    Args:
        poses: where the legs begin and end.
        steps: poses of each leg.
    """
    legs = []
    for start, end, count in zip(poses[:-1], poses[1:], steps, strict=True):
        share = jnp.arange(1, count + 1) / count
        legs.append(jax.tree.map(lambda a, b, t=share: _between(a, b, t), start, end))
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *legs)


def _between(start: Array, end: Array, share: Float[Array, " steps"]) -> Array:
    share = share.reshape(-1, *[1] * start.ndim)
    return start + share * (end - start)
