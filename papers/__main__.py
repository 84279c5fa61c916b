"""Command line: `python -m papers list|run|leaderboard|sweep`."""

import csv
import io
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn
from rich.table import Table

from contactmodel.common.command_line import errors, make_app, run_app, say, say_error
from estimation.frames.extras import MissingExtraError, require_extra
from estimation.frames.files import check_writable, write_whole
from estimation.output.result_folder import renew_results
from papers.items import EXTRAS, ITEMS, STUDIES, choose_items
from papers.published import compare, read_published

app = make_app("Published results regenerated, and studies of our own.")


@app.command("list")
def list_items() -> None:
    """List the items that `run` computes, by paper or study, and the studies that `sweep` takes."""
    print("Items, for `run PAPER [ITEM]`:")
    for paper, items in ITEMS.items():
        print(" ", paper, *items)
    print("Studies, for `sweep STUDY` (extra `sweeps`):")
    for study in STUDIES:
        print(" ", study)


@app.command()
def run(
    paper: Annotated[str | None, typer.Argument(help="Paper or study; all if none.")] = None,
    item: Annotated[str | None, typer.Argument(help="One of its items; all if none.")] = None,
    quick: Annotated[bool, typer.Option(help="A few draws instead of all.")] = False,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/papers"),
) -> None:
    """Compute items, draw them, print their tables and what was published beside ours.

    Items are left out if they need an extra that is not installed or data that cannot be fetched.
    Each is reported, the extras before anything is computed, and named at the end, exit status 2.
    index.html shows what is in the folder, and is renewed after each item.
    """
    from estimation.output.report import figure_png
    from papers.index import write_index

    chosen = choose_items(paper, item)
    check_writable(out)
    left_out = _without_their_extra(chosen)
    write_index(out, left_out)
    found: dict[Callable, Any] = {}  # some items draw what another has computed
    for name, part in chosen:
        if (name, part) in left_out:
            continue
        module = import_module(f"papers.{name}.{part}")
        if module.compute not in found:
            try:
                with _progress() as progress:
                    track = partial(progress.track, description=f"{name} {part}")
                    found[module.compute] = module.compute(quick=quick, track=track)
            except OSError as error:  # data that cannot be fetched
                say_error(f"{name} {part}: {error}")
                left_out[name, part] = str(error)
                write_index(out, left_out)
                continue
        result = found[module.compute]
        write_whole(out / name / f"{part}.png", figure_png(module.plot(result)))
        shown: dict[str, list[dict[str, object]]] = module.tables(result)
        if rows := [row for row in read_published(name) if row.item == part]:
            shown["_published"] = compare(rows, module.numbers(result))
        for suffix, rows in shown.items():
            write_whole(out / name / f"{part}{suffix}.csv", _csv(rows))
            Console(width=200).print(_table(f"{name} {part}{suffix}", rows))
        write_index(out, left_out)
    if left_out:
        names = ", ".join(f"{name} {part}" for name, part in left_out)
        raise OSError(f"{names} left out of what was written to {out}")
    print(f"written to {out}; see {out / 'index.html'}")


@app.command()
def leaderboard(
    quick: Annotated[bool, typer.Option(help="One draw of each virtual pivot.")] = False,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/papers"),
    angles: Annotated[
        list[Path] | None,
        typer.Option(
            help="Another method's answers: a CSV named after the method, with the columns case "
            "(name of the recording), frame (index of the frame in the recording, from 0; not its "
            "source_index) and angle_deg [°]. Can be given several times.",
            show_default="none",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(
            help="Folder to write the recordings to, with a README.md about the answers.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Compare all methods and the published rivals on virtual pivots and real recordings."""
    from estimation.output.report import figure_png
    from papers.leaderboard import alarms, board, cases, settings

    check_writable(out)
    draws = settings.QUICK_DRAWS if quick else settings.DRAWS
    virtual = [
        cases.virtual_case(name, draw) for name in settings.CONDITIONS for draw in range(draws)
    ]
    virtual += [cases.elongated_case(draw) for draw in range(draws)]
    every = virtual + cases.real_cases(say=say_error)
    others = [answers for path in angles or () for answers in board.read_answers(path, every)]
    if export is not None:
        with renew_results(export, "papers leaderboard --export", say) as results:
            board.export_cases(every, results.draft)
        print(f"{len(every)} recordings exported to {export}; its README.md says how to answer")
    with Progress(console=errors) as progress:
        track = partial(progress.track, description="leaderboard")
        answers = board.answer_all(every, track)
    answers += others
    rows = board.tabulate(answers)
    folder = out / "leaderboard"
    for name, table in (("leaderboard", rows), ("warnings", alarms.tabulate_warnings(draws))):
        write_whole(folder / f"{name}.csv", _csv(table))
        Console(width=200).print(_table(name, table))
    write_whole(folder / "leaderboard.png", figure_png(board.plot(answers, rows)))
    write_whole(folder / "curves.png", figure_png(board.plot_curves(answers)))
    print(f"written to {folder}")


@app.command()
def sheets(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("build/sheets"),
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Draw other frames with this seed, from all videos in the data set's folder.",
            show_default="the frames of the study's table",
        ),
    ] = None,
    clip: Annotated[
        list[str] | None,
        typer.Option(
            help="Every frame of this video, such as lemon/exp_num_2/camera_0, instead of a draw. "
            "Can be given several times.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Make sheets of pictures from which the state of the contact is read by eye.

    They show frames of `state-videos` without any answer of ours; README.md in the folder says how
    to read them, reading.csv is the table to fill in. `run marker_images states` scores ours.
    """
    require_extra("video", "sheets")
    from estimation.frames.datasets import fetch
    from papers.marker_images import reading, settings
    from papers.marker_images import sheets as pages

    check_writable(out)
    root = fetch("state-videos", say)
    if clip:
        drawn = pages.every_frame(root, clip)
    elif seed is None:
        drawn = reading.read_frames()
    else:
        drawn = pages.draw(root, settings.SHEETS._replace(seed=seed))
    with _progress() as progress:
        pages.write_sheets(root, out, drawn, partial(progress.track, description="sheets"))
    print(f"written to {out}")


@app.command()
def sweep(
    study: Annotated[
        str, typer.Argument(help=f"Module of the study: {', '.join(STUDIES)}, or your own.")
    ],
    quick: Annotated[bool, typer.Option(help="Its small table of cases.")] = False,
    store: Annotated[
        Path | None,
        typer.Option(help="Folder of the store.", show_default="build/sweeps/STUDY.zarr"),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes of this machine.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler; its workers do the work.", show_default="none"
        ),
    ] = None,
) -> None:
    """Evaluate a study's cases; an interrupted sweep resumes when it is run again."""
    require_extra("sweeps", f"sweep {study}")
    from papers import sweeps

    path = store or sweeps.store_path(study, quick)
    executor = sweeps.in_process if workers == 1 else sweeps.local_processes(workers)
    if scheduler is not None:
        executor = sweeps.on_cluster(scheduler)
    with _progress() as progress:
        task = progress.add_task(study, total=None)
        results = sweeps.run_sweep(
            study,
            path,
            executor,
            quick=quick,
            tell=lambda finished, total: progress.update(task, completed=finished, total=total),
        )
    print(f"{results.done.sum()} cases done, {len(results.failures)} failed: {path}")
    for row, reason in list(results.failures.items())[:10]:
        print(f"  case {row}: {reason}")


def _without_their_extra(chosen: list[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Items that need an extra that is not installed, and why; each is reported."""
    left_out = {}
    for name, part in chosen:
        try:
            if extra := EXTRAS.get((name, part)):
                require_extra(extra, f"{name} {part}")
        except MissingExtraError as error:
            say_error(str(error))
            left_out[name, part] = str(error)
    return left_out


def _progress() -> Progress:
    """Bar, cases, time gone and time left."""
    return Progress(
        *Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn(), console=errors
    )


def _csv(rows: list[dict[str, object]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _table(title: str, rows: list[dict[str, object]]) -> Table:
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*("–" if value is None else str(value) for value in row.values()))
    return table


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
