"""Torsion solves per second, many at once (`vmap`) and one after the other.

`python -m tests.benchmarks.batch [CASES [CELLS]]`: spheres pressed to a contact radius of 0.3 of
the side and turned from rest to c/a from 0.9 to 0.5, in double and single precision, each with the
error of its moment against Lubkin's. Runs on whatever JAX runs on, a GPU where there is one.
"""

import sys
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from contactmodel import Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact
from contactmodel.analytic import lubkin_moment, lubkin_twist

SIDE, RADIUS, CURVATURE, FRICTION = 10.0, 3.0, 30.0, 0.5
LAPS = 5


def main() -> None:
    """Print the table."""
    jax.config.update("jax_enable_x64", True)
    given = [int(word) for word in sys.argv[1:]]
    cases, cells = given + [64, 64][len(given) :]
    console = Console()
    device = jax.devices()[0]
    none = "" if device.platform == "gpu" else "; no GPU here, its figures are not measured"
    console.print(f"{cases} torsion solves of {cells}² on {device.device_kind}{none}")
    table = Table("precision", "at once [1/s]", "in turn [1/s]", "over", "largest error of M")
    for dtype, rtol in ((jnp.float64, 1e-8), (jnp.float32, 1e-5)):
        table.add_row(jnp.dtype(dtype).name, *measure(cases, cells, dtype, rtol))
    console.print(table)


def measure(cases: int, cells: int, dtype: jnp.dtype, rtol: float) -> list[str]:
    """The cells of a row."""
    grid = Grid((cells, cells), (SIDE, SIDE))
    ratio = FRICTION * 2.0 / np.pi * RADIUS / CURVATURE * 2.0  # μp0/2G, p0 = (2/π) E* a/R, E* = 4G
    friction = jnp.asarray(FRICTION, dtype)
    stick = np.linspace(0.9, 0.5, cases)
    twists = jnp.asarray([float(lubkin_twist(c, ratio)) for c in stick], dtype)

    def moment(twist: Array) -> Array:
        zero = jnp.zeros(2, dtype)
        pose = Pose(jnp.asarray(RADIUS**2 / CURVATURE, dtype), zero, twist, zero, linear=True)
        body, ball = HalfSpace(1.0, 0.5), Paraboloid(CURVATURE)
        return solve_contact(
            body, Rigid(), ball, pose, grid, friction, rtol=rtol, throw=False
        ).moment

    one, many = jax.jit(moment), jax.jit(jax.vmap(moment))
    found = jax.block_until_ready(many(twists))
    jax.block_until_ready(one(twists[0]))
    at_once = _time(lambda: many(twists))
    in_turn = _time(lambda: [one(twist) for twist in twists])
    force = 4.0 / 3.0 * 4.0 * RADIUS**3 / CURVATURE
    exact = np.array([float(lubkin_moment(c, FRICTION, force, RADIUS)) for c in stick])
    error = float(np.max(np.abs(np.asarray(found, float) / exact - 1.0)))
    rates = [cases / at_once, cases / in_turn]
    return [*(f"{rate:.4g}" for rate in rates), f"{rates[0] / rates[1]:.2f}", f"{error:.1e}"]


def _time(run: Callable[[], Array | list[Array]]) -> float:
    """Seconds, the median of several laps."""
    laps = []
    for _ in range(LAPS):
        start = time.perf_counter()
        jax.block_until_ready(run())
        laps.append(time.perf_counter() - start)
    return float(np.median(laps))


if __name__ == "__main__":
    main()
