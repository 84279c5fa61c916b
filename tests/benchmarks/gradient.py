"""Time of the moment's gradient over the time of one solve, in one run, without compilation.

`python -m tests.benchmarks.gradient`: a paraboloid is pressed and twisted. The gradient is with
respect to shear modulus, Poisson's ratio, friction, approach, twist and radius at once.
"""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.console import Console
from rich.table import Table

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact
from tests.benchmarks.arguments import make_parser

LAPS = 9
VALUES = (0.2, 0.48, 0.5, 0.9, 0.1, 40.0)


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    jax.config.update("jax_enable_x64", True)
    table = Table("cells", "solve [ms]", "reverse / solve", "forward / solve")
    for cells in (64, 128, 256):
        table.add_row(f"{cells}²", *(f"{value:.3g}" for value in measure(cells)))
    Console().print(table)


def measure(cells: int) -> tuple[float, float, float]:
    """Time of a solve [ms], and times of both gradients over it [-]; medians over the laps."""
    grid = Grid((cells, cells), (20.0, 20.0))

    def moment(values: Float[Array, " 6"]) -> Array:
        modulus, poisson_ratio, friction, approach, twist, radius = values
        elastomer = HalfSpace(shear_modulus=modulus, poisson_ratio=poisson_ratio)
        pose = Pose(approach=approach, twist=twist)
        return solve_contact(
            Contact(elastomer, Rigid(), Paraboloid(radius), grid, friction), pose, throw=False
        ).moment

    values = jnp.array(VALUES)
    directions = jnp.eye(len(VALUES))
    functions: tuple[Callable, ...] = (
        jax.jit(moment),
        jax.jit(jax.grad(moment)),
        jax.jit(lambda v: jax.jvp(moment, (v,), (directions[0],))),
    )
    laps = np.array([[_time(function, values) for function in functions] for _ in range(LAPS + 1)])
    solve, reverse, forward = np.median(laps[1:], axis=0)
    return 1e3 * solve, reverse / solve, forward / solve


def _time(function: Callable, values: Float[Array, " 6"]) -> float:
    start = time.perf_counter()
    jax.block_until_ready(function(values))
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
