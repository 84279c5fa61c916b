"""What an experiment, planned or recorded, can tell: before fitting, or before measuring.

The Fisher information of fields and forces about the unknown numbers of a scene gives the interval
to expect, the combinations that nothing measured depends on, and what another measurement would
add. The bounds of a number count as what is known of it without any measurement, a uniform
distribution.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from calibration.field_fit import Problem, value_and_jacobian
from calibration.field_result import FieldData
from calibration.forward import FieldModel, Unknown
from calibration.information import LARGEST_ERROR, Z95, correlate, is_determined

REFERENCE_ERROR = 0.01
"""Of a reference for one number that would be measured beside: relative, or in its unit."""

_NAMED = 0.1  # share of the largest from which a number is named in a combination
_DESIGN_STEP = 0.05  # relative


class Help(NamedTuple):
    """What another measurement, or another experiment, would do for one number.

    Attributes:
        what: the measurement or the change.
        error: standard error by that without it [-]; for a change, after one of 10 %.
    """

    what: str
    error: float


@dataclass(frozen=True)
class Identifiability:
    """What can be told of each unknown number.

    Attributes:
        names: of the numbers.
        values: where the experiment was looked at.
        errors: standard errors to expect, relative where the logarithm is sought.
        low: lower ends of the 95 % intervals to expect.
        high: upper ends.
        determined: whether a fit would report a number.
        correlation: of the numbers.
        unseen: combinations that hardly change what is measured, in words.
        shares: by measurement, its share of what is known of each number [-].
        helps: by number, what would help, the best first.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    errors: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    determined: Bool[np.ndarray, " p"]
    correlation: Float[np.ndarray, "p p"]
    unseen: tuple[str, ...]
    shares: Mapping[str, Float[np.ndarray, " p"]]
    helps: Mapping[str, Sequence[Help]]


def identify(
    model: FieldModel,
    numbers: Mapping[str, Any],
    data: FieldData,
    design: Sequence[str] = (),
) -> Identifiability:
    """Tell which of the unknown numbers an experiment determines.

    Args:
        model: scene, grid and markers.
        numbers: by name; of an `Unknown` its start is where the experiment is looked at.
        data: what is measured, and its errors; of the values only whether they are there counts.
        design: names of numbers that the experimenter can change, such as `approach`: what 10 %
            more of them would do.

    Raises:
        ValueError: nothing unknown, or data that do not fit.
        RuntimeError: the contact cannot be solved there.
    """
    problem = Problem.make(model, numbers, data)
    outputs, information = _by_measurement(problem, data)
    measured = _measured(data)
    told = _add_up(information, measured)
    total = told + _beforehand(problem)
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
        unseen=_unseen(problem, told),
        shares={
            name: np.diag(covariance @ information[name] @ covariance) / errors**2
            for name in measured
        },
        helps=_helps(problem, information, total, errors, redesigned),
    )


_MEASUREMENTS = (
    "displacement in the plane",
    "displacement along z",
    "shear force",
    "normal force",
    "moment",
)


def _measured(data: FieldData) -> list[str]:
    """Which measurements there are."""
    force = np.full((1, 3), np.nan) if data.force is None else data.force
    moment = np.full(1, np.nan) if data.moment is None else data.moment
    fields = data.displacement
    parts = (fields[..., :2], fields[..., 2], force[:, :2], force[:, 2], moment)
    there = [bool(np.isfinite(part).any()) for part in parts]
    return [name for name, one in zip(_MEASUREMENTS, there, strict=True) if one]


def _add_up(
    information: Mapping[str, Float[np.ndarray, "p p"]], which: Sequence[str]
) -> Float[np.ndarray, "p p"]:
    """Information of the measurements that there are."""
    return np.sum([information[name] for name in which], axis=0)


@eqx.filter_jit
def _linearise(problem: Problem) -> tuple[Array, Array]:
    return value_and_jacobian(problem.outputs, problem.start)


def _by_measurement(
    problem: Problem, data: FieldData
) -> tuple[Float[np.ndarray, " m"], dict[str, Float[np.ndarray, "p p"]]]:
    """What is seen, and the Fisher information of each kind of measurement, made or not."""
    outputs, jacobian = (np.asarray(part) for part in _linearise(problem))
    if not np.isfinite(outputs).all():
        raise RuntimeError(
            "the contact cannot be solved there: does the grid hold the whole contact, and is the "
            "approach large enough to touch?"
        )
    frames = problem.model.frames
    fields, forces, moment, _ = (
        part.reshape(*shape, jacobian.shape[1])
        for part, shape in zip(
            np.split(jacobian, np.cumsum([data.displacement.size, 3 * frames, frames])),
            ((-1, 3), (frames, 3), (frames,), (1,)),
            strict=True,
        )
    )
    seen = np.asarray(problem.weights)[: data.displacement.size].reshape(-1, 3, 1) > 0
    fields = fields * seen / np.asarray(data.displacement_error)[:, None]
    forces, moment = forces / data.force_error, moment / data.moment_error
    parts = (fields[:, :2], fields[:, 2], forces[:, :2], forces[:, 2], moment)
    flat = [part.reshape(-1, jacobian.shape[1]) for part in parts]
    return outputs, {name: j.T @ j for name, j in zip(_MEASUREMENTS, flat, strict=True)}


def _beforehand(problem: Problem) -> Float[np.ndarray, "p p"]:
    """Information of the bounds and the priors."""
    span = np.asarray(problem.high - problem.low)
    return np.diag(12.0 / span**2 + np.asarray(problem.priors)[:, 1] ** 2)


def _unseen(problem: Problem, information: Float[np.ndarray, "p p"]) -> tuple[str, ...]:
    """Directions in which a change of `LARGEST_ERROR` is within one standard error, in words."""
    values, vectors = np.linalg.eigh(information)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value * LARGEST_ERROR**2 > 1.0:
            continue
        largest = np.argmax(np.abs(vector))
        share = vector / vector[largest]
        order = np.argsort(-np.abs(share), kind="stable").tolist()
        named = [i for i in order if abs(share[i]) >= _NAMED]
        found.append(" with ".join(_change(problem, i, float(0.1 * share[i])) for i in named))
    return tuple(found)


def _change(problem: Problem, i: int, change: float) -> str:
    """A small change of one number."""
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
    """What each further measurement, reference or change would leave of the errors."""
    added = {f"{name} (once more)": value for name, value in information.items()}
    for i, name in enumerate(problem.names):
        one = np.zeros_like(total)
        one[i, i] = REFERENCE_ERROR**-2
        known = "to 1 %" if problem.logarithmic[i] else f"to {REFERENCE_ERROR:g}"
        added[f"{name} from elsewhere, {known}"] = one
    left = {
        what: np.sqrt(np.diag(np.linalg.inv(total + more))) / errors for what, more in added.items()
    }
    left |= {f"10 % more {name}": error / errors for name, error in redesigned.items()}
    return {
        name: sorted((Help(what, float(ratio[i])) for what, ratio in left.items()), key=_by_error)
        for i, name in enumerate(problem.names)
    }


def _by_error(one: Help) -> float:
    return one.error


def _redesign(
    problem: Problem, numbers: Mapping[str, Any], data: FieldData, design: Sequence[str]
) -> dict[str, Float[np.ndarray, " p"]]:
    """Errors after 10 % more of each of the design's numbers, by their slope."""
    found = {}
    for name in design:
        if name not in numbers:
            raise ValueError(f"unknown number {name!r} to change; choose from {', '.join(numbers)}")
        slopes = [
            np.log(_errors_of(problem.model, _scaled(numbers, name, 1.0 + step), data))
            for step in (-_DESIGN_STEP, _DESIGN_STEP)
        ]
        found[name] = np.exp(0.5 * sum(slopes) + 0.1 * (slopes[1] - slopes[0]) / (2 * _DESIGN_STEP))
    return found


def _errors_of(
    model: FieldModel, numbers: Mapping[str, Any], data: FieldData
) -> Float[np.ndarray, " p"]:
    problem = Problem.make(model, numbers, data)
    _, information = _by_measurement(problem, data)
    total = _add_up(information, _measured(data)) + _beforehand(problem)
    return np.sqrt(np.diag(np.linalg.inv(total)))


def _scaled(numbers: Mapping[str, Any], name: str, by: float) -> dict[str, Any]:
    """The numbers with one of them changed."""
    one = numbers[name]
    changed = (
        replace(one, start=np.asarray(one.start) * by)
        if isinstance(one, Unknown)
        else jnp.asarray(one) * by
    )
    return {**numbers, name: changed}
