"""Command line: `python -m estimation run|live|report|fetch`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from contactmodel.common.command_line import errors, lasting_imports, make_app, run_app, say
from contactmodel.common.options import spread
from estimation.choices import Choices, Constants, Known, LiveChoices, RunChoices
from estimation.frames import datasets

app = make_app(
    "Estimate the angle of an object from the frames of the tactile sensor that holds it."
)


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
            "ROS 2) or data set names; the virtual pivot if none is named. Times of pictures come "
            "from a table with columns frame and time_s, if there is one: times.csv in the folder "
            "of images, CLIP.csv beside CLIP.avi.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
    topics: Annotated[
        bool,
        typer.Option(
            "--topics",
            help="Only list the topics of bags and the videos of LeRobot data sets.",
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Resume the same command after an interruption."),
    ] = False,
) -> None:
    """Estimate the object's angle in recordings and write tables, a summary and a report.

    During the run, each frame adds a row to unfinished/angles.csv in the output folder.
    """
    with lasting_imports():
        from rich.progress import Progress

        from estimation.inputs import open_inputs
        from estimation.output.result_folder import expect_apart
        from estimation.run import run_all
        from estimation.settings import read_settings
        from estimation.sources import list_contents

    if topics:
        for name in recordings or []:
            for content in list_contents(Path(name)):
                print(content)
        return
    settings = read_settings(choices, known, constants)
    expect_apart(recordings or [], out)
    inputs = open_inputs(recordings or [], settings, say, out if resume else None)
    as_json = "json" in settings.sink  # standard output then carries JSON only
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
            "(tac3d:PORT), or a recording to play, as for `run`.",
        ),
    ] = "",
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Resume the same command on a camera after an interruption."),
    ] = False,
) -> None:
    """Estimate angles live from a camera, a sensor or a recording that is played.

    Each frame prints a line of comma-separated values on standard output. If estimation is slower
    than the source, the oldest waiting frames are dropped, and their number is printed at the end.
    Ctrl-C ends the run and writes tables, a summary and a report, as `run` does.
    """
    with lasting_imports():
        from estimation.live.command import follow
        from estimation.output.result_folder import expect_apart
        from estimation.settings import read_settings

    settings = read_settings(choices, known, constants)
    expect_apart([source] if source else [], out)
    outcome = follow(source, out, settings, live_choices, say, resume)
    for line in outcome.lines:
        say(line)
    raise typer.Exit(130 if outcome.interrupted else 0)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="Output folder of a run, finished or not.")],
) -> None:
    """Rebuild the tables and reports of a run from its record.

    Reports of a run that is still going on or was interrupted go to `unfinished` in its output
    folder.
    """
    from estimation.run import report_all

    for line in report_all(folder):
        print(line)


@app.command()
def fetch(
    names: Annotated[
        list[str], typer.Argument(metavar="DATASET...", help=f"{', '.join(datasets.list_names())}")
    ],
) -> None:
    """Download published data sets to the cache, unless it holds them intact."""
    for name in names:
        print(datasets.fetch(name, log=say))


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
