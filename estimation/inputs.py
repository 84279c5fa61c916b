"""The inputs of a run, and the records of earlier runs over them."""

import hashlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from contactmodel.common.version import __version__
from estimation.frames.bags.bag import split_place
from estimation.frames.columns.episodes import find_clip
from estimation.frames.names import name_recordings, number_alike
from estimation.frames.source import Source
from estimation.frames.state import load_state
from estimation.output.record import RECORD_NAME, RecordReader
from estimation.pictures.stream import is_camera
from estimation.settings import Settings, describe_changes, describe_unused, list_fields
from estimation.sources import find_paths, open_source
from estimation.tracking.stream import Checkpoint
from estimation.virtual.recording import Truth, simulate_pivot

UNFINISHED_NAME = "unfinished"
"""Folder within the output folder that holds a run until it is finished."""


class Input(NamedTuple):
    """An input of a run.

    Attributes:
        source: source of the frames.
        truth: true angles and sticking markers of a virtual recording.
        checkpoint: state of an earlier, interrupted run over this input.
        record: path of the record of an earlier run that finished this input.
        place: path that the source was opened at; empty if it is the source's own.
        notes: returns further notes up to now, in sentences.
        resumes: whether a run over the input can be resumed, so that its state is stored.
    """

    source: Source
    truth: Truth | None = None
    checkpoint: Checkpoint | None = None
    record: Path | None = None
    place: str = ""
    notes: Callable[[], tuple[str, ...]] = tuple
    resumes: bool = True


def open_inputs(
    names: Sequence[str],
    settings: Settings,
    say: Callable[[str], None],
    resume: Path | None = None,
) -> list[Input]:
    """Open all recordings of a run before it starts; without names, the virtual pivot.

    The names are paths of recordings or names of data sets; `say` receives the warnings, and
    `resume` is the output folder of the run to resume.

    Returns:
        The recordings, each with a unique name: its file or folder, and as much of the path above
        as makes the name unique.

    Raises:
        ValueError: a path holds no recording, a data set cannot be fetched, or the earlier run had
            another command.
        OSError: a file cannot be read.
    """
    if not names:
        recording, truth = simulate_pivot(seed=settings.seed)
        earlier = find_earlier(resume, "", recording.source, settings)
        unused = describe_unused(settings, None)
        for remark in unused:
            say(remark)
        return [Input(recording, truth, *earlier, notes=partial(tuple, unused))]
    paths = find_paths(names, say, settings.topic)
    if cameras := [str(path) for path in paths if is_camera(path)]:
        raise ValueError(
            f"{cameras[0]} is a camera: follow it with `python -m estimation live {cameras[0]}`"
        )
    named = name_folders(name_recordings(paths))
    inputs = []
    for path, name in zip(paths, named, strict=True):
        inner = name if len(paths) > 1 else ""
        checkpoint, record = find_earlier(resume, inner, str(path), settings)
        try:
            source = open_source(path, settings.images, name, checkpoint)
        except (ValueError, OSError) as error:
            if len(paths) > 1 and not isinstance(error, ImportError):
                error.add_note("no recording was run: leave this one out to run the others")
            raise
        unused = describe_unused(settings, path)
        for warning in (*source.warnings, *unused):
            say(f"{name}: {warning}")
        inputs.append(Input(source, None, checkpoint, record, str(path), partial(tuple, unused)))
    return inputs


def name_folders(names: Sequence[str]) -> list[str]:
    """The names, numbered where two are equal or one equals that of the unfinished run's folder."""
    return number_alike([UNFINISHED_NAME, *names])[1:]


def find_earlier(
    folder: Path | None, inner: str, source: str, settings: Settings
) -> tuple[Checkpoint | None, Path | None]:
    """The checkpoint of an earlier run over a source, or the record if that run finished."""
    if folder is None:
        return None, None
    for place in (folder / UNFINISHED_NAME / inner / RECORD_NAME, folder / inner / RECORD_NAME):
        if not place.is_file():
            continue
        with RecordReader(place) as record:
            _expect_same(record.about.get("identity", {}), identity_of(source, settings), place)
            if record.about.get("complete"):
                return None, place
            _, state = record.checkpoint()
            return (load_state(state) if state else None), None
    return None, None


def identity_of(source: str, settings: Settings) -> dict[str, str]:
    """Values, by name, that must be equal for a run to be resumed; one for each field."""
    split = split_place(Path(source)) if source else None
    clip = find_clip(Path(source))
    path = clip.video if clip else Path(source) if split is None else split[0]
    stamp = hashlib.sha256()
    if source and path.exists() and not is_camera(path):
        files = sorted(path.iterdir()) if path.is_dir() else [path, path.with_suffix(".csv")]
        for file in filter(Path.is_file, files):  # a folder inside may hold this run's results
            stamp.update(repr((file.name, file.stat().st_size, file.stat().st_mtime_ns)).encode())
    about = {"source": source, "files": stamp.hexdigest(), "version": __version__}
    return about | dict(list_fields("settings", settings))


def _expect_same(then: dict[str, str], now: dict[str, str], place: Path) -> None:
    if changes := describe_changes(then, now):
        raise ValueError(
            f"{place} was made with another command or from other files ({'; '.join(changes)}): "
            "repeat the same command, or leave --resume out and give another folder (--out)"
        )
