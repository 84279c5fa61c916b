"""The array types that functions of NumPy or JAX arrays take."""

import jax
import numpy as np

AnyArray = jax.Array | np.ndarray | np.generic
