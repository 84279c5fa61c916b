"""Command line: `python -m papers list|run|leaderboard|sweep`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, Task, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from contactmodel.common.command_line import errors, make_app, run_app, say, say_error
from estimation.frames.extras import MissingExtraError, require_extra
from estimation.frames.files import check_writable, write_whole
from estimation.output.result_folder import renew_results
from papers.items import EXTRAS, ITEMS, STUDIES, choose_items
from papers.published import compare, read_published

if TYPE_CHECKING:
    from papers.leaderboard.publish import Ranking

app = make_app("Regenerate published results, and run our own studies.")


@app.command("list")
def list_items() -> None:
    """List the items that `run` computes, by paper or study, and the studies for `sweep`."""
    print("Items, for `run PAPER [ITEM]`:")
    for paper, items in ITEMS.items():
        print(" ", paper, *items)
    print("Studies, for `sweep STUDY` (extra `sweeps`):")
    for study in STUDIES:
        print(" ", study)


@app.command()
def run(
    paper: Annotated[str | None, typer.Argument(help="Paper or study (default: all).")] = None,
    item: Annotated[str | None, typer.Argument(help="One of its items (default: all).")] = None,
    quick: Annotated[bool, typer.Option(help="Compute a few draws instead of all.")] = False,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/papers"),
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Keep the items that are in the folder, as after an interruption. Whether they "
            "were made by this version and with --quick is not checked.",
        ),
    ] = False,
) -> None:
    """Compute and draw items, print their tables, and compare with published numbers.

    An item is skipped if its extra is not installed or its data cannot be fetched. Missing extras
    are reported before the first computation. The command names all skipped items at the end and
    exits with status 2. index.html shows all items in the folder and is updated after each item.
    """
    from estimation.output.report import figure_png
    from papers.index import picture_of, write_index

    chosen = choose_items(paper, item)
    if resume:
        chosen = [one for one in chosen if not picture_of(out, *one).is_file()]
    check_writable(out)
    left_out = _without_their_extra(chosen)
    write_index(out, left_out)
    results: dict[Callable, Any] = {}  # items that share `compute` share its result
    keeps = f"finished items are in {out}; repeat the command with --resume to compute the others"
    for name, part in chosen:
        if (name, part) in left_out:
            continue
        module = import_module(f"papers.{name}.{part}")
        if module.compute not in results:
            try:
                with _progress(keeps) as progress:
                    track = partial(progress.track, description=f"{name} {part}")
                    results[module.compute] = module.compute(quick=quick, track=track)
            except OSError as error:  # data that cannot be fetched
                say_error(f"{name} {part}: {error}")
                left_out[name, part] = str(error)
                write_index(out, left_out)
                continue
        result = results[module.compute]
        tables: dict[str, list[dict[str, object]]] = module.tables(result)
        if rows := [row for row in read_published(name) if row.item == part]:
            tables["_published"] = compare(rows, module.numbers(result))
        for suffix, rows in tables.items():
            write_whole(out / name / f"{part}{suffix}.csv", _csv(rows))
            Console(width=200).print(_table(f"{name} {part}{suffix}", rows))
        write_whole(picture_of(out, name, part), figure_png(module.plot(result)))  # last: complete
        write_index(out, left_out)
    if left_out:
        names = ", ".join(f"{name} {part}" for name, part in left_out)
        raise OSError(f"{names} left out of the results in {out}")
    print(f"written to {out}; see {out / 'index.html'}")


@app.command()
def leaderboard(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/papers"),
    angles: Annotated[
        list[Path] | None,
        typer.Option(
            help="CSV file named after its method: columns case, frame (row of the recording, not "
            "its source_index), angle_deg [°], slipped (of lifts). Can be given several times.",
            show_default="none",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(
            help="Write the recordings and the rules to this folder; no ranking.",
            show_default="none",
        ),
    ] = None,
    split: Annotated[
        str, typer.Option(help="Cases to rank by: scored, or tuning (their truth is exported).")
    ] = "scored",
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed of the scored cases; use the same for export and ranking. Keep it secret: "
            "the truth can be computed from it.",
            show_default="that of the practice round",
        ),
    ] = None,
    alone: Annotated[
        bool,
        typer.Option(
            help="Run no method; rank the entries of --angles, in the practice round beside the "
            "listed rows of the README."
        ),
    ] = False,
) -> None:
    """Rank methods by their share of right answers in three tiers: virtual, finite strain, real.

    Entries are checked first. Data sets that have not been fetched are left out, with a note.
    """
    from papers.leaderboard.cases import SPLITS, list_cases
    from papers.leaderboard.entries import read_entry

    entries = [read_entry(path, list_cases(split)) for path in angles or ()]
    if alone and not entries:
        raise ValueError("--alone ranks only the entries of --angles: add --angles FILE")
    check_writable(out if export is None else export)
    from papers.leaderboard import publish

    with _progress("the results are incomplete; repeat the command") as progress:
        track = partial(progress.track, description="leaderboard")
        if export is not None:
            with renew_results(export, "papers leaderboard --export", say) as results:
                publish.export_splits(SPLITS, seed, results.draft, track)
            say(f"exported to {export}; its README.md has the rules")
            return
        ranking = publish.rank_entries(entries, split, seed, alone=alone, track=track)
    _write_ranking(ranking, out / "leaderboard")
    print(f"written to {out / 'leaderboard'}")


@app.command()
def sheets(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/sheets"),
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Draw other frames with this seed, from all videos in the folder of the data set.",
            show_default="the frames of the study's table",
        ),
    ] = None,
    clip: Annotated[
        list[str] | None,
        typer.Option(
            help="Take every frame of this video, such as lemon/exp_num_2/camera_0, instead of "
            "drawing frames. Can be given several times.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Make sheets of pictures for reading the state of the contact by eye.

    The sheets show frames of `state-videos` without any estimate. README.md in the folder explains
    how to read them; reading.csv is the table to fill in. `run marker_images states` compares our
    states with such tables.
    """
    require_extra("video", "sheets")
    from estimation.frames.datasets import fetch
    from papers.marker_images import reading, settings
    from papers.marker_images import sheets as pages

    check_writable(out)
    pages.check_clips(clip or ())
    root = fetch("state-videos", say)
    if clip:
        drawn = pages.every_frame(root, clip)
    elif seed is None:
        drawn = reading.read_frames()
    else:
        drawn = pages.draw(root, settings.SHEETS._replace(seed=seed))
    with _progress("sheets are missing; repeat the command") as progress:
        pages.write_sheets(root, out, drawn, partial(progress.track, description="sheets"))
    print(f"written to {out}")


@app.command()
def changed(
    change: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of a change, such as 'JPEG, quality 25'. Can be given several times.",
            show_default="all",
        ),
    ] = None,
) -> None:
    """Answer published clips with changed pictures, and print a row for each change.

    Each change takes minutes. Finished changes are kept in build/changed until the code changes;
    `run marker_images changed` computes the others and writes the tables.
    """
    require_extra("video", "changed")
    from papers.marker_images.changed import NAMES, answer_changes

    keeps = "finished changes are kept; repeat the command to answer the others"
    with _progress(keeps) as progress:
        track = partial(progress.track, description="changed")
        answer_changes(change or NAMES, track=track)


@app.command()
def sweep(
    study: Annotated[
        str, typer.Argument(help=f"Module of the study: {', '.join(STUDIES)}, or your own module.")
    ],
    quick: Annotated[bool, typer.Option(help="Evaluate the study's small table of cases.")] = False,
    store: Annotated[
        Path | None,
        typer.Option(help="Folder of the store.", show_default="build/sweeps/STUDY.zarr"),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes on this machine.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler; its workers evaluate the cases.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Evaluate a study's cases; the same command resumes an interrupted sweep."""
    require_extra("sweeps", f"sweep {study}")
    from papers import sweeps

    path = store or sweeps.store_path(study, quick)
    executor = sweeps.in_process if workers == 1 else sweeps.local_processes(workers)
    if scheduler is not None:
        executor = sweeps.on_cluster(scheduler)
    keeps = f"finished cases are in {path}; repeat the command to evaluate the others"
    with _progress(keeps) as progress:
        task = progress.add_task(study, total=None)
        results = sweeps.run_sweep(
            study,
            path,
            executor,
            quick=quick,
            report=lambda finished, total: progress.update(task, completed=finished, total=total),
        )
    print(f"{results.done.sum()} cases done, {len(results.failures)} failed: {path}")
    for row, reason in list(results.failures.items())[:10]:
        print(f"  case {row}: {reason}")


def _write_ranking(ranking: "Ranking", folder: Path) -> None:
    """Write the tables, entries and picture of a ranking, and print its short form."""
    for name, rows in ranking.tables.items():
        write_whole(folder / f"{name}.csv", _csv(rows))
    for name, text in ranking.entries.items():
        write_whole(folder / "entries" / f"{name}.csv", text)
    write_whole(folder / "leaderboard.png", ranking.picture)
    Console(width=200).print(_table("leaderboard", ranking.tables["leaderboard"][: ranking.shown]))


def _without_their_extra(chosen: list[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """The items whose extra is not installed, with the reason; each is reported."""
    left_out = {}
    for name, part in chosen:
        try:
            if extra := EXTRAS.get((name, part)):
                require_extra(extra, f"{name} {part}")
        except MissingExtraError as error:
            say_error(str(error))
            left_out[name, part] = str(error)
    return left_out


class _Cases(MofNCompleteColumn):
    """The number of finished cases, and of all if it is known."""

    def render(self, task: Task) -> Text:
        """The text of a task: `14 of 20`, or `14 done`."""
        if task.total is None:
            return Text(f"{int(task.completed)} done", style="progress.download")
        return Text(f"{int(task.completed)} of {int(task.total)}", style="progress.download")


@contextmanager
def _progress(keeps: str) -> Iterator[Progress]:
    """A progress bar with cases, elapsed and remaining time; Ctrl-C prints what the run keeps."""
    columns = (*Progress.get_default_columns(), _Cases(), TimeElapsedColumn())
    try:
        with Progress(*columns, console=errors) as progress:
            yield progress
    except KeyboardInterrupt:
        say(f"interrupted: {keeps}")
        raise typer.Exit(130) from None


def _columns(rows: list[dict[str, object]]) -> list[str]:
    """The columns of a table; none if it is empty, as a list of faults may be."""
    return list(rows[0]) if rows else []


def _csv(rows: list[dict[str, object]]) -> str:
    from estimation.output.table import csv_text

    return csv_text({name: [row.get(name) for row in rows] for name in _columns(rows)})


def _table(title: str, rows: list[dict[str, object]]) -> Table:
    table = Table(*_columns(rows), title=title)
    for row in rows:
        table.add_row(*("–" if value is None else str(value) for value in row.values()))
    return table


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
