"""Fit numbers of a contact to displacement fields and forces, with the contact model.

[Levenberg1944] K. Levenberg, "A method for the solution of certain non-linear problems in least
squares"; [Marquardt1963] D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear
parameters"; the loop is optimistix's.

A sigmoid keeps the coordinates between their bounds.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from scipy.stats import chi2

from calibration.discrepancy import (
    Whitening,
    estimate_size,
    make_modes,
    share_of,
    whiten_modes,
    widen,
)
from calibration.field_problem import Problem, find_kinds, find_parts, value_and_jacobian
from calibration.field_result import LEAST_P, FieldData, FieldFit
from calibration.forward import FieldModel
from calibration.information import correlate, invert_information, is_determined
from estimation.estimators.measurement import Z95

_AT_BOUND = 0.02  # a number is at a bound within this share of the range and one standard error
_SETTLED = 0.1  # largest norm of the last step's change of the residuals, in standard deviations


def fit_fields(
    model: FieldModel,
    numbers: Mapping[str, Any],
    data: FieldData,
    *,
    discrepancy: bool = False,
    starts: int = 1,
    seed: int = 0,
    max_steps: int = 60,
    log: Callable[[str], None] = lambda _: None,
) -> FieldFit:
    """Fit the unknown numbers of a scene, those which are `Unknown`, to fields and forces.

    The first start is given, the others are drawn between the bounds. `log` is called with a
    message about the end of each. With `discrepancy`, intervals contain the error of the model at
    finite strain, whose size follows from the residuals (see `discrepancy`).

    Raises:
        ValueError: no number is unknown, there are fewer data than unknown numbers, the data do not
            match the model, or a number is not valid.
        RuntimeError: the contact could not be solved from any start.
    """
    problem = Problem.make(model, numbers, data)
    rng = np.random.default_rng(seed)
    ends: list[tuple[float, _End]] = []
    for i in range(starts):
        end = _minimise(problem, problem.start if i == 0 else problem.draw(rng), max_steps)
        loss = float(jnp.sum(end.residual**2))
        log(f"start {i + 1} of {starts}: χ² {loss:.5g} after {int(end.steps)} steps")
        if np.isfinite(loss):
            ends.append((loss, end))
    if not ends:
        problem.check_scene(problem.start)
        raise RuntimeError(
            "the contact could not be solved from any start: check that the grid covers the whole "
            "contact, and that the approach is large enough to touch"
        )
    least, best = min(ends, key=lambda end: end[0])
    close = sum(loss <= 1.001 * least + 1e-3 for loss, _ in ends) / starts
    modes = None
    if discrepancy:
        problem, best, modes = _allow_discrepancy(problem, best, max_steps)
    return _describe(problem, numbers, best, close, modes)


class _End(NamedTuple):
    coordinates: Array
    outputs: Array
    residual: Array
    jacobian: Array
    steps: Array
    converged: Array


@eqx.filter_jit
def _minimise(problem: Problem, start: Array, max_steps: int) -> _End:
    """Minimise by Levenberg and Marquardt's method, between the bounds."""
    span = problem.high - problem.low

    def coordinates(free: Array) -> Array:
        return problem.low + span * jax.nn.sigmoid(free)

    @jax.custom_jvp
    def outputs(coordinates: Array) -> Array:
        return problem.outputs(coordinates)

    @outputs.defjvp
    def _(primals, tangents):  # the Jacobian as a matrix: one per step, its transpose is free
        value, jacobian = value_and_jacobian(problem.outputs, *primals)
        return value, jacobian @ tangents[0]

    def residual(free: Array, _: None) -> tuple[Array, Array]:
        at = coordinates(free)
        predicted = outputs(at)
        return problem.residual(predicted, at), predicted

    share = (start - problem.low) / span
    end = optx.least_squares(
        residual,
        optx.LevenbergMarquardt(rtol=0.0, atol=_SETTLED, norm=optx.two_norm),
        jnp.log(share / (1.0 - share)),
        has_aux=True,
        max_steps=max_steps,
        throw=False,
    )
    within = jax.nn.sigmoid(end.value) * jax.nn.sigmoid(-end.value)
    return _End(
        coordinates(end.value),
        end.aux,
        end.state.f_info.residual,
        end.state.f_info.jac.as_matrix() / (span * jnp.maximum(within, 1e-12)),
        end.stats["num_steps"],
        end.result == optx.RESULTS.successful,
    )


def _allow_discrepancy(
    problem: Problem, end: _End, max_steps: int
) -> tuple[Problem, _End, Float[np.ndarray, "m k"] | None]:
    """Fit again with the model's error in the weights; None without an error beyond the noise."""
    model, whitening, used = problem.model, None, None
    centre = model.scene(problem.numbers(end.coordinates), model.grid).axis
    modes = make_modes(model, problem.split(np.asarray(end.outputs)), np.asarray(centre))
    modes = np.asarray(problem.weights)[:, None] * modes
    modes = np.pad(modes, [(0, len(problem.start)), (0, 0)])  # priors have none
    margin = 1e-6 * (problem.high - problem.low)
    for _ in range(2):
        size = estimate_size(np.asarray(end.residual), np.asarray(end.jacobian), modes, whitening)
        if size == 0.0:
            break
        used = size * modes
        whitening = whiten_modes(used[: len(problem.weights)], model.frames, len(model.markers))
        problem = eqx.tree_at(
            lambda p: (p.blocks, p.scale), problem, tuple(map(jnp.asarray, whitening))
        )
        start = jnp.clip(end.coordinates, problem.low + margin, problem.high - margin)
        end = _minimise(problem, start, max_steps)
    return problem, end, used


def _describe(
    problem: Problem,
    numbers: Mapping[str, Any],
    end: _End,
    agreeing: float,
    modes: Float[np.ndarray, "m k"] | None,
) -> FieldFit:
    """The result of a fit: intervals, determined numbers, and the quality of the fit."""
    residual, jacobian, c = (
        np.asarray(part) for part in (end.residual, end.jacobian, end.coordinates)
    )
    low, high, weights = (np.asarray(a) for a in (problem.low, problem.high, problem.weights))
    freedom = max(int(np.count_nonzero(weights)) - len(c), 1)
    misfits, p_value = _test(problem, residual, freedom)
    outputs = problem.split(np.asarray(end.outputs))
    trusted = p_value >= LEAST_P
    covariance, error = invert_information(jacobian.T @ jacobian)
    if modes is not None:
        whitening = Whitening(np.asarray(problem.blocks), np.asarray(problem.scale))
        covariance = widen(covariance, jacobian, modes, whitening)
        error = np.where(np.isfinite(error), np.sqrt(np.diag(covariance)), error)
    slack = np.minimum(c - low, high - c)
    at_bound = slack < np.minimum(_AT_BOUND * (high - low), np.maximum(error, 1e-6))
    determined = is_determined(error, high - low) & ~at_bound
    determined &= problem.is_seen(np.asarray(end.outputs))
    ends = [problem.to_values(c + sign * Z95 * error) for sign in (-1.0, 1.0)]
    measured = problem.split(np.where(weights > 0, np.asarray(problem.data), np.nan))
    numbers_at_end = problem.numbers(end.coordinates)
    return FieldFit(
        names=problem.names,
        values=np.where(determined, problem.to_values(c), np.nan),
        low=np.where(determined & trusted, ends[0], np.nan),
        high=np.where(determined & trusted, ends[1], np.nan),
        determined=determined,
        covariance=covariance,
        correlation=correlate(covariance),
        misfit=float(np.sum(residual[: len(weights)] ** 2)) / freedom,
        misfits=misfits,
        p_value=p_value,
        left_out=_leave_out(problem, end),
        residual=np.asarray(measured.displacement - outputs.displacement),
        predicted=outputs,
        best={name: np.asarray(numbers_at_end[name]) for name in numbers},
        converged=bool(end.converged),
        steps=int(end.steps),
        agreeing=agreeing,
        discrepancy=0.0
        if modes is None
        else share_of(modes, weights, np.asarray(outputs.displacement)),
    )


def _test(
    problem: Problem, residual: Float[np.ndarray, " m"], freedom: int
) -> tuple[dict[str, float], float]:
    """χ² per value of each kind of measurement, and the p-value of the test."""
    square, count = residual[: len(problem.weights)] ** 2, np.asarray(problem.weights) > 0
    kinds = {name: part & count for name, part in find_kinds(problem.model).items()}
    sizes = {name: int(part.sum()) for name, part in kinds.items() if part.any()}
    sums = {name: float(square[kinds[name]].sum()) for name in sizes}
    tails = [chi2.sf(sums[name], size) for name, size in sizes.items()]
    smallest = min(chi2.sf(float(square.sum()), freedom), *tails)
    misfits = {name: sums[name] / size for name, size in sizes.items()}
    return misfits, min(float(smallest) * (1 + len(tails)), 1.0)


def _leave_out(problem: Problem, end: _End) -> dict[str, Float[np.ndarray, " p"]]:
    """Estimates without each part of the data, to first order; NaN if undetermined."""
    residual, jacobian, c = (
        np.asarray(part) for part in (end.residual, end.jacobian, end.coordinates)
    )
    low, high, weights = (np.asarray(a) for a in (problem.low, problem.high, problem.weights))
    priors = np.ones(len(residual) - len(weights), dtype=bool)
    centre = problem.model.scene(problem.numbers(end.coordinates), problem.model.grid).axis
    estimates = {}
    for name, part in find_parts(problem.model, np.asarray(centre)).items():
        rest = np.concatenate([~part, priors])
        if not (part & (weights > 0)).any():
            continue
        covariance, error = invert_information(jacobian[rest].T @ jacobian[rest])
        moved = np.clip(c - covariance @ (jacobian[rest].T @ residual[rest]), low, high)
        determined = is_determined(error, high - low)
        estimates[name] = np.where(determined, problem.to_values(moved), np.nan)
    return estimates
