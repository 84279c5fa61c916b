"""Double precision for every test; the library itself never touches `jax.config`.

What tests and the processes that they start compile is not kept in the user's cache folder.
"""

import os

# before JAX is imported: most of the suite's time is compiling, and its grids are small
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"

import jax

jax.config.update("jax_enable_x64", True)
