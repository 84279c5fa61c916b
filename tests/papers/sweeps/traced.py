"""The squares once more, for JAX: one compiled program for each number of cells."""

import equinox as eqx
import jax.numpy as jnp

from papers.sweeps import Study
from tests.papers.sweeps.squares import cases


def evaluate(x, cells):
    assert isinstance(cells, int)  # a plain number, to make shapes of
    x = eqx.error_if(x, x == 13.0, "13 has no square")
    return {"square": x**2, "sum": jnp.sum(jnp.full(cells, x)) * jnp.ones(2)}


STUDY = Study(cases, evaluate, static=("cells",), batch=7)
