"""A pivot in 40 steps: operator applications per step, and the solver's time outside them.

`python -m tests.benchmarks.path [CELLS]`: a rigid ball is pressed on in 4 steps, turned by 12° in
14 and back to −8° in 22. The pads are half-spaces without, with weak and with strong coupling, and
a bonded layer. An application is one of the compliance or of its approximate inverse: to a
pressure, to a traction or, with coupling, to both. The counts include the solver's applications and
one of each kind for the output fields. Each kind is timed alone, in a loop inside a compiled
program. The last column is the path's time over the sum of its applications' times. All times are
processor times of one run.
"""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Layer,
    Paraboloid,
    Pose,
    Rigid,
    make_path,
    solve_path,
)
from contactmodel.elasticity.bodies import AbstractBody
from contactmodel.elasticity.compliance import pair_compliance
from tests.benchmarks.arguments import make_parser

SIDE, RADIUS, APPROACH, FRICTION = 13.0, 20.0, 0.6, 0.6
STEPS = (4, 14, 22)
TWISTS_DEG = (0.0, 0.0, 12.0, -8.0)
BODIES: dict[str, AbstractBody] = {
    "half-space, ν = 0.5": HalfSpace(0.2, 0.5),
    "half-space, ν = 0.48": HalfSpace(0.2, 0.48),
    "half-space, ν = 0.3": HalfSpace(0.2, 0.3),
    "layer of 3 mm, ν = 0.48": Layer(0.2, 0.48, 3.0),
}
LAPS = 5
REPEATS = 200  # applications in a lap


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("cells", nargs="?", type=int, default=64, help="cells along a side")
    cells = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    grid = Grid((cells, cells), (SIDE, SIDE))
    table = Table("elastomer", "normal", "tangential", "applications a step", "ms a step", "over")
    for name, body in BODIES.items():
        table.add_row(name, *measure(body, grid))
    Console().print(table)


def measure(body: AbstractBody, grid: Grid) -> list[str]:
    """The texts of a row of the table."""
    twists = np.radians(TWISTS_DEG)
    poses = [Pose(APPROACH * min(i, 1), twist=twist) for i, twist in enumerate(twists)]
    path = make_path(poses, STEPS)
    compliance = pair_compliance(body, Rigid(), grid)
    fields = jnp.ones((3, *grid.shape))
    pressure, traction = fields[0], fields[1:]

    def follow():
        return solve_path(Contact(body, Rigid(), Paraboloid(RADIUS), grid, FRICTION), path)

    end = follow()
    press, both = _repeat(compliance.press, pressure), _repeat(compliance.drag, traction)
    if compliance.coupling is not None:
        both = _repeat(lambda f: _stack(*compliance.displace(f[0], f[1:])), fields)
    laps = [[_time(run) for run in (follow, press, both)] for _ in range(LAPS + 1)]
    whole, by_pressure, by_traction = np.median(laps[1:], axis=0) / (1, REPEATS, REPEATS)
    normal, tangential = (int(done.applications.sum()) for done in (end.normal, end.friction))
    steps = sum(STEPS)
    normal, tangential = normal + steps * (compliance.coupling is None), tangential + steps
    parts = normal * by_pressure + tangential * by_traction
    counts = [normal / steps, tangential / steps, (normal + tangential) / steps]
    ratios = [1e3 * whole / steps, whole / parts]
    return [*(f"{count:.1f}" for count in counts), *(f"{ratio:.3g}" for ratio in ratios)]


def _stack(normal: Array, tangential: Array) -> Array:
    return jnp.concatenate([normal[None], tangential])


def _repeat(operator: Callable[[Array], Array], field: Array) -> Callable[[], Array]:
    """Many applications in sequence, each to the result of the last."""

    @jax.jit
    def run(field: Array) -> Array:
        return jax.lax.fori_loop(0, REPEATS, lambda _, f: operator(f), field)

    return lambda: run(field)


def _time(run: Callable) -> float:
    """Processor time of a call [s]."""
    start = time.process_time()
    jax.block_until_ready(run())
    return time.process_time() - start


if __name__ == "__main__":
    main()
