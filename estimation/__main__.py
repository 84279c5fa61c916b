"""Command line: `python -m estimation run|live|report|fetch`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from contactmodel.common.command_line import errors, make_app, run_app, say
from contactmodel.common.options import spread
from estimation.choices import Choices, Constants, Known, LiveChoices, RunChoices
from estimation.frames import datasets

app = make_app("From frames of a tactile sensor to the angle of the object it holds.")


@app.command()
@spread
def run(
    choices: RunChoices,
    known: Known,
    constants: Annotated[Any, Constants],
    recordings: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RECORDING|DATASET]...",
            help="Tac3D folders, .npz recordings, videos, folders of images, bags (MCAP, ROS 1, "
            "ROS 2) or data set names; the virtual pivot if none. Pictures "
            "take their times from a table with columns frame and time_s, if there is one: "
            "times.csv in the folder, CLIP.csv beside CLIP.avi.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
    topics: Annotated[
        bool,
        typer.Option(
            "--topics", help="List the topics of bags and the videos of LeRobot sets; run nothing."
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on where the same command was cut off before."),
    ] = False,
) -> None:
    """Estimate the object's angle in recordings and write tables, a summary and a report.

    While it runs, every frame adds its row to unfinished/angles.csv in the folder it writes to.
    """
    from rich.progress import Progress

    from estimation.run import run_all
    from estimation.settings import read_settings
    from estimation.sources import list_contents, open_inputs

    if topics:
        for name in recordings or []:
            for found in list_contents(Path(name)):
                print(found)
        return
    settings = read_settings(choices, known, constants)
    inputs = open_inputs(recordings or [], settings, say, out if resume else None)
    as_json = "json" in settings.sink  # then there is nothing else on standard output
    with Progress(console=errors) as progress:
        outcome = run_all(inputs, out, settings, progress, resume=resume)
    for line in outcome.lines:
        (say if as_json else print)(line)
    raise typer.Exit(130 if outcome.interrupted else 0)


@app.command()
@spread
def live(
    choices: Choices,
    live_choices: LiveChoices,
    known: Known,
    constants: Annotated[Any, Constants],
    source: Annotated[
        str,
        typer.Argument(
            metavar="[SOURCE]",
            show_default="the virtual pivot",
            help="A camera (camera:0), a Tac3D sensor whose desktop program sends to a UDP port "
            "(tac3d:PORT), or a recording as for `run`, which is played.",
        ),
    ] = "",
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with a camera where the same command was cut off."),
    ] = False,
) -> None:
    """Follow a camera, a sensor or a recording that is played, and answer while it goes on.

    Each frame is a line of comma-separated values on standard output. The source is read beside the
    answers: who answers too slowly leaves out the oldest frames, and the end says how many. Ctrl-C
    ends it; then tables, summary and report are made, as by `run`.
    """
    from estimation.live.command import follow
    from estimation.settings import read_settings

    settings = read_settings(choices, known, constants)
    outcome = follow(source, out, settings, live_choices, say, resume)
    for line in outcome.lines:
        say(line)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="Folder that a run writes to, or has written to.")],
) -> None:
    """Make the tables and reports of a run anew from its record, as far as it has got.

    Those of a run that goes on, or was cut off, are written to its folder `unfinished`.
    """
    from estimation.run import report_all

    for line in report_all(folder):
        print(line)


@app.command()
def fetch(
    names: Annotated[
        list[str], typer.Argument(metavar="DATASET...", help=f"{', '.join(datasets.NAMES)}")
    ],
) -> None:
    """Bring published data sets into the cache, unless they are there and intact."""
    for name in names:
        print(datasets.fetch(name, say=say))


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
