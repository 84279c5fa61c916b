"""Double precision for every test; the library itself never touches `jax.config`."""

import jax

jax.config.update("jax_enable_x64", True)
