"""Types and helpers for functions that take NumPy or JAX arrays. JAX is not imported."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, get_args, get_type_hints, runtime_checkable

import numpy as np
from jaxtyping import AbstractArray

if TYPE_CHECKING:
    import jax
    from jax.typing import ArrayLike

    AnyArray = jax.Array | np.ndarray
    Value = ArrayLike
else:

    @runtime_checkable
    class AnyArray(Protocol):
        """A NumPy array, a JAX array or a NumPy scalar."""

        shape: tuple[int, ...]

        def __array_namespace__(self):
            """The module whose functions take this array."""

    Value = AnyArray | bool | int | float | complex


def as_arrays(*values: Value) -> tuple[Any, ...]:
    """The values as arrays, after their module: `jax.numpy` if one is a JAX array, else `numpy`."""
    spaces = {
        value.__array_namespace__()
        for value in values
        if isinstance(value, AnyArray) and not isinstance(value, np.ndarray | np.generic)
    }
    xp = spaces.pop() if spaces else np
    return xp, *(xp.asarray(value) for value in values)


@cache
def declared_arrays(owner: type) -> dict[str, type[AbstractArray]]:
    """The array fields of a dataclass by name, each with its type and shape by jaxtyping."""
    return {
        name: kind
        for name, hint in get_type_hints(owner).items()
        for kind in get_args(hint) or (hint,)
        if isinstance(kind, type) and issubclass(kind, AbstractArray)
    }


def fill_masked(values: Any) -> np.ndarray:
    """A copy of numbers as floats, with NaN where they are masked."""
    return np.ma.filled(np.ma.array(values, dtype=float, copy=True), np.nan)


def make_arrays(owner: Any) -> None:
    """Replace lists and other sequences in the array fields of a frozen dataclass by NumPy arrays.

    Truth values may be whole numbers 0 and 1. Masked numbers become NaN.

    Raises:
        ValueError: a field holds something else, or rows of unequal length.
    """
    for name, kind in declared_arrays(type(owner)).items():
        values, marks = getattr(owner, name), "bool" in kind.dtypes
        if np.ma.is_masked(values) and not marks:
            values = fill_masked(values)
        elif values is None or (isinstance(values, np.ndarray) and not marks):
            continue
        try:
            array = np.asarray(values)
            if marks and array.dtype.kind in "iuf" and np.isin(array, (0, 1)).all():
                array = array.astype(bool)
            elif not marks and array.dtype.kind not in "iu":
                array = array.astype(float)
        except (TypeError, ValueError):
            array = None
        if array is None or (marks and array.dtype != bool):
            what = "true or false" if marks else "a number"
            axes = " and ".join(kind.dim_str.split())
            raise ValueError(
                f"`{name}` must be {what} for each of ({axes}): give an array, or lists of equal "
                "lengths"
            )
        object.__setattr__(owner, name, array)


def root(square: AnyArray) -> Any:
    """√ of a positive value, 0 otherwise; its derivative is 0 where it is 0."""
    xp = square.__array_namespace__()
    above = square > 0.0
    return xp.where(above, xp.sqrt(xp.where(above, square, 1.0)), 0.0)


def is_traced(value: object) -> bool:
    """Whether a value is a tracer, as inside `jit`, `vmap` or a derivative."""
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(value, jax.core.Tracer)


_wrong_is_nan = ContextVar("_wrong_is_nan", default=False)


@contextmanager
def wrong_is_nan() -> Iterator[None]:
    """Let `refuse` replace wrong traced arrays by NaN instead of raising an error.

    A program that can raise an error calls the host, and JAX's compilation cache does not keep it.
    """
    token = _wrong_is_nan.set(True)
    try:
        yield
    finally:
        _wrong_is_nan.reset(token)


def refuse(array: Any, wrong: AnyArray, message: str) -> Any:
    """The array, or an error if any of it is wrong; the message is the violated requirement.

    Outside `jit` the error is a ValueError with the array. Inside `jit` it is a RuntimeError when
    the program runs: it starts with the message under `equinox.filter_jit`, and is wrapped in an
    error of JAX under `jax.jit`. See also `wrong_is_nan`.
    """
    if is_traced(wrong) and _wrong_is_nan.get():
        xp = array.__array_namespace__()
        return xp.where(xp.any(wrong), xp.nan, array)
    if is_traced(wrong):
        import equinox as eqx

        return eqx.error_if(array, wrong, message)
    if bool(np.any(wrong)):
        raise ValueError(f"{message}, got {array}")
    return array
