"""Command line: `python -m contactmodel simulate|verify`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Column, Table

from contactmodel.common.command_line import (
    describe_error,
    errors,
    make_app,
    run_app,
    say_error,
)

app = make_app("Contact of two elastic bodies with friction.")
console = Console()
_TABLE_WIDTH = 165  # on every terminal: text may wrap there, but numbers are not cut


@app.command()
def simulate(
    config: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG",
            help="TOML file, or a shipped example: pivoting_cube, cube_on_layer, shifted_sphere.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write to; an interrupted run resumes.")],
    sensor: Annotated[
        Path | None,
        typer.Option(
            help="Sensor description (TOML); supplies the pad's keys that CONFIG lacks.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Solve a contact along a path; write its fields, a table and pictures."""
    from contactmodel.elasticity.pad import read_pad
    from contactmodel.simulate.configuration import read_simulation
    from contactmodel.simulate.run import run_simulation, write_results
    from contactmodel.solution import stack_steps

    try:
        simulation = read_simulation(config, None if sensor is None else read_pad(sensor))
        solutions = [
            solution
            for _, solution in track(
                run_simulation(simulation, out),
                "Solving",
                total=len(simulation),
                console=errors,
            )
        ]
        write_results(stack_steps(solutions), out)
    except (OSError, ValueError, RuntimeError) as error:
        say_error(describe_error(error))
        raise typer.Exit(2) from error
    apart = sum(not bool(solution.contact.any()) for solution in solutions)
    if apart:
        errors.print(
            f"note: the bodies do not touch in {apart} of {len(solutions)} steps; use a larger "
            "approach",
            highlight=False,
        )
    console.print(f"wrote {len(solutions)} steps, path.csv and pictures to {out}", highlight=False)


@app.command()
def verify(
    cells: Annotated[
        int, typer.Option(min=32, help="Cells along each side of the grid; more take longer.")
    ] = 128,
) -> None:
    """Compare the solver with closed forms, conservation laws and its own convergence.

    The exit status is 1 if a row fails.
    """
    from contactmodel.verify.rows import Row
    from contactmodel.verify.table import CHECKS, convergence

    rows: list[Row] = []
    for check in track(CHECKS, "Checking", console=errors):
        rows += check(cells)
    with errors.status("Computing orders of convergence from 32² to 256² cells"):
        rows += convergence()
    names = ("check", "model", "expected", "error", "tolerance", "verdict", "limited by")
    words = ("check", "limited by")
    table = Table(*(Column(name, no_wrap=name not in words) for name in names), box=None)
    for row in rows:
        verdict = "[green]ok[/green]" if row.passed else "[red]FAILED[/red]"
        numbers = [f"{row.value:.7g}", f"{row.expected:.7g}", f"{row.error:.1e}"]
        table.add_row(escape(row.what), *numbers, f"{row.tolerance:.1e}", verdict, row.because)
    Console(width=_TABLE_WIDTH).print(table)
    failed = sum(not row.passed for row in rows)
    console.print(f"{len(rows) - failed} of {len(rows)} rows agree", highlight=False)
    raise typer.Exit(int(failed > 0))


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
