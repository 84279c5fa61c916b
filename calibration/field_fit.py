"""Fit numbers of a contact to displacement fields and forces, with the contact model.

[Levenberg1944] K. Levenberg, "A method for the solution of certain non-linear problems in least
squares"; [Marquardt1963] D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear
parameters"; the loop is optimistix's.

The fit varies coordinates: the logarithm of a number whose bounds are above 0, otherwise the number
itself. A sigmoid keeps them between the bounds. Residuals are in standard deviations.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float
from scipy.stats import chi2

from calibration.field_parts import find_kinds, find_parts
from calibration.field_result import FRICTION, LEAST_P, LEAST_SLIP, FieldData, FieldFit
from calibration.forward import FieldModel, Prediction, Unknown
from calibration.information import correlate, invert_information, is_determined
from estimation.estimators.measurement import Z95

_AT_BOUND = 0.02  # a number is at a bound within this share of the range and one standard error
_SETTLED = 0.1  # largest norm of the last step's change of the residuals, in standard deviations
_START_SHARE = 0.8  # share of the range between the bounds from which random starts are drawn


def fit_fields(
    model: FieldModel,
    numbers: Mapping[str, Any],
    data: FieldData,
    *,
    starts: int = 1,
    seed: int = 0,
    max_steps: int = 60,
    said: Callable[[str], None] = lambda _: None,
) -> FieldFit:
    """Fit the unknown numbers of a scene, those which are `Unknown`, to fields and forces.

    The first start is given, the others are drawn between the bounds. `said` is called with a
    message about the end of each.

    Raises:
        ValueError: no number is unknown, there are fewer data than unknown numbers, or the data do
            not match the model.
        RuntimeError: the contact could not be solved from any start.
    """
    problem = Problem.make(model, numbers, data)
    rng = np.random.default_rng(seed)
    ends: list[tuple[float, _End]] = []
    for i in range(starts):
        end = _minimise(problem, problem.start if i == 0 else problem.draw(rng), max_steps)
        loss = float(jnp.sum(end.residual**2))
        said(f"start {i + 1} of {starts}: χ² {loss:.5g} after {int(end.steps)} steps")
        if np.isfinite(loss):
            ends.append((loss, end))
    if not ends:
        raise RuntimeError(
            "the contact could not be solved from any start: check that the grid covers the whole "
            "contact, and that the approach is large enough to touch"
        )
    least, best = min(ends, key=lambda end: end[0])
    close = sum(loss <= 1.001 * least + 1e-3 for loss, _ in ends) / starts
    return _describe(problem, numbers, best, close)


class _End(NamedTuple):
    coordinates: Array
    outputs: Array
    residual: Array
    jacobian: Array
    steps: Array
    converged: Array


class Problem(eqx.Module):
    """Scene, data and coordinates, ready for the solver.

    Attributes:
        model: scene, grid and markers.
        known: known numbers.
        data: all measurements in one vector.
        weights: inverse standard deviations of the data, 0 for missing values.
        low: lower bounds of the coordinates.
        high: upper bounds of the coordinates.
        start: first guess of the coordinates.
        priors: mean and inverse standard deviation of each coordinate's prior, 0 without one.
        layout: name, shape and whether it is a logarithm, of each unknown.
    """

    model: FieldModel
    known: dict[str, Any]
    data: Array
    weights: Array
    low: Array
    high: Array
    start: Array
    priors: Array
    layout: tuple[tuple[str, tuple[int, ...], bool], ...] = eqx.field(static=True)

    @classmethod
    def make(cls, model: FieldModel, numbers: Mapping[str, Any], data: FieldData) -> "Problem":
        """Check the numbers and the data, and scale the data by their standard deviations.

        Raises:
            ValueError: no number is unknown, there are fewer data than unknown numbers, or the
                data do not match the model.
        """
        unknown = {name: value for name, value in numbers.items() if isinstance(value, Unknown)}
        if not unknown:
            raise ValueError("nothing is unknown: give at least one number as `Unknown`")
        layout, low, high, start, priors = [], [], [], [], []
        for name, number in unknown.items():
            shape, size = np.shape(number.start), int(np.size(number.start))
            layout.append((name, shape, number.logarithmic))
            turn = np.log if number.logarithmic else np.asarray
            low += [turn(number.low)] * size
            high += [turn(number.high)] * size
            start += list(np.ravel(turn(number.start)))
            mean, sharpness = 0.0, 0.0
            if number.prior is not None:
                mean = turn(number.prior[0])
                sharpness = (number.prior[0] if number.logarithmic else 1.0) / number.prior[1]
            priors += [(mean, sharpness)] * size
        measured, weights = _whiten(model, data)
        count = int(np.count_nonzero(weights))
        if count + np.count_nonzero([s for _, s in priors]) < len(start):
            raise ValueError(
                f"{count} measured values cannot determine {len(start)} unknown numbers: measure "
                "more, or give fewer numbers as unknown"
            )
        return cls(
            model=model,
            known={n: jnp.asarray(v, float) for n, v in numbers.items() if n not in unknown},
            data=measured,
            weights=weights,
            low=jnp.asarray(low),
            high=jnp.asarray(high),
            start=jnp.asarray(start),
            priors=jnp.asarray(priors),
            layout=tuple(layout),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates, such as `twist[1]`."""
        names: list[str] = []
        for name, shape, _ in self.layout:
            places = list(np.ndindex(*shape))
            names += [name + (f"[{','.join(map(str, i))}]" if shape else "") for i in places]
        return tuple(names)

    @property
    def logarithmic(self) -> Bool[np.ndarray, " p"]:
        """Which coordinates are logarithms."""
        return np.concatenate([[log] * int(np.prod(shape)) for _, shape, log in self.layout])

    def numbers(self, coordinates: Array) -> dict[str, Any]:
        """All numbers of the scene by name, for given coordinates."""
        numbers, place = dict(self.known), 0
        for name, shape, logarithmic in self.layout:
            size = int(np.prod(shape))
            part = coordinates[place : place + size].reshape(shape)
            numbers[name] = jnp.exp(part) if logarithmic else part
            place += size
        return numbers

    def to_values(self, coordinates: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """Convert coordinates to numbers; infinite if they overflow."""
        with np.errstate(over="ignore"):
            return np.where(self.logarithmic, np.exp(coordinates), coordinates)

    def outputs(self, coordinates: Array) -> Array:
        """All predicted measurements in one vector; NaN if the contact could not be solved."""
        seen = self.model.predict(self.numbers(coordinates))
        values = jnp.concatenate([jnp.ravel(value) for value in seen[:4]])
        return jnp.where(seen.failed, jnp.nan, values)

    def residual(self, outputs: Array, coordinates: Array) -> Array:
        """Residuals, predicted minus measured, then those of priors, in standard deviations."""
        mean, sharpness = self.priors.T
        return jnp.concatenate(
            [self.weights * (outputs - self.data), sharpness * (coordinates - mean)]
        )

    def split(self, outputs: np.ndarray) -> Prediction:
        """Split a vector of predicted measurements into its parts."""
        frames, n = self.model.frames, len(self.model.along_x)
        sizes = np.cumsum([3 * frames * n, 3 * frames, frames])
        fields, force, moment, width = np.split(outputs, sizes)
        return Prediction(
            fields.reshape(frames, n, 3),
            force.reshape(frames, 3),
            moment,
            width[0],
            np.asarray(False),
        )

    def is_seen(self, outputs: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " p"]:
        """Which coordinates the grid resolves: μ only if the slipping ring is wide enough."""
        friction = np.array([name == FRICTION for name in self.names])
        return ~friction | (self.split(outputs).slip_width >= LEAST_SLIP)

    def draw(self, rng: np.random.Generator) -> Array:
        """Draw coordinates between the bounds."""
        margin = 0.5 * (1.0 - _START_SHARE)
        share = rng.uniform(margin, 1.0 - margin, len(self.start))
        return self.low + share * (self.high - self.low)


def _whiten(model: FieldModel, data: FieldData) -> tuple[Array, Array]:
    """Measured values and their inverse standard deviations, 0 for missing values."""
    wanted = (model.frames, len(model.along_x), 3)
    if np.shape(data.displacement) != wanted:
        raise ValueError(
            f"the displacements have the shape {np.shape(data.displacement)}; the model's frames "
            f"and markers require the shape {wanted}"
        )
    errors = np.array([*data.displacement_error, data.force_error, data.moment_error])
    if not (errors > 0.0).all():
        raise ValueError(f"standard deviations must be above 0, got {errors.tolist()}")
    force = np.full((model.frames, 3), np.nan) if data.force is None else data.force
    moment = np.full(model.frames, np.nan) if data.moment is None else data.moment
    parts = (data.displacement, force, moment, np.full(1, np.nan))  # slip is never measured
    measured = np.concatenate([np.ravel(part) for part in parts])
    scales = (np.asarray(data.displacement_error), data.force_error, data.moment_error, 1.0)
    pairs = zip(parts, scales, strict=True)
    scale = np.concatenate([np.ravel(np.broadcast_to(s, np.shape(v))) for v, s in pairs])
    return jnp.asarray(np.nan_to_num(measured)), jnp.asarray(np.isfinite(measured) / scale)


def value_and_jacobian(
    function: Callable[[Array], Array], at: Float[Array, " p"]
) -> tuple[Float[Array, " m"], Float[Array, "m p"]]:
    """Value and Jacobian of a function: one solve, then one tangent after the other.

    Tangents in one batch would all wait for the slowest: on 64² cells five take 5.6 instead of 2.5
    solves.
    """
    value, push = jax.linearize(function, at)
    return value, jax.lax.map(push, jnp.eye(len(at))).T


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


def _describe(problem: Problem, numbers: Mapping[str, Any], end: _End, agreeing: float) -> FieldFit:
    """The result of a fit: intervals, determined numbers, and the quality of the fit."""
    residual, jacobian, c = (
        np.asarray(part) for part in (end.residual, end.jacobian, end.coordinates)
    )
    low, high, weights = (np.asarray(a) for a in (problem.low, problem.high, problem.weights))
    freedom = max(int(np.count_nonzero(weights)) - len(c), 1)
    misfits, p_value = _test(problem, residual, freedom)
    trusted = p_value >= LEAST_P
    covariance, error = invert_information(jacobian.T @ jacobian)
    slack = np.minimum(c - low, high - c)
    at_bound = slack < np.minimum(_AT_BOUND * (high - low), np.maximum(error, 1e-6))
    determined = is_determined(error, high - low) & ~at_bound
    determined &= problem.is_seen(np.asarray(end.outputs))
    ends = [problem.to_values(c + sign * Z95 * error) for sign in (-1.0, 1.0)]
    measured = problem.split(np.where(weights > 0, np.asarray(problem.data), np.nan))
    predicted = problem.split(np.asarray(end.outputs))
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
        residual=np.asarray(measured.displacement - predicted.displacement),
        predicted=predicted,
        best={name: np.asarray(numbers_at_end[name]) for name in numbers},
        converged=bool(end.converged),
        steps=int(end.steps),
        agreeing=agreeing,
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
    centre = problem.model.scene(problem.numbers(end.coordinates), problem.model.grid).path.centre[
        -1
    ]
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
