"""Types and helpers for functions that take NumPy or JAX arrays. JAX is not imported."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

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
