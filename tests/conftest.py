"""Double precision for every test; the library itself never touches `jax.config`."""

import os

# before JAX is imported: most of the suite's time is compiling, and its grids are small
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

import jax

jax.config.update("jax_enable_x64", True)
