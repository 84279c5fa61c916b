"""Command line: `python -m calibration noise|stereo`."""

import sys
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console
from rich.markup import escape

from calibration.noise import assess_noise
from calibration.stereo import calibrate_from_pictures
from estimation.files import check_writable, toml_text, write_whole
from estimation.images.stereo import write_rig
from estimation.sources import read_recording

app = typer.Typer(
    help="What must be found out about sensor and object before angles can be trusted.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
console = Console(stderr=True)


@app.callback()
def calibrate() -> None:
    """What must be found out about sensor and object before angles can be trusted."""


@app.command()
def noise(
    recording: Annotated[Path, typer.Argument(help="Ten seconds of the sensor at rest.")],
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
) -> None:
    """Find the noise of a sensor at rest and write it to noise.toml."""
    check_writable(out)
    found = assess_noise(read_recording(recording))
    write_whole(out / "noise.toml", toml_text(found))
    print(f"written to {out / 'noise.toml'}")


@app.command()
def stereo(
    pictures: Annotated[Path, typer.Argument(help="Pictures of a plane checkerboard in poses.")],
    rows: Annotated[int, typer.Option(help="Rows of its inner corners.")],
    columns: Annotated[int, typer.Option(help="Columns of its inner corners.")],
    pitch_mm: Annotated[float, typer.Option(help="Side of its cells [mm].")],
    orthographic: Annotated[
        bool, typer.Option("--orthographic/--perspective", help="The left view.")
    ] = True,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
) -> None:
    """Calibrate both views of a mirror-split picture and write them to stereo.toml."""
    check_writable(out)
    rig, left_out = calibrate_from_pictures(pictures, (rows, columns), pitch_mm, orthographic)
    write_rig(rig, out / "stereo.toml")
    for reason in left_out:
        console.print(escape(reason))
    print(f"reprojection error {rig.error:.3f} px rms, written to {out / 'stereo.toml'}")


def main() -> None:
    """Run the command line; what is wrong with the input goes to stderr, exit status 2."""
    jax.config.update("jax_enable_x64", True)
    try:
        app()
    except (ValueError, OSError) as error:
        console.print(f"[red]error:[/red] {escape(str(error))}", highlight=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
