"""Run the estimators over recordings and streams and write what they find as they find it."""

import shutil
import time
from collections.abc import Sequence, Sized
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.progress import Progress

from estimation.estimators.grasp import compare_fingers
from estimation.frames.noise import expect_unit
from estimation.output.answer import describe_run
from estimation.output.found import Run, find_in_record
from estimation.output.missing import describe_answers
from estimation.output.overview import write_overview
from estimation.output.preview import find_encoder, write_preview
from estimation.output.record import NAME, RecordReader, RecordWriter
from estimation.output.report import FIRM_MARKERS, summarise, write_run
from estimation.output.result_folder import MANIFEST, ResultFolder, renew_results
from estimation.output.sinks.by_name import check_sinks, finish_files, growing_files, open_sinks
from estimation.output.table import TableWriter
from estimation.pictures.reading import PictureSource
from estimation.pictures.stream import is_pictures
from estimation.settings import Settings
from estimation.sources import UNFINISHED, Input, identity_of, name_folders
from estimation.tracking.stream import Sink, Stream, make_trackers

CHECKPOINT_S = 5.0
"""Longest work that is done again after a run was killed [s]."""


class Outcome(NamedTuple):
    """What to tell the user, and whether the run was interrupted."""

    lines: list[str]
    interrupted: bool


def run_all(
    inputs: Sequence[Input],
    out: Path,
    settings: Settings,
    progress: Progress,
    sinks: Sequence[Sink] = (),
    resume: bool = False,
) -> Outcome:
    """Run every method over every recording and write what is found, frame by frame.

    While a recording is run, `out/unfinished` has `angles.csv`, to which every frame adds its row,
    and the record that everything else is made from. A run that is killed leaves them whole, and is
    resumed by `resume`. What is done goes to `out`: one recording to `out` itself, several to
    a folder each, named after the recording. Ctrl-C ends the run early: what was computed is
    written, and so labelled.

    Args:
        inputs: what to run over.
        out: folder to write to.
        settings: of the run.
        progress: that shows how far it is.
        sinks: that take the answers beside those of the settings.
        resume: go on where an earlier run was cut off.

    Raises:
        ValueError: a wrong setting, or an unfinished run in the folder that is not resumed.
        OSError: something cannot be written; what was written before stays.
    """
    if settings.grasp and len(inputs) != 2:
        raise ValueError(f"a grasp requires the recordings of two fingers, got {len(inputs)}")
    _check_all(inputs, settings)
    names = name_folders([one.source.name for one in inputs])
    inner = names if len(inputs) > 1 else [""]
    lines: list[str] = []
    done: list[tuple[Run, dict[str, Any]]] = []
    with renew_results(out, "estimation run", lines.append, draft=UNFINISHED) as results:
        _expect_finished(out, inner if resume else [])
        for one, name, folder in zip(inputs, names, inner, strict=True):
            job = _Job(one, name, folder, results, settings)
            interrupted = job.follow(progress, sinks)
            if job.record.is_file():
                with RecordReader(job.record) as record:
                    found = find_in_record(record)
                    summary, told = job.conclude(found)
                done.append((found, summary))
                lines += [*told, *(f"  {line}" for line in job.told)]
                results.publish()
            if interrupted:
                lines.append("interrupted: the frames done so far are written")
                results.keep_earlier()
                return Outcome(lines, True)
        if len(done) > 1:
            first, more = _put_side_by_side(done, results.draft)
            lines[:0] = first
            lines += [*more, f"side by side: {out / 'report.html'}"]
    return Outcome(lines, False)


def _check_all(inputs: Sequence[Input], settings: Settings) -> None:
    """Check what can be checked before anything is computed."""
    check_sinks(settings.sink)
    if settings.preview:
        find_encoder()
    for one in inputs:
        expect_unit(settings.noise, one.source)
        make_trackers(one.source.layout, settings, settings.noise)


def _expect_finished(out: Path, resumed: Sequence[str]) -> None:
    """Expect no frames of an unfinished run, but in folders that are resumed."""
    folders = [out / UNFINISHED / inner for inner in resumed]
    for place in sorted((out / UNFINISHED).rglob(NAME)):
        if place.parent in folders:
            continue
        with RecordReader(place) as record:
            frames = len(record)
        if frames:
            raise ValueError(
                f"{place.parent} has {frames} frames of an unfinished run: continue it "
                "with the same command and --resume, give another folder (--out), or remove "
                f"{out / UNFINISHED}"
            )
        place.unlink()  # of a run that answered nothing


@dataclass
class _Job:
    """One recording of a run.

    `inner` is its folder within that of the results, `told` what there is to say of its sinks.
    """

    input: Input
    name: str
    inner: str
    results: ResultFolder
    settings: Settings
    told: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """That it writes to."""
        return self.results.draft / self.inner

    @property
    def shown(self) -> Path:
        """That what was written is moved to."""
        return self.results.path / self.inner

    @property
    def record(self) -> Path:
        """Of its frames."""
        return self.input.record or self.folder / NAME

    def follow(self, progress: Progress, more: Sequence[Sink]) -> bool:
        """Answer the frames that are not answered yet; whether Ctrl-C came."""
        if self.input.record is not None:
            return False
        source, settings = self.input.source, self.settings
        stream = Stream(source, settings, self.input.checkpoint)
        rows = stream.follower.row
        self.folder.mkdir(parents=True, exist_ok=True)
        if rows and not self.record.is_file():  # Ctrl-C ended that run, which put it in its place
            for name in self._files:
                shutil.copyfile(self.shown / name, self.folder / name)
        with ExitStack() as opened:
            writer = opened.enter_context(closing(self._open_record(rows)))
            table = TableWriter(self.folder / "angles.csv", settings.method, source.unit, rows)
            at = (self.folder, source, settings.method, rows)
            readers, files = open_sinks(settings.sink, *at, opened, self.told.append)
            # who waits for an answer comes first, what takes longest to write last
            sinks = [*readers, writer, opened.enter_context(closing(table)), *more, *files]
            self._tell_state(writer, stream)
            interrupted = self._answer(stream, writer, sinks, progress)
            self._tell_state(writer, stream, complete=not interrupted)
        if not stream.done:
            for name in self._files:
                (self.folder / name).unlink()
        elif not interrupted:
            finish_files(settings.sink, self.folder)
        return interrupted

    @property
    def _files(self) -> list[str]:
        """Names of the files that grow with every frame."""
        return [NAME, "angles.csv", *growing_files(self.settings.sink)]

    def _answer(
        self, stream: Stream, writer: RecordWriter, sinks: list[Sink], progress: Progress
    ) -> bool:
        """Let the sinks have all answers; whether Ctrl-C came."""
        total = len(stream.source) if isinstance(stream.source, Sized) else 0
        task = progress.add_task(self.name, total=total or None, completed=stream.follower.row)
        kept = time.monotonic()
        try:
            for _ in stream.answers(*sinks):
                progress.advance(task)
                if time.monotonic() > kept + CHECKPOINT_S:
                    self._tell_state(writer, stream)
                    kept = time.monotonic()
        except KeyboardInterrupt:
            writer.cut(stream.done)
            return not stream.source.live  # which has no other end
        return stream.interrupted and not stream.source.live

    def _open_record(self, rows: int) -> RecordWriter:
        settings, source = self.settings, self.input.source
        pictures = source if isinstance(source, PictureSource) else None
        writer = RecordWriter(self.record, tuple(settings.methods), settings.preview, pictures)
        writer.cut(rows)
        truth = self.input.truth
        writer.tell(
            identity=identity_of(self.input.place or source.source, settings),
            name=self.name,
            source=source.source,
            convention=source.convention,
            unit=source.unit,
            methods=list(settings.methods),
            warnings=source.warnings,
            truth=None
            if truth is None
            else [truth.angle.tolist(), truth.stick.sum(axis=1).tolist()],
        )
        return writer

    def _tell_state(self, writer: RecordWriter, stream: Stream, complete: bool = False) -> None:
        """Keep what is known by now, and what is needed to go on."""
        follower, source, settings = stream.follower, stream.source, self.settings
        noise, row = follower.noise, stream.done
        notes = [*follower.notes, *(f"{n} frames: {flaw}" for flaw, n in follower.flaws.items())]
        writer.tell(
            complete=complete,
            total=len(source) if isinstance(source, Sized) else 0,
            reference=follower.layout.reference.tolist(),
            source_notes=[*source.notes, *self.input.notes()],
            notes=notes,
            sha256=follower.sha256,
            branch=None if follower.branch is None else follower.branch.write(),
            looks_back=noise is not None,
            settings={
                "seed": settings.seed if self.input.truth is not None else None,
                "noise_in_plane_um" if source.unit == "mm" else "noise_in_plane_millipx": (
                    None if noise is None else round(1e3 * noise.in_plane, 4)
                ),
                "noise_from": "given" if settings.noise else "recording" if noise else "misfit",
                "softness": settings.softness.content(),
                **vars(settings.contact),
                **vars(settings.alert),
                "keep_withdrawn": settings.keep_withdrawn,
                "grasp": settings.grasp,
                **settings.images.content(),
                **follower.trackers.constants[settings.method],
            },
        )
        if state := stream.checkpoint():
            writer.keep_checkpoint(row - 1, state)
        writer.commit()

    def conclude(self, run: Run) -> tuple[dict[str, Any], list[str]]:
        """Write what was found; the summary, and lines for the terminal."""
        if self.record.parent == self.shown:
            self.results.keep_earlier(self.inner)
            done = f"{self.name}: already done; see {self.shown / 'report.html'}"
            return summarise(run), [done]
        summary = write_run(run, self.folder)
        lines = _tell(run, summary, self.shown)
        if self.settings.preview:
            lines.append(_preview(run, self.folder, self.shown, self.settings))
        return summary, lines


def report_all(folder: Path) -> list[str]:
    """Make the reports of a run anew from its records, as far as it has got.

    The reports of a run that goes on, or was cut off, are written to its folder `unfinished`.
    Results of other runs in folders inside are left alone.

    Args:
        folder: that the run writes to.

    Returns:
        Lines for the terminal.

    Raises:
        FileNotFoundError: there is no record in the folder.
        ValueError: a record is damaged, or of a later version, or the folder is `unfinished`.
        OSError: something cannot be written.
    """
    if folder.name == UNFINISHED:
        raise ValueError(
            f"{folder} belongs to a run: give the folder that the run writes to, {folder.parent}"
        )
    places = [
        place
        for place in sorted(folder.rglob(NAME))
        if not any((up / MANIFEST).exists() for up in place.parents if folder in up.parents)
    ]
    if not places:
        raise FileNotFoundError(f"{folder} has no {NAME}: give the folder that a run writes to")
    lines: list[str] = []
    done: list[tuple[Run, dict[str, Any]]] = []
    with renew_results(folder, "estimation run", lines.append) as results:
        results.keep_earlier()
        for place in places:
            with RecordReader(place) as record:
                if not len(record):
                    lines.append(f"{place} has no frames yet")
                    continue
                run, inner = find_in_record(record), place.parent.relative_to(folder)
                if UNFINISHED in inner.parts:
                    summary = write_run(run, place.parent, table=False)
                else:
                    summary = write_run(run, results.draft / inner)
                    done.append((run, summary))
            lines += _tell(run, summary, place.parent)
        if len(done) > 1:
            first, more = _put_side_by_side(done, results.draft)
            lines[:0] = first
            lines += more
    return lines


def _put_side_by_side(
    done: Sequence[tuple[Run, dict[str, Any]]], folder: Path
) -> tuple[list[str], list[str]]:
    """Write the angles of several recordings side by side, and two fingers as one grasp.

    Where the fingers cannot be brought together, the report and a line say so.

    Returns:
        A line that comes before all others, if the fingers disagree; the lines that come last.
    """
    if not all(run.settings["grasp"] for run, _ in done) or len(done) != 2:
        write_overview(done, folder)
        return [], []
    try:
        grasp = compare_fingers(done[0][0].main, done[1][0].main)
    except ValueError as error:
        note = f"no comparison: {error}"
        write_overview(done, folder, note=note)
        return [], [note]
    first = [grasp.raw.describe()] if grasp.raw is not None and grasp.raw.clear else []
    write_overview(done, folder, grasp, note="".join(first))
    lines = [
        f"the fingers differ by {np.degrees(fit.rms):.3f}° rms before macro slip, {what}, clock "
        f"offset {fit.clock_offset:.3f} ± {fit.errors[1]:.3f} s"
        for fit, what in (
            (grasp.fixed, "slope 1"),
            (grasp.free, f"slope {grasp.free.slope:.3f} ± {grasp.free.errors[0]:.3f}"),
        )
    ]
    if grasp.own_clocks:
        lines.append("the recordings' own clocks are used: the angles show no offset between them")
    return first, lines


def _preview(run: Run, folder: Path, shown: Path, settings: Settings) -> str:
    """Write the annotated video, where the recording was read from pictures.

    Args:
        run: over the recording.
        folder: to write to.
        shown: the folder that it is published in.
        settings: of the run.
    """
    name = "preview.mp4"
    if not is_pictures(Path(run.source)):
        return f"no preview: {run.name} was not read from pictures"
    told = settings.images
    try:
        write_preview(run, told, folder / name)
    except ValueError as error:
        return f"no preview: {error}"
    return f"annotated video: {shown / name}"


def _tell(run: Run, summary: dict[str, Any], folder: Path) -> list[str]:
    """Lines for the terminal."""
    answers = f"{describe_run(run)}; {describe_answers(run.main)}"
    lines = [f"{run.name}: {answers}; see {folder / 'report.html'}"]
    if not run.main.answered.any():
        lines += [f"  {note}" for note in run.notes]
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
