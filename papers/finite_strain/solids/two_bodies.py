"""A soft square bar pressed onto a square gel and turned, with Coulomb friction at each node.

As in `papers.finite_strain.two_bodies`, the bar's far end is gripped, and its displacements are
taken in the frame of the grip. A quarter of both bodies is meshed. Each node of the gel's top is
held against the bar's face at its own present x and y. The face is a smooth surface through the
nodes of all four quarters (Catmull and Rom's). The opposite force acts on the 16 nodes around that
point, with their weights in it, so that forces and moments balance. Slip is measured from the bar's
material point that the node was held against at the end of the last step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Float, Int

from papers.finite_strain.gel import Rubber, grow, law_of
from papers.finite_strain.solids.bricks import Bricks, lay_bricks
from papers.finite_strain.solids.faces import Face, find_step, meet, weigh
from papers.finite_strain.solids.press import (
    Linear,
    Pressed,
    assemble_forces,
    assemble_stiffness,
    measure_top,
)
from papers.finite_strain.steps import (
    Law,
    Motion,
    Residual,
    TwoBodies,
    admit,
    assemble,
    components,
    differentiate,
    into_frame,
    make_law,
    measure_rest,
    record,
    turn_back,
)
from papers.finite_strain.two_bodies import Ball


class Bar(NamedTuple):
    """A rubber bar with a square face, its edges rounded; its far end is gripped.

    The law is that of `Gel`.

    Attributes:
        flat: half of the flat face's width [mm].
        edge: radius of the edges, which 0.8 of it from the flat face go over to a slope [mm].
        height: height from the face to the grip [mm].
        shear_modulus: G [MPa].
        poisson_ratio: ν at small strain [-].
        second_share: m, the share of the second invariant [-].
    """

    flat: float = 3.5
    edge: float = 1.5
    height: float = 10.0
    shear_modulus: float = 0.4
    poisson_ratio: float = 0.48
    second_share: float = 0.0

    @property
    def width(self) -> float:
        """Width of the bar [mm]."""
        return 2.0 * (self.flat + self.edge)

    def profile(
        self, x: Float[np.ndarray, "*points"], y: Float[np.ndarray, "*points"]
    ) -> Float[np.ndarray, "*points"]:
        """Height of the face above its lowest point [mm].

        Args:
            x: distance from the middle along one side [mm].
            y: distance from the middle along the other [mm].
        """
        beyond = np.hypot(*(np.maximum(np.abs(along) - self.flat, 0.0) for along in (x, y)))
        return Ball(self.edge, 0.8 * self.edge).profile(beyond)


class Held(NamedTuple):
    """Solution along a path.

    Attributes:
        gel: that of the gel.
        grip_force: force along z of the grip on the bar, pressing [N].
        grip_moment: moment about the axis of the grip on the bar [N·mm].
    """

    gel: Pressed
    grip_force: Float[np.ndarray, " steps"]
    grip_moment: Float[np.ndarray, " steps"]


class _Touched(NamedTuple):
    """The bar's material points that the gel's nodes touched.

    Attributes:
        nodes: the face's nodes around it.
        share: place on the side, from 0 to 1 along both [-].
        gap: height of the bar's point above the node [mm].
    """

    nodes: Int[np.ndarray, "top 16"]
    share: Float[np.ndarray, "top 2"]
    gap: Float[np.ndarray, " top"]


class _Problem(NamedTuple):
    """A quarter of a gel under a quarter of a bar (`steps.Problem`)."""

    gel: Bricks
    bar: Bricks
    face: Face
    rubbers: tuple[Array, Array]
    law: Law
    order: Int[np.ndarray, " components"]
    rtol: float

    def start(self) -> TwoBodies:
        gel, bar = (np.zeros(body.place.shape) for body in (self.gel, self.bar))
        return TwoBodies(gel, bar, np.zeros((self.gel.top.size, 3)))

    def touch(self, state: TwoBodies, motion: Motion) -> _Touched:
        surface, at = self.face.positions(state.object), self._at(state, motion)
        side, share, _ = self.face.find(surface, at[:, :2])
        share = np.clip(share, 0.0, 1.0)
        nodes = self.face.around(side)
        met = np.asarray(meet(surface[nodes], share))
        return _Touched(nodes, share, met[:, 2] - at[:, 2])

    def add(self, state: TwoBodies, step: np.ndarray) -> TwoBodies:
        parts = np.split(step, np.cumsum([state.gel.size, state.object.size]))
        return TwoBodies(
            *(old + new.reshape(old.shape) for old, new in zip(state, parts, strict=True))
        )

    def residual(self, state: TwoBodies, motion: Motion, touched: _Touched) -> Residual:
        bodies, area = (self.gel, self.bar), self.gel.area[:, None]
        parts = list(zip(bodies, state[:2], self.rubbers, strict=True))
        totals = [assemble_forces(*part) for part in parts]
        pushed = area * (state.traction @ turn_back(np.eye(3), motion.twist))
        totals[0][self.gel.top] -= pushed
        args, nodes = self.rows(state, motion, touched)
        rows, slopes = map(np.asarray, _contact_rows(*args))
        lack, weights = rows[:, :3], rows[:, 3:]
        near = nodes[:, :16]
        back = np.einsum("na,ni,naij->naj", weights, state.traction, self.face.turn[near])
        np.add.at(totals[1], self.face.owner[near], area[..., None] * back)
        for body, total in zip(bodies, totals, strict=True):
            total[body.fixed] = 0.0

        def step() -> np.ndarray:
            stiff = [assemble_stiffness(*part) for part in parts]
            return Linear(
                stiff=scipy.sparse.csr_array(scipy.sparse.block_diag(stiff)),
                forces=np.concatenate([total.ravel() for total in totals]),
                lack=lack,
                contact=self._assemble(nodes, state.traction, weights, slopes),
                fixed=np.concatenate([body.fixed.ravel() for body in bodies]),
                order=self.order,
            ).solve(self.gel, motion.twist)

        return Residual(measure_rest(totals, lack * area, pushed), step)

    def measure(self, state: TwoBodies, motion: Motion, touched: _Touched) -> tuple:
        """The values of `Pressed`, then those of `Held`."""
        stick = np.asarray(_project(*self.rows(state, motion, touched)[0]))
        gel = measure_top(self.gel, state.gel, state.traction, motion.twist, stick)
        return *gel, *self._grip(state)

    def _grip(self, state: TwoBodies) -> tuple[float, float]:
        """Force along z, pressing [N], and moment about the axis [N·mm] of the grip on the bar."""
        bar = self.bar
        forces = assemble_forces(bar, state.object, self.rubbers[1])
        end = bar.place[:, 2] > bar.place[:, 2].max() - 1e-9
        (x, y, _), (fx, fy, fz) = bar.place[end].T, forces[end].T
        return -bar.sectors * float(fz.sum()), bar.sectors * float(np.sum(x * fy - y * fx))

    def rows(self, state: TwoBodies, motion: Motion, touched: _Touched) -> tuple[tuple, np.ndarray]:
        """The arguments of `_contact_rows` and `_project`, and the face's 32 nodes of each row."""
        surface, at = self.face.positions(state.object), self._at(state, motion)
        side, share, over = self.face.find(surface, at[:, :2])
        nodes = np.concatenate([self.face.around(side), touched.nodes], axis=1)
        place = self._top(state)
        known = ~self.gel.fixed[self.gel.top, 0], over, share, touched.share, touched.gap
        return (self.law, jnp.array(motion), known, (place, state.traction, surface[nodes])), nodes

    def _at(self, state: TwoBodies, motion: Motion) -> np.ndarray:
        """Positions of the gel's top in the frame of the grip [mm]."""
        return np.asarray(into_frame(jnp.asarray(self._top(state)), *jnp.array(motion)))

    def _top(self, state: TwoBodies) -> np.ndarray:
        return (self.gel.place + state.gel)[self.gel.top]

    def _assemble(
        self, nodes: np.ndarray, traction: np.ndarray, weights: np.ndarray, slopes: np.ndarray
    ) -> scipy.sparse.csr_array:
        """Derivatives of what acts on the bar, and of the lack (`Linear.contact`)."""
        count, size = len(nodes), self.gel.place.size + self.bar.place.size
        turn, owner = self.face.turn[nodes], self.face.owner[nodes]
        by_near = slopes[..., 6:].reshape(count, 19, 32, 3)
        by_near = np.einsum("nrai,naij->nraj", by_near, turn).reshape(count, 19, 96)
        slopes = np.concatenate([slopes[..., :6], by_near], axis=2)
        back = np.einsum("nac,ni->naic", slopes[:, 3:], traction)
        back[..., 3:6] += weights[..., None, None] * np.eye(3)
        back = np.einsum("naij,naic->najc", turn[:, :16], back).reshape(count, 48, -1)
        top, tractions = components(self.gel.top), size + components(np.arange(count))
        near = self.gel.place.size + components(owner).reshape(count, -1)
        unknown = np.concatenate([top, tractions, near], axis=1)
        area = self.gel.area[:, None, None]
        blocks = [(tractions, unknown, slopes[:, :3]), (near[:, :48], unknown, area * back)]
        size += 3 * count
        return scipy.sparse.csr_array(assemble(blocks, size, np.arange(size)))


def cut_bar(bar: Bar, across: Float[np.ndarray, " nx"], cell: float, growth: float) -> Bricks:
    """Mesh a quarter of a bar, with small elements at its face.

    Args:
        bar: the bar to mesh.
        across: coordinates of the nodes along both sides, from 0 to half of its width; best the
            gel's, since a finer face is pressed in at single nodes [mm].
        cell: height of the elements at the face [mm].
        growth: ratio of the heights of neighbouring elements [-].
    """
    profile = bar.profile(*np.meshgrid(across, across, indexing="ij"))
    return lay_bricks(across, across, grow(bar.height, cell, growth), profile)


def hold(
    gel: tuple[Rubber, Bricks],
    bar: tuple[Rubber, Bricks],
    friction: float,
    path: Sequence[Motion],
    *,
    rtol: float = 1e-6,
) -> Held:
    """Solve a path of the grip, each step from the solution of the last.

    Args:
        gel: law of the gel, and the mesh of a quarter.
        bar: law of the bar, and the mesh of a quarter.
        friction: μ [-].
        path: poses of the grip.
        rtol: largest residual force, relative to the contact forces [-].

    Raises:
        RuntimeError: a step does not converge; smaller steps may help.
    """
    law = make_law(gel[1].cell, friction, gel[0], bar[0])
    rubbers, order = (law_of(gel[0]), law_of(bar[0])), _order(gel[1], bar[1])
    problem = _Problem(gel[1], bar[1], Face.of(bar[1]), rubbers, law, order, rtol)
    values = record(problem, path)
    return Held(Pressed(*values[:5]), *values[5:])


def _order(gel: Bricks, bar: Bricks) -> Int[np.ndarray, " components"]:
    """Components of both bodies: first what is inside them, then what may touch."""
    reach = 1.5 * bar.grid[0][-1]
    near = np.isin(gel.order, gel.top[np.hypot(*gel.place[gel.top, :2].T) < reach])
    face = np.isin(bar.order, bar.top)
    other = bar.order + len(gel.place)
    nodes = [gel.order[~near], other[~face], gel.order[near], other[face]]
    return components(np.concatenate(nodes)).ravel()


def _node(law: Law, now: Array, known: tuple, unknown: tuple) -> tuple[Array, Array, Array]:
    """The projection of a node's traction, weights of the bar's nodes, whether it sticks."""
    off, over, share, before, apart = known
    place, traction, near = unknown
    at, patch = into_frame(place, *now), near[:16]
    # the place is found already: the step is 0, and has its derivatives
    share = jnp.where(over, share - find_step(patch[:, :2], share, at[:2]), 0.5)
    weights, along = weigh(share), patch.T @ jax.jacfwd(weigh)(share)
    normal = jnp.cross(along[:, 1], along[:, 0])
    normal = normal / jnp.linalg.norm(normal)
    gap = jnp.where(over, -(weights @ patch[:, 2] - at[2]) * normal[2], 1.0)
    slip = at - weigh(before) @ near[16:] + jnp.array([0.0, 0.0, 1.0]) * apart
    admitted, stick = admit(law, traction, gap, normal, slip, off)
    return admitted, weights, stick


@jax.jit
def _project(law: Law, now: Array, known: tuple, unknown: tuple) -> Bool[Array, " top"]:
    return jax.vmap(_node, (None, None, 0, 0))(law, now, known, unknown)[2]


@jax.jit
def _contact_rows(law: Law, now: Array, known: tuple, unknown: tuple) -> tuple[Array, Array]:
    """Residual of each node's contact law and weights of the bar's nodes, and their derivatives.

    The derivatives are by the node's place and traction, and by the 32 nodes of the face.
    """

    def row(known: tuple, unknown: tuple) -> Array:
        admitted, weights, _ = _node(law, now, known, unknown)
        return jnp.concatenate([unknown[1] - admitted, weights])

    return differentiate(row, known, unknown)
