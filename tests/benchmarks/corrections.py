"""Cost of the corrections for finite strain: a step of a solve, and the field, with and without.

`python -m tests.benchmarks.corrections [CELLS]`: a rigid sphere is pressed onto a layer by 0.13 of
its thickness in 4 steps, turned to 20° in 10 and back to 10° in 4, with corotated poses. Times are
processor times of one run, each the median of laps in which the ways take turns.
"""

import time
from collections.abc import Callable

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from contactmodel import Contact, ContactSolution, Grid, Layer, Pose, Rigid, Sphere, solve_path
from tests.benchmarks.arguments import make_parser

THICKNESS, DEPTH, RADIUS, SIDE, FRICTION = 8.0, 1.04, 20.0, 12.5, 0.5
WAYS = {
    "linear": Layer(0.2, 0.48, THICKNESS),
    "corrected": Layer(0.2, 0.48, THICKNESS, radius=30.0, neo_hookean=True),
}
LAPS = 9


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("cells", nargs="?", type=int, default=64, help="cells along a side")
    cells = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    table = Table("gel", "ms a step", "ms for force and moment", "ms for the field on the grid")
    times = measure(cells)
    for name, row in times.items():
        table.add_row(name, *(f"{value:.1f}" for value in row))
    Console().print(table)
    more = times["corrected"].sum() / times["linear"].sum() - 1.0
    Console().print(f"step, force, moment and field of a step: {100.0 * more:+.1f} %")


def measure(cells: int) -> dict[str, np.ndarray]:
    """Times of a step's parts by way [ms].

    Args:
        cells: cells along a side of the grid.
    """
    grid, depth = Grid((cells, cells), (SIDE, SIDE)), np.append(np.linspace(0.25, 1.0, 4), [1] * 14)
    degrees = np.concatenate([np.zeros(4), np.arange(2, 21, 2), [17.5, 15.0, 12.5, 10.0]])
    path = Pose(DEPTH * depth, twist=np.radians(degrees), corotated=True)
    contacts = {
        name: Contact(gel, Rigid(), Sphere(RADIUS), grid, FRICTION) for name, gel in WAYS.items()
    }
    laps = []
    for _ in range(LAPS + 1):  # the first compiles
        laps.append([_time_parts(contact, path) for contact in contacts.values()])
    middle = np.median(laps[1:], axis=0) * 1e3 / len(depth)
    return dict(zip(WAYS, middle, strict=True))


def _time_parts(contact: Contact, path: Pose) -> list[float]:
    solved: list[ContactSolution] = []
    parts: tuple[Callable[[], object], ...] = (
        lambda: solved.append(solve_path(contact, path)),
        lambda: (solved[0].force, solved[0].moment),
        lambda: solved[0].elastomer_displacement(),
    )
    times = []
    for part in parts:
        start = time.process_time()
        jax.block_until_ready(part())
        jax.block_until_ready(solved[0].pressure)
        times.append(time.process_time() - start)
    return times


if __name__ == "__main__":
    main()
