"""Sources to follow live: a camera, a Tac3D sensor, or a recording that is played."""

from collections.abc import Callable, Iterator
from pathlib import Path

from estimation.choices import LiveChoices
from estimation.fields.torsion import prepare_faces
from estimation.frames.names import name_recordings
from estimation.frames.recording import Frame
from estimation.frames.source import FrameStream, Source, describe_source
from estimation.inputs import UNFINISHED_NAME, Input, find_earlier
from estimation.live.feed import Feed
from estimation.live.tac3d import Tac3DReceiver, Tac3DSource, is_tac3d_port
from estimation.output.record import RECORD_NAME, RecordReader
from estimation.pictures.reading import marker_readers
from estimation.pictures.stream import is_camera
from estimation.settings import Settings, describe_unused
from estimation.sources import find_paths, open_source
from estimation.tracking.stream import Checkpoint
from estimation.virtual.recording import simulate_pivot


def open_live(
    name: str,
    settings: Settings,
    choices: LiveChoices,
    say: Callable[[str], None],
    resume: Path | None = None,
) -> tuple[Input, Feed]:
    """Open a source to follow, and the feed that its frames or pictures pass through.

    The source is a camera, a Tac3D port or a recording; without a name, the virtual pivot. A run
    over a camera can be resumed from its folder.

    Raises:
        ValueError: the name stands for no source or for several, or a recording cannot be resumed.
        OSError: the source cannot be read.
    """
    prepare_faces()  # no frame waits for tables and imports
    marker_readers()
    if is_tac3d_port(name):
        receiver = Tac3DReceiver(name)
        feed = Feed(name, choices, say, arrived=receiver.notes)
        source = Tac3DSource(name, receiver, feed)
        checkpoint = _find_state(resume, name, settings)
        notes = _describe(source, settings, Path(name), feed, say)
        return Input(source, None, checkpoint, None, name, notes), feed
    paths = find_paths([name], say, settings.topic) if name else []
    if len(paths) > 1:
        names = ", ".join(name_recordings(paths))
        raise ValueError(f"{name} holds {len(paths)} recordings ({names}): name one of them")
    recorded = not (paths and is_camera(paths[0]))
    if recorded and resume is not None:
        raise ValueError(
            "--resume needs a camera: play the recording again into another folder (--out), or "
            "run over it with `python -m estimation run`"
        )
    title = name_recordings(paths)[0] if paths else "virtual pivot"
    feed = Feed(title, choices, say, recorded=recorded)
    if not paths:
        pivot, _ = simulate_pivot(seed=settings.seed)
        notes = _describe(pivot, settings, None, feed, say)
        return Input(play(pivot, feed), place="live", notes=notes, resumes=False), feed
    checkpoint = _find_state(resume, name, settings)
    source = open_source(paths[0], settings.images, title, checkpoint, feed)
    notes = _describe(source, settings, paths[0], feed, say)
    place = f"{name}, live" if recorded else name
    followed = source if source.live else play(source, feed)
    return Input(followed, None, checkpoint, None, place, notes, resumes=not recorded), feed


def _find_state(folder: Path | None, name: str, settings: Settings) -> Checkpoint | None:
    """The state from which a live run resumes, behind all frames that it has stored.

    A live source does not give these frames again, so none of them may be replaced.

    Raises:
        ValueError: that run has ended, was killed before it stored a state, or had another command.
    """
    checkpoint, ended = find_earlier(folder, "", name, settings)
    if folder is None:
        return None
    advice = "follow the source into another folder (--out)"
    if ended is not None:
        raise ValueError(f"the live run in {folder} has ended and cannot be resumed: {advice}")
    place = folder / UNFINISHED_NAME / RECORD_NAME
    if not place.is_file():
        return checkpoint
    with RecordReader(place) as record:
        rows = len(record) - 1  # the other files may lack the last one
        numbers = record.track(next(iter(settings.methods))).source_index
    if checkpoint is None and rows > 0:
        raise ValueError(
            f"the live run in {folder} was killed before it stored a state, and cannot be resumed: "
            f"`python -m estimation report {folder}` makes a report of its frames; {advice}"
        )
    if checkpoint is not None and rows > checkpoint.row:  # frames may have been lost between them
        time, _ = checkpoint.follower.last
        checkpoint.follower.row, checkpoint.follower.last = rows, (time, int(numbers[rows - 1]))
    return checkpoint


def _describe(
    source: Source, settings: Settings, path: Path | None, feed: Feed, say: Callable[[str], None]
) -> Callable[[], tuple[str, ...]]:
    """Say what is doubtful about a source; return the notes about it for the report, up to now."""
    unused = describe_unused(settings, path)
    for warning in (*source.warnings, *unused):
        say(f"{feed.name}: {warning}")
    return lambda: (*unused, *feed.notes())


def play(source: Source, feed: Feed) -> FrameStream:
    """A live source that passes on the frames of another source, whose reference is final."""
    played = FrameStream(source.layout, (), live=True, **describe_source(source))

    def follow() -> Iterator[Frame]:
        for frame in feed(iter(source)):
            played.notes = source.notes
            yield frame

    played.frames = follow()
    return played
