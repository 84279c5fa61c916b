"""Command line: `python -m estimation run|fetch`."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from contactmodel.common.command_line import errors, make_app, run_app, say
from estimation.estimators import DEFAULT_METHOD, METHODS, RIVALS
from estimation.fields.contact import SHARE
from estimation.frames import datasets
from estimation.frames.recording import ONSET_MM
from estimation.pictures.kinds import MARKER_KINDS
from estimation.tracker import RIGID_OBJECT, STICK_SHARE, method_constants

app = make_app("From frames of a tactile sensor to the angle of the object it holds.")


def _constants(name: str) -> str:
    """Defaults of a constant, with the methods that have it."""
    methods: dict[Any, list[str]] = {}
    for method in METHODS | RIVALS:
        own = method_constants(method)
        if name in own:
            methods.setdefault(own[name], []).append(method)

    def show(value: Any) -> str:
        return ("off", "on")[value] if isinstance(value, bool) else f"{value:.4g}"

    return "; ".join(f"{show(value)} {', '.join(those)}" for value, those in methods.items())


@app.command()
def run(
    recordings: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RECORDING|DATASET]...",
            help="Tac3D folders, .npz recordings, videos, folders of images, cameras (camera:0) "
            "or data set names; the virtual pivot if none. Pictures take their times from a table "
            "with columns frame and time_s, if there is one: times.csv in the folder, CLIP.csv "
            "beside CLIP.avi.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("out"),
    method: Annotated[
        str, typer.Option(help=f"Method of angles.csv: {', '.join(METHODS | RIVALS)}.")
    ] = DEFAULT_METHOD,
    softness: Annotated[
        Path | None,
        typer.Option(
            help="TOML file with the softness correction k, L.", show_default="a rigid object"
        ),
    ] = None,
    grasp: Annotated[
        bool, typer.Option("--grasp", help="Two recordings of fingers that hold one object.")
    ] = False,
    keep_withdrawn: Annotated[
        bool,
        typer.Option(
            "--keep-withdrawn",
            help="Keep the angles that were reported while the object may have been sliding "
            "unnoticed. By default they are moved to the columns withdrawn_… of angles.csv.",
        ),
    ] = False,
    sensor: Annotated[
        Path | None,
        typer.Option(
            help="TOML file that describes the sensor; options override it.", show_default="none"
        ),
    ] = None,
    mm_per_px: Annotated[
        float | None,
        typer.Option(help="Scale [mm/px].", show_default="lengths stay in px"),
    ] = None,
    dot_radius_px: Annotated[
        float | None,
        typer.Option(help="Radius of the dots [px].", show_default="detected"),
    ] = None,
    dark_dots: Annotated[
        bool | None,
        typer.Option(
            "--dark/--bright",
            help="Dots that are darker or brighter than the pad.",
            show_default="detected",
        ),
    ] = None,
    unloaded_frame: Annotated[
        int | None,
        typer.Option(
            help="Number of an unloaded frame: the number in the picture's name, or counted from 0 "
            "(angles.csv: source_index).",
            show_default="detected",
        ),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(
            help="Rate of the pictures of a folder without times.csv [1/s].",
            show_default="30, with a warning",
        ),
    ] = None,
    marker: Annotated[
        str | None,
        typer.Option(help=f"Kind of markers: {', '.join(MARKER_KINDS)}.", show_default="detected"),
    ] = None,
    stereo: Annotated[
        Path | None,
        typer.Option(
            help="TOML file of a stereo calibration, where mirrors split the picture.",
            show_default="one view",
        ),
    ] = None,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="Write an annotated video, preview.mp4 (needs the extra `video`).",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the virtual pivot.")] = 0,
    noise_um: Annotated[
        float | None,
        typer.Option(
            help="Marker noise per in-plane coordinate [µm].", show_default="from the recording"
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Eq. 15's threshold [-].", show_default=_constants("threshold")),
    ] = None,
    angle_floor_deg: Annotated[
        float | None,
        typer.Option(
            help="Least denominator of Eq. 15 [°].", show_default=_constants("angle_floor_deg")
        ),
    ] = None,
    min_stick_markers: Annotated[
        int | None,
        typer.Option(
            help="Fewest markers that stick before macro slip [-].",
            show_default=_constants("min_stick_markers"),
        ),
    ] = None,
    window: Annotated[
        int | None,
        typer.Option(help="Trailing mean of `paper` [frames].", show_default=_constants("window")),
    ] = None,
    zero_drift: Annotated[
        bool | None,
        typer.Option(
            help="Zero-drift compensation of `paper`.", show_default=_constants("zero_drift")
        ),
    ] = None,
    max_strain: Annotated[
        float | None,
        typer.Option(
            help="Relative misfit above which markers do not move as one body [-].",
            show_default=_constants("max_strain"),
        ),
    ] = None,
    keyframe_interval: Annotated[
        int | None,
        typer.Option(
            help="Interval between keyframes [frames].",
            show_default=_constants("keyframe_interval"),
        ),
    ] = None,
    mature_age: Annotated[
        int | None,
        typer.Option(
            help="How long markers must move together to count as sticking [frames].",
            show_default=_constants("mature_age"),
        ),
    ] = None,
    slip_deg: Annotated[
        float | None,
        typer.Option(
            help="Lead of the contact's outline over the gel, gained within --mature-age, that "
            "counts as macro slip [°].",
            show_default=_constants("slip_deg"),
        ),
    ] = None,
    shape_change: Annotated[
        float | None,
        typer.Option(
            help="Relative change of the contact's curvature at which its outline is no longer "
            "followed [-].",
            show_default=_constants("shape_change"),
        ),
    ] = None,
    onset_mm: Annotated[
        float, typer.Option(help="Displacement from which there is contact [mm].")
    ] = ONSET_MM,
    contact_share: Annotated[
        float, typer.Option(help="Share of the largest indentation that bounds the contact [-].")
    ] = SHARE,
    stick_share: Annotated[
        float, typer.Option(help="Share of the contact that sticks in state `stick` [-].")
    ] = STICK_SHARE,
) -> None:
    """Estimate the object's angle in recordings and write tables, a summary and a report."""
    from rich.progress import Progress

    from estimation.frames.noise import Noise
    from estimation.pictures.reader import ImageSettings
    from estimation.pictures.rig import read_rig
    from estimation.pictures.sensor import Sensor, read_sensor
    from estimation.run import Settings, gather_recordings, run_all
    from estimation.softness import read_softness

    constants = {
        "threshold": threshold,
        "angle_floor_deg": angle_floor_deg,
        "min_stick_markers": min_stick_markers,
        "window": window,
        "zero_drift": zero_drift,
        "max_strain": max_strain,
        "keyframe_interval": keyframe_interval,
        "mature_age": mature_age,
        "slip_deg": slip_deg,
        "shape_change": shape_change,
    }
    told = {"mm_per_px": mm_per_px, "radius": dot_radius_px, "dark": dark_dots, "marker": marker}
    described = replace(
        Sensor() if sensor is None else read_sensor(sensor),
        **{name: value for name, value in told.items() if value is not None},
    )
    settings = Settings(
        method=method,
        softness=RIGID_OBJECT if softness is None else read_softness(softness),
        noise=described.noise if noise_um is None else Noise.given(noise_um * 1e-3),
        seed=seed,
        onset_mm=onset_mm,
        contact_share=contact_share,
        stick_share=stick_share,
        images=ImageSettings(
            described, unloaded_frame, None if stereo is None else read_rig(stereo), fps
        ),
        preview=preview,
        grasp=grasp,
        keep_withdrawn=keep_withdrawn,
        constants={name: value for name, value in constants.items() if value is not None},
    )
    inputs = gather_recordings(
        recordings or [], settings, say=say, answer=partial(print, flush=True)
    )
    with Progress(console=errors) as progress:
        outcome = run_all(inputs, out, settings, progress)
    for line in outcome.lines:
        print(line)
    raise typer.Exit(130 if outcome.interrupted else 0)


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
