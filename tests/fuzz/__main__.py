"""Command line: `python -m tests.fuzz --cases N --seed S`."""

from collections.abc import Sequence
from functools import partial
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from tests.fuzz.cases import kind_of, prepare, run_case
from tests.fuzz.kinds import KINDS
from tests.fuzz.runner import Job, Verdict, run_cases

console = Console(width=160)
OUTCOMES = ("answered", "refused", "failed")


def fuzz(
    cases: Annotated[int, typer.Option(min=1, help="Number of damaged inputs.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of the damage.")] = 0,
    case: Annotated[
        int | None, typer.Option(min=0, help="Run this case only, and tell what came of it.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes that run cases.")] = 1,
) -> None:
    """Damage inputs and see that each ends in an answer or in an error that names file and cause.

    Exit status 1 if one does not.
    """
    chosen = range(cases) if case is None else [case]
    verdicts = []
    results = run_cases(chosen, Job(partial(run_case, seed), prepare), workers)
    for verdict in track(results, "cases", len(chosen), console=Console(stderr=True)):
        verdicts.append(verdict)
        if verdict.outcome == "failed" or case is not None:
            console.print(describe(verdict, seed), highlight=False, soft_wrap=True)
    console.print(tabulate(verdicts))
    raise typer.Exit(int(any(one.outcome == "failed" for one in verdicts)))


def describe(verdict: Verdict, seed: int) -> str:
    """A case in a line or two, and how to run it again."""
    return escape(
        f"{kind_of(verdict.case)} ({verdict.damage}): {verdict.outcome}: {verdict.message}\n"
        f"    python -m tests.fuzz --seed {seed} --case {verdict.case}"
    )


def tabulate(verdicts: Sequence[Verdict]) -> Table:
    """How many cases of each kind ended how, and the most time and memory that one took."""
    table = Table("input", "cases", *OUTCOMES, "slowest [s]", "most memory [MB]", box=None)
    rows = {kind: [one for one in verdicts if kind_of(one.case) == kind] for kind in KINDS}
    for name, group in (rows | {"all": list(verdicts)}).items():
        if not group:
            continue
        counts = [sum(one.outcome == outcome for one in group) for outcome in OUTCOMES]
        slowest, largest = max(one.seconds for one in group), max(one.megabytes for one in group)
        table.add_row(name, *map(str, (len(group), *counts)), f"{slowest:.2f}", f"{largest:.0f}")
    return table


if __name__ == "__main__":
    typer.run(fuzz)
