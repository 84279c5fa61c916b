"""A rigid object of any shape pressed onto a square gel and turned, with friction at each node.

`steps` has the law of contact and follows the path. A node's traction is eliminated from Newton's
equations, by its balance of forces.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Float
from scipy.sparse.linalg import splu

from papers.finite_strain.gel import Rubber, law_of
from papers.finite_strain.solids.bricks import Bricks, element_forces, element_stiffness
from papers.finite_strain.steps import (
    Law,
    Motion,
    Residual,
    State,
    admit,
    assemble,
    components,
    contact_rows,
    find_stick,
    follow,
    into_frame,
    measure_rest,
    sum_tractions,
    turn_back,
)


@runtime_checkable
class Solid(Protocol):
    """A rigid object, a tuple of its sizes, with its lowest point at the origin."""

    def outside(self, place: Float[Array, "3"]) -> Float[Array, ""]:
        """Distance from the surface near it, outside positive [mm].

        Args:
            place: position in the object's frame [mm].
        """
        ...


class Block(NamedTuple):
    """A square face with rounded edges; a sphere without a face.

    Attributes:
        flat: half of the flat face's width [mm].
        edge: radius of the rounded edges [mm].
    """

    flat: float
    edge: float

    def outside(self, place: Float[Array, "3"]) -> Float[Array, ""]:
        """Distance from the surface, outside positive [mm]."""
        beyond = jnp.maximum(jnp.abs(place[:2]) - self.flat, 0.0)
        return jnp.sqrt(beyond @ beyond + (place[2] - self.edge) ** 2) - self.edge


class Egg(NamedTuple):
    """An ellipsoid.

    Attributes:
        a: half of its length along x [mm].
        b: half of its length along y [mm].
        c: half of its height [mm].
    """

    a: float
    b: float
    c: float

    def outside(self, place: Float[Array, "3"]) -> Float[Array, ""]:
        """Distance from the surface, to first order; outside positive [mm]."""
        scaled = (place - jnp.array([0.0, 0.0, self.c])) / jnp.array(self)
        size = jnp.linalg.norm(scaled)
        return (size - 1.0) * size / jnp.linalg.norm(scaled / jnp.array(self))


class Pressed(NamedTuple):
    """Solution along a path, on the top of the meshed sector.

    Attributes:
        moved: displacement of the top's nodes [mm].
        normal_force: P of the whole gel [N].
        moment: M about the axis, on the whole gel [N·mm].
        contact: mask of the nodes in contact.
        stick: mask of the nodes in contact that do not slip in the step.
    """

    moved: Float[np.ndarray, "steps nx ny 3"]
    normal_force: Float[np.ndarray, " steps"]
    moment: Float[np.ndarray, " steps"]
    contact: Bool[np.ndarray, "steps nx ny"]
    stick: Bool[np.ndarray, "steps nx ny"]


class _Problem(NamedTuple):
    """A sector of a gel under a rigid object (`steps.Problem`)."""

    bricks: Bricks
    rubber: Array
    solid: Solid
    law: Law
    rtol: float

    def start(self) -> State:
        return State(np.zeros(self.bricks.place.shape), np.zeros((self.bricks.top.size, 3)))

    def touch(self, state: State, motion: Motion) -> Array:
        """Positions of the top's nodes in the object's frame [mm]."""
        return into_frame(jnp.asarray(self._top(state)), *jnp.array(motion))

    def add(self, state: State, step: np.ndarray) -> State:
        moved, traction = np.split(step, [state.moved.size])
        return State(
            state.moved + moved.reshape(state.moved.shape),
            state.traction + traction.reshape(state.traction.shape),
        )

    def residual(self, state: State, motion: Motion, touched: Array) -> Residual:
        bricks = self.bricks
        turn = turn_back(np.eye(3), motion.twist).T  # of the object's components
        args = state.moved[bricks.nodes], bricks.parts, self.rubber
        total = np.zeros_like(state.moved)
        np.add.at(total, bricks.nodes, np.asarray(element_forces(*args)))
        pushed = state.traction @ turn.T * bricks.area[:, None]
        total[bricks.top] -= pushed
        total[bricks.fixed] = 0.0
        lack, *give = map(np.asarray, contact_rows(_admitted, *self.rows(state, motion, touched)))
        rest = measure_rest([total], lack * bricks.area[:, None], pushed)

        def step() -> np.ndarray:
            whole = assemble_stiffness(bricks, np.asarray(element_stiffness(*args)))
            return _newton(bricks, whole, turn, (total, lack), give)

        return Residual(rest, step)

    def rows(self, state: State, motion: Motion, touched: Array) -> tuple:
        """The arguments of `contact_rows` and `find_stick`, after the first."""
        place, off = self._top(state), ~self.bricks.fixed[self.bricks.top, 0]
        return self.law, self.solid, off, place, state.traction, jnp.array(motion), touched

    def _top(self, state: State) -> np.ndarray:
        return (self.bricks.place + state.moved)[self.bricks.top]


def press(
    gel: Rubber,
    bricks: Bricks,
    solid: Solid,
    friction: float,
    path: Sequence[Motion],
    *,
    rtol: float = 1e-6,
) -> Pressed:
    """Solve a path, each step from the solution of the last.

    Args:
        gel: law of the gel.
        bricks: mesh of a sector of it.
        solid: shape of the object; a turn by a sector does not change it.
        friction: μ [-].
        path: poses of the object.
        rtol: largest residual force, relative to the contact forces [-].

    Raises:
        RuntimeError: a step does not converge; smaller steps may help.
    """
    stiffness = gel.shear_modulus / float(np.sqrt(bricks.area.min()))
    law = Law(jnp.array(friction), jnp.array(stiffness))
    problem = _Problem(bricks, law_of(gel), solid, law, rtol)
    rows = []
    for motion, state, touched in follow(problem, path):
        stick = np.array(find_stick(_admitted, *problem.rows(state, motion, touched)))
        rows.append(_measure(bricks, state, motion.twist, stick))
    return Pressed(*map(np.stack, zip(*rows, strict=True)))


def _measure(bricks: Bricks, state: State, twist: float, stick: np.ndarray) -> tuple:
    """The values of a step for `Pressed`."""
    lattice, top = bricks.lattice, bricks.top
    place = (bricks.place + state.moved)[top, :2].T
    force, moment, contact = sum_tractions(state.traction, twist, place, bricks.area)
    number = np.searchsorted(top, bricks.owner[lattice])
    return (
        bricks.spread(state.moved)[lattice],
        bricks.sectors * force,
        bricks.sectors * moment,
        contact[number],
        (contact & stick)[number],
    )


def _admitted(
    law: Law, solid: Solid, off: Array, place: Array, traction: Array, now: Array, before: Array
) -> tuple[Array, Array]:
    """The projection of a node's traction [MPa], and whether it sticks."""
    at = into_frame(place, *now)
    gap, slope = jax.value_and_grad(solid.outside)(at)
    return admit(law, traction, gap, slope / jnp.linalg.norm(slope), at - before, off)


def assemble_stiffness(
    bricks: Bricks, stiff: Float[np.ndarray, "elements 24 24"]
) -> scipy.sparse.csr_array:
    """The gel's matrix from that of its elements; 1 on the diagonal where it is fixed [N/mm]."""
    numbers, every = components(bricks.nodes).reshape(-1, 24), np.arange(bricks.place.size)
    whole = assemble([(numbers, numbers, stiff)], every.size, every).tocsr()
    fixed = bricks.fixed.ravel().astype(float)
    free = scipy.sparse.diags_array(1.0 - fixed)
    return free @ whole @ free + scipy.sparse.diags_array(fixed)


def _newton(
    bricks: Bricks,
    whole: scipy.sparse.csr_array,
    turn: np.ndarray,
    lacks: tuple[np.ndarray, np.ndarray],
    give: Sequence[np.ndarray],
) -> np.ndarray:
    """Newton's step of displacements and tractions.

    With forces K du − A Q dt = −f at the top and contact rows C du + D dt = −l, dt = Qᵀ(K du + f)/A
    leaves [Q D Qᵀ K + A Q C] du = −Q (A l + D Qᵀ f).
    """
    (forces, lack), (by_moved, by_traction) = lacks, give
    size, area = forces.size, bricks.area[:, None, None]
    top = components(bricks.top)
    through = turn @ by_traction @ turn.T
    rest = np.setdiff1d(np.arange(size), top)[:, None]
    blocks = [(top, top, through), (rest, rest, np.ones((len(rest), 1, 1)))]
    carried = assemble(blocks, size, np.arange(size)).tocsr()
    added = assemble([(top, top, area * (turn @ by_moved))], size, np.arange(size))
    right = -(carried @ forces.ravel())
    np.add.at(right, top, -(area[..., 0] * lack) @ turn.T)
    moved = solve_ordered(bricks, carried @ whole + added, right)
    reached = (whole @ moved + forces.ravel())[top] @ turn / area[..., 0]
    return np.concatenate([moved, reached.ravel()])


def solve_ordered(
    bricks: Bricks, matrix: scipy.sparse.csr_array | scipy.sparse.csr_matrix, right: np.ndarray
) -> Float[np.ndarray, " components"]:
    """Solution of a system of all displacement components; a `RuntimeError` if it is singular."""
    order = components(bricks.order).ravel()
    ordered = matrix[order].tocsc()[:, order]
    solved = np.empty(len(order))
    # pivots stay on the diagonal unless they are small, so that the order is kept
    symmetric = {"diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True}}
    solved[order] = splu(ordered, permc_spec="NATURAL", **symmetric).solve(right[order])
    return solved
