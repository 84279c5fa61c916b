"""Functions of NumPy or JAX arrays: types, and which of the two computes. JAX is not imported."""

import sys
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
        """An array of either kind, or a NumPy scalar."""

        shape: tuple[int, ...]

        def __array_namespace__(self):
            """The functions that take such an array."""

    Value = AnyArray | bool | int | float | complex


def as_arrays(*values: Value) -> tuple[Any, ...]:
    """`jax.numpy` where one of the values is a JAX array, else `numpy`; then the values in it."""
    spaces = {
        value.__array_namespace__()
        for value in values
        if isinstance(value, AnyArray) and not isinstance(value, np.ndarray | np.generic)
    }
    xp = spaces.pop() if spaces else np
    return xp, *(xp.asarray(value) for value in values)


def is_traced(value: object) -> bool:
    """Whether a value is not known yet: inside `jit`, `vmap` or a derivative."""
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(value, jax.core.Tracer)


def refuse(array: Any, wrong: AnyArray, message: str) -> Any:
    """The array, or the error with what was got.

    Outside `jit` the error is a ValueError. Inside it is a RuntimeError when the program runs, with
    the words in front under `equinox.filter_jit`, and wrapped in JAX's own under `jax.jit`.
    """
    if is_traced(wrong):
        import equinox as eqx

        return eqx.error_if(array, wrong, message)
    if bool(np.any(wrong)):
        raise ValueError(f"{message}, got {array}")
    return array
