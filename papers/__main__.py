"""Command line: `python -m papers list|run`."""

import csv
import io
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from estimation.files import check_writable, write_whole
from estimation.report import figure_png

ITEMS = {"virtual_pivots": ("accuracy",)}

app = typer.Typer(
    help="Published results regenerated, and studies of our own.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
console = Console(stderr=True)


@app.command("list")
def list_items() -> None:
    """List the papers and studies and their items."""
    for paper, items in ITEMS.items():
        print(paper, *items)


@app.command()
def run(
    paper: Annotated[str, typer.Argument(help="Paper or study.")],
    item: Annotated[str | None, typer.Argument(help="One of its items; all if none.")] = None,
    quick: Annotated[bool, typer.Option(help="A few draws instead of all.")] = False,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/papers"),
) -> None:
    """Compute items, draw them and print their tables."""
    if paper not in ITEMS:
        raise ValueError(f"no paper {paper!r}; there are {', '.join(ITEMS)}")
    if item is not None and item not in ITEMS[paper]:
        raise ValueError(f"{paper} has no item {item!r}; it has {', '.join(ITEMS[paper])}")
    check_writable(out)
    settings = import_module(f"papers.{paper}.settings")
    for name in ITEMS[paper] if item is None else (item,):
        module = import_module(f"papers.{paper}.{name}")
        with Progress(console=console) as progress:
            result = module.compute(
                draws=settings.QUICK_DRAWS if quick else settings.DRAWS,
                track=lambda cases: progress.track(cases, description=name),  # noqa: B023
            )
        write_whole(out / paper / f"{name}.png", figure_png(module.plot(result)))
        for suffix, rows in (
            ("", module.tabulate(result)),
            ("_angles", module.tabulate_angles(result)),
        ):
            write_whole(out / paper / f"{name}{suffix}.csv", _csv(rows))
            Console(width=200).print(_table(rows))
        print(f"written to {out / paper}")


def _csv(rows: list[dict[str, object]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _table(rows: list[dict[str, object]]) -> Table:
    table = Table(*rows[0])
    for row in rows:
        table.add_row(*map(str, row.values()))
    return table


def main() -> None:
    """Run the command line; what is wrong with the input goes to stderr, exit status 2."""
    jax.config.update("jax_enable_x64", True)
    try:
        app()
    except (ValueError, OSError) as error:
        console.print(f"[red]error:[/red] {error}", highlight=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
