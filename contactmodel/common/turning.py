"""Kinematics of a contact that turns far: what sticks goes round on circles, and the gel along.

Linear elasticity lets points move along straight lines. Imposing the true path of sticking points,
(R − I) r, makes it read the versine 1 − cos θ as strain, which loads friction falsely; imposing
θ × r leaves the points beside their circles. Both errors are of the second order in θ, and both
vanish in a frame that turns with the object:

1. In a round contact a point turns by ψ(r) about the axis. Of the strains of such a twist only the
   shears r ψ,r and r ψ,z are of first order, and they are linear in ψ however large it is. So the
   twist by arcs r ψ is the linear problem, and its displacement u_θ is an arc on the circle on
   which the point now is, of radius r + u_r: a step by dθ imposes the arc dθ (r + u_r) on what
   sticks, and everywhere ψ = u_θ/(r + u_r).
2. Tractions that the object carries round stay as they are in its frame, and so does the
   compliance, which is the same in all directions. A shift S of the object is R(−θ) S there, and
   what a shift displaces is turned back by R(θ).

The gel's displacement in the frame is split about the object's middle into what is odd, the twist
and the press, and what is even, the shift; sticking points are split exactly, and those of round
contacts. With ψ and u_r of the odd part and e the even one, a point X ends at
R(ψ) X (1 + u_r/r) + R(θ) e. Friction and slip are those of the frame, which is the object's.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


def turn(vectors: Float[Array, "2 ..."], angle: Float[Array, "..."]) -> Float[Array, "2 ..."]:
    """Vectors in the plane, turned counter-clockwise by an angle, or each by its own [rad]."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * vectors[0] - s * vectors[1], s * vectors[0] + c * vectors[1]])


def on_circles(
    points: Float[Array, "2 ..."], moved: Float[Array, "2 ..."]
) -> Float[Array, "2 ..."]:
    """Points moved along the radius only, as far as their displacement goes along it.

    Args:
        points: seen from the axis [mm].
        moved: their displacement in the frame that turns [mm].
    """
    return points * (1.0 + _along(points, moved))


def to_space(
    points: Float[Array, "2 ..."],
    moved: Float[Array, "2 ..."],
    opposite: Float[Array, "2 ..."],
    twist: Float[Array, "..."],
) -> Float[Array, "2 ..."]:
    """Displacement in space of the gel's points, from that in the frame that turns [mm].

    Args:
        points: of the undeformed gel, seen from the object's middle [mm].
        moved: their displacement in the frame [mm].
        opposite: displacement of −points in the frame [mm].
        twist: θ of the object [rad].
    """
    odd, even = 0.5 * (moved - opposite), 0.5 * (moved + opposite)
    stretch = 1.0 + _along(points, odd)
    across = jnp.stack([-points[1], points[0]])
    angle = _along(points, odd, across) / stretch
    return turn(points * stretch, angle) - points + turn(even, twist)


def _along(
    points: Float[Array, "2 ..."],
    moved: Float[Array, "2 ..."],
    direction: Float[Array, "2 ..."] | None = None,
) -> Float[Array, "..."]:
    """Displacement over distance, along the radius or another direction; 0 on the axis [-]."""
    square = points[0] ** 2 + points[1] ** 2
    off = square > 0.0
    x, y = points if direction is None else direction
    return jnp.where(off, (x * moved[0] + y * moved[1]) / jnp.where(off, square, 1.0), 0.0)
