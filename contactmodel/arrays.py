"""The array types that functions of NumPy or JAX arrays take."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import jax
    import numpy as np

    AnyArray = jax.Array | np.ndarray
else:

    @runtime_checkable
    class AnyArray(Protocol):
        """An array of either kind, or a NumPy scalar; stated without importing JAX."""

        shape: tuple[int, ...]

        def __array_namespace__(self):
            """The functions that take such an array."""
