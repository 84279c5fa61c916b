"""Converters of fields: numbers become JAX arrays, and wrong values are rejected."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import AnyArray, is_traced, refuse

Numbers = ArrayLike | Sequence[float]


def number(value: Numbers) -> Float[Array, "*shape"]:
    """Convert to a floating-point array; ValueError unless all values are finite numbers."""
    message = "a value must be a finite number"
    try:
        array = jnp.asarray(value)  # without a dtype, which would read text as a number
    except (TypeError, ValueError) as error:
        raise ValueError(f"{message}, got {value!r}") from error
    if array.dtype.kind in "bc":
        raise ValueError(f"{message}, got {value!r}")
    array = array.astype(_precision(value))
    return refuse(array, ~(abs(known(array)) < np.inf), message)


def positive(value: Numbers) -> Float[Array, "*shape"]:
    """Convert to an array; ValueError unless all values are above 0."""
    array = number(value)
    return refuse(array, ~(known(array) > 0), "a modulus, radius or length must be above 0")


def non_negative(value: Numbers) -> Float[Array, "*shape"]:
    """Convert to an array; ValueError unless all values are from 0."""
    array = number(value)
    return refuse(
        array,
        ~(known(array) >= 0),
        "a friction coefficient, edge radius or depth must not be below 0",
    )


def poisson(value: Numbers) -> Float[Array, "*shape"]:
    """Convert to an array; ValueError unless all values are from 0 to 0.5."""
    array = number(value)
    wrong = ~((known(array) >= 0) & (known(array) <= 0.5))
    return refuse(array, wrong, "Poisson's ratio must lie from 0 to 0.5")


def check_type(name: str, value: object, kind: type, example: str) -> None:
    """Reject a value of another class than a kind; the example shows how to make one."""
    if not isinstance(value, kind):
        raise ValueError(
            f"{name}: expected an object such as {example}, got one of type {type(value).__name__}"
        )


def _precision(value: Numbers) -> np.dtype:
    """The value's own floating-point type, else JAX's default."""
    dtype = getattr(value, "dtype", None)
    if dtype is not None and jnp.issubdtype(dtype, jnp.floating):
        return jax.dtypes.canonicalize_dtype(dtype)
    return jax.dtypes.canonicalize_dtype(np.float64)


def known(array: Array) -> AnyArray:
    """The array in NumPy unless it is traced, because a compiled check takes longer."""
    return array if is_traced(array) else np.asarray(array)
