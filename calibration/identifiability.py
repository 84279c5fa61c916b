"""Predict which numbers an experiment determines, before fitting or before measuring.

The Fisher information of fields and forces about the unknown numbers of a scene gives the expected
intervals, the combinations of numbers that no measurement shows, and the gain from another
measurement. The bounds of a number count as prior knowledge, a uniform distribution.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from calibration.field_problem import Problem, value_and_jacobian
from calibration.field_result import FieldData
from calibration.forward import FieldModel, Unknown
from calibration.information import LARGEST_ERROR, correlate, is_determined
from estimation.estimators.measurement import Z95

REFERENCE_ERROR = 0.01
"""Standard error of an additional reference measurement of a number, relative or in its unit."""

_NAMED = 0.1  # smallest share of the largest component that is named in a combination
_DESIGN_STEP = 0.05  # relative


class Help(NamedTuple):
    """Gain for one number from another measurement or a changed experiment."""

    what: str  # the measurement or the change
    error: float  # standard error with it over that without it [-]; a change is by 10 %


@dataclass(frozen=True)
class Identifiability:
    """Expected accuracy of each unknown number."""

    names: tuple[str, ...]  # names of the unknown numbers
    values: Float[np.ndarray, " p"]  # assumed values of the numbers
    # expected standard errors, relative if the fit varies the logarithm
    errors: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]  # lower ends of the expected 95 % intervals
    high: Float[np.ndarray, " p"]  # upper ends of the expected 95 % intervals
    determined: Bool[np.ndarray, " p"]  # whether a fit would report a number
    correlation: Float[np.ndarray, "p p"]  # correlation of the numbers' errors
    unseen: tuple[str, ...]  # combined changes that hardly change the measurements, in words
    # share of each measurement in the information about each number, by measurement [-]
    shares: Mapping[str, Float[np.ndarray, " p"]]
    # measurements and changes that would help, by number, the best first
    helps: Mapping[str, Sequence[Help]]
    covered: bool  # whether the corrections for finite strain, if any, cover the contact


def identify(
    model: FieldModel,
    numbers: Mapping[str, Any],
    data: FieldData,
    design: Sequence[str] = (),
) -> Identifiability:
    """Predict which unknown numbers an experiment determines.

    Args:
        model: scene, grid and markers.
        numbers: values by name; the start of an `Unknown` is its assumed value.
        data: errors of the measurements; of their values, only whether they are missing counts.
        design: names of numbers that the experimenter can change, such as `approach`; the gain
            from 10 % more of each is predicted.

    Raises:
        ValueError: no number is unknown, the data do not match the model, or a number is not
            valid.
        RuntimeError: the contact cannot be solved at the assumed values.
    """
    problem = Problem.make(model, numbers, data)
    outputs, information = _by_measurement(problem, data)
    measured = _measured(data)
    from_data = _add_up(information, measured)
    total = from_data + _prior_information(problem)
    covariance = np.linalg.inv(total)
    errors = np.sqrt(np.diag(covariance))
    start = np.asarray(problem.start)
    span = np.asarray(problem.high - problem.low)
    ends = [problem.to_values(start + sign * Z95 * errors) for sign in (-1.0, 1.0)]
    redesigned = _redesign(problem, numbers, data, design)
    return Identifiability(
        names=problem.names,
        values=problem.to_values(start),
        errors=errors,
        low=ends[0],
        high=ends[1],
        determined=is_determined(errors, span) & problem.is_seen(outputs),
        correlation=correlate(covariance),
        unseen=_unseen(problem, from_data),
        shares={
            name: np.diag(covariance @ information[name] @ covariance) / errors**2
            for name in measured
        },
        helps=_helps(problem, information, total, errors, redesigned),
        covered=bool(problem.split(outputs).covered),
    )


_MEASUREMENTS = (
    "displacement in the plane",
    "displacement along z",
    "shear force",
    "normal force",
    "moment",
)


def _measured(data: FieldData) -> list[str]:
    """Names of the measurements that the data contain."""
    force = np.full((1, 3), np.nan) if data.force is None else data.force
    moment = np.full(1, np.nan) if data.moment is None else data.moment
    fields = data.displacement
    parts = (fields[..., :2], fields[..., 2], force[:, :2], force[:, 2], moment)
    present = [bool(np.isfinite(part).any()) for part in parts]
    return [name for name, is_in in zip(_MEASUREMENTS, present, strict=True) if is_in]


def _add_up(
    information: Mapping[str, Float[np.ndarray, "p p"]], which: Sequence[str]
) -> Float[np.ndarray, "p p"]:
    """Sum of the information of some measurements."""
    return np.sum([information[name] for name in which], axis=0)


@eqx.filter_jit
def _linearise(problem: Problem) -> tuple[Array, Array]:
    return value_and_jacobian(problem.outputs, problem.start)


def _by_measurement(
    problem: Problem, data: FieldData
) -> tuple[Float[np.ndarray, " m"], dict[str, Float[np.ndarray, "p p"]]]:
    """Predicted values, and the Fisher information of each kind of measurement, made or not."""
    outputs, jacobian = (np.asarray(part) for part in _linearise(problem))
    if not np.isfinite(outputs).all():
        problem.check_scene(problem.start)
        raise RuntimeError(
            "the contact cannot be solved at the assumed values: check that the grid covers the "
            "whole contact, and that the approach is large enough to touch"
        )
    frames = problem.model.frames
    fields, forces, moment, _ = (
        part.reshape(*shape, jacobian.shape[1])
        for part, shape in zip(
            np.split(jacobian, np.cumsum([data.displacement.size, 3 * frames, frames])),
            ((-1, 3), (frames, 3), (frames,), (3,)),
            strict=True,
        )
    )
    seen = np.asarray(problem.weights)[: data.displacement.size].reshape(-1, 3, 1) > 0
    fields = fields * seen / np.asarray(data.displacement_error)[:, None]
    forces, moment = forces / data.force_error, moment / data.moment_error
    parts = (fields[:, :2], fields[:, 2], forces[:, :2], forces[:, 2], moment)
    flat = [part.reshape(-1, jacobian.shape[1]) for part in parts]
    return outputs, {name: j.T @ j for name, j in zip(_MEASUREMENTS, flat, strict=True)}


def _prior_information(problem: Problem) -> Float[np.ndarray, "p p"]:
    """Information of the bounds and the priors."""
    span = np.asarray(problem.high - problem.low)
    return np.diag(12.0 / span**2 + np.asarray(problem.priors)[:, 1] ** 2)


def _unseen(problem: Problem, information: Float[np.ndarray, "p p"]) -> tuple[str, ...]:
    """Directions in which a change of `LARGEST_ERROR` is within one standard error, in words."""
    values, vectors = np.linalg.eigh(information)
    combinations = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value * LARGEST_ERROR**2 > 1.0:
            continue
        largest = np.argmax(np.abs(vector))
        share = vector / vector[largest]
        order = np.argsort(-np.abs(share), kind="stable").tolist()
        named = [i for i in order if abs(share[i]) >= _NAMED]
        changes = (_change(problem, i, float(0.1 * share[i])) for i in named)
        combinations.append(" with ".join(changes))
    return tuple(combinations)


def _change(problem: Problem, i: int, change: float) -> str:
    """Text of a small change of one number."""
    if problem.logarithmic[i]:
        return f"{problem.names[i]} {100 * change:+.1f} %"
    return f"{problem.names[i]} {change:+.3g}"


def _helps(
    problem: Problem,
    information: Mapping[str, Float[np.ndarray, "p p"]],
    total: Float[np.ndarray, "p p"],
    errors: Float[np.ndarray, " p"],
    redesigned: Mapping[str, Float[np.ndarray, " p"]],
) -> dict[str, list[Help]]:
    """Remaining share of each error after a further measurement, reference or change."""
    added = {f"{name} (once more)": value for name, value in information.items()}
    for i, name in enumerate(problem.names):
        reference = np.zeros_like(total)
        reference[i, i] = REFERENCE_ERROR**-2
        accuracy = "to 1 %" if problem.logarithmic[i] else f"to {REFERENCE_ERROR:g}"
        added[f"{name} from elsewhere, {accuracy}"] = reference
    ratios = {
        what: np.sqrt(np.diag(np.linalg.inv(total + more))) / errors for what, more in added.items()
    }
    ratios |= {f"10 % more {name}": error / errors for name, error in redesigned.items()}
    return {
        name: sorted((Help(w, float(r[i])) for w, r in ratios.items()), key=attrgetter("error"))
        for i, name in enumerate(problem.names)
    }


def _redesign(
    problem: Problem, numbers: Mapping[str, Any], data: FieldData, design: Sequence[str]
) -> dict[str, Float[np.ndarray, " p"]]:
    """Errors after an increase of each design number by 10 %, from their slope."""
    errors = {}
    for name in design:
        if name not in numbers:
            raise ValueError(f"design: unknown number {name!r}; choose from {', '.join(numbers)}")
        slopes = [
            np.log(_errors_of(problem.model, _scaled(numbers, name, 1.0 + step), data))
            for step in (-_DESIGN_STEP, _DESIGN_STEP)
        ]
        slope = (slopes[1] - slopes[0]) / (2 * _DESIGN_STEP)
        errors[name] = np.exp(0.5 * sum(slopes) + 0.1 * slope)
    return errors


def _errors_of(
    model: FieldModel, numbers: Mapping[str, Any], data: FieldData
) -> Float[np.ndarray, " p"]:
    problem = Problem.make(model, numbers, data)
    _, information = _by_measurement(problem, data)
    total = _add_up(information, _measured(data)) + _prior_information(problem)
    return np.sqrt(np.diag(np.linalg.inv(total)))


def _scaled(numbers: Mapping[str, Any], name: str, by: float) -> dict[str, Any]:
    """The numbers with one of them multiplied by a factor."""
    number = numbers[name]
    changed = (
        replace(number, start=np.asarray(number.start) * by)
        if isinstance(number, Unknown)
        else jnp.asarray(number) * by
    )
    return {**numbers, name: changed}
