"""The pressure of a contact without friction, at a given approach.

[Polonsky1999] I. A. Polonsky, L. M. Keer, "A numerical method for solving rough contact problems
based on the multi-level multi-summation and conjugate gradient techniques".
[Vollebregt2014] E. A. H. Vollebregt, "A new solver for the elastic normal contact problem using
conjugate gradients, deflation, and an FFT-based preconditioner" (BCCG).

The solver minimises ½ p·Cp + p·g₀ over pressures p ≥ 0 [MPa], where g₀ is the gap at p = 0 [mm],
below 0 where the undeformed bodies overlap. The loop is our own:
minimisers of JAX libraries take neither bounds nor the preconditioner that keeps the number of
iterations small. On 64² cells optimistix's L-BFGS on p = q² stops after 519 steps at a residual of
0.5, this solver after 13 steps at 2e-9 (`tests/benchmarks/loops.py`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from contactmodel.elasticity.compliance import Compliance
from contactmodel.grid import Grid
from contactmodel.solver.linear import Iterations

_LARGE = 128  # cells along a side from which a coarse first solve saves time; measured
_RATIO = 4
_ROUGH = 1e-3  # tolerance of the coarse solve; a smaller one saves no iterations
_STEPS = 50


class _State(NamedTuple):
    pressure: Float[Array, "nx ny"]
    gap: Float[Array, "nx ny"]
    direction: Float[Array, "nx ny"]
    defect: Float[Array, "nx ny"]
    descent: Float[Array, ""]
    steps: Int[Array, ""]
    clipped: Int[Array, ""]  # number of steps that led to negative pressure


def solve_pressure(
    compliance: Compliance,
    gap: Float[Array, "nx ny"],
    *,
    start: Float[Array, "nx ny"],
    rtol: ArrayLike,
    max_steps: ArrayLike,
) -> tuple[Float[Array, "nx ny"], Iterations]:
    """Solve for the pressure p ≥ 0 with gap ≥ 0, and gap = 0 where p > 0, by conjugate gradients.

    The set of cells in contact is updated in every iteration. Derivatives stop here; see
    `derivative`.

    Args:
        compliance: compliance of the pair.
        gap: gap at p = 0, below 0 where the undeformed bodies overlap [mm].
        start: initial pressure [MPa].
        rtol: tolerance of the residual, `pressure_residual` [-].
        max_steps: largest number of iterations.

    Returns:
        Pressure [MPa] and the solver's iterations.
    """
    compliance, gap, start = jax.lax.stop_gradient((compliance, gap, start))
    inverse = compliance.inverse()

    def violation(state: _State) -> Array:
        return gap_residual(state.pressure, state.gap, gap)

    def go_on(state: _State) -> Array:
        return (violation(state) > rtol) & (state.steps < max_steps)

    start = jnp.maximum(start, 0.0)
    state = _State(
        pressure=start,
        gap=compliance.press(start) + gap,
        direction=jnp.zeros_like(gap),
        defect=jnp.zeros_like(gap),
        descent=jnp.ones((), gap.dtype),
        steps=jnp.zeros((), jnp.int32),
        clipped=jnp.zeros((), jnp.int32),
    )
    end = jax.lax.while_loop(go_on, lambda now: _step(compliance, inverse, gap, now), state)
    applications = 2 * end.steps + end.clipped + 1
    return end.pressure, Iterations(end.steps, applications, violation(end))


def _step(compliance: Compliance, inverse: Compliance, gap: Array, state: _State) -> _State:
    """One conjugate gradient step on the cells in contact."""
    contact: Bool[Array, "nx ny"] = (state.pressure > 0.0) | (state.gap < 0.0)
    defect = jnp.where(contact, -state.gap, 0.0)
    improved = jnp.where(contact, inverse.press(defect), 0.0)
    # Polak and Ribière: after a large change of the set, the old direction is dropped
    turn = jnp.sum(improved * (defect - state.defect)) / state.descent
    direction = improved + jnp.maximum(turn, 0.0) * jnp.where(contact, state.direction, 0.0)
    image = compliance.press(direction)
    length = jnp.sum(defect * direction) / jnp.sum(direction * image)
    moved = state.pressure + length * direction
    pressure = jnp.maximum(moved, 0.0)
    pulls = jnp.any(moved < 0.0)
    return _State(
        pressure=pressure,
        gap=jax.lax.cond(
            pulls,
            lambda: compliance.press(pressure) + gap,
            lambda: state.gap + length * image,
        ),
        direction=direction,
        defect=defect,
        descent=jnp.sum(defect * improved),
        steps=state.steps + 1,
        clipped=state.clipped + pulls,
    )


def is_large(grid: Grid) -> bool:
    """Whether `guess_pressure` saves time and is possible: numbers of cells are multiples of 4."""
    return min(grid.shape) >= _LARGE and not any(n % _RATIO for n in grid.shape)


def guess_pressure(
    compliance: Compliance, gap: Float[Array, "nx ny"]
) -> tuple[Float[Array, "nx ny"], Iterations]:
    """Initial pressure for a large grid, solved on cells four times as long.

    Most iterations search for the edge of the contact; on the coarse grid they are cheap.

    Returns:
        Pressure [MPa] and the solver's iterations on the coarse grid.
    """
    nx, ny = gap.shape
    blocks = gap.reshape(nx // _RATIO, _RATIO, ny // _RATIO, _RATIO)
    gap = jnp.mean(blocks, axis=(1, 3))
    pressure, done = solve_pressure(
        compliance.coarsen(_RATIO), gap, start=jnp.zeros_like(gap), rtol=_ROUGH, max_steps=_STEPS
    )
    return jnp.repeat(jnp.repeat(pressure, _RATIO, axis=0), _RATIO, axis=1), done


def pressure_residual(
    compliance: Compliance, gap: Float[Array, "nx ny"], pressure: Float[Array, "nx ny"]
) -> Float[Array, ""]:
    """Residual of a pressure [-].

    It is the root mean square, over the cells in contact, of the gap there and of the overlap
    elsewhere, divided by the largest overlap at p = 0.
    """
    return gap_residual(pressure, compliance.press(pressure) + gap, gap)


def gap_residual(
    pressure: Float[Array, "nx ny"],
    gap: Float[Array, "nx ny"],
    undeformed: Float[Array, "nx ny"],
) -> Float[Array, ""]:
    """Residual of a pressure [-] whose gap is known; see `pressure_residual`."""
    scale = jnp.maximum(jnp.max(-undeformed), jnp.finfo(gap.dtype).tiny)
    in_contact = pressure > 0.0
    wrong = jnp.where(in_contact, gap, jnp.minimum(gap, 0.0))
    count = jnp.maximum(jnp.sum(in_contact), 1)
    return jnp.sqrt(jnp.sum(wrong**2) / count) / scale
