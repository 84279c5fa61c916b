"""Tests, and the options with which they and the site's tutorials compile and compute."""

import gc
import os
import subprocess
import sys

COMPILE_FAST = (
    "--xla_backend_optimization_level=1",
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_cpu_parallel_codegen_split_count=1",
    "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling=true,"
    "xla_cpu_disable_slp_vectorizer=true,xla_cpu_optimize_for_size=true,-disable-lsr",
)
"""Options of XLA and LLVM for small grids: most of the suite's time and memory is compiling.

At level 0 coupled contacts do not settle, though each part of the solver meets its own tests."""


def compile_fast() -> None:
    """Set options of XLA and NumPy, before they read them and for other processes to inherit.

    An option of XLA that the installed jaxlib does not know ends the process: another one tries
    them. Garbage is collected seldom, since tracing makes many objects that stay. Matrices are too
    small to share among NumPy's threads, which wait for work on the core of another worker.
    """
    gc.set_threshold(50_000)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if "XLA_FLAGS" in os.environ:
        return
    chosen = {**os.environ, "XLA_FLAGS": " ".join(COMPILE_FAST)}
    probe = (sys.executable, "-c", "import jax; jax.devices()")
    known = subprocess.run(probe, env=chosen, capture_output=True, check=False).returncode == 0
    os.environ["XLA_FLAGS"] = chosen["XLA_FLAGS"] if known else COMPILE_FAST[0]
