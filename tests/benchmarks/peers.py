"""Normal contact and torsion beside other codes on the same problem, after compilation.

`python -m tests.benchmarks.peers [CELLS …]`: a paraboloid, contact radius 0.3 of the side, on a
free half-space; then the torsion from rest, c/a = 0.7, which the others do not have. Where tamaas
is not installed its columns are empty.

Residuals differ. Ours: root mean square over the contact of gap and overlap, by the largest overlap
at p = 0; for the traction, of the slip that friction's law forbids, by the rigid motion. tamaas:
its own error estimate for Polonsky and Keer's iteration, for the same force. The last column, the
largest difference of the two pressures by the peak, tells whether they are comparable.
"""

import importlib
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from contactmodel import ContactSolution, Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact
from contactmodel.analytic import lubkin_twist

SIDE, RADIUS, CURVATURE = 10.0, 3.0, 30.0
BODY = HalfSpace(shear_modulus=1.0, poisson_ratio=0.5)  # not coupled to a rigid object
FRICTION, STICK_RATIO = 0.5, 0.7
RTOL = 1e-8
LAPS = 5


def main() -> None:
    """Print the table."""
    jax.config.update("jax_enable_x64", True)
    ours = ("normal [ms]", "iterations", "first call [s]", "torsion [ms]", "over normal")
    table = Table("cells", *ours, "applications", "tamaas [ms]", "over ours", "difference")
    for cells in [int(word) for word in sys.argv[1:]] or [128, 256, 512, 1024]:
        table.add_row(f"{cells}²", *measure(cells))
    Console(width=130).print(table)


def measure(cells: int) -> list[str]:
    """The cells of a row."""
    ratio = FRICTION * 2.0 / np.pi * RADIUS / CURVATURE * 2.0  # μp0/2G, p0 = (2/π) E* a/R, E* = 4G
    twist = float(lubkin_twist(STICK_RATIO, ratio))
    start = time.perf_counter()
    pressed = solve(cells, 0.0, 0.0)
    first = time.perf_counter() - start
    normal = median(lambda: solve(cells, 0.0, 0.0))
    turned = solve(cells, twist, FRICTION)
    torsion = median(lambda: solve(cells, twist, FRICTION))
    row = [f"{1e3 * normal:.3g}", str(int(pressed.normal.steps)), f"{first:.3g}"]
    row += [f"{1e3 * torsion:.3g}", f"{torsion / normal:.3g}"]
    row += [str(int(turned.friction.applications))]
    return row + compare_tamaas(cells, pressed, normal)


def solve(cells: int, twist: float, friction: float) -> ContactSolution:
    """Ours, from rest."""
    grid = Grid((cells, cells), (SIDE, SIDE))
    pose = Pose(RADIUS**2 / CURVATURE, twist=twist, linear=True)
    solution = solve_contact(BODY, Rigid(), Paraboloid(CURVATURE), pose, grid, friction, rtol=RTOL)
    return jax.block_until_ready(solution)


def compare_tamaas(cells: int, ours: ContactSolution, normal: float) -> list[str]:
    """Its time for our force, over ours, and how far the pressures are apart."""
    try:
        tamaas = importlib.import_module("tamaas")
    except ModuleNotFoundError:
        return ["", "", ""]
    x, y = ours.grid.points
    model = tamaas.ModelFactory.createModel(
        tamaas.model_type.basic_2d, [SIDE, SIDE], [cells, cells]
    )
    model.E, model.nu = 2.0 * (1.0 + 0.5), 0.5
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    mean = float(jnp.mean(ours.pressure))

    def run() -> None:
        model.traction[:] = 0.0
        solver = tamaas.PolonskyKeerRey(model, -(x**2 + y**2) / (2.0 * CURVATURE), RTOL)
        solver.setIntegralOperator("dcfft")
        solver.solve(mean)

    run()
    theirs = median(run)
    apart = np.abs(np.asarray(model.traction) - np.asarray(ours.pressure)).max()
    peak = float(jnp.max(ours.pressure))
    return [f"{1e3 * theirs:.3g}", f"{theirs / normal:.3g}", f"{apart / peak:.1e}"]


def median(run) -> float:
    """Seconds, of several laps."""
    laps = []
    for _ in range(LAPS):
        start = time.perf_counter()
        run()
        laps.append(time.perf_counter() - start)
    return float(np.median(laps))


if __name__ == "__main__":
    main()
