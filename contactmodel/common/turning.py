"""Kinematics of large twists: sticking points and the gel move on circles.

In linear elasticity points move along straight lines. If the true path (R − I) r of sticking points
is imposed, linear elasticity takes the versine 1 − cos θ for strain, which loads friction wrongly.
If θ × r is imposed, the points leave their circles. Both errors are of second order in θ, and both
vanish in a frame that turns with the object:

1. In a round contact a point turns by ψ(r) about the axis. The only first-order strains of this
   twist are the shears r ψ,r and r ψ,z, which are linear in ψ of any size. A twist by arcs r ψ is
   therefore the linear problem. Its displacement u_θ is an arc on the point's present circle, of
   radius r + u_r: a step by dθ imposes the arc dθ (r + u_r) on sticking points, and
   ψ = u_θ/(r + u_r) everywhere.
2. Tractions that turn with the object are constant in its frame. So is the compliance, because it
   is the same in all directions. A shift S of the object is R(−θ) S in the frame, and the
   displacement by a shift is turned back by R(θ).

The gel's displacement in the frame is split about the object's middle into an odd part, from twist
and press, and an even part, from the shift. The split is exact for sticking points and for round
contacts. With ψ and u_r of the odd part and the even part e, a point X moves to
R(ψ) X (1 + u_r/r) + R(θ) e. Friction and slip refer to the frame, which is the object's.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


def turn(vectors: Float[Array, "2 ..."], angle: Float[Array, "..."]) -> Float[Array, "2 ..."]:
    """Turn plane vectors counter-clockwise by one angle, or each by its own [rad]."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * vectors[0] - s * vectors[1], s * vectors[0] + c * vectors[1]])


def on_circles(
    points: Float[Array, "2 ..."], moved: Float[Array, "2 ..."]
) -> Float[Array, "2 ..."]:
    """Move points by the radial part of their displacement only [mm].

    Args:
        points: positions relative to the axis [mm].
        moved: displacements in the turning frame [mm].
    """
    return points * (1.0 + _along(points, moved))


def to_space(
    points: Float[Array, "2 ..."],
    moved: Float[Array, "2 ..."],
    opposite: Float[Array, "2 ..."],
    twist: Float[Array, "..."],
) -> Float[Array, "2 ..."]:
    """Displacement of the gel's points in space, from that in the turning frame [mm].

    Args:
        points: undeformed positions relative to the object's middle [mm].
        moved: displacement of the points in the frame [mm].
        opposite: displacement of −points in the frame [mm].
        twist: θ of the object [rad].
    """
    return to_circles(points, moved, opposite).displacement(points, twist)


class Circles(NamedTuple):
    """Motion of the gel's points on circles."""

    # 1 + u_r/r, the radius of a point's circle over its first distance [-]
    stretch: Float[Array, "..."]
    angle: Float[Array, "..."]  # ψ, by which the point turns [rad]
    even: Float[Array, "2 ..."]  # displacement by a shift, in the turning frame [mm]

    def displacement(
        self, points: Float[Array, "2 ..."], twist: Float[Array, "..."]
    ) -> Float[Array, "2 ..."]:
        """Displacement in space [mm].

        Args:
            points: undeformed positions relative to the object's middle [mm].
            twist: θ of the object [rad].
        """
        return turn(points * self.stretch, self.angle) - points + turn(self.even, twist)


def to_circles(
    points: Float[Array, "2 ..."], moved: Float[Array, "2 ..."], opposite: Float[Array, "2 ..."]
) -> Circles:
    """Split a displacement in the turning frame; arguments as for `to_space`."""
    odd, even = 0.5 * (moved - opposite), 0.5 * (moved + opposite)
    stretch = 1.0 + _along(points, odd)
    across = jnp.stack([-points[1], points[0]])
    return Circles(stretch, _along(points, odd, across) / stretch, even)


def _along(
    points: Float[Array, "2 ..."],
    moved: Float[Array, "2 ..."],
    direction: Float[Array, "2 ..."] | None = None,
) -> Float[Array, "..."]:
    """Displacement along the radius or another direction, over the distance; 0 on the axis [-]."""
    square = points[0] ** 2 + points[1] ** 2
    off = square > 0.0
    x, y = points if direction is None else direction
    return jnp.where(off, (x * moved[0] + y * moved[1]) / jnp.where(off, square, 1.0), 0.0)
