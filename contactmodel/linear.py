"""Symmetric linear systems on part of the grid, and derivatives by the implicit function theorem.

The conjugate gradients are our own: they count the applications of the operator, on which the cost
of every solver here is measured and which JAX's do not tell. lineax's take as many steps, but their
guard against breakdown ends them after one in single precision from 256² cells on.
`jax.lax.custom_linear_solve` makes the derivatives.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

Operator = Callable[[Array], Array]


class Iterations(NamedTuple):
    """What a solver did.

    Attributes:
        steps: iterations.
        applications: of the compliance.
        residual: at the end, relative; its norm is named by the solver.
    """

    steps: Int[Array, ""]
    applications: Int[Array, ""]
    residual: Float[Array, ""]


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
    rtol: float,
    max_steps: int,
) -> tuple[Float[Array, "*shape"], Int[Array, ""]]:
    """Solve a symmetric positive definite system by preconditioned conjugate gradients.

    Args:
        operator: applies the matrix.
        rhs: right-hand side; 0 is answered by 0.
        preconditioner: applies roughly the inverse, symmetric as well.
        rtol: of the defect's norm by that of the right-hand side [-].
        max_steps: iterations at most.

    Returns:
        The solution and the number of applications of the operator.
    """
    limit = rtol**2 * jnp.sum(rhs**2)

    def go_on(state: _State) -> Array:
        return (jnp.sum(state.defect**2) > limit) & (state.steps < max_steps)

    def step(state: _State) -> _State:
        image = operator(state.direction)
        length = state.descent / jnp.sum(state.direction * image)
        defect = state.defect - length * image
        improved = preconditioner(defect)
        descent = jnp.sum(defect * improved)
        return _State(
            solution=state.solution + length * state.direction,
            defect=defect,
            direction=improved + descent / state.descent * state.direction,
            descent=descent,
            steps=state.steps + 1,
        )

    first = preconditioner(rhs)
    start = _State(jnp.zeros_like(rhs), rhs, first, jnp.sum(rhs * first), jnp.zeros((), jnp.int32))
    end = jax.lax.while_loop(go_on, step, start)
    return end.solution, end.steps


def minimal_residual(
    operator: Operator, rhs: Float[Array, "*shape"], *, rtol: float, max_steps: int
) -> Float[Array, "*shape"]:
    """Solve a system near the identity, going along the defect as far as it shrinks.

    Args:
        operator: applies the matrix, its symmetric part positive definite.
        rhs: right-hand side; 0 is answered by 0.
        rtol: of the defect's norm by that of the right-hand side [-].
        max_steps: iterations at most.
    """
    limit = rtol**2 * jnp.sum(rhs**2)

    def go_on(state: tuple[Array, Array, Array]) -> Array:
        _, defect, steps = state
        return (jnp.sum(defect**2) > limit) & (steps < max_steps)

    def step(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        solution, defect, steps = state
        image = operator(defect)
        length = jnp.sum(image * defect) / jnp.sum(image**2)
        return solution + length * defect, defect - length * image, steps + 1

    start = (jnp.zeros_like(rhs), rhs, jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(go_on, step, start)[0]


def attach_derivative(
    solution: Array,
    residual: Operator,
    tangent: Operator,
    preconditioner: Operator,
    *,
    rtol: float,
    max_steps: int,
) -> Array:
    """The solution, with the derivative that residual(solution; parameters) = 0 gives it.

    First derivatives, forward and reverse; the parameters are whatever `residual` closes over.

    Args:
        solution: where the residual vanishes.
        residual: vanishes at the solution, for all parameters.
        tangent: its derivative with respect to the solution, symmetric positive definite.
        preconditioner: applies roughly the inverse of the tangent.
        rtol: tolerance of the linear solve [-].
        max_steps: iterations of the linear solve at most.
    """

    def solve(operator: Operator, rhs: Array) -> Array:
        return conjugate_gradients(operator, rhs, preconditioner, rtol=rtol, max_steps=max_steps)[0]

    solution = jax.lax.stop_gradient(solution)
    defect = residual(solution)
    change = jax.lax.stop_gradient(defect) - defect  # 0, but its derivative is not
    return solution + jax.lax.custom_linear_solve(tangent, change, solve, symmetric=True)
