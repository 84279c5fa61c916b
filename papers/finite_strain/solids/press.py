"""A rigid object of any shape pressed onto a square gel and turned, with friction at each node.

`steps` has the law of contact and follows the path. A node's traction is eliminated from Newton's
equations, by its balance of forces. `two_bodies` solves soft objects.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Float, Int
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
    differentiate,
    into_frame,
    make_law,
    measure_rest,
    record,
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
        pushed = state.traction @ turn.T * bricks.area[:, None]
        total = assemble_forces(bricks, state.moved, self.rubber)
        total[bricks.top] -= pushed
        total[bricks.fixed] = 0.0
        lack, give = map(np.asarray, _contact_rows(*self.rows(state, motion, touched)))
        rest = measure_rest([total], lack * bricks.area[:, None], pushed)

        def step() -> np.ndarray:
            top = components(bricks.top)
            tractions = total.size + components(np.arange(len(top)))
            size = total.size + tractions.size
            rows = [(tractions, np.concatenate([top, tractions], axis=1), give)]
            return Linear(
                stiff=assemble_stiffness(bricks, state.moved, self.rubber),
                forces=total.ravel(),
                lack=lack,
                contact=scipy.sparse.csr_array(assemble(rows, size, np.arange(size))),
                fixed=bricks.fixed.ravel(),
                order=components(bricks.order).ravel(),
            ).solve(bricks, motion.twist)

        return Residual(rest, step)

    def measure(self, state: State, motion: Motion, touched: Array) -> tuple:
        """The values of `Pressed`."""
        stick = np.array(_project(*self.rows(state, motion, touched)))
        return measure_top(self.bricks, state.moved, state.traction, motion.twist, stick)

    def rows(self, state: State, motion: Motion, touched: Array) -> tuple:
        """The arguments of `_contact_rows` and `_project`."""
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
    law = make_law(bricks.cell, friction, gel)
    return Pressed(*record(_Problem(bricks, law_of(gel), solid, law, rtol), path))


def measure_top(
    bricks: Bricks,
    moved: Float[np.ndarray, "nodes 3"],
    traction: Float[np.ndarray, "top 3"],
    twist: float,
    stick: Bool[np.ndarray, " top"],
) -> tuple:
    """The values of a step for `Pressed`.

    Args:
        bricks: mesh of a sector of the gel.
        moved: displacement of its nodes [mm].
        traction: traction on its top's nodes, in the object's frame [MPa].
        twist: θ of the object [rad].
        stick: whether friction does not reach its limit at a node.
    """
    lattice, top = bricks.lattice, bricks.top
    place = (bricks.place + moved)[top, :2].T
    force, moment, contact = sum_tractions(traction, twist, place, bricks.area)
    number = np.searchsorted(top, bricks.owner[lattice])
    return (
        bricks.spread(moved)[lattice],
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


@jax.jit
def _project(law: Law, solid, off, place, traction, now, before):
    axes = (None, None, 0, 0, 0, None, 0)
    return jax.vmap(_admitted, axes)(law, solid, off, place, traction, now, before)[1]


@jax.jit
def _contact_rows(law: Law, solid, off, place, traction, now, before):
    """Residual of each node's contact law, and its derivatives by displacement and traction."""

    def lack(fixed: tuple, unknown: tuple) -> Array:
        (off, before), (place, traction) = fixed, unknown
        return traction - _admitted(law, solid, off, place, traction, now, before)[0]

    return differentiate(lack, (off, before), (place, traction))


def assemble_forces(bricks: Bricks, moved: np.ndarray, rubber: Array) -> np.ndarray:
    """Forces that strain needs at each node [N].

    Args:
        bricks: mesh of the body.
        moved: displacement of its nodes [mm].
        rubber: G [MPa], K [MPa] and m [-].
    """
    total = np.zeros_like(moved)
    each = element_forces(jnp.asarray(moved[bricks.nodes]), bricks.parts, rubber)
    np.add.at(total, bricks.nodes, np.asarray(each))
    return total


def assemble_stiffness(bricks: Bricks, moved: np.ndarray, rubber: Array) -> scipy.sparse.csr_array:
    """Derivative of these forces; 1 on the diagonal where the body is fixed [N/mm].

    Args:
        bricks: mesh of the body.
        moved: displacement of its nodes [mm].
        rubber: G [MPa], K [MPa] and m [-].
    """
    stiff = np.asarray(element_stiffness(jnp.asarray(moved[bricks.nodes]), bricks.parts, rubber))
    numbers, every = components(bricks.nodes).reshape(-1, 24), np.arange(bricks.place.size)
    whole = assemble([(numbers, numbers, stiff)], every.size, every).tocsr()
    fixed = bricks.fixed.ravel().astype(float)
    free = scipy.sparse.diags_array(1.0 - fixed)
    return free @ whole @ free + scipy.sparse.diags_array(fixed)


class Linear(NamedTuple):
    """Newton's equations of a gel and of what is pressed on it.

    Attributes:
        stiff: derivative of the bodies' forces by their displacements, the gel's first [N/mm].
        forces: their unbalanced forces [N].
        lack: residual of the contact's law, by node of the gel's top [MPa].
        contact: derivatives of what acts on a soft object, and of the lack, by all displacements
            and tractions.
        fixed: mask of the displacement components that are 0.
        order: order of the components in which a factorization fills in little.
    """

    stiff: scipy.sparse.csr_array
    forces: Float[np.ndarray, " components"]
    lack: Float[np.ndarray, "top 3"]
    contact: scipy.sparse.csr_array
    fixed: Bool[np.ndarray, " components"]
    order: Int[np.ndarray, " components"]

    def solve(self, bricks: Bricks, twist: float) -> Float[np.ndarray, " unknowns"]:
        """Newton's step of displacements and tractions.

        The gel's balance K du − R dt = −f at its top, R = A Q, gives dt = R⁻¹ (K du + f). That
        leaves the contact's rows R (L du + D dt) = −R l there, and those of a soft object,
        K du + P du + T dt = −f.

        Args:
            bricks: mesh of the gel.
            twist: θ of the object [rad].
        """
        size, area = len(self.forces), bricks.area[:, None, None]
        top, every = components(bricks.top), np.arange(size + 3 * len(bricks.top))
        turn = turn_back(np.eye(3), twist).T  # of the object's components
        tractions = size + components(np.arange(len(top)))
        out, back = ((top, tractions, area * turn), (tractions, top, turn.T / area))
        out = assemble([out], len(every), every)[:size, size:]
        back = assemble([back], len(every), every)[size:, :size]
        contact, free = self.contact, scipy.sparse.diags_array(1.0 - self.fixed)
        rest = np.ones(size)
        rest[top.ravel()] = 0.0
        by_traction = free @ contact[:size, size:] + out @ contact[size:, size:]
        carried = scipy.sparse.diags_array(rest) + by_traction @ back
        added = contact[:size, :size] + out @ contact[size:, :size]
        right = carried @ self.forces + out @ self.lack.ravel()
        moved = solve_ordered(self.order, carried @ self.stiff + free @ added @ free, -right)
        return np.concatenate([moved, back @ (self.stiff @ moved + self.forces)])


def solve_ordered(
    order: np.ndarray, matrix: scipy.sparse.csr_array | scipy.sparse.csr_matrix, right: np.ndarray
) -> Float[np.ndarray, " components"]:
    """Solution of a system, factorized in an order; a `RuntimeError` if it is singular."""
    ordered = matrix[order].tocsc()[:, order]
    solved = np.empty(len(order))
    # pivots stay on the diagonal unless they are small, so that the order is kept
    symmetric = {"diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True}}
    solved[order] = splu(ordered, permc_spec="NATURAL", **symmetric).solve(right[order])
    return solved
