"""Normal contact and torsion compared with other codes on the same problem, in one run.

`python -m tests.benchmarks.peers [CELLS …]`: a paraboloid on a free half-space, with a contact
radius of 0.3 of the side; then torsion from rest to c/a = 0.7, which the others do not offer.
Compilation is timed separately, and the others' operators are made before the clock starts. Times
are processor times, which other programs on the machine disturb less. Our time and steps include
our initial coarse grid. Columns of aspher or tamaas are empty if the code is not installed. The
memory is valid in the first row only.

Residuals differ. Ours: root mean square of gap and overlap over the contact, relative to the
largest overlap at p = 0; for the traction, of the slip that violates the friction law, relative to
the rigid motion. aspher: its certified errors of energy, penetration and load. tamaas: its own
error estimate for Polonsky and Keer's iteration. The peers get our force, our solver its approach.
The columns of differences, of two pressures over the peak, show whether the results are comparable.
"""

import importlib
import resource
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from contactmodel import (
    Contact,
    ContactSolution,
    Grid,
    HalfSpace,
    Paraboloid,
    Pose,
    Rigid,
    solve_contact,
)
from contactmodel.analytic import lubkin_twist
from tests.benchmarks.arguments import make_parser

SIDE, RADIUS, CURVATURE = 10.0, 3.0, 30.0
BODY = HalfSpace(shear_modulus=1.0, poisson_ratio=0.5)  # not coupled to a rigid object
STIFFNESS = 4.0  # E*
FRICTION, STICK_RATIO = 0.5, 0.7
RTOL = 1e-8
LAPS = 3

Run = Callable[[], Any]


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    sizes = [128, 256, 512, 1024]
    parser.add_argument("cells", nargs="*", type=int, default=sizes, help="cells along a side")
    chosen = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    jax.block_until_ready(jnp.zeros(1) + 1.0)
    imported = memory()
    ours = ("normal [ms]", "steps", "first call [s]", "torsion [ms]", "steps", "applications")
    peers = ("aspher FFT [ms]", "steps", "difference", "tamaas [ms]", "difference")
    ratios = ("ours/aspher", "tamaas/ours", "torsion/aspher", "memory [MB]")
    table = Table("cells", *ours, *peers, *ratios)
    for cells in chosen:
        table.add_row(f"{cells}²", *measure(cells, imported))
    Console(width=190).print(table)


def measure(cells: int, imported: float) -> list[str]:
    """The texts of a row of the table."""
    ratio = FRICTION * 2.0 / np.pi * RADIUS / CURVATURE * 2.0  # μp0/2G, p0 = (2/π) E* a/R, E* = 4G
    twist = float(lubkin_twist(STICK_RATIO, ratio))
    start = time.perf_counter()
    pressed = solve(cells, 0.0, 0.0)
    first = time.perf_counter() - start
    used = memory() - imported  # before friction and the peers take theirs
    turned = solve(cells, twist, FRICTION)
    mean = float(jnp.mean(pressed.pressure))
    gap = (Paraboloid(CURVATURE).height(jnp.asarray(pressed.grid.points))).__array__()
    runs: dict[str, Run | None] = {
        "normal": lambda: solve(cells, 0.0, 0.0),
        "torsion": lambda: solve(cells, twist, FRICTION),
        "aspher": with_aspher(gap, mean),
        "tamaas": with_tamaas(gap, mean),
    }
    times, ends = side_by_side(runs)
    steps = [str(int(done.steps)) for done in (pressed.normal, turned.friction)]
    row = [milliseconds(times, "normal"), steps[0], f"{first:.3g}"]
    row += [milliseconds(times, "torsion"), steps[1], str(int(turned.friction.applications))]
    row += [milliseconds(times, "aspher"), told(ends, "aspher", lambda end: str(end.iterations))]
    row += [told(ends, "aspher", lambda end: apart(end.pressure, pressed))]
    row += [milliseconds(times, "tamaas"), told(ends, "tamaas", lambda end: apart(end, pressed))]
    pairs = (("normal", "aspher"), ("tamaas", "normal"), ("torsion", "aspher"))
    row += [f"{times[a] / times[b]:.3g}" if {a, b} <= set(times) else "" for a, b in pairs]
    return [*row, f"{used:.0f}"]


def solve(cells: int, twist: float, friction: float) -> ContactSolution:
    """Solve with our solver, from rest."""
    grid = Grid((cells, cells), (SIDE, SIDE))
    pose = Pose(RADIUS**2 / CURVATURE, twist=twist, linear=True)
    solution = solve_contact(
        Contact(BODY, Rigid(), Paraboloid(CURVATURE), grid, friction), pose, rtol=RTOL
    )
    return jax.block_until_ready(solution)


def with_aspher(gap: np.ndarray, mean: float) -> Run | None:
    """aspher's solver with exact convolution, as ours, and its FFT preconditioner."""
    aspher = find("aspher")
    if aspher is None:
        return None
    solver = aspher.ContactSolver(
        grid_size=len(gap), domain_size=SIDE, E_star=STIFFNESS, backend="fft"
    )
    return lambda: solver.solve(gap.ravel(), p_nominal=mean, tol=RTOL, precond="fourier-fft")


def with_tamaas(gap: np.ndarray, mean: float) -> Run | None:
    """tamaas's solver in free space."""
    tamaas = find("tamaas")
    if tamaas is None:
        return None
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [SIDE, SIDE], gap.shape)
    model.E, model.nu = 2.0 * (1.0 + 0.5), 0.5
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")

    def run() -> np.ndarray:
        model.traction[:] = 0.0
        solver = tamaas.PolonskyKeerRey(model, -gap, RTOL)
        solver.setIntegralOperator("dcfft")
        solver.solve(mean)
        return np.asarray(model.traction)

    return run


def find(name: str) -> Any:
    """A peer's module; None if it is not installed."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        return None


def side_by_side(runs: dict[str, Run | None]) -> tuple[dict[str, float], dict[str, Any]]:
    """Processor times, medians over alternating laps [s], and the results of the last lap."""
    there = {name: run for name, run in runs.items() if run is not None}
    ends: dict[str, Any] = {}
    laps = []
    for _ in range(LAPS):
        lap = []
        for name, run in there.items():
            start = time.process_time()
            ends[name] = run()
            lap.append(time.process_time() - start)
        laps.append(lap)
    return dict(zip(there, np.median(laps, axis=0), strict=True)), ends


def apart(theirs: np.ndarray, ours: ContactSolution) -> str:
    """The largest difference of two pressures, over the peak [-]."""
    mine = np.asarray(ours.pressure)
    return f"{np.abs(np.asarray(theirs).reshape(mine.shape) - mine).max() / mine.max():.1e}"


def milliseconds(times: dict[str, float], name: str) -> str:
    """The time of a code [ms]; empty if it is not installed."""
    return f"{1e3 * times[name]:.3g}" if name in times else ""


def told(ends: dict[str, Any], name: str, tell: Callable[[Any], str]) -> str:
    """A text about the result of a code; empty if it is not installed."""
    return tell(ends[name]) if name in ends else ""


def memory() -> float:
    """Peak memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


if __name__ == "__main__":
    main()
