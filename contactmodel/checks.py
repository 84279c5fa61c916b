"""Converters of fields: numbers become arrays, wrong values are refused (inside `jit`, too)."""

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float


def number(value: ArrayLike) -> Float[Array, "*shape"]:
    """An array of floating-point numbers that are not NaN."""
    array = jnp.asarray(value, dtype=_precision(value))
    return eqx.error_if(array, jnp.isnan(array), "a value is NaN; give a number")


def positive(value: ArrayLike) -> Float[Array, "*shape"]:
    """Numbers above 0."""
    array = number(value)
    return eqx.error_if(array, ~(array > 0), "a modulus, radius or length must be above 0")


def non_negative(value: ArrayLike) -> Float[Array, "*shape"]:
    """Numbers from 0."""
    array = number(value)
    return eqx.error_if(
        array, ~(array >= 0), "a friction coefficient or edge radius must not be below 0"
    )


def poisson(value: ArrayLike) -> Float[Array, ""]:
    """A Poisson's ratio from 0 to 0.5."""
    array = number(value)
    wrong = ~((array >= 0) & (array <= 0.5))
    return eqx.error_if(array, wrong, "Poisson's ratio must lie from 0 to 0.5")


def _precision(value: ArrayLike) -> jnp.dtype:
    """The value's own floating-point type, else JAX's default."""
    dtype = getattr(value, "dtype", None)
    if dtype is not None and jnp.issubdtype(dtype, jnp.floating):
        return dtype
    return jnp.zeros(()).dtype
