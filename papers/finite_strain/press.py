"""A rigid body of revolution pressed onto a gel and turned, with Coulomb friction at each node.

`steps` has the law of contact and follows the path; `two_bodies` solves soft objects.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from papers.finite_strain.gel import Elements, Gel, law_of
from papers.finite_strain.steps import (
    Law,
    Motion,
    Residual,
    State,
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
    sum_tractions,
    top_of,
    turn_back,
)


class Round(NamedTuple):
    """A sphere, or a flat punch with a rounded edge.

    Attributes:
        flat: radius of the flat face; 0 for a sphere [mm].
        edge: radius of the rounded edge, or of the sphere [mm].
    """

    flat: float
    edge: float

    def reach(self, depth: float) -> float:
        """Radius of the top that small elements must cover [mm].

        Args:
            depth: largest depth [mm].
        """
        if self.flat:
            return self.flat + 1.8 * min(1.0, self.edge)
        return float(np.sqrt(2.0 * self.edge * depth)) + 0.3


class Pressed(NamedTuple):
    """Solution along a path.

    Attributes:
        radius: radius of the undeformed top's nodes [mm].
        moved: u_r, u_θ and u_z of these nodes [mm].
        normal_force: P [N].
        moment: M about the axis, on the gel [N·mm].
        contact: mask of the nodes in contact.
        stick: mask of the nodes in contact that do not slip in the step.
    """

    radius: Float[np.ndarray, " top"]
    moved: Float[np.ndarray, "steps top 3"]
    normal_force: Float[np.ndarray, " steps"]
    moment: Float[np.ndarray, " steps"]
    contact: Bool[np.ndarray, "steps top"]
    stick: Bool[np.ndarray, "steps top"]


class _Problem(NamedTuple):
    """A gel under a rigid object (`steps.Problem`)."""

    elements: Elements
    rubber: Array
    sizes: Array
    law: Law
    rtol: float

    def start(self) -> State:
        return State(np.zeros((len(self.elements.place), 3)), np.zeros((self.elements.top.size, 3)))

    def touch(self, state: State, motion: Motion) -> Array:
        """Positions of the top's nodes in the object's frame [mm]."""
        r, top = top_of(self.elements, state.moved)
        return in_frame(r, top, *jnp.array(motion))

    def add(self, state: State, step: np.ndarray) -> State:
        free, moved = self.elements.free, state.moved.copy()
        moved.ravel()[free] += step[: len(free)]
        return State(moved, state.traction + step[len(free) :].reshape(state.traction.shape))

    def residual(self, state: State, motion: Motion, touched: Array) -> Residual:
        elements = self.elements
        turn = turn_back(np.eye(3), motion.twist).T  # of the object's components
        total, stiff = strain(elements, state.moved, self.rubber)
        pushed = state.traction @ turn.T * elements.area[:, None]
        total[elements.top] -= pushed
        lack, give = map(np.asarray, _contact_rows(*self.rows(state, motion, touched)))
        unbalanced = total.ravel()[elements.free]
        rest = measure_rest([unbalanced], lack * elements.area[:, None], pushed)
        whole = np.concatenate([unbalanced, lack.ravel()])
        return Residual(
            rest,
            lambda: solve_sparse(_assemble(elements, stiff, turn, give), -whole),
        )

    def measure(self, state: State, motion: Motion, touched: Array) -> tuple:
        """The values of `Pressed`."""
        _, stick = _project(*self.rows(state, motion, touched))
        return measure_top(
            self.elements, state.moved, state.traction, motion.twist, np.array(stick)
        )

    def rows(self, state: State, motion: Motion, touched: Array) -> tuple:
        """The arguments of `_contact_rows` and `_project`."""
        top, traction = top_of(self.elements, state.moved), jnp.asarray(state.traction)
        return self.law, self.sizes, *top, traction, jnp.array(motion), touched


def press(
    gel: Gel,
    elements: Elements,
    shape: Round,
    friction: float,
    path: Sequence[Motion],
    *,
    rtol: float = 1e-7,
) -> Pressed:
    """Solve a path, each step from the solution of the last.

    Args:
        gel: the gel.
        elements: the gel's mesh.
        shape: shape of the object.
        friction: μ [-].
        path: poses of the object.
        rtol: largest residual force, relative to the contact forces [-].

    Raises:
        RuntimeError: a step does not converge; smaller steps may help.
    """
    law = make_law(elements.cell, friction, gel)
    problem = _Problem(elements, law_of(gel), jnp.array(shape), law, rtol)
    return Pressed(elements.place[elements.top, 0], *record(problem, path))


def measure_top(
    elements: Elements,
    moved: Float[np.ndarray, "nodes 3"],
    traction: Float[np.ndarray, "top 3"],
    twist: float,
    stick: Bool[np.ndarray, " top"],
) -> tuple:
    """The values of a step for `Pressed`.

    Args:
        elements: mesh of the gel.
        moved: displacement of its nodes [mm].
        traction: traction on its top's nodes, in the object's frame [MPa].
        twist: θ of the object [rad].
        stick: whether friction does not reach its limit at a node.
    """
    top = moved[elements.top]
    place = np.stack([elements.place[elements.top, 0] + top[:, 0], top[:, 1]])
    force, moment, contact = sum_tractions(traction, twist, place, elements.area)
    return top, force, moment, contact, contact & stick


def _distance(place: Float[Array, "2"], sizes: Float[Array, "2"]) -> Float[Array, ""]:
    """Distance from the surface of an object with its lowest point at 0; outside positive [mm]."""
    flat, edge = sizes
    beyond = jnp.maximum(place[0] - flat, 0.0)
    return jnp.sqrt(beyond**2 + (place[1] - edge) ** 2) - edge


def _admitted(
    law: Law, sizes: Array, r: Array, moved: Array, traction: Array, now: Array, before: Array
) -> tuple[Array, Array]:
    """The projection of a node's traction [MPa], and whether it sticks."""
    at = in_frame(r, moved, *now)
    around, outward = from_axis(at)
    gap, slope = jax.value_and_grad(_distance)(jnp.stack([around, at[2]]), sizes)
    normal = jnp.append(slope[0] * outward, slope[1])
    return admit(law, traction, gap, normal, at - before, r > 0.0)


@jax.jit
def _project(
    law: Law, sizes: Array, r: Array, moved: Array, traction: Array, now: Array, before: Array
):
    axes = (None, None, 0, 0, 0, None, 0)
    return jax.vmap(_admitted, axes)(law, sizes, r, moved, traction, now, before)


@jax.jit
def _contact_rows(
    law: Law, sizes: Array, r: Array, moved: Array, traction: Array, now: Array, before: Array
):
    """Residual of each node's contact law, and its derivatives by displacement and traction."""

    def lack(fixed: tuple, unknown: tuple) -> Array:
        (r, before), (moved, traction) = fixed, unknown
        return traction - _admitted(law, sizes, r, moved, traction, now, before)[0]

    return differentiate(lack, (r, before), (moved, traction))


def _assemble(
    elements: Elements,
    stiff: np.ndarray,
    turn: np.ndarray,
    give: np.ndarray,
):
    """Matrix of the derivatives of both residuals by free displacements and by tractions."""
    numbers = components(elements.nodes).reshape(-1, 12)
    displacements = components(elements.top)
    count = 3 * len(elements.place)
    tractions = count + components(np.arange(len(elements.top)))
    blocks = [
        (numbers, numbers, stiff),
        (displacements, tractions, -elements.area[:, None, None] * turn),
        (tractions, np.concatenate([displacements, tractions], axis=1), give),
    ]
    free = np.concatenate([elements.free, tractions.ravel()])
    return assemble(blocks, count + tractions.size, free)
