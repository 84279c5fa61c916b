"""Scene, data and coordinates of a field fit, as residuals for a solver, and parts of the data.

The fit varies coordinates: the logarithm of a number whose bounds are above 0, otherwise the number
itself. Residuals are in standard deviations.
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from calibration.field_result import FRICTION, LEAST_SLIP, FieldData
from calibration.forward import FieldModel, Prediction, Unknown
from contactmodel.common.arrays import wrong_is_nan

Parts = dict[str, Bool[np.ndarray, " m"]]

_START_SHARE = 0.8  # share of the range between the bounds from which random starts are drawn
_RINGS = ("inner", "middle", "outer")


class Problem(eqx.Module):
    """Scene, data and coordinates, ready for the solver."""

    model: FieldModel  # scene, grid and markers
    known: dict[str, Any]  # known numbers
    data: Array  # all measurements in one vector
    weights: Array  # inverse standard deviations of the data, 0 for missing values
    blocks: Array  # matrices that the residual displacements of each marker are multiplied by
    scale: Array  # factors on the other residuals
    low: Array  # lower bounds of the coordinates
    high: Array  # upper bounds of the coordinates
    start: Array  # first guess of the coordinates
    priors: Array  # mean and inverse standard deviation of each coordinate's prior, 0 without one
    # name, shape and whether it is a logarithm, of each unknown
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
            blocks=jnp.tile(jnp.eye(3), (model.frames, len(model.markers), 1, 1)),
            scale=jnp.ones(4 * model.frames + 3),
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
        """All predicted measurements in one vector.

        They are NaN if the contact could not be solved, or if a number is not valid.
        """
        with wrong_is_nan():
            seen = self.model.predict(self.numbers(coordinates))
        values = jnp.concatenate([jnp.ravel(value) for value in seen[:-1]])
        return jnp.where(seen.failed, jnp.nan, values)

    def check_scene(self, coordinates: Array) -> None:
        """Raise a ValueError if a number of the scene is not valid."""
        self.model.scene(self.numbers(coordinates), self.model.grid)

    def residual(self, outputs: Array, coordinates: Array) -> Array:
        """Residuals, predicted minus measured, then those of priors, in standard deviations."""
        mean, sharpness = self.priors.T
        every = self.weights * (outputs - self.data)
        fields = every[: -len(self.scale)].reshape(*self.blocks.shape[:3], 1)
        return jnp.concatenate(
            [
                jnp.ravel(self.blocks @ fields),
                self.scale * every[-len(self.scale) :],
                sharpness * (coordinates - mean),
            ]
        )

    def split(self, outputs: np.ndarray) -> Prediction:
        """Split a vector of predicted measurements into its parts."""
        frames, n = self.model.frames, len(self.model.markers)
        sizes = np.cumsum([3 * frames * n, 3 * frames, frames])
        fields, force, moment, (width, radius, covered) = np.split(outputs, sizes)
        return Prediction(
            fields.reshape(frames, n, 3),
            force.reshape(frames, 3),
            moment,
            *(width, radius, covered),
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
    wanted = (model.frames, len(model.markers), 3)
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
    parts = (data.displacement, force, moment, np.full(3, np.nan))  # the rest is never measured
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


def find_kinds(model: FieldModel) -> Parts:
    """Kinds of measurement, as masks of the vector of all outputs."""
    kind, _, _ = _index(model)
    names = ("in the plane", "along z", "force", "moment")
    return {name: kind == i for i, name in enumerate(names)}


def find_parts(model: FieldModel, centre: Float[np.ndarray, "2"]) -> Parts:
    """Parts that can be left out: kinds of measurement, thirds of the markers, frames.

    Args:
        model: scene, grid and markers.
        centre: centre of the three rings of markers, each with a third of the markers [mm].

    Returns:
        Masks of the vector of all outputs, by name.
    """
    _, frame, marker = _index(model)
    kinds = find_kinds(model)
    parts = {f"displacements {name}": kinds[name] for name in ("in the plane", "along z")}
    parts["forces"] = kinds["force"] | kinds["moment"]
    distance = np.linalg.norm(model.markers - centre, axis=1)
    ring = np.searchsorted(np.quantile(distance, [1 / 3, 2 / 3]), distance)
    for i, name in enumerate(_RINGS):
        parts[f"{name} third of the markers"] = (marker >= 0) & (ring[marker] == i)
    if model.frames > 1:
        names = [f"frame {i + 1} of {model.frames}" for i in range(model.frames)]
        parts |= {name: frame == i for i, name in enumerate(names)}
    return parts


def _index(model: FieldModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kind, frame and marker of each output in the order of `Prediction`; −1 if it has none."""
    frames, n = model.frames, len(model.markers)
    frame, marker, axis = np.indices((frames, n, 3)).reshape(3, -1)
    none, each = np.full(3, -1), np.arange(frames)
    return (
        np.concatenate([axis // 2, np.full(3 * frames, 2), np.full(frames, 3), none]),
        np.concatenate([frame, np.repeat(each, 3), each, none]),
        np.concatenate([marker, np.full(4 * frames + 3, -1)]),
    )
