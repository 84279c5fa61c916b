"""Run the estimators over recordings and streams and write their results frame by frame."""

import shutil
import time
from collections.abc import Sequence, Sized
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from rich.progress import Progress

from estimation.frames.inspection import list_flaws
from estimation.frames.noise import Noise, expect_unit
from estimation.inputs import UNFINISHED_NAME, Input, identity_of, name_folders
from estimation.output.answer import describe_run
from estimation.output.found import Run, choose_notes, find_in_record
from estimation.output.missing import describe_answers
from estimation.output.overview import put_side_by_side
from estimation.output.preview import find_encoder, write_preview
from estimation.output.record import RECORD_NAME, RecordReader, RecordWriter
from estimation.output.report import FIRM_MARKERS, summarise, write_run
from estimation.output.result_folder import MANIFEST_NAME, ResultFolder, renew_results
from estimation.output.sinks.by_name import check_sinks, finish_files, growing_files, open_sinks
from estimation.output.table import TableWriter
from estimation.pictures.reading import PictureSource
from estimation.pictures.stream import is_pictures
from estimation.settings import Settings
from estimation.softness import expect_scale
from estimation.tracking.stream import Sink, Stream, make_trackers


class RunEnd(NamedTuple):
    """The end of a run: lines for the terminal, and whether it was interrupted."""

    lines: list[str]
    interrupted: bool


def run_all(
    inputs: Sequence[Input],
    out: Path,
    settings: Settings,
    progress: Progress,
    sinks: Sequence[Sink] = (),
    resume: bool = False,
) -> RunEnd:
    """Run every method over every recording and write the results, frame by frame.

    During a recording, `out/unfinished` holds `angles.csv`, to which each frame adds a row, and the
    record, from which all other files are made. A killed run leaves both intact, and `resume`
    continues it. Finished results go to `out`: one recording to `out` itself, several to one folder
    each, named after the recording. Ctrl-C ends the run early; the results so far are written and
    labelled as interrupted. Ctrl-C while they are written leaves the frames in `out/unfinished`.

    The sinks are in addition to those of the settings.

    Raises:
        ValueError: a wrong setting, or the folder holds an unfinished run that is not resumed.
        OSError: a file cannot be written; files written before remain.
    """
    if settings.grasp and len(inputs) != 2:
        raise ValueError(f"a grasp requires the recordings of two fingers, got {len(inputs)}")
    places = [item.place or item.source.source for item in inputs]
    if settings.grasp and places[0] and len(set(places)) == 1:
        raise ValueError(
            f"a grasp requires the recordings of two fingers, got {places[0]} twice: name the "
            "second finger's"
        )
    _check_all(inputs, settings)
    lines: list[str] = []
    try:
        interrupted = _run_each(inputs, out, settings, progress, sinks, resume, lines)
    except KeyboardInterrupt:
        interrupted = True
        lines.append(
            "interrupted before the report was complete: `python -m estimation report "
            f"{out}` makes it from the answered frames in {out / UNFINISHED_NAME}"
        )
    return RunEnd(lines, interrupted)


def _run_each(
    inputs: Sequence[Input],
    out: Path,
    settings: Settings,
    progress: Progress,
    sinks: Sequence[Sink],
    resume: bool,
    lines: list[str],
) -> bool:
    """Run over each recording, and add to the lines; return whether Ctrl-C ended the run."""
    names = name_folders([item.source.name for item in inputs])
    inner = names if len(inputs) > 1 else [""]
    done: list[tuple[Run, dict[str, Any]]] = []
    with renew_results(out, "estimation run", lines.append, draft=UNFINISHED_NAME) as results:
        _expect_finished(out, inner if resume else [])
        for item, name, folder in zip(inputs, names, inner, strict=True):
            job = _Job(item, name, folder, results, settings)
            interrupted = job.follow(progress, sinks)
            if job.record.is_file():
                with RecordReader(job.record) as record:
                    finished = find_in_record(record)
                    summary, description = job.conclude(finished)
                done.append((finished, summary))
                lines += [*description, *(f"  {note}" for note in job.notes)]
                results.publish()
            if interrupted:
                lines.append("interrupted: the results of the frames so far are written")
                results.keep_earlier()
                return True
        if len(done) > 1:
            first, more = put_side_by_side(done, results.draft)
            lines[:0] = first
            lines += [*more, f"side by side: {out / 'report.html'}"]
    return False


def _check_all(inputs: Sequence[Input], settings: Settings) -> None:
    """Check settings, sinks and layouts before the first frame is computed."""
    check_sinks(settings.sink)
    if settings.preview:
        find_encoder()
    for item in inputs:
        expect_unit(settings.noise, item.source)
        expect_scale(settings.softness, item.source.unit, item.source.name)
        make_trackers(item.source.layout, settings, settings.noise)


def _expect_finished(out: Path, resumed: Sequence[str]) -> None:
    """Expect no frames of an unfinished run, except in folders that are resumed."""
    folders = [out / UNFINISHED_NAME / inner for inner in resumed]
    for place in sorted((out / UNFINISHED_NAME).rglob(RECORD_NAME)):
        if place.parent in folders:
            continue
        with RecordReader(place) as record:
            frames = len(record)
        if frames:
            raise ValueError(
                f"{place.parent} has {frames} frames of an unfinished run: continue it "
                "with the same command and --resume, give another folder (--out), or remove "
                f"{out / UNFINISHED_NAME}"
            )
        place.unlink()  # the record of a run without a frame


@dataclass
class _Job:
    """One recording of a run.

    `inner` is its folder within that of the results; `notes` are messages of its sinks. A killed
    run repeats at most the work of `checkpoint_s` seconds, the time between checkpoints.
    """

    checkpoint_s: ClassVar[float] = 5.0
    input: Input
    name: str
    inner: str
    results: ResultFolder
    settings: Settings
    notes: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """Folder that the files are written to."""
        return self.results.draft / self.inner

    @property
    def shown(self) -> Path:
        """Folder that the finished files are moved to."""
        return self.results.path / self.inner

    @property
    def record(self) -> Path:
        """Path of the record of its frames."""
        return self.input.record or self.folder / RECORD_NAME

    def follow(self, progress: Progress, more: Sequence[Sink]) -> bool:
        """Answer the remaining frames; return whether Ctrl-C interrupted them."""
        if self.input.record is not None:
            return False
        source, settings = self.input.source, self.settings
        stream = Stream(source, settings, self.input.checkpoint)
        rows = stream.follower.row
        self.folder.mkdir(parents=True, exist_ok=True)
        if rows and not self.record.is_file():  # Ctrl-C ended that run, and its files were moved
            for name in self._files:
                shutil.copyfile(self.shown / name, self.folder / name)
        with ExitStack() as opened:
            identity = self._identify()
            writer = opened.enter_context(closing(self._open_record(rows, identity)))
            table = TableWriter(self.folder / "angles.csv", settings.method, source.unit, rows)
            at = (self.folder, source, settings.method, rows)
            readers, files = open_sinks(settings.sink, *at, opened, self.notes.append)
            # programs that wait for an answer come first, the slowest files last
            sinks = [*readers, writer, opened.enter_context(closing(table)), *more, *files]
            self._write_state(writer, stream)
            interrupted = self._answer(stream, writer, sinks, progress)
            self._write_state(writer, stream, complete=not interrupted)
        if not (interrupted or source.live) and self._identify() != identity:
            self.notes.append(
                f"{self.name} changed while it was read, as a recording does that still grows: "
                "run it again once it is complete"
            )
        if not stream.done:
            for name in self._files:
                (self.folder / name).unlink()
        elif not interrupted:
            finish_files(settings.sink, self.folder)
        return interrupted

    @property
    def _files(self) -> list[str]:
        """Names of the files that grow with every frame."""
        return [RECORD_NAME, "angles.csv", *growing_files(self.settings.sink)]

    def _answer(
        self, stream: Stream, writer: RecordWriter, sinks: list[Sink], progress: Progress
    ) -> bool:
        """Pass all answers to the sinks; return whether Ctrl-C interrupted a recording."""
        total = len(stream.source) if isinstance(stream.source, Sized) else 0
        task = progress.add_task(self.name, total=total or None, completed=stream.follower.row)
        saved = time.monotonic()
        try:
            for _ in stream.answers(*sinks):
                progress.advance(task)
                if time.monotonic() > saved + self.checkpoint_s:
                    self._write_state(writer, stream)
                    saved = time.monotonic()
        except KeyboardInterrupt:
            writer.truncate(stream.done)
            return not stream.source.live  # Ctrl-C is the regular end of a live source
        return stream.interrupted and not stream.source.live

    def _identify(self) -> dict[str, str]:
        return identity_of(self.input.place or self.input.source.source, self.settings)

    def _open_record(self, rows: int, identity: dict[str, str]) -> RecordWriter:
        settings, source = self.settings, self.input.source
        pictures = source if isinstance(source, PictureSource) else None
        writer = RecordWriter(self.record, tuple(settings.methods), settings.preview, pictures)
        writer.truncate(rows)
        truth = self.input.truth
        writer.set_metadata(
            identity=identity,
            name=self.name,
            source=source.source,
            convention=source.convention,
            unit=source.unit,
            resumes=self.input.resumes,
            methods=list(settings.methods),
            warnings=source.warnings,
            truth=None
            if truth is None
            else [truth.angle.tolist(), truth.stick.sum(axis=1).tolist()],
        )
        return writer

    def _write_state(self, writer: RecordWriter, stream: Stream, complete: bool = False) -> None:
        """Write the facts about the run so far, and the checkpoint for resuming it."""
        follower, source, settings = stream.follower, stream.source, self.settings
        noise, row = follower.noise, stream.done
        notes = [*follower.notes, *list_flaws(follower.flaws)]
        writer.set_metadata(
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
                **_describe_noise(noise, source.unit),
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
        if self.input.resumes and (state := stream.checkpoint()):
            writer.keep_checkpoint(row - 1, state)
        writer.commit()

    def conclude(self, run: Run) -> tuple[dict[str, Any], list[str]]:
        """Write the results; return the summary and lines for the terminal."""
        if self.record.parent == self.shown:
            self.results.keep_earlier(self.inner)
            done = f"{self.name}: already done; see {self.shown / 'report.html'}"
            return summarise(run), [done]
        summary = write_run(run, self.folder)
        lines = _describe_results(run, summary, self.shown)
        if self.settings.preview:
            lines.append(_preview(run, self.folder, self.shown, self.settings))
        return summary, lines


def report_all(folder: Path) -> list[str]:
    """Make the reports of a run again from its records.

    Reports of a run that is going on or was interrupted go to its folder `unfinished`. Results of
    other runs in folders inside are not touched.

    Returns:
        Lines for the terminal.

    Raises:
        FileNotFoundError: the folder holds no record.
        ValueError: a record is damaged, or of a later version, or the folder is `unfinished`.
        OSError: a file cannot be written.
    """
    if folder.name == UNFINISHED_NAME:
        raise ValueError(
            f"{folder} belongs to a run: give the output folder of the run, {folder.parent}"
        )
    places = [
        place
        for place in sorted(folder.rglob(RECORD_NAME))
        if not any((up / MANIFEST_NAME).exists() for up in place.parents if folder in up.parents)
    ]
    if not places:
        raise FileNotFoundError(f"{folder} has no {RECORD_NAME}: give the output folder of a run")
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
                if UNFINISHED_NAME in inner.parts:
                    summary = write_run(run, place.parent, table=False)
                else:
                    summary = write_run(run, results.draft / inner)
                    done.append((run, summary))
            lines += _describe_results(run, summary, place.parent)
        if len(done) > 1:
            first, more = put_side_by_side(done, results.draft)
            lines[:0] = first
            lines += more
    return lines


def _preview(run: Run, folder: Path, shown: Path, settings: Settings) -> str:
    """Write the annotated video of a recording of pictures; return a line for the terminal."""
    name = "preview.mp4"
    if not is_pictures(Path(run.source)):
        return f"no preview: {run.name} was not read from pictures"
    try:
        write_preview(run, settings.images, folder / name)
    except (ValueError, OSError) as error:
        return f"no preview: {error}"
    except KeyboardInterrupt:
        return "no preview: interrupted"
    return f"annotated video: {shown / name}"


def _describe_noise(noise: Noise | None, unit: str) -> dict[str, float | None]:
    """The noise for the summary, in µm or px."""
    name, factor = ("noise_in_plane_um", 1e3) if unit == "mm" else ("noise_in_plane_px", 1.0)
    return {name: None if noise is None else float(f"{factor * noise.in_plane:.4g}")}


def _describe_results(run: Run, summary: dict[str, Any], folder: Path) -> list[str]:
    """Lines for the terminal."""
    answers = f"{describe_run(run)}; {describe_answers(run.main)}"
    lines = [f"{run.name}: {answers}; see {folder / 'report.html'}"]
    if run.unfinished:
        lines.append(f"  {run.unfinished}")
    if not run.main.answered.any():
        lines += [f"  {note}" for note in run.notes if note != run.unfinished]
    else:
        lines += [f"  {note}" for note in choose_notes(run)]
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
