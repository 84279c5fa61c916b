"""A soft body of revolution pressed onto a gel and turned, with Coulomb friction at each node.

The gel is that of `press`. The object is a ball whose far end is gripped: moved and turned as one
body. Its displacements are taken in the frame of the grip, where its far end rests. Each node of
the gel's top is held against the point of the ball's surface at its own present radius. The surface
is swept by the straight edges of the deformed elements. The opposite force acts on the two nodes of
the edge, with the weights of that point, so that forces and moments balance. Slip is measured from
the ball's material point that the node touched at the end of the last step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from papers.finite_strain.gel import Elements, Gel, grow, law_of, make_elements, space_radii
from papers.finite_strain.press import Pressed, measure_top
from papers.finite_strain.steps import (
    Law,
    Motion,
    Residual,
    TwoBodies,
    admit,
    assemble,
    components,
    differentiate,
    from_axis,
    in_frame,
    make_law,
    measure_rest,
    record,
    solve_sparse,
    strain,
    top_of,
    turn_back,
)


class Ball(NamedTuple):
    """A rubber body of revolution with a round tip, or a flat one; its far end is gripped.

    The tip is a sphere around a flat face, and goes over to a cone. The side is that of a cylinder.
    The law is that of `Gel`.

    Attributes:
        radius: R of the tip, or of the edge around its flat face [mm].
        cone: distance from the flat face, or the axis, beyond which the surface is a cone, tangent
            to the sphere [mm].
        width: radius of the body [mm].
        height: height from the tip to the gripped end [mm].
        shear_modulus: G [MPa].
        poisson_ratio: ν at small strain [-].
        second_share: m, the share of the second invariant [-].
        flat: radius of the flat face; 0 for a ball [mm].
    """

    radius: float = 20.0
    cone: float = 10.0
    width: float = 40.0
    height: float = 40.0
    shear_modulus: float = 0.4
    poisson_ratio: float = 0.48
    second_share: float = 0.0
    flat: float = 0.0

    def profile(self, r: Float[np.ndarray, "*points"]) -> Float[np.ndarray, "*points"]:
        """Height of the surface above its lowest point [mm].

        Args:
            r: distance from the axis [mm].
        """
        beyond = np.maximum(r - self.flat, 0.0)
        near = np.minimum(beyond, self.cone)
        steep = self.cone / np.sqrt(self.radius**2 - self.cone**2)
        return self.radius - np.sqrt(self.radius**2 - near**2) + steep * (beyond - near)


class Held(NamedTuple):
    """Solution along a path.

    Attributes:
        gel: that of the gel.
        radius: radius of the undeformed ball's surface nodes [mm].
        moved: u_r, u_θ and u_z of these nodes, in the frame of the grip [mm].
        grip_force: force along z of the grip on the ball, pressing [N].
        grip_moment: moment about the axis of the grip on the ball [N·mm].
    """

    gel: Pressed
    radius: Float[np.ndarray, " surface"]
    moved: Float[np.ndarray, "steps surface 3"]
    grip_force: Float[np.ndarray, " steps"]
    grip_moment: Float[np.ndarray, " steps"]


class _Touched(NamedTuple):
    """The ball's material points that the gel's nodes touched.

    Attributes:
        edge: number of the surface's edge.
        share: place along the edge, from 0 to 1 [-].
        turn: azimuth of the point [rad].
        gap: height of the ball's point above the node [mm].
    """

    edge: Int[np.ndarray, " top"]
    share: Array
    turn: Array
    gap: Array


class _Problem(NamedTuple):
    """A gel under a soft ball (`steps.Problem`)."""

    gel: Elements
    ball: Elements
    rubbers: tuple[Array, Array]
    law: Law
    rtol: float

    def start(self) -> TwoBodies:
        gel, ball = (np.zeros((len(body.place), 3)) for body in (self.gel, self.ball))
        return TwoBodies(gel, ball, np.zeros((self.gel.top.size, 3)))

    def touch(self, state: TwoBodies, motion: Motion) -> _Touched:
        edge = self._edges(state, motion)
        r, top = top_of(self.gel, state.gel)
        at = in_frame(r, top, *jnp.array(motion))
        return _Touched(edge, *_meet(at, self._surface(state)[_ends(edge)]))

    def add(self, state: TwoBodies, step: np.ndarray) -> TwoBodies:
        first, second = (len(body.free) for body in (self.gel, self.ball))
        parts = np.split(step, [first, first + second])
        gel, ball = state.gel.copy(), state.object.copy()
        gel.ravel()[self.gel.free] += parts[0]
        ball.ravel()[self.ball.free] += parts[1]
        return TwoBodies(gel, ball, state.traction + parts[2].reshape(state.traction.shape))

    def residual(self, state: TwoBodies, motion: Motion, touched: _Touched) -> Residual:
        gel, ball = self.gel, self.ball
        turn = turn_back(np.eye(3), motion.twist).T  # of the object's components
        total, stiff = strain(gel, state.gel, self.rubbers[0])
        against, firm = strain(ball, state.object, self.rubbers[1])
        pushed = state.traction @ turn.T * gel.area[:, None]
        total[gel.top] -= pushed
        args, nodes = self.rows(state, motion, touched)
        rows, slopes = map(np.asarray, _contact_rows(*args))
        lack, push = rows[:, :3], rows[:, 3:].reshape(-1, 2, 3) * gel.area[:, None, None]
        np.add.at(against, nodes[:, 1:3], -push)
        unbalanced = [total.ravel()[gel.free], against.ravel()[ball.free]]
        rest = measure_rest(unbalanced, lack * gel.area[:, None], pushed)
        whole = np.concatenate([*unbalanced, lack.ravel()])
        return Residual(
            rest,
            lambda: solve_sparse(self._assemble((stiff, firm), turn, nodes, slopes), -whole),
        )

    def measure(self, state: TwoBodies, motion: Motion, touched: _Touched) -> tuple:
        """The values of `Pressed`, then those of `Held` after the ball's radius."""
        stick = np.asarray(_project(*self.rows(state, motion, touched)[0]))
        gel = measure_top(self.gel, state.gel, state.traction, motion.twist, stick)
        return *gel, state.object[self.ball.top], *self._grip(state)

    def _grip(self, state: TwoBodies) -> tuple[float, float]:
        """Force along z, pressing [N], and moment about the axis [N·mm] of the grip on the ball."""
        ball = self.ball
        forces, _ = strain(ball, state.object, self.rubbers[1])
        end = ball.place[:, 1] > ball.place[:, 1].max() - 1e-9
        return -float(forces[end, 2].sum()), float(ball.place[end, 0] @ forces[end, 1])

    def rows(self, state: TwoBodies, motion: Motion, touched: _Touched) -> tuple[tuple, np.ndarray]:
        """The arguments of `_contact_rows` and `_project`, and the ball's six nodes of each row."""
        edge = self._edges(state, motion)
        numbers = np.concatenate([_around(edge), _ends(touched.edge)], axis=1)
        numbers = np.clip(numbers, 0, self.ball.top.size - 1)
        nodes = self.ball.top[numbers]
        place = jnp.asarray(_spread(self.ball.place[nodes]))
        # beyond the axis is the mirror image
        flip = jnp.asarray(np.where((edge == 0)[:, None] & (np.arange(6) == 0), -1.0, 1.0))
        near = jnp.asarray(state.object[nodes])
        r, top = top_of(self.gel, state.gel)
        past = touched.share, touched.turn, touched.gap
        traction = jnp.asarray(state.traction)
        return (self.law, r, place, flip, jnp.array(motion), past, (top, traction, near)), nodes

    def _edges(self, state: TwoBodies, motion: Motion) -> Int[np.ndarray, " top"]:
        """Number of the ball's edge at each node's present radius."""
        r, top = top_of(self.gel, state.gel)
        at = np.asarray(in_frame(r, top, *jnp.array(motion)))
        around = np.hypot(*np.asarray(self._surface(state))[:, :2].T)
        edge = np.searchsorted(np.maximum.accumulate(around), np.hypot(at[:, 0], at[:, 1]), "right")
        return np.clip(edge - 1, 0, self.ball.top.size - 2)

    def _surface(self, state: TwoBodies) -> Array:
        """Positions of the ball's surface nodes in the frame of the grip [mm]."""
        place = _spread(self.ball.place[self.ball.top])
        return jnp.asarray(place + state.object[self.ball.top])

    def _assemble(
        self, stiff: tuple[np.ndarray, np.ndarray], turn: np.ndarray, nodes: np.ndarray, slopes
    ):
        gel, ball = self.gel, self.ball
        start = 3 * len(gel.place)
        end = start + 3 * len(ball.place)
        inner = components(gel.nodes).reshape(-1, 12)
        outer = start + components(ball.nodes).reshape(-1, 12)
        top, tractions = components(gel.top), end + components(np.arange(gel.top.size))
        near = start + components(nodes).reshape(-1, 18)
        pushed = start + components(nodes[:, 1:3]).reshape(-1, 6)
        unknown = np.concatenate([top, tractions, near], axis=1)
        area = gel.area[:, None, None]
        blocks = [
            (inner, inner, stiff[0]),
            (outer, outer, stiff[1]),
            (top, tractions, -area * turn),
            (tractions, unknown, slopes[:, :3]),
            (pushed, unknown, -area * slopes[:, 3:]),
        ]
        free = np.concatenate([gel.free, start + ball.free, tractions.ravel()])
        return assemble(blocks, end + tractions.size, free)


def cut_ball(ball: Ball, cell: float, fine: float, growth: float = 1.25) -> Elements:
    """Mesh a ball, with small elements at its tip.

    Args:
        ball: the ball to mesh.
        cell: side of the elements at the tip; best the gel's, since a finer surface is pressed in
            at single nodes [mm].
        fine: radius of the finely meshed part [mm].
        growth: ratio of the sizes of neighbouring elements beyond the fine part [-].
    """
    across = space_radii(ball.width, cell, fine, growth)
    return make_elements(across, grow(ball.height, cell, growth), ball.profile(across))


def hold(
    gel: tuple[Gel, Elements],
    ball: tuple[Ball, Elements],
    friction: float,
    path: Sequence[Motion],
    *,
    rtol: float = 1e-7,
) -> Held:
    """Solve a path of the grip, each step from the solution of the last.

    Args:
        gel: the gel and its mesh.
        ball: the ball and its mesh.
        friction: μ [-].
        path: poses of the grip.
        rtol: largest residual force, relative to the contact forces [-].

    Raises:
        RuntimeError: a step does not converge; smaller steps may help.
    """
    law = make_law(gel[1].cell, friction, gel[0], ball[0])
    problem = _Problem(gel[1], ball[1], (law_of(gel[0]), law_of(ball[0])), law, rtol)
    gel_radius, ball_radius = (body.place[body.top, 0] for _, body in (gel, ball))
    values = record(problem, path)
    return Held(Pressed(gel_radius, *values[:5]), ball_radius, *values[5:])


def _spread(place: np.ndarray) -> np.ndarray:
    """Positions x, y, z of nodes at the azimuth 0 from r and z."""
    return np.insert(place, 1, 0.0, axis=-1)


def _ends(edge: np.ndarray) -> np.ndarray:
    return edge[:, None] + np.arange(2)


def _around(edge: np.ndarray) -> np.ndarray:
    """The nodes of the edges and of their neighbours; before the axis the second node."""
    numbers = edge[:, None] + np.arange(-1, 3)
    return np.abs(numbers)


def _turned(place: Array, turn: Array) -> Array:
    """A position in the object's frame, turned about the axis."""
    c, s = jnp.cos(turn), jnp.sin(turn)
    x, y, z = place
    return jnp.stack([c * x - s * y, s * x + c * y, z])


def _point(at: Array, ends: Array) -> tuple[Array, Array, Array]:
    """The point of an edge at a position's radius: share of the edge, azimuth [rad], position.

    |start + share · along| is the radius.
    """
    square = at[0] ** 2 + at[1] ** 2
    off = square > 1e-24
    start, along = ends[0], ends[1] - ends[0]
    a, b = along[:2] @ along[:2], start[:2] @ along[:2]
    c = start[:2] @ start[:2] - jnp.where(off, square, 1.0)
    root = b**2 - a * c
    share = jnp.where(off, (jnp.sqrt(jnp.where(root > 0.0, root, 1.0)) - b) / a, 0.0)
    place = start + share * along
    x, y = (jnp.where(off, at[0], 1.0), jnp.where(off, at[1], 0.0))
    px, py = (jnp.where(off, place[0], 1.0), jnp.where(off, place[1], 0.0))
    turn = jnp.arctan2(px * y - py * x, px * x + py * y)
    return share, turn, place


@jax.jit
def _meet(at: Array, ends: Array) -> tuple[Array, Array, Array]:
    """Share, azimuth and gap of each node on its edge."""
    share, turn, place = jax.vmap(_point)(at, ends)
    return share, turn, place[:, 2] - at[:, 2]


def _normal(at: Array, share: Array, near: Array, flip: Array) -> Float[Array, "3"]:
    """Unit normal out of the ball: the slope of the surface is averaged over neighbouring edges."""
    around = flip[:4] * jax.vmap(from_axis)(near[:4])[0]
    slopes = (near[2:4, 2] - near[:2, 2]) / (around[2:] - around[:2])
    slope = slopes[0] + share * (slopes[1] - slopes[0])
    _, outward = from_axis(at)
    return jnp.append(slope * outward, -1.0) / jnp.sqrt(1.0 + slope**2)


def _node(
    law: Law, r: Array, place: Array, flip: Array, now: Array, past: tuple, unknown: tuple
) -> tuple[Array, Array, Array]:
    """The projection of a node's traction, what acts on the ball's two nodes, whether it sticks."""
    moved, traction, shifted = unknown
    at, near = in_frame(r, moved, *now), place + shifted
    share, turn, met = _point(at, near[1:3])
    normal = _normal(at, share, near, flip)
    before, azimuth, apart = past
    touched = _turned(near[4] + before * (near[5] - near[4]), azimuth)
    slip = at - touched + jnp.array([0.0, 0.0, 1.0]) * apart
    gap = -(met[2] - at[2]) * normal[2]
    admitted, stick = admit(law, traction, gap, normal, slip, r > 0.0)
    back = -_turned(traction, -turn)
    return admitted, jnp.stack([(1.0 - share) * back, share * back]), stick


@jax.jit
def _project(law: Law, r: Array, place, flip, now, past, unknown):
    axes = (None, 0, 0, 0, None, 0, 0)
    return jax.vmap(_node, axes)(law, r, place, flip, now, past, unknown)[2]


@jax.jit
def _contact_rows(law: Law, r: Array, place, flip, now, past, unknown):
    """Residual of each node's contact law and force on the ball over area, and their derivatives.

    The derivatives are by the node's displacement and traction, and by the six nodes of the ball.
    """

    def row(fixed: tuple, unknown: tuple) -> Array:
        r, place, flip, past = fixed
        admitted, back, _ = _node(law, r, place, flip, now, past, unknown)
        return jnp.concatenate([unknown[1] - admitted, back.ravel()])

    return differentiate(row, (r, place, flip, past), unknown)
