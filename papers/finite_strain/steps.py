"""Contact with Coulomb friction at finite strain: its law at a node, and steps along a path.

Contact and friction hold exactly at each node of the gel's top, in the frame that moves with the
object: [Alart1991] P. Alart, A. Curnier, "A mixed formulation for frictional contact problems prone
to Newton like solution methods". Unknowns are the displacements and the tractions t. For any number
c > 0, t is the projection of t − c (gap n + slip) onto the tractions that friction admits.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Float
from scipy.sparse.linalg import splu

from papers.finite_strain.gel import Elements, Rubber, forces_and_stiffness


class Motion(NamedTuple):
    """Pose of the object.

    Attributes:
        approach: δ [mm].
        twist: θ, counter-clockwise [rad].
    """

    approach: float
    twist: float


def press_and_turn(depth: float, presses: int, turns_deg: Iterable[float | int]) -> list[Motion]:
    """A path: pressed on in even steps to a depth [mm], then turned through angles [°]."""
    pressed = [Motion(depth * (i + 1) / presses, 0.0) for i in range(presses)]
    return pressed + [Motion(depth, float(np.radians(angle))) for angle in turns_deg]


class Law(NamedTuple):
    """The law of contact: μ [-], and c of [Alart1991] [MPa/mm]."""

    friction: Array
    stiffness: Array


class State(NamedTuple):
    """Displacement of a gel [mm], and traction at its top, in the object's frame [MPa]."""

    moved: np.ndarray
    traction: np.ndarray


class TwoBodies(NamedTuple):
    """Displacements of both bodies [mm], and traction on the gel in the object's frame [MPa]."""

    gel: np.ndarray
    object: np.ndarray
    traction: np.ndarray


class Residual(NamedTuple):
    """Residual of a problem.

    Attributes:
        rest: size of the residual forces and tractions relative to the contact forces; infinite
            if one is not finite [-].
        step: Newton's step of the unknowns; a `RuntimeError` if it is singular.
    """

    rest: float
    step: Callable[[], np.ndarray]


@runtime_checkable
class Problem(Protocol):
    """A contact that is solved step by step; its state is a tuple of arrays."""

    @property
    def rtol(self) -> float:
        """Largest residual, relative to the contact forces [-]."""
        ...

    def start(self) -> Any:
        """State of the undeformed bodies."""
        ...

    def touch(self, state: Any, motion: Motion) -> Any:
        """The points of the object that the gel's nodes touch, from which slip is measured."""
        ...

    def residual(self, state: Any, motion: Motion, touched: Any) -> Residual:
        """Residual of a state after slip from the points touched."""
        ...

    def add(self, state: Any, step: np.ndarray) -> Any:
        """The state after a step of the unknowns."""
        ...

    def measure(self, state: Any, motion: Motion, touched: Any) -> tuple:
        """What is kept of a solved state after slip from the points touched: arrays, numbers."""
        ...


def record(problem: Problem, path: Sequence[Motion]) -> tuple[np.ndarray, ...]:
    """Solve a path, each step from the solution of the last.

    Args:
        problem: the contact.
        path: poses of the object.

    Returns:
        The values of `Problem.measure`, each with a first axis for the steps.

    Raises:
        RuntimeError: a step does not converge; smaller steps may help.
    """
    rows = [problem.measure(state, *step) for step, state in _follow(problem, path)]
    return tuple(map(np.stack, zip(*rows, strict=True)))


def _follow(problem: Problem, path: Sequence[Motion]) -> Iterator[tuple[tuple[Motion, Any], Any]]:
    """Pose and the points from which the step's slip is measured, and the state, of each step."""
    state, last = problem.start(), Motion(0.0, 0.0)
    before = state, last
    for motion in path:
        share = _carry_on(before[1], last, motion)
        guess = type(state)(*(b + share * (b - a) for a, b in zip(before[0], state, strict=True)))
        solved, touched = _go(problem, state, last, motion, guess)
        before, state, last = (state, last), solved, motion
        yield (motion, touched), state


def _go(
    problem: Problem, state: Any, last: Motion, now: Motion, guess: Any, cuts: int = 4
) -> tuple[Any, Any]:
    """One step, halved if it does not converge, and the points last touched."""
    touched = problem.touch(state, last)
    try:
        return _balance(problem, guess, now, touched), touched
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


def _balance(problem: Problem, state: Any, now: Motion, touched: Any, most: int = 14) -> Any:
    """Newton's method for all unknowns together, damped where it diverges."""
    residual = problem.residual(state, now, touched)
    for _ in range(most):
        if residual.rest < problem.rtol:
            return state
        try:
            step = residual.step()
        except RuntimeError:  # of SciPy: a singular matrix
            break
        tried, after = state, residual
        for halving in range(6):
            tried = problem.add(state, 0.5**halving * step)
            after = problem.residual(tried, now, touched)
            if after.rest < 1.5 * residual.rest:
                break
        state, residual = tried, after
    raise RuntimeError(
        f"a step to an approach of {now.approach:g} mm and {np.degrees(now.twist):g}° did not "
        "converge: take smaller steps"
    )


def make_law(cell: float, friction: float, *bodies: Rubber) -> Law:
    """The law of contact of a mesh.

    Args:
        cell: side of the smallest element of the gel's top [mm].
        friction: μ [-].
        bodies: the rubber bodies, of which the softest counts.
    """
    modulus = min(body.shear_modulus for body in bodies)
    return Law(jnp.array(friction), jnp.array(modulus / cell))


def admit(
    law: Law, traction: Array, gap: Array, normal: Array, slip: Array, off_axis: Array
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """The projection of a node's traction [MPa], and whether the node sticks.

    Args:
        law: the law of contact.
        traction: t on the gel [MPa].
        gap: distance from the object, outside positive [mm].
        normal: unit normal out of the object.
        slip: motion of the gel's point relative to the object since the last step [mm].
        off_axis: whether the node is off the axis; on the axis there is no shear.
    """
    pressure = jnp.maximum(normal @ traction - law.stiffness * gap, 0.0)
    tried = traction - law.stiffness * slip
    tried = tried - normal * (normal @ tried)
    square, limit = tried @ tried, law.friction * pressure
    slides = square >= limit**2
    size = jnp.sqrt(jnp.where(slides & (square > 0.0), square, 1.0))
    shear = off_axis * tried * jnp.where(slides, limit / size, 1.0)
    return pressure * normal + shear, ~slides


def in_frame(r: Array, moved: Array, approach: Array, twist: Array) -> Array:
    """Positions of the points of a round top in the object's frame [mm].

    Args:
        r: radius of the undeformed points [mm].
        moved: their displacement [mm].
        approach: δ of the object [mm].
        twist: θ of the object [rad].
    """
    return into_frame(moved.at[..., 0].add(r), approach, twist)


def into_frame(place: Array, approach: Array, twist: Array) -> Array:
    """Positions in the object's frame from present positions x, y, z [mm].

    Args:
        place: present positions, in the last axis [mm].
        approach: δ of the object [mm].
        twist: θ of the object [rad].
    """
    c, s = jnp.cos(twist), jnp.sin(twist)
    x, y, z = jnp.moveaxis(place, -1, 0)
    return jnp.stack([c * x + s * y, c * y - s * x, z + approach], axis=-1)


def from_axis(at: Float[Array, "3"]) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Distance of a position from the axis, and the direction outward; on it both are 0.

    Neither has a slope on the axis.

    Args:
        at: position in the object's frame [mm].
    """
    square = at[0] ** 2 + at[1] ** 2
    off = square > 1e-24
    around = jnp.sqrt(jnp.where(off, square, 1.0)) * off
    return around, jnp.where(off, at[:2] / jnp.where(off, around, 1.0), 0.0)


def differentiate(
    row: Callable[..., Array], fixed: Any, unknown: tuple
) -> tuple[Float[Array, "nodes rows"], Float[Array, "nodes rows unknowns"]]:
    """Values of a function of one node, for all nodes, and their derivatives.

    Args:
        row: the function of what is fixed and of the unknowns; its value is a vector.
        fixed: its first argument, by node.
        unknown: its second argument, by node.
    """
    values, slopes = (jax.vmap(each)(fixed, unknown) for each in (row, jax.jacfwd(row, 1)))
    flat = [slope.reshape(*values.shape, -1) for slope in slopes]
    return values, jnp.concatenate(flat, axis=-1)


def turn_back(vectors: np.ndarray, twist: float) -> np.ndarray:
    """Rotate vectors from the object's frame to the frame of the undeformed point.

    Args:
        vectors: the vectors, in the last axis.
        twist: θ of the object [rad].
    """
    c, s = np.cos(twist), np.sin(twist)
    return vectors @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def strain(
    elements: Elements, moved: np.ndarray, rubber: Array
) -> tuple[Float[np.ndarray, "nodes 3"], Float[np.ndarray, "elements 12 12"]]:
    """Forces that strain needs at each node [N], and the stiffness of each element [N/mm].

    Args:
        elements: mesh of the body.
        moved: displacement of its nodes [mm].
        rubber: G [MPa], K [MPa] and m [-].
    """
    parts = elements.value, elements.slope, elements.volume
    inner, stiff = forces_and_stiffness(jnp.asarray(moved[elements.nodes]), parts, rubber)
    total = np.zeros_like(moved)
    np.add.at(total, elements.nodes, np.asarray(inner).reshape(-1, 4, 3))
    return total, np.asarray(stiff)


def top_of(elements: Elements, moved: np.ndarray) -> tuple[Array, Array]:
    """Undeformed radius of the nodes of a mesh's top, and their displacement [mm].

    Args:
        elements: mesh of the gel.
        moved: displacement of all its nodes [mm].
    """
    return jnp.asarray(elements.place[elements.top, 0]), jnp.asarray(moved[elements.top])


def components(nodes: np.ndarray) -> np.ndarray:
    """Indices of the three displacement components of nodes, along the last axis.

    Args:
        nodes: indices of the nodes, in any shape; a last axis of nodes is flattened.
    """
    return 3 * nodes[..., None] + np.arange(3)


def measure_rest(
    lack: Sequence[np.ndarray], traction_lack: np.ndarray, pushed: np.ndarray
) -> float:
    """Residual relative to the contact forces; infinite if it is not finite [-].

    Args:
        lack: residual forces of the bodies [N].
        traction_lack: residual tractions times the nodes' areas [N].
        pushed: contact forces [N].
    """
    rest = np.linalg.norm([np.linalg.norm(part) for part in (*lack, traction_lack)])
    return float(rest / max(float(np.abs(pushed).sum()), 1e-3)) if np.isfinite(rest) else np.inf


class Touching(NamedTuple):
    """What the object does to the gel.

    Attributes:
        force: P, normal force [N].
        moment: M about the axis, on the gel [N·mm].
        contact: mask of the nodes in contact.
    """

    force: float
    moment: float
    contact: Bool[np.ndarray, " top"]


def sum_tractions(
    traction: Float[np.ndarray, "top 3"],
    twist: float,
    place: Float[np.ndarray, "2 top"],
    area: Float[np.ndarray, " top"],
) -> Touching:
    """Force, moment and contact of the object on a gel.

    Args:
        traction: traction at the top's nodes, in the object's frame [MPa].
        twist: θ of the object [rad].
        place: x and y of these nodes now [mm].
        area: their areas [mm²].
    """
    force, (x, y) = turn_back(traction, twist) * area[:, None], place
    pressed = np.linalg.norm(traction, axis=1)
    return Touching(
        force=-force[:, 2].sum(),
        moment=np.sum(x * force[:, 1] - y * force[:, 0]),
        contact=pressed > 1e-6 * pressed.max(),  # beyond rounding
    )


def solve_sparse(matrix: scipy.sparse.csc_matrix, right: np.ndarray) -> np.ndarray:
    """Solution of a sparse system; a `RuntimeError` if it is singular."""
    return splu(matrix).solve(right)


def assemble(
    blocks: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], size: int, free: np.ndarray
) -> scipy.sparse.csc_matrix:
    """Sparse matrix from dense blocks.

    Args:
        blocks: rows, columns and values of blocks, by block.
        size: number of all components.
        free: indices of the free components, which are kept.
    """
    rows = [np.repeat(row, column.shape[1], axis=1).ravel() for row, column, _ in blocks]
    columns = [np.tile(column, row.shape[1]).ravel() for row, column, _ in blocks]
    values = np.concatenate([value.ravel() for _, _, value in blocks])
    place = np.concatenate(rows), np.concatenate(columns)
    whole = scipy.sparse.csr_matrix((values, place), shape=(size, size))
    return whole[free].tocsc()[:, free]
