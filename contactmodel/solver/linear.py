"""Linear systems on part of the grid.

The loops are our own. They count the applications of the operator, which measure the cost of every
solver here; JAX's solvers do not report them. lineax's CG takes as many steps, but in single
precision its guard against breakdown stops it after one step from 256² cells on. Its GMRES and
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
    """Iterations of a solver and its final residual."""

    steps: Int[Array, ""]  # number of iterations
    # number of applications of the compliance, or of its approximate inverse, which takes as long
    applications: Int[Array, ""]
    residual: Float[Array, ""]  # relative residual at the end [-]; the solver defines its norm

    def after(self, before: "Iterations") -> "Iterations":
        """Sum of these and earlier iterations, with the residual of these."""
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
        rhs: right-hand side; if 0, so is the solution.
        preconditioner: applies an approximate inverse, symmetric as well.
        rtol: tolerance of the defect's norm over that of the right-hand side [-].
        max_steps: largest number of iterations.

    Returns:
        The solution and the number of iterations; each applies operator and preconditioner once.
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


class _History(NamedTuple):
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
        rhs: right-hand side; if 0, so is the solution.
        preconditioner: applies an approximate inverse.
        rtol: tolerance of the defect's norm over that of the right-hand side [-].
        max_steps: largest number of iterations.
        kept: number of earlier directions to which a new one is made conjugate.

    Returns:
        The solution and the number of iterations; each applies operator and preconditioner once.
    """
    limit = rtol**2 * jnp.sum(rhs**2)

    def go_on(done: _History) -> Array:
        return (jnp.sum(done.defect**2) > limit) & (done.steps < max_steps)

    def part(done: _History) -> Callable:
        """Remove the component along an earlier direction from a new one."""

        def take_out(i: Array, pair: tuple[Array, Array]) -> tuple[Array, Array]:
            share = jnp.sum(done.images[i] * pair[1])
            return pair[0] - share * done.directions[i], pair[1] - share * done.images[i]

        return take_out

    def step(done: _History) -> _History:
        direction = preconditioner(done.defect)
        image = operator(direction)
        count = jnp.minimum(done.steps, kept)
        direction, image = jax.lax.fori_loop(0, count, part(done), (direction, image))
        unit = 1.0 / jnp.sqrt(jnp.sum(image**2))
        direction, image = unit * direction, unit * image
        length = jnp.sum(done.defect * image)
        place = done.steps % kept
        return _History(
            solution=done.solution + length * direction,
            defect=done.defect - length * image,
            directions=done.directions.at[place].set(direction),
            images=done.images.at[place].set(image),
            steps=done.steps + 1,
        )

    empty = jnp.zeros((kept, *rhs.shape), rhs.dtype)
    start = _History(jnp.zeros_like(rhs), rhs, empty, empty, jnp.zeros((), jnp.int32))
    end = jax.lax.while_loop(go_on, step, start)
    return end.solution, end.steps
