"""The array types that functions of NumPy or JAX arrays take."""

from typing import TYPE_CHECKING

import jax
import numpy as np

if TYPE_CHECKING:
    AnyArray = jax.Array | np.ndarray
else:  # NumPy turns results without dimensions into scalars of its own
    AnyArray = jax.Array | np.ndarray | np.generic
