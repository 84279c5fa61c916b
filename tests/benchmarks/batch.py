"""Torsion solves per second: all at once, eight at a time on every device, or one after the other.

"At once" is `vmap` over all solves: each continues until the last has converged, and on a processor
the fields exceed the cache. "Eight at a time" is `jax.lax.map` with that batch size under
`jax.shard_map`; every processor core is a device here (`jax_num_cpu_devices`).

`python -m tests.benchmarks.batch [CASES [CELLS]]`: spheres are pressed to a contact radius of 0.3
of the side and turned from rest to c/a from 0.9 to 0.5, in double and single precision. The last
column is the error of the moment compared with Lubkin's. Runs on JAX's default device: a GPU, if
present.
"""

import math
import os
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact
from contactmodel.analytic import lubkin_moment, lubkin_twist
from tests.benchmarks.arguments import make_parser

SIDE, RADIUS, CURVATURE, FRICTION = 10.0, 3.0, 30.0, 0.5
AT_A_TIME = 8
LAPS = 5


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("cases", nargs="?", type=int, default=64, help="number of solves")
    parser.add_argument("cells", nargs="?", type=int, default=64, help="cells along a side")
    given = parser.parse_args()
    cases, cells = given.cases, given.cells
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)
    console = Console()
    device = jax.devices()[0]
    console.print(f"{cases} torsion solves of {cells}² on {device.device_kind}")
    table = Table(
        "precision",
        "at once [1/s]",
        f"by {AT_A_TIME} [1/s]",
        "in turn [1/s]",
        "at once / in turn",
        f"by {AT_A_TIME} / in turn",
        "largest error of M",
    )
    for dtype, rtol in ((jnp.float64, 1e-8), (jnp.float32, 1e-5)):
        table.add_row(jnp.dtype(dtype).name, *measure(cases, cells, dtype, rtol))
    console.print(table)


def measure(cases: int, cells: int, dtype: jnp.dtype, rtol: float) -> list[str]:
    """The texts of a row of the table."""
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
            Contact(body, Rigid(), ball, grid, friction), pose, rtol=rtol, throw=False
        ).moment

    def some(twists: Array) -> Array:
        return jax.lax.map(moment, twists, batch_size=AT_A_TIME)

    devices = math.gcd(cases, jax.device_count())
    mesh, over = jax.make_mesh((devices,), ("devices",)), PartitionSpec("devices")
    dealt = twists.reshape(-1, devices).T.ravel()  # the harder ones to each in turn
    shared = jax.device_put(dealt, NamedSharding(mesh, over))
    by_device = jax.shard_map(some, mesh=mesh, in_specs=over, out_specs=over, check_vma=False)
    one, many, parts = jax.jit(moment), jax.jit(jax.vmap(moment)), jax.jit(by_device)
    found = jax.block_until_ready(many(twists))
    jax.block_until_ready((one(twists[0]), parts(shared)))
    at_once = _time(lambda: many(twists))
    by_some = _time(lambda: parts(shared))
    in_turn = _time(lambda: [one(twist) for twist in twists])
    force = 4.0 / 3.0 * 4.0 * RADIUS**3 / CURVATURE
    exact = np.array([float(lubkin_moment(c, FRICTION, force, RADIUS)) for c in stick])
    error = float(np.max(np.abs(np.asarray(found, float) / exact - 1.0)))
    rates = [cases / took for took in (at_once, by_some, in_turn)]
    ratios = [rate / rates[-1] for rate in rates[:-1]]
    return [*(f"{r:.4g}" for r in rates), *(f"{r:.2f}" for r in ratios), f"{error:.1e}"]


def _time(run: Callable[[], Array | list[Array]]) -> float:
    """Wall time of a call, median of several laps [s]."""
    laps = []
    for _ in range(LAPS):
        start = time.perf_counter()
        jax.block_until_ready(run())
        laps.append(time.perf_counter() - start)
    return float(np.median(laps))


if __name__ == "__main__":
    main()
