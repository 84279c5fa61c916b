"""Our linear solver for derivatives and Newton's method, compared with lineax's in one run.

`python -m tests.benchmarks.krylov [CELLS …]`. First table: the system of `derivative`, for the
twist of a contact that sticks in the middle and slides around it, is solved to 1e-8. The solvers
are our conjugate residuals, lineax's GMRES and BiCGStab, and CG if the system is symmetric, all
with the same preconditioner. Second table: paths and a gradient, with our solver and with lineax's
in its place. Times are processor times; compilation is listed separately.
"""

import os

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp
import lineax
import numpy as np
from jax.typing import ArrayLike
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
    solve_contact,
    solve_path,
)
from contactmodel.elasticity.compliance import pair_compliance
from contactmodel.solver import derivative, newton
from contactmodel.solver.friction import find_sets
from contactmodel.solver.linear import Operator, conjugate_residuals
from contactmodel.solver.tangent import Tangent
from tests.benchmarks.arguments import make_parser

LAPS = 5
RTOL = 1e-8
MOST = 400
SIDE = 20.0
SHAPE = Paraboloid(40.0)
PADS = {
    "uncoupled": HalfSpace(0.2, 0.5),
    "coupled": HalfSpace(0.2, 0.3),
    "layer": Layer(0.2, 0.48, 3.0),
}
CONTACTS = {"partly slides": (0.5, 0.1), "sticks": (50.0, 1e-3)}  # μ, twist
SOLVERS = {
    "GMRES(20)": lambda atol, most: lineax.GMRES(0.0, atol, norm, max_steps=most, restart=20),
    "GMRES(12)": lambda atol, most: lineax.GMRES(0.0, atol, norm, max_steps=most, restart=12),
    "GMRES(6)": lambda atol, most: lineax.GMRES(0.0, atol, norm, max_steps=most, restart=6),
    "BiCGStab": lambda atol, most: lineax.BiCGStab(0.0, atol, norm, max_steps=most),
    "CG": lambda atol, most: lineax.CG(0.0, atol, norm, max_steps=most),
}


def norm(field: Array) -> Array:
    """Root of the sum of squares: the norm of all solvers, so that their tolerances are equal."""
    return jnp.sqrt(jnp.sum(field**2))


def by_lineax(name: str) -> Callable[..., tuple[Array, Array]]:
    """A linear solver of lineax with the interface of `conjugate_residuals`."""

    def solve(
        operator: Operator,
        rhs: Array,
        preconditioner: Operator,
        *,
        rtol: ArrayLike,
        max_steps: ArrayLike,
        kept: int = 0,
    ) -> tuple[Array, Array]:
        structure = jax.eval_shape(lambda: rhs)
        tags = lineax.positive_semidefinite_tag if name == "CG" else ()
        inverse_tags = lineax.positive_semidefinite_tag
        matrix = lineax.FunctionLinearOperator(operator, structure, tags)
        inverse = lineax.FunctionLinearOperator(preconditioner, structure, inverse_tags)
        options = {"preconditioner": inverse}
        most = kept or MOST  # lineax wants a known number; Newton's method keeps all of its few
        solver = SOLVERS[name](rtol * norm(rhs), most)  # lineax's rtol is cell by cell
        end = lineax.linear_solve(matrix, rhs, solver, options=options, throw=False)
        return end.value, end.stats["num_steps"].astype(jnp.int32)

    return solve


def main() -> None:
    """Print both tables."""
    parser = make_parser(__doc__)
    parser.add_argument("cells", nargs="*", type=int, default=[64, 128], help="cells along a side")
    sizes = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    columns = ("cells", "pad", "contact", "solver", "operator", "residual", "time [ms]")
    systems = Table(*columns, "compile [s]", title="the derivative's system")
    for cells in sizes:
        for pad in PADS:
            for contact in CONTACTS:
                for row in compare_systems(cells, pad, contact):
                    systems.add_row(f"{cells}²", pad, contact, *row)
    Console().print(systems)
    columns = ("cells", "pad", "what", "solver", "time [ms]", "compile [s]", "off")
    paths = Table(*columns, title="in the place of ours")
    for cells in sizes:
        for pad in PADS:
            for row in compare_paths(cells, pad):
                paths.add_row(f"{cells}²", pad, *row)
    Console().print(paths)


def compare_systems(cells: int, pad: str, contact: str) -> Iterator[tuple[str, ...]]:
    """For each solver: applications, true residual, time [ms] and compilation [s]."""
    tangent, rhs = make_system(cells, PADS[pad], *CONTACTS[contact])
    symmetric = (pad, contact) == ("uncoupled", "sticks")  # the coupling is skew
    names = ["GMRES(20)", "GMRES(12)", "BiCGStab", *(["CG"] if symmetric else [])]
    solvers = {"ours": conjugate_residuals} | {f"lineax {n}": by_lineax(n) for n in names}
    for name, solver in solvers.items():

        def solve(tangent: Tangent, rhs: Array, solver: Callable = solver) -> Array:
            rough = tangent.make_preconditioner()
            return solver(tangent.apply, rhs, rough, rtol=RTOL, max_steps=MOST)[0]

        program, compiling = compile_one(solve, tangent, rhs)
        defect = tangent.apply(program(tangent, rhs)) - rhs
        residual = float(jnp.linalg.norm(defect) / jnp.linalg.norm(rhs))
        applied = count_applications(solver, tangent, rhs)
        duration = measure(lambda p=program: p(tangent, rhs))
        yield name, str(applied), f"{residual:.0e}", f"{1e3 * duration:.1f}", f"{compiling:.1f}"


def make_system(cells: int, pad: Any, mu: float, twist: float) -> tuple[Tangent, Array]:
    """The system of `attach_derivative` for the derivative by the twist."""
    grid = Grid((cells, cells), (SIDE, SIDE))
    end = solve_contact(Contact(pad, Rigid(), SHAPE, grid, mu), Pose(0.9, twist=twist))
    compliance = pair_compliance(pad, Rigid(), grid)
    sets = find_sets(end.traction, end.slip_increment, mu * end.pressure, compliance.stiffest)
    tangent = Tangent(compliance, end.contact, sets, jnp.asarray(mu))
    x, y = jnp.asarray(grid.points)
    return tangent, tangent.restrict(jnp.zeros_like(x), jnp.stack([-y, x]))


def count_applications(solver: Callable, tangent: Tangent, rhs: Array) -> int:
    """Number of applications of the operator."""
    count = [0]

    def tick() -> None:
        count[0] += 1

    def counted(unknown: Array) -> Array:
        jax.debug.callback(tick)
        return tangent.apply(unknown)

    rough = tangent.make_preconditioner()
    end = jax.jit(lambda rhs: solver(counted, rhs, rough, rtol=RTOL, max_steps=MOST)[0])(rhs)
    jax.block_until_ready(end)
    jax.effects_barrier()
    return count[0]


def compare_paths(cells: int, pad: str) -> Iterator[tuple[str, ...]]:
    """For a path and a gradient: time [ms], compilation [s] and difference from our solver [-]."""
    grid = Grid((cells, cells), (SIDE, SIDE))
    path = make_path([Pose(0.9), Pose(0.9, twist=0.2), Pose(0.9, twist=0.0)], [8, 8])

    def moments(angle: Array) -> Array:
        turned = path.__class__(path.approach, path.shift, angle * path.twist, path.centre)
        return solve_path(Contact(PADS[pad], Rigid(), SHAPE, grid, 0.5), turned, throw=False).moment

    def slope(angle: Array) -> Array:
        def turn(twist: Array) -> Array:
            pose = Pose(0.9, twist=twist)
            return solve_contact(
                Contact(PADS[pad], Rigid(), SHAPE, grid, 0.5), pose, throw=False
            ).moment

        return jax.grad(turn)(0.1 * angle)

    for what, function in (("path of 17 steps", moments), ("gradient", slope)):
        reference = None
        for name in ("ours", "GMRES(6)", "BiCGStab"):
            with replaced(conjugate_residuals if name == "ours" else by_lineax(name)):
                program, compiling = compile_one(function, jnp.ones(()))
            value = np.asarray(program(jnp.ones(())))
            reference = value if reference is None else reference
            off = np.abs(value - reference).max() / np.abs(reference).max()
            duration = measure(lambda p=program: p(jnp.ones(())))
            shown = name if name == "ours" else f"lineax {name}"
            yield what, shown, f"{1e3 * duration:.0f}", f"{compiling:.1f}", f"{off:.0e}"


@contextmanager
def replaced(solver: Callable) -> Iterator[None]:
    """Replace the linear solver in Newton's method and in the derivative; clear compiled code."""
    jax.clear_caches()
    homes = (newton, derivative)
    for home in homes:
        home.conjugate_residuals = solver
    try:
        yield
    finally:
        for home in homes:
            home.conjugate_residuals = conjugate_residuals


def compile_one(function: Callable, *arguments: Any) -> tuple[Callable, float]:
    """A compiled program, and the processor time of tracing and compiling [s]."""
    start = time.process_time()
    program = jax.jit(function).lower(*arguments).compile()
    return program, time.process_time() - start


def measure(program: Callable[[], Array]) -> float:
    """Processor time of a call, median of the laps after the first [s]."""
    jax.block_until_ready(program())
    laps = []
    for _ in range(LAPS):
        start = time.process_time()
        jax.block_until_ready(program())
        laps.append(time.process_time() - start)
    return float(np.median(laps))


if __name__ == "__main__":
    main()
