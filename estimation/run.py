"""Run the estimators over recordings and write what they find, so that nothing done is lost."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.progress import Progress

from estimation.estimators import DEFAULT_METHOD, METHODS
from estimation.estimators.grasp import compare_fingers
from estimation.estimators.result import Estimate, Result, State
from estimation.fields.contact import SHARE
from estimation.fields.outline import OutlineFollower
from estimation.frames import datasets
from estimation.frames.names import name_recordings, number_alike
from estimation.frames.noise import Noise, find_noise
from estimation.frames.recording import ONSET_MM, Recording
from estimation.live import LiveAngles
from estimation.output.missing import describe_answers
from estimation.output.overview import write_overview
from estimation.output.preview import find_encoder, write_preview
from estimation.output.report import FIRM_MARKERS, Run, write_run
from estimation.output.result_folder import renew_results
from estimation.pictures.reader import ImageSettings
from estimation.pictures.stream import is_camera, is_pictures
from estimation.slip.lookback import FOLLOWING, find_slips, withdraw
from estimation.slip.margin import follow_margin
from estimation.slip.motion import describe_counts
from estimation.slip.onset import describe_slips
from estimation.softness import Softness
from estimation.sources import find_recordings, read_recording
from estimation.tracker import RIGID_OBJECT, STICK_SHARE, Trackers
from estimation.virtual.recording import Truth, simulate_pivot


@dataclass(frozen=True)
class Settings:
    """What a run is told.

    Attributes:
        method: the method of `angles.csv`; the others stand beside it in `angles_all.csv`.
        softness: correction by Eq. (13), for every method.
        noise: of the markers; estimated from each recording unless given.
        seed: of the virtual pivot.
        onset_mm: displacement of the stick centre from which there is contact [mm].
        contact_share: share of the largest normal displacement that bounds the contact [-].
        stick_share: share of the contact's markers from which the state is `stick` [-].
        constants: of the chosen method.
        images: what is known of pictures.
        preview: write an annotated video of each recording that was read from pictures.
        grasp: the two recordings are two fingers that hold one object.
        keep_withdrawn: leave angles in that the whole recording speaks against.

    Raises:
        ValueError: a preview is wanted, and PyAV or its H.264 encoder is not installed.
    """

    method: str = DEFAULT_METHOD
    softness: Softness = RIGID_OBJECT
    noise: Noise | None = None
    seed: int = 0
    onset_mm: float = ONSET_MM
    contact_share: float = SHARE
    stick_share: float = STICK_SHARE
    constants: Mapping[str, Any] = field(default_factory=dict)
    images: ImageSettings = field(default_factory=ImageSettings)
    preview: bool = False
    grasp: bool = False
    keep_withdrawn: bool = False

    def __post_init__(self) -> None:
        """Check that a preview can be written before anything is computed."""
        if self.preview:
            find_encoder()


class Input(NamedTuple):
    """A recording to run, with the truth if it is a virtual one."""

    recording: Recording
    truth: Truth | None = None


class Outcome(NamedTuple):
    """What to tell the user, and whether the run was interrupted."""

    lines: list[str]
    interrupted: bool


def gather_recordings(
    names: Sequence[str],
    settings: Settings,
    say: Callable[[str], None],
    answer: Callable[[str], None] | None = None,
) -> list[Input]:
    """Read every recording that was asked for, before anything is computed.

    A camera is read until it goes or Ctrl-C comes.

    Args:
        names: paths of recordings or names of data sets; none for the virtual pivot.
        settings: for the virtual pivot's seed, and what a camera's pictures are answered with.
        say: told what a data set's fetching has to say, and what is assumed about a recording or
            looks wrong with it.
        answer: told the angle of each picture of a camera as it comes, as a line.

    Returns:
        The recordings, each with a name of its own: that of its file or folder, and as much of what
        is above it as tells it apart.

    Raises:
        ValueError: what is there is no recording, or a data set cannot be fetched.
        OSError: a file cannot be read.
    """
    if not names:
        return [Input(*simulate_pivot(seed=settings.seed))]
    paths: list[Path] = []
    for name in names:
        is_dataset = name in datasets.NAMES and not Path(name).exists()
        paths += find_recordings(datasets.fetch(name, say=say) if is_dataset else Path(name))
    inputs = []
    for path, name in zip(paths, name_recordings(paths), strict=True):
        watch = _answer_live(settings, answer) if answer and is_camera(path) else None
        recording = replace(read_recording(path, settings.images, watch), name=name)
        for warning in recording.warnings:
            say(f"{name}: {warning}")
        inputs.append(Input(recording))
    return inputs


def _answer_live(settings: Settings, answer: Callable[[str], None]) -> LiveAngles:
    return LiveAngles(
        answer,
        settings.method,
        noise=settings.noise,
        **_tracking(settings),
        **settings.constants,
    )


def run_all(inputs: Sequence[Input], out: Path, settings: Settings, progress: Progress) -> Outcome:
    """Run every method over every recording and write what was found.

    One recording is written to `out` itself, several to a folder each, named after the recording.
    Ctrl-C ends the run early: what was computed is written, and so labelled.

    Raises:
        ValueError: a wrong setting.
        OSError: something cannot be written; what was written before stays.
    """
    if settings.grasp and len(inputs) != 2:
        raise ValueError(f"a grasp takes the recordings of two fingers, not {len(inputs)}")
    names = number_alike([recording.name for recording, _ in inputs])
    inputs = [
        Input(replace(recording, name=name), truth)
        for name, (recording, truth) in zip(names, inputs, strict=True)
    ]
    prepared = [_prepare(recording, settings) for recording, _ in inputs]
    lines: list[str] = []
    runs: list[Run] = []
    interrupted = False
    with renew_results(out, "estimation run", lines.append) as results:
        for i, (recording, truth) in enumerate(inputs):
            estimates, interrupted = _estimate(recording, prepared[i], progress)
            if estimates:
                run = _put_together(recording, truth, settings, prepared[i], estimates)
                inner = names[i] if len(inputs) > 1 else ""
                summary = write_run(run, results.draft / inner)
                runs.append(run)
                lines += _tell(run, summary, out / inner)
                if settings.preview:
                    lines.append(_preview(run, results.draft / inner, out / inner, settings))
                results.publish()
            if interrupted:
                lines.append("interrupted: the frames done so far are written")
                results.keep_earlier()
                break
        if len(runs) > 1:
            lines += _put_side_by_side(runs, results.draft, settings)
            lines.append(f"side by side: {out / 'report.html'}")
    return Outcome(lines, interrupted)


def _tracking(settings: Settings) -> dict[str, Any]:
    """What trackers are told beside the noise and a method's constants."""
    return {
        "softness": settings.softness,
        "onset_mm": settings.onset_mm,
        "contact_share": settings.contact_share,
        "stick_share": settings.stick_share,
    }


class _Prepared(NamedTuple):
    """Trackers of a recording, the noise they were told, and what to note about it."""

    trackers: Trackers
    noise: Noise | None
    notes: tuple[str, ...]
    outline: OutlineFollower


def _prepare(recording: Recording, settings: Settings) -> _Prepared:
    noise, notes = (settings.noise, ()) if settings.noise else find_noise(recording)
    methods = {settings.method: settings.constants}
    methods |= {method: {} for method in METHODS if method != settings.method}
    trackers = Trackers(recording.layout, methods, noise=noise, **_tracking(settings))
    return _Prepared(trackers, noise, notes, OutlineFollower())


def _estimate(
    recording: Recording, prepared: _Prepared, progress: Progress
) -> tuple[list[dict[str, Estimate]], bool]:
    """Per frame the estimates by method, and whether Ctrl-C came before the last frame."""
    estimates: list[dict[str, Estimate]] = []
    try:
        for frame in progress.track(recording, len(recording), description=recording.name):
            estimate = prepared.trackers.update(frame)
            seen = prepared.trackers.observation
            prepared.outline.update(None if seen is None else seen.fields)
            estimates.append(estimate)
    except KeyboardInterrupt:
        return estimates, True
    return estimates, False


def _put_together(
    recording: Recording,
    truth: Truth | None,
    settings: Settings,
    prepared: _Prepared,
    estimates: list[dict[str, Estimate]],
) -> Run:
    done = len(estimates)
    notes = prepared.notes
    if done < len(recording):
        notes += (f"Interrupted: {done} of {len(recording)} frames were done.",)
        recording = recording.head(done)
        truth = None if truth is None else truth.take(slice(done))
    results = {
        method: Result.gather(method, [estimate[method] for estimate in estimates])
        for method in estimates[0]
    }
    noise, outline = prepared.noise, prepared.outline.outline(recording).angle
    slips = [] if noise is None else find_slips(recording, results[settings.method], noise)
    results |= {
        method: withdraw(results[method], slips, outline, keep=settings.keep_withdrawn)
        for method in FOLLOWING
    }
    main = results[settings.method]
    notes += _reference_notes(main)
    notes += describe_counts(main)
    notes += _softness_notes(main)
    notes += describe_slips(slips, recording.time[0])
    return Run(
        recording=recording,
        results=results,
        method=settings.method,
        outline=outline,
        settings={
            "seed": settings.seed if truth is not None else None,
            "noise_in_plane_um" if recording.unit == "mm" else "noise_in_plane_millipx": (
                None if noise is None else round(1e3 * noise.in_plane, 4)
            ),
            "noise_from": "given" if settings.noise else "recording" if noise else "misfit",
            "softness": settings.softness.content(),
            "onset_mm": settings.onset_mm,
            "contact_share": settings.contact_share,
            "stick_share": settings.stick_share,
            "keep_withdrawn": settings.keep_withdrawn,
            **prepared.trackers.constants[settings.method],
        },
        notes=notes,
        truth=truth,
        slips=slips,
        margin=follow_margin(main),
    )


def _reference_notes(result: Result) -> tuple[str, ...]:
    """What the angles are relative to, where that is not plain."""
    states = [state for state in result.state if state != State.UNKNOWN]
    if not states:
        return ("No frame of this recording can be used.",)
    if all(state == State.NO_CONTACT for state in states):
        return (f"There is no contact in the {len(states)} usable frames of {len(result.state)}.",)
    if states[0] != State.NO_CONTACT:
        start = "There is contact from the first usable frame on: "
        first = next(i for i, state in enumerate(result.state) if state != State.UNKNOWN)
        if result.anew[first]:
            return (
                start + "it had already slipped against the unloaded reference shape, so angles "
                "are counted from that frame.",
            )
        return (
            start + "angles are relative to the unloaded reference shape that came with the "
            "recording, not to that frame, and what the object turned before it stuck is not in "
            "them.",
        )
    return ("Angles are relative to the unloaded reference shape, from the onset of contact on.",)


def _softness_notes(result: Result) -> tuple[str, ...]:
    """Where the object's softness is told beyond the contacts that it was found on."""
    beyond = int((result.answered & ~result.covered).sum())
    if not beyond:
        return ()
    return (
        f"{beyond} of {int(result.answered.sum())} angles are of contacts unlike those that the "
        "softness was found on (turned further, pressed otherwise or of another size): they and "
        "their intervals are extrapolated.",
    )


def _put_side_by_side(runs: Sequence[Run], folder: Path, settings: Settings) -> list[str]:
    """Write the angles of several recordings side by side, and two fingers as one grasp.

    Where the fingers cannot be brought together, the report and a line say so.
    """
    if not settings.grasp or len(runs) != 2:
        write_overview(runs, folder)
        return []
    try:
        grasp = compare_fingers(*(run.results[run.method] for run in runs))
    except ValueError as error:
        note = f"no comparison: {error}"
        write_overview(runs, folder, note=note)
        return [note]
    write_overview(runs, folder, grasp)
    return [
        f"the fingers differ by {np.degrees(fit.rms):.3f}° rms before macro slip, {what}, clock "
        f"offset {fit.clock_offset:.3f} ± {fit.errors[1]:.3f} s"
        for fit, what in (
            (grasp.fixed, "slope 1"),
            (grasp.free, f"slope {grasp.free.slope:.3f} ± {grasp.free.errors[0]:.3f}"),
        )
    ]


def _preview(run: Run, folder: Path, shown: Path, settings: Settings) -> str:
    """Write the annotated video, where the recording was read from pictures.

    Args:
        run: of the recording.
        folder: to write to.
        shown: the folder that it is published in.
        settings: of the run.
    """
    name = "preview.mp4"
    if not is_pictures(Path(run.recording.source)):
        return f"no preview: {run.recording.name} was not read from pictures"
    told, result = settings.images, run.results[run.method]
    try:
        write_preview(run.recording, result, told.sensor, folder / name, told.rig)
    except ValueError as error:
        return f"no preview: {error}"
    return f"annotated video: {shown / name}"


def _tell(run: Run, summary: dict[str, Any], folder: Path) -> list[str]:
    """Lines for the terminal."""
    main = run.results[run.method]
    lines = [f"{run.recording.name}: {describe_answers(main)}; see {folder / 'report.html'}"]
    if not main.answered.any():
        lines += [f"  {note}" for note in (*run.recording.notes, *run.notes)]
    if run.truth is not None:
        for name, figures in summary["methods"].items():
            firm, all_answered = (
                "–" if error is None else f"{error:.4f}°"
                for error in (
                    figures["mean_absolute_error_firm_deg"],
                    figures["mean_absolute_error_deg"],
                )
            )
            lines.append(
                f"  {name}: mean absolute error {firm} where {FIRM_MARKERS} markers or more have "
                f"always stuck ({figures['answered_firm']} of {figures['firm_frames']} frames "
                f"answered), {all_answered} over all {figures['answered']} answers"
            )
    return lines
