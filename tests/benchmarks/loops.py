"""The solver's own loops compared with those of JAX's libraries, in one run, without compilation.

`python -m tests.benchmarks.loops [CELLS …]`: the linear system of a half sliding contact is solved
by our conjugate gradients, lineax's and JAX's; the pressure is solved by our bounded conjugate
gradients and by optimistix's unbounded minimiser with p = q²; the motion under a given force and
moment by our Newton's method and by optimistix's, whose steps solve the contact. All loops that
accept a preconditioner have the same one, and all stop at the same residual.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Paraboloid,
    Pose,
    Resultants,
    Rigid,
    solve_contact,
)
from contactmodel.elasticity.compliance import pair_compliance
from contactmodel.solver.friction import find_sets, make_preconditioner
from contactmodel.solver.linear import conjugate_gradients
from contactmodel.solver.normal import pressure_residual, solve_pressure
from tests.benchmarks.arguments import make_parser

LAPS = 7
RTOL = 1e-8
MOST = 2000
FRICTION = 0.5
APPROACH, TWIST = 0.9, 0.1


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("cells", nargs="*", type=int, default=[64, 128], help="cells along a side")
    chosen = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    table = Table("cells", "problem", "loop", "steps", "residual", "time [ms]")
    for cells in chosen:
        for problem, loops in PROBLEMS.items():
            for loop, steps, residual, duration in measure(loops(cells)):
                row = (f"{cells}²", problem, loop, steps, f"{residual:.1e}", f"{duration:.1f}")
                table.add_row(*row)
    Console().print(table)


def linear_loops(cells: int) -> dict[str, Callable[[], tuple[Array, Array]]]:
    """Steps (−1: not reported) and residual of each loop on a Newton system of the friction."""
    grid = Grid((cells, cells), (20.0, 20.0))
    pad = HalfSpace(0.2, 0.48)
    pose = Pose(APPROACH, twist=TWIST)
    end = solve_contact(Contact(pad, Rigid(), Paraboloid(40.0), grid, FRICTION), pose)
    compliance = pair_compliance(pad, Rigid(), grid)
    limit = FRICTION * end.pressure
    sets = find_sets(end.traction, end.slip_increment, limit, compliance.stiffest)
    precondition = make_preconditioner(compliance, sets)
    x, y = jnp.asarray(grid.points)
    rhs = sets.along(jnp.stack([-y, x]))

    def tangent(change: Array) -> Array:
        free = sets.along(change)
        return sets.along(compliance.drag(free)) + sets.stiffness * free + (change - free)

    def rms(field: Array) -> Array:
        return jnp.sqrt(jnp.mean(field**2))

    def told(solution: Array, steps: Array | int) -> tuple[Array, Array]:
        return jnp.asarray(steps), rms(tangent(solution) - rhs) / rms(rhs)

    def ours() -> tuple[Array, Array]:
        return told(*conjugate_gradients(tangent, rhs, precondition, rtol=RTOL, max_steps=MOST))

    def by_lineax() -> tuple[Array, Array]:
        structure = jax.eval_shape(lambda: rhs)
        tag = lineax.positive_semidefinite_tag
        matrix, inverse = (
            lineax.FunctionLinearOperator(operator, structure, tag)
            for operator in (tangent, precondition)
        )
        solver = lineax.CG(
            rtol=0.0, atol=RTOL * rms(rhs), norm=rms, stabilise_every=None, max_steps=MOST
        )
        options = {"preconditioner": inverse}
        end = lineax.linear_solve(matrix, rhs, solver, options=options, throw=False)
        return told(end.value, end.stats["num_steps"])

    def by_jax() -> tuple[Array, Array]:
        cg = jax.scipy.sparse.linalg.cg
        return told(cg(tangent, rhs, M=precondition, tol=RTOL, maxiter=MOST)[0], -1)

    return {"ours": ours, "lineax.CG": by_lineax, "jax.scipy cg": by_jax}


def pressure_loops(cells: int) -> dict[str, Callable[[], tuple[Array, Array]]]:
    """Steps and residual of each loop on the pressure at a given approach."""
    grid = Grid((cells, cells), (20.0, 20.0))
    compliance = pair_compliance(HalfSpace(0.2, 0.48), Rigid(), grid)
    gap = Paraboloid(40.0).height(jnp.asarray(grid.points)) - APPROACH

    def ours() -> tuple[Array, Array]:
        start = jnp.zeros(grid.shape)
        pressure, done = solve_pressure(compliance, gap, start=start, rtol=RTOL, max_steps=MOST)
        return done.steps, pressure_residual(compliance, gap, pressure)

    def by_optimistix() -> tuple[Array, Array]:
        def energy(root: Array, _: None) -> Array:
            pressure = root**2
            return jnp.sum(pressure * (0.5 * compliance.press(pressure) + gap))

        start = jnp.sqrt(jnp.maximum(-gap, 0.0) / jnp.max(compliance.normal)) + 1e-3
        solver = optimistix.LBFGS(rtol=1e-12, atol=1e-12)
        end = optimistix.minimise(energy, solver, start, max_steps=MOST, throw=False)
        return end.stats["num_steps"], pressure_residual(compliance, gap, end.value**2)

    return {"ours": ours, "optimistix.LBFGS, p = q²": by_optimistix}


def resultant_loops(cells: int) -> dict[str, Callable[[], tuple[Array, Array]]]:
    """Steps (−1: not reported) and residual of each loop on the motion by four resultants."""
    grid = Grid((cells, cells), (20.0, 20.0))
    contact = Contact(HalfSpace(0.2, 0.48), Rigid(), Paraboloid(40.0), grid, FRICTION)
    given = jnp.array([2.0, 0.4, 0.1, 1.0])  # N, N, N, N·mm
    guess = jnp.array([0.2, 0.0, 0.0, 0.0])  # mm, mm, mm, rad

    def misfit(motion: Array, _: None = None) -> Array:
        pose = Pose(motion[0], motion[1:3], motion[3])
        end = solve_contact(contact, pose, rtol=RTOL, throw=False)
        return (
            jnp.append(end.force[jnp.array([2, 0, 1])] * jnp.array([-1, 1, 1]), end.moment) - given
        )

    def told(motion: Array, steps: Array | int) -> tuple[Array, Array]:
        return jnp.asarray(steps), jnp.max(jnp.abs(misfit(motion) / given))

    def ours() -> tuple[Array, Array]:
        load = Resultants(given[0], given[1:3], given[3])
        pose = solve_contact(contact, Pose(guess[0]), load, rtol=RTOL, throw=False).pose
        return told(jnp.stack([pose.approach, *pose.shift, pose.twist]), -1)

    def by(solver: Any) -> Callable[[], tuple[Array, Array]]:
        def loop() -> tuple[Array, Array]:
            end = optimistix.root_find(misfit, solver, guess, max_steps=60, throw=False)
            return told(end.value, end.stats["num_steps"])

        return loop

    tolerances = {"rtol": 1e-7, "atol": 1e-7}
    solvers = optimistix.Newton(**tolerances), optimistix.Dogleg(**tolerances)
    return {"ours": ours} | {f"optimistix.{type(one).__name__}": by(one) for one in solvers}


PROBLEMS = {"linear": linear_loops, "pressure": pressure_loops, "resultants": resultant_loops}


def measure(
    loops: dict[str, Callable[[], tuple[Array, Array]]],
) -> list[tuple[str, str, float, float]]:
    """Name, steps, residual and time [ms] of each loop; times are medians over the laps."""
    compiled = {name: jax.jit(loop) for name, loop in loops.items()}
    ends = {name: jax.block_until_ready(loop()) for name, loop in compiled.items()}
    laps = [[_time(loop) for loop in compiled.values()] for _ in range(LAPS)]
    rows = []
    for (name, (steps, residual)), duration in zip(ends.items(), np.median(laps, 0), strict=True):
        shown = "not reported" if int(steps) < 0 else str(int(steps))
        rows.append((name, shown, float(residual), 1e3 * float(duration)))
    return rows


def _time(loop: Callable) -> float:
    start = time.perf_counter()
    jax.block_until_ready(loop())
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
