"""A rigid body of revolution pressed onto a gel and turned, with Coulomb friction at each node.

Contact and friction hold exactly at each node of the top, in the frame that turns with the object:
[Alart1991] P. Alart, A. Curnier, "A mixed formulation for frictional contact problems prone to
Newton like solution methods". Unknowns are the displacements and the tractions t. For any number
c > 0, t is the projection of t − c (gap n + slip) onto the tractions that friction admits.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Float
from scipy.sparse.linalg import splu

from papers.finite_strain.gel import Elements, Gel, forces_and_stiffness, law_of


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


class Motion(NamedTuple):
    """Pose of the object.

    Attributes:
        approach: δ [mm].
        twist: θ, counter-clockwise [rad].
    """

    approach: float
    twist: float


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


class _Law(NamedTuple):
    """The law of contact: the object's radii [mm], μ [-], and c of [Alart1991] [MPa/mm]."""

    sizes: Array
    friction: Array
    stiffness: Array


class _Problem(NamedTuple):
    """The data that all steps share: mesh, law of the gel, law of contact, tolerance."""

    elements: Elements
    rubber: Array
    law: _Law
    rtol: float


class _State(NamedTuple):
    """Displacement of all nodes [mm], and traction at the top nodes in the object's frame [MPa]."""

    moved: np.ndarray
    traction: np.ndarray


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
    r = jnp.asarray(elements.place[elements.top, 0])
    stiffness = gel.shear_modulus / float(np.diff(elements.place[elements.top, 0]).min())
    law = _Law(jnp.array(shape), jnp.array(friction), jnp.array(stiffness))
    state = _State(np.zeros((len(elements.place), 3)), np.zeros((len(r), 3)))
    problem = _Problem(elements, law_of(gel), law, rtol)
    before, last, rows = (state, Motion(0.0, 0.0)), Motion(0.0, 0.0), []
    for motion in path:
        share = _carry_on(before[1], last, motion)
        guess = [b + share * (b - a) for a, b in zip(before[0], state, strict=True)]
        solved, top = _go(problem, state, last, motion, _State(*guess))
        before, state, last = (state, last), solved, motion
        rows.append(_measure(state, elements, law, motion, top))
    return Pressed(np.asarray(r), *map(np.stack, zip(*rows, strict=True)))


def _go(
    problem: "_Problem", state: _State, last: Motion, now: Motion, guess: _State, cuts: int = 4
) -> tuple[_State, Array]:
    """One step, halved if it does not converge, and the last position of the top [mm]."""
    elements = problem.elements
    r = jnp.asarray(elements.place[elements.top, 0])
    top = _in_frame(r, jnp.asarray(state.moved[elements.top]), jnp.array(last))
    try:
        return _balance(guess, problem, jnp.array(now), top), top
    except RuntimeError:
        if cuts == 0:
            raise
    middle = Motion(*(0.5 * (a + b) for a, b in zip(last, now, strict=True)))
    half, _ = _go(problem, state, last, middle, state, cuts - 1)
    return _go(problem, half, middle, now, half, cuts - 1)


def _carry_on(earlier: Motion, last: Motion, now: Motion) -> float:
    """Share of the last step by which to extrapolate, from 0 to 1 [-]."""
    step, before = np.subtract(now, last), np.subtract(last, earlier)
    return float(np.clip(step @ before / max(before @ before, 1e-30), 0.0, 1.0))


def _measure(state: _State, elements: Elements, law: _Law, now: Motion, at: Array) -> tuple:
    """The values of a step for `Pressed`."""
    top = state.moved[elements.top]
    force = _turn_back(state.traction, now.twist) * elements.area[:, None]
    x, y = elements.place[elements.top, 0] + top[:, 0], top[:, 1]
    moment = np.sum(x * force[:, 1] - y * force[:, 0])
    r = jnp.asarray(elements.place[elements.top, 0])
    _, stick = _project(law, r, jnp.asarray(top), jnp.asarray(state.traction), jnp.array(now), at)
    pressed = np.linalg.norm(state.traction, axis=1)
    contact = pressed > 1e-6 * pressed.max()  # beyond rounding
    return top, -force[:, 2].sum(), moment, contact, contact & np.asarray(stick)


def _distance(place: Float[Array, "2"], sizes: Float[Array, "2"]) -> Float[Array, ""]:
    """Distance from the surface of an object with its lowest point at 0; outside positive [mm]."""
    flat, edge = sizes
    beyond = jnp.maximum(place[0] - flat, 0.0)
    return jnp.sqrt(beyond**2 + (place[1] - edge) ** 2) - edge


def _in_frame(r: Array, moved: Array, now: Float[Array, "2"]) -> Array:
    """Positions of the top's points in the object's frame [mm]."""
    c, s = jnp.cos(now[1]), jnp.sin(now[1])
    x, y, z = r + moved[..., 0], moved[..., 1], moved[..., 2] + now[0]
    return jnp.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def _turn_back(vectors: np.ndarray, twist: float) -> np.ndarray:
    """Rotate vectors from the object's frame to the frame of the undeformed point."""
    c, s = np.cos(twist), np.sin(twist)
    return vectors @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _admitted(
    law: _Law, r: Array, moved: Array, traction: Array, now: Array, before: Array
) -> tuple[Array, Array]:
    """The projection of a node's traction [MPa], and whether it sticks."""
    at = _in_frame(r, moved, now)
    square = at[0] ** 2 + at[1] ** 2
    off = square > 1e-24
    around = jnp.sqrt(jnp.where(off, square, 1.0)) * off
    gap, slope = jax.value_and_grad(_distance)(jnp.stack([around, at[2]]), law.sizes)
    outward = jnp.where(off, at[:2] / jnp.where(off, around, 1.0), 0.0)
    normal = jnp.append(slope[0] * outward, slope[1])
    pressure = jnp.maximum(normal @ traction - law.stiffness * gap, 0.0)
    tried = traction - law.stiffness * (at - before)
    tried = tried - normal * (normal @ tried)
    square, limit = tried @ tried, law.friction * pressure
    slides = square >= limit**2
    size = jnp.sqrt(jnp.where(slides & (square > 0.0), square, 1.0))
    shear = (r > 0.0) * tried * jnp.where(slides, limit / size, 1.0)  # none on the axis
    return pressure * normal + shear, ~slides


@jax.jit
def _project(law: _Law, r: Array, moved: Array, traction: Array, now: Array, before: Array):
    return jax.vmap(_admitted, (None, 0, 0, 0, None, 0))(law, r, moved, traction, now, before)


@jax.jit
def _contact_rows(law: _Law, r: Array, moved: Array, traction: Array, now: Array, before: Array):
    """Residual of each node's contact law, and its derivatives by displacement and traction."""

    def lack(*unknown: Array) -> Array:
        r, moved, traction, before = unknown
        return traction - _admitted(law, r, moved, traction, now, before)[0]

    args = r, moved, traction, before
    missing = jax.vmap(lack)(*args)
    by_moved, by_traction = jax.vmap(jax.jacfwd(lack, (1, 2)))(*args)
    return missing, by_moved, by_traction


def _balance(state: _State, problem: _Problem, now: Array, before: Array, most: int = 14) -> _State:
    """Newton's method for displacements and tractions together, damped where it diverges."""
    elements = problem.elements
    turn = _turn_back(np.eye(3), float(now[1])).T  # of the object's components
    residual = _residual(state, problem, now, before, turn)
    for _ in range(most):
        if residual.rest < problem.rtol:
            return state
        matrix = _assemble(elements, residual.stiff, turn, *residual.give, len(state.moved))
        try:
            step = splu(matrix).solve(-residual.lack)
        except RuntimeError:  # of SciPy: a singular matrix
            break
        tried, after = state, residual
        for halving in range(6):
            moved, share = state.moved.copy(), 0.5**halving
            moved.ravel()[elements.free] += share * step[: len(elements.free)]
            more = share * step[len(elements.free) :].reshape(state.traction.shape)
            tried = _State(moved, state.traction + more)
            after = _residual(tried, problem, now, before, turn)
            if after.rest < 1.5 * residual.rest:
                break
        state, residual = tried, after
    raise RuntimeError(
        f"a step to an approach of {float(now[0]):g} mm and {np.degrees(float(now[1])):g}° did not "
        "converge: take smaller steps"
    )


class _Residual(NamedTuple):
    """Residual forces and tractions, their size relative to the force, and derivatives."""

    lack: np.ndarray
    rest: float
    stiff: np.ndarray
    give: tuple[np.ndarray, np.ndarray]


def _residual(
    state: _State, problem: _Problem, now: Array, before: Array, turn: np.ndarray
) -> _Residual:
    elements = problem.elements
    parts = elements.value, elements.slope, elements.volume
    moved = jnp.asarray(state.moved[elements.nodes])
    inner, stiff = forces_and_stiffness(moved, parts, problem.rubber)
    total = np.zeros_like(state.moved)
    np.add.at(total, elements.nodes, np.asarray(inner).reshape(-1, 4, 3))
    pushed = state.traction @ turn.T * elements.area[:, None]
    total[elements.top] -= pushed
    r, top = elements.place[elements.top, 0], state.moved[elements.top]
    lack, *give = map(
        np.asarray,
        _contact_rows(problem.law, *map(jnp.asarray, (r, top, state.traction)), now, before),
    )
    unbalanced = total.ravel()[elements.free]
    rest = np.hypot(np.linalg.norm(unbalanced), np.linalg.norm(lack * elements.area[:, None]))
    scale = max(float(np.abs(pushed).sum()), 1e-3)
    rest = rest / scale if np.isfinite(rest) else np.inf
    whole = np.concatenate([unbalanced, lack.ravel()])
    return _Residual(whole, float(rest), np.asarray(stiff), (give[0], give[1]))


def _assemble(
    elements: Elements,
    stiff: np.ndarray,
    turn: np.ndarray,
    by_moved: np.ndarray,
    by_traction: np.ndarray,
    count: int,
) -> scipy.sparse.csc_matrix:
    """Matrix of the derivatives of both residuals by free displacements and by tractions."""
    numbers = (3 * elements.nodes[..., None] + np.arange(3)).reshape(-1, 12)
    displacements = 3 * elements.top[:, None] + np.arange(3)
    tractions = 3 * count + np.arange(displacements.size).reshape(displacements.shape)
    force = -elements.area[:, None, None] * turn
    blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = [
        (numbers, numbers, stiff),
        (displacements, tractions, force),
        (tractions, displacements, by_moved),
        (tractions, tractions, by_traction),
    ]
    rows = [np.repeat(row, column.shape[1], axis=1).ravel() for row, column, _ in blocks]
    columns = [np.tile(column, row.shape[1]).ravel() for row, column, _ in blocks]
    values = np.concatenate([value.ravel() for _, _, value in blocks])
    size = 3 * count + displacements.size
    place = np.concatenate(rows), np.concatenate(columns)
    whole = scipy.sparse.csr_matrix((values, place), shape=(size, size))
    free = np.concatenate([elements.free, tractions.ravel()])
    return whole[free].tocsc()[:, free]
