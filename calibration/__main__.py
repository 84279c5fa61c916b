"""Command line: `python -m calibration noise|sensor|softness|squeeze|field|design|stereo`."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Annotated, Any

import typer

from calibration.softness.choices import SoftnessChoices, SqueezeChoices
from contactmodel.common.command_line import errors, make_app, run_app, say
from contactmodel.common.options import spread
from estimation.frames.files import check_writable
from estimation.frames.recording import Recording
from estimation.output.result_folder import renew_results

app = make_app("Measure the properties of sensor and object that angles depend on.")
_Out = Annotated[Path, typer.Option(help="Folder to write to.")]
_Sensor = Annotated[
    Path | None,
    typer.Option(
        help="TOML file that describes the sensor; options override its values.",
        show_default="none",
    ),
]


@app.command()
def noise(
    recording: Annotated[
        str, typer.Argument(help="Recording of the sensor at rest, ten seconds or more.")
    ],
    out: _Out = Path("out"),
    sensor: _Sensor = None,
) -> None:
    """Estimate the noise of a sensor at rest; write sensor.toml, noise.json and a report."""
    from calibration.noise import assess_noise, write_noise

    check_writable(out)
    known = _describe(sensor)
    (at_rest,) = _read([recording], known)
    rest_noise = assess_noise(at_rest)
    with renew_results(out, "calibration noise", say) as results:
        lines = write_noise(rest_noise, known, results.draft)
    _conclude(lines, out, "sensor.toml", "noise.json")


@app.command()
@spread
def softness(
    choices: SoftnessChoices,
    recordings: Annotated[
        list[str],
        typer.Argument(
            metavar="RECORDING|DATASET...", help="Recordings of grasps in which the object turns."
        ),
    ],
    out: _Out = Path("out"),
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="Reference angles: a CSV (time_s, angle_deg), or `outline`. Repeat the option to "
            "give a CSV for each recording.",
            show_default="none",
        ),
    ] = None,
    object_name: Annotated[
        list[str] | None,
        typer.Option(
            "--object",
            help="Name of the object: once for all recordings, or once for each.",
            show_default="object",
        ),
    ] = None,
    sensor: _Sensor = None,
) -> None:
    """Fit stiffness ratio k and load term L to reference angles; write softness.toml and report."""
    from rich.progress import Progress

    from calibration.softness.readings import layer_of
    from calibration.softness.report import (
        fit_objects,
        gather_grasps,
        write_fits,
        write_two_fingers,
    )
    from contactmodel.elasticity.pad import Pad, complete_pad
    from estimation.frames.noise import Noise

    check_writable(out)
    choices.expect_used(reference or [], object_name or [])
    known, search = _describe(sensor), choices.clock_search
    noise = known.noise if choices.noise_um is None else Noise.from_std(choices.noise_um * 1e-3)
    pad = Pad(thickness=choices.thickness_mm, marker_depth=choices.depth_mm)
    layer = layer_of(complete_pad(pad, known.pad), choices.shape.lengths)
    loaded, files = _read(recordings, known), ["softness.toml"]
    with renew_results(out, "calibration softness", say) as results:
        if choices.k_ratio is not None:
            lines = write_two_fingers(loaded, choices.k_ratio, noise, search, results.draft)
            files = ["first.toml", "second.toml"]
        else:
            grasps = gather_grasps(
                loaded, reference or [], object_name or [], choices.references, noise
            )
            with Progress(console=errors) as progress:
                track = partial(progress.track, description="recordings")
                fits = fit_objects(grasps, choices.load, search, layer, track)
            lines = write_fits(fits, results.draft)
    _conclude(lines, out, *files)


@app.command()
@spread
def squeeze(
    choices: SqueezeChoices,
    source: Annotated[
        str,
        typer.Argument(
            metavar="CSV|RECORDING",
            help="CSV (travel_mm, indentation_mm), or a recording of a sphere pressed on the pad.",
        ),
    ],
    out: _Out = Path("out"),
    sensor: _Sensor = None,
) -> None:
    """Fit the stiffness ratio k by pressing, to the gripper's travel or the contact's curvature."""
    from calibration.softness.squeeze import (
        Bodies,
        read_travel,
        squeeze_by_curvature,
        squeeze_by_travel,
        write_squeeze,
    )
    from contactmodel.elasticity.pad import Pad, complete_pad

    check_writable(out)
    choices.expect_used(source)
    known = _describe(sensor)
    chosen = Pad(poisson_ratio=choices.poisson_ratio, dome_radius=choices.pad_radius_mm)
    pad = complete_pad(chosen, known.pad)
    ratio = {} if pad.poisson_ratio is None else {"poisson_ratio": pad.poisson_ratio}
    bodies = Bodies(object_poisson=choices.object_poisson, **ratio)
    if source.endswith(".csv"):
        readings = read_travel(Path(source))
        fit = squeeze_by_travel(*readings, bodies, choices.pressing, source=source)
    elif choices.radius_mm is None:
        raise ValueError(
            "a recording requires --radius-mm, the radius of the sphere pressed on the pad"
        )
    else:
        (recording,) = _read([source], known)
        dome = inf if pad.dome_radius is None else pad.dome_radius
        fit = squeeze_by_curvature(recording, choices.radius_mm, bodies, pad_radius=dome)
    with renew_results(out, "calibration squeeze", say) as results:
        lines = write_squeeze(fit, results.draft)
    _conclude(lines, out, "softness.toml")


def _conclude(lines: Iterable[str], out: Path, *files: str) -> None:
    """Print the findings and the files that hold them."""
    for line in lines:
        print(line)
    written = " and ".join(str(out / file) for file in files)
    print(f"written to {written}; see {out / 'report.html'}")


def _describe(sensor: Path | None) -> Any:
    """The `Sensor` that a file describes, or an unknown one without a file."""
    from estimation.pictures.sensor import Sensor, read_sensor

    return Sensor() if sensor is None else read_sensor(sensor)


def _read(names: list[str], sensor: Any) -> list[Recording]:
    """Read recordings by path or data set; their pictures are those of a sensor."""
    from estimation.pictures.reader import ImageSettings
    from estimation.sources import find_paths, read_recordings

    return read_recordings(find_paths(names, say), ImageSettings(sensor), say)


@app.command()
def stereo(
    pictures: Annotated[
        Path, typer.Argument(help="Folder of pictures of a flat checkerboard in several poses.")
    ],
    rows: Annotated[int, typer.Option(min=2, help="Rows of inner corners of the checkerboard.")],
    columns: Annotated[
        int, typer.Option(min=2, help="Columns of inner corners of the checkerboard.")
    ],
    pitch_mm: Annotated[float, typer.Option(help="Side of a cell of the checkerboard [mm].")],
    orthographic: Annotated[
        bool, typer.Option("--orthographic/--perspective", help="Model of the left view.")
    ] = True,
    mirrored: Annotated[
        list[str] | None,
        typer.Option(
            help="Mirrored view: left or right. Repeat the option for both.", show_default="none"
        ),
    ] = None,
    out: _Out = Path("out"),
) -> None:
    """Calibrate both views of a mirror-split picture and write them to stereo.toml."""
    from calibration.stereo import calibrate_from_pictures
    from estimation.pictures.rig import write_rig

    check_writable(out)
    rig, left_out = calibrate_from_pictures(
        pictures, (rows, columns), pitch_mm, orthographic, tuple(mirrored or ())
    )
    with renew_results(out, "calibration stereo", say) as results:
        write_rig(rig, results.draft / "stereo.toml")
    for reason in left_out:
        say(reason)
    print(f"reprojection error {rig.error:.3f} px rms, written to {out / 'stereo.toml'}")


_EXPERIMENT = typer.Option(help="TOML file, or a shipped example: tac3d_press, soft_ball.")


@app.command()
def field(
    recording: Annotated[str, typer.Argument(help="Recording, or name of a data set.")],
    experiment: Annotated[str, _EXPERIMENT],
    out: _Out = Path("out"),
    starts: Annotated[
        int,
        typer.Option(
            min=1,
            help="Number of starting points of the fit. Larger values find the best fit more "
            "reliably.",
        ),
    ] = 1,
    sensor: _Sensor = None,
) -> None:
    """Fit properties of pad and contact to measured fields and forces; write sensor.toml."""
    from calibration.experiment import read_experiment
    from calibration.field_fit import fit_fields
    from calibration.field_report import find_pad, format_numbers, write_fit
    from estimation.pictures.sensor import write_sensor

    check_writable(out)
    known = _describe(sensor)
    plan = read_experiment(experiment, known.pad)
    model, data = plan.of(_read([recording], known)[0])
    with errors.status("compiling and fitting"):
        fit = fit_fields(
            model,
            plan.numbers,
            data,
            discrepancy=plan.finite_strain,
            starts=starts,
            log=say,
        )
    pad = find_pad(fit, known.pad)
    with renew_results(out, "calibration field", say) as results:
        write_fit(fit, data, model.markers, plan.frames, results.draft)
        if pad is not None:
            write_sensor(replace(known, pad=pad), results.draft / "sensor.toml")
    for line in (*format_numbers(fit), *fit.verdict):
        print(line)
    print(f"written to {out / 'report.html'}")
    if pad is not None:
        print(f"the pad's numbers are in {out / 'sensor.toml'}; use it with --sensor")


@app.command()
def design(
    experiment: Annotated[str, _EXPERIMENT],
    out: _Out = Path("out"),
    sensor: _Sensor = None,
) -> None:
    """Predict which numbers a planned experiment determines, and how to improve it."""
    from calibration.experiment import read_experiment
    from calibration.field_report import write_design
    from calibration.field_result import NOT_COVERED
    from calibration.identifiability import identify

    check_writable(out)
    plan = read_experiment(experiment, _describe(sensor).pad)
    model, data = plan.plan()
    with errors.status("compiling and solving"):
        prediction = identify(model, plan.numbers, data, plan.design)
    with renew_results(out, "calibration design", say) as results:
        write_design(prediction, results.draft)
    pairs = zip(prediction.names, prediction.determined, strict=True)
    lost = [name for name, determined in pairs if not determined]
    print(f"not determined: {', '.join(lost)}" if lost else "all unknown numbers are determined")
    if not prediction.covered:
        say(NOT_COVERED)
    print(f"written to {out / 'report.html'}")


@app.command("sensor")
def calibrate(
    unloaded: Annotated[
        Path, typer.Argument(help="Folder of pictures of the pad without contact.")
    ],
    pitch_mm: Annotated[
        float | None,
        typer.Option(
            help="Distance between neighbouring dots [mm].", show_default="lengths stay in px"
        ),
    ] = None,
    boards: Annotated[
        Path | None,
        typer.Option(
            help="Folder of pictures of a checkerboard in several poses; calibrates the lens.",
            show_default="no lens is calibrated",
        ),
    ] = None,
    rows: Annotated[
        int, typer.Option(min=2, help="Rows of inner corners of the checkerboard.")
    ] = 6,
    columns: Annotated[
        int, typer.Option(min=2, help="Columns of inner corners of the checkerboard.")
    ] = 9,
    out: _Out = Path("out"),
    sensor: _Sensor = None,
) -> None:
    """Calibrate lens, scale, marker layout and noise; write sensor.toml and a report."""
    from calibration.sensor import calibrate_sensor, fit_lens, write_calibration

    check_writable(out)
    lens, lines = None, []
    with errors.status("detecting boards and dots"):
        if boards is not None:
            lens, error = fit_lens(boards, (rows, columns))
            lines.append(f"Lens: reprojection error {error:.3f} px rms.")
        calibrated = calibrate_sensor(unloaded, pitch_mm, lens, _describe(sensor))
    with renew_results(out, "calibration sensor", say) as results:
        write_calibration(calibrated, lines, results.draft)
    _conclude((*lines, *calibrated.remarks), out, "sensor.toml")


def main() -> None:
    """Run the command line."""
    run_app(app)


if __name__ == "__main__":
    main()
