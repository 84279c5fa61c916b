"""Linear systems on part of the grid.

The loops are our own: they count the applications of the operator, on which the cost
of every solver here is measured and which JAX's do not report. lineax's CG takes as many steps, but
its guard against breakdown ends it after one in single precision from 256² cells on. Its GMRES and
BiCGStab apply the operator up to four times as often as `conjugate_residuals`, and double the time
of a coupled path (`tests.benchmarks.krylov`).

[Eisenstat1983] S. C. Eisenstat, H. C. Elman, M. H. Schultz, "Variational iterative methods for
nonsymmetric systems of linear equations".
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

Operator = Callable[[Array], Array]


class Iterations(NamedTuple):
    """What a solver did.

    Attributes:
        steps: iterations.
        applications: of the compliance or, as long, of its rough inverse.
        residual: at the end, relative; its norm is named by the solver.
    """

    steps: Int[Array, ""]
    applications: Int[Array, ""]
    residual: Float[Array, ""]

    def after(self, before: "Iterations") -> "Iterations":
        """These and those before; the residual is that of these."""
        applications = before.applications + self.applications
        return Iterations(before.steps + self.steps, applications, self.residual)


class _State(NamedTuple):
    solution: Array
    defect: Array
    direction: Array
    descent: Array
    steps: Int[Array, ""]


def conjugate_gradients(
    operator: Operator,
    rhs: Float[Array, "*shape"],
    preconditioner: Operator,
    *,
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> tuple[Float[Array, "*shape"], Int[Array, ""]]:
    """Solve a symmetric positive definite system by preconditioned conjugate gradients.

    Args:
        operator: applies the matrix.
        rhs: right-hand side; 0 is answered by 0.
        preconditioner: applies roughly the inverse, symmetric as well.
        rtol: of the defect's norm by that of the right-hand side [-].
        max_steps: iterations at most.

    Returns:
        The solution and the number of iterations, each with one application of both.
    """
    limit = rtol**2 * jnp.sum(rhs**2)

    def go_on(state: _State) -> Array:
        return (jnp.sum(state.defect**2) > limit) & (state.steps < max_steps)

    def step(state: _State) -> _State:
        improved = preconditioner(state.defect)
        descent = jnp.sum(state.defect * improved)
        direction = improved + descent / state.descent * state.direction
        image = operator(direction)
        length = descent / jnp.sum(direction * image)
        return _State(
            solution=state.solution + length * direction,
            defect=state.defect - length * image,
            direction=direction,
            descent=descent,
            steps=state.steps + 1,
        )

    zero, inf = jnp.zeros_like(rhs), jnp.full((), jnp.inf, rhs.dtype)
    start = _State(zero, rhs, zero, inf, jnp.zeros((), jnp.int32))
    end = jax.lax.while_loop(go_on, step, start)
    return end.solution, end.steps


class _Kept(NamedTuple):
    solution: Array
    defect: Array
    directions: Array
    images: Array
    steps: Int[Array, ""]


def conjugate_residuals(
    operator: Operator,
    rhs: Float[Array, "*shape"],
    preconditioner: Operator,
    *,
    rtol: ArrayLike,
    max_steps: ArrayLike,
    kept: int = 16,
) -> tuple[Float[Array, "*shape"], Int[Array, ""]]:
    """Solve a system that need not be symmetric by conjugate residuals ([Eisenstat1983], Orthomin).

    Args:
        operator: applies the matrix.
        rhs: right-hand side; 0 is answered by 0.
        preconditioner: applies roughly the inverse.
        rtol: of the defect's norm by that of the right-hand side [-].
        max_steps: iterations at most.
        kept: directions that a new one is made conjugate to.

    Returns:
        The solution and the number of iterations, each with one application of both.
    """
    limit = rtol**2 * jnp.sum(rhs**2)

    def go_on(done: _Kept) -> Array:
        return (jnp.sum(done.defect**2) > limit) & (done.steps < max_steps)

    def part(done: _Kept) -> Callable:
        """Takes a kept direction's share out of a new one."""

        def take_out(i: Array, pair: tuple[Array, Array]) -> tuple[Array, Array]:
            share = jnp.sum(done.images[i] * pair[1])
            return pair[0] - share * done.directions[i], pair[1] - share * done.images[i]

        return take_out

    def step(done: _Kept) -> _Kept:
        direction = preconditioner(done.defect)
        image = operator(direction)
        count = jnp.minimum(done.steps, kept)
        direction, image = jax.lax.fori_loop(0, count, part(done), (direction, image))
        unit = 1.0 / jnp.sqrt(jnp.sum(image**2))
        direction, image = unit * direction, unit * image
        length = jnp.sum(done.defect * image)
        place = done.steps % kept
        return _Kept(
            solution=done.solution + length * direction,
            defect=done.defect - length * image,
            directions=done.directions.at[place].set(direction),
            images=done.images.at[place].set(image),
            steps=done.steps + 1,
        )

    none = jnp.zeros((kept, *rhs.shape), rhs.dtype)
    start = _Kept(jnp.zeros_like(rhs), rhs, none, none, jnp.zeros((), jnp.int32))
    end = jax.lax.while_loop(go_on, step, start)
    return end.solution, end.steps
