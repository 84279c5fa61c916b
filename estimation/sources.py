"""Recordings opened by name, and what an earlier run has made of them."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from contactmodel.common.inputs import naming
from contactmodel.common.version import __version__
from estimation.frames import datasets
from estimation.frames.archive import SUFFIX, read_archive
from estimation.frames.bags.bag import is_bag, split_place
from estimation.frames.bags.source import BagSource
from estimation.frames.bags.topics import find_topic, list_topics
from estimation.frames.columns.episodes import find_clip, is_lerobot, list_episodes, list_features
from estimation.frames.columns.lerobot import is_ours, open_lerobot
from estimation.frames.columns.rows import stream_rows
from estimation.frames.columns.zarr_folder import is_zarr, open_zarr
from estimation.frames.inspection import inspect_recording
from estimation.frames.names import name_recordings, natural_key, number_alike
from estimation.frames.recording import Recording
from estimation.frames.source import SOURCE_FACTS, FrameStream, Source, record_source
from estimation.frames.state import load_state
from estimation.frames.tac3d import is_tac3d, read_tac3d
from estimation.output.record import NAME, RecordReader
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource, read_images
from estimation.pictures.stream import Picture, ignored_rate, is_camera, is_pictures
from estimation.settings import Settings
from estimation.tracking.stream import Checkpoint
from estimation.virtual.recording import Truth, simulate_pivot

EXPECTED = (
    f"a folder of Tac3D arrays (3D_Positions.npy, …), a recording archive (*{SUFFIX}), a video, a "
    "folder of images, a bag (*.mcap, *.bag, a ROS 2 folder), what --sink writes (*.zarr, "
    "lerobot), a LeRobot data set or a camera (camera:0)"
)


def read_recording(path: str | Path, images: ImageSettings | None = None) -> Recording:
    """Read the one recording at `path` and inspect it; it is named after its file or folder.

    Args:
        path: a folder of Tac3D arrays, an archive of ours, a bag, or pictures of markers.
        images: properties of the pictures.

    Raises:
        FileNotFoundError: there is nothing there, or an array is missing.
        ValueError: no recording, several, or a damaged one.
        OSError: something there cannot be read.

    Examples:
        >>> import numpy as np
        >>> from estimation import estimate_angles, read_recording, simulate_pivot, write_archive
        >>> write_archive(simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))[0], "lift.npz")
        >>> recording = read_recording("lift.npz")
        >>> angle = estimate_angles(recording).angle[-1]
        >>> print(f"{recording.name}: {len(recording)} frames, {np.degrees(angle):.1f}° at the end")
        lift: 43 frames, 10.0° at the end
    """
    found = find_recordings(path)
    if len(found) > 1:
        names = ", ".join(one.name for one in found)
        raise ValueError(f"{path} holds {len(found)} recordings ({names}): name one of them")
    with naming(found[0]):
        if is_pictures(found[0]):
            return inspect_recording(read_images(found[0], images))
        if split_place(found[0]):
            source = BagSource(found[0], unloaded=_unloaded_number(images))
            return inspect_recording(record_source(source, list(source)))
        if is_rows(found[0]):
            source = _open_rows(found[0], name_recordings(found)[0])
            return inspect_recording(record_source(source, list(source)))
        reader = read_tac3d if found[0].is_dir() else read_archive
        recording = replace(reader(found[0]), name=name_recordings(found)[0])
        if images is not None:
            warnings = () if images.rate is None else (ignored_rate(images.rate, "the recording"),)
            if unused := ", ".join(images.content()):
                warnings += (f"Not used, since the recording is not of pictures: {unused}.",)
            recording = replace(recording, warnings=(*recording.warnings, *warnings))
        return inspect_recording(recording)


def _unloaded_number(images: ImageSettings | None) -> int | None:
    """The number of the unloaded frame, where one was given."""
    unloaded = None if images is None else images.unloaded
    return unloaded if isinstance(unloaded, int) else None


def read_recordings(
    paths: Sequence[Path], images: ImageSettings, say: Callable[[str], None]
) -> list[Recording]:
    """Read recordings, each with a name of its own.

    Args:
        paths: of one recording each.
        images: properties of the pictures.
        say: told what is assumed about a recording or looks wrong with it.

    Raises:
        ValueError: a path is of no recording, or of a damaged one.
        OSError: a file cannot be read.
    """
    recordings = []
    for path, name in zip(paths, name_recordings(paths), strict=True):
        recordings.append(replace(read_recording(path, images), name=name))
        for warning in recordings[-1].warnings:
            say(f"{name}: {warning}")
    return recordings


def open_source(
    path: Path,
    images: ImageSettings,
    name: str,
    checkpoint: Checkpoint | None = None,
    feed: Callable[[Iterator[Picture]], Iterator[Picture]] | None = None,
) -> Source:
    """Open the one recording at a path: pictures give their frames as they are read.

    Args:
        path: a folder of Tac3D arrays, an archive of ours, a bag, or pictures of markers.
        images: properties of the pictures.
        name: of the recording.
        checkpoint: where an earlier run got to; the frames after it are given.
        feed: passes pictures on while they come; see `PictureSource`.

    Raises:
        ValueError: no recording, or a damaged one.
        OSError: it cannot be read.
    """
    with naming(path):
        if is_camera(path):
            after = (0.0, 0) if checkpoint is None else checkpoint.clock_now()
            return PictureSource(path, images, name=name, after=after, feed=feed)
        row = 0 if checkpoint is None else checkpoint.row
        if is_pictures(path):
            state = None if checkpoint is None else checkpoint.pictures
            return PictureSource(path, images, name=name, state=state, skip=row, feed=feed)
        if split_place(path):
            return BagSource(path, name=name, unloaded=_unloaded_number(images), skip=row)
        if is_rows(path):
            return _open_rows(path, name, row)
        recording = replace(read_recording(path, images), name=name)
        if checkpoint is None:
            return recording
        about = {name: getattr(recording, name) for name in SOURCE_FACTS}
        return FrameStream(recording.layout, islice(recording, row, None), **about)


def list_contents(path: Path) -> list[str]:
    """What can be named as a topic at a path, in a line each: topics of a bag, videos of a LeRobot
    data set.

    Raises:
        ImportError: an extra is not installed.
        ValueError: it is neither, or damaged.
        OSError: it cannot be read.
    """
    if not is_lerobot(path):
        return [one.describe() for one in list_topics(path)]
    videos = list_features(path)
    counts = [len(list_episodes(path, (one,))) for one in videos]
    return [f"{one}: video ({n} episodes)" for one, n in zip(videos, counts, strict=True)]


def is_rows(path: Path) -> bool:
    """Whether there is a Zarr group at the path, or a LeRobot data set of ours."""
    return is_zarr(path) or is_ours(path)


def _holds_episodes(path: Path) -> bool:
    """Whether there is a LeRobot data set of another program at the path."""
    return is_lerobot(path) and not is_ours(path)


def _open_rows(path: Path, name: str, skip: int = 0) -> FrameStream:
    file = open_zarr(path) if is_zarr(path) else open_lerobot(path)
    return stream_rows(file, str(path), name, skip)


def find_recordings(path: str | Path, topics: Sequence[str] = ()) -> list[Path]:
    """The recordings at `path`: itself, or those in it, in the natural order of their names.

    Args:
        path: of a recording, a folder of recordings, or a bag.
        topics: of the bag, or videos of the LeRobot data set; may be omitted if only one can be
            read.

    Raises:
        FileNotFoundError: there is nothing there.
        ValueError: there is something else there.
        OSError: the folder cannot be read.

    Examples:
        >>> from pathlib import Path
        >>> from estimation import find_recordings, simulate_pivot, write_archive
        >>> Path("grasps").mkdir()
        >>> for name in ("grasp10", "grasp2"):
        ...     write_archive(simulate_pivot(frames=(2, 2, 2))[0], f"grasps/{name}.npz")
        >>> print([path.name for path in find_recordings("grasps")])
        ['grasp2.npz', 'grasp10.npz']
    """
    path = Path(path)
    if split_place(path):
        places = [path / topic.strip("/") for topic in topics] or [path]
        for place in places:
            find_topic(place)
        return places
    if _holds_episodes(path):
        return list_episodes(path, tuple(topics))
    if topics:
        raise ValueError(
            f"{path} is neither a bag nor a LeRobot data set of another program: --topic applies "
            "to these only"
        )
    if is_camera(path) or find_clip(path):
        return [path]
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: give {EXPECTED}")
    if not path.is_dir():
        if path.suffix == SUFFIX or is_pictures(path):
            return [path]
        hint = f"; give its folder, {path.parent}" if path.suffix == ".npy" else ""
        raise ValueError(f"{path} is a file of another kind{hint}: expected {EXPECTED}")
    if is_tac3d(path) or is_rows(path) or is_pictures(path):
        return [path]
    return _find_inside(path)


def _find_inside(path: Path) -> list[Path]:
    """The recordings in a folder."""
    inside = sorted(path.iterdir(), key=natural_key)
    found = [
        one
        for one in inside
        if one.suffix == SUFFIX
        or is_bag(one)
        or is_rows(one)
        or is_lerobot(one)
        or is_pictures(one)
        or (one.is_dir() and is_tac3d(one))
    ]
    if not found:
        what = "holds no recording" if inside else "is empty"
        raise ValueError(f"{path} {what}: expected {EXPECTED}, or a folder of those")
    return [
        place for one in found for place in (list_episodes(one) if _holds_episodes(one) else [one])
    ]


UNFINISHED = "unfinished"
"""The folder, in that of the results, of a run that goes on or was cut off."""


class Input(NamedTuple):
    """What to run over.

    Attributes:
        source: of the frames.
        truth: of a virtual recording.
        checkpoint: where an earlier run got to.
        record: of an earlier run that has finished this.
        place: path that the source was opened at; what the source calls it unless given.
        notes: what else there is to note, in sentences, as known by now.
    """

    source: Source
    truth: Truth | None = None
    checkpoint: Checkpoint | None = None
    record: Path | None = None
    place: str = ""
    notes: Callable[[], tuple[str, ...]] = tuple


def find_paths(
    names: Sequence[str], say: Callable[[str], None], topics: Sequence[str] = ()
) -> list[Path]:
    """The recordings that were asked for.

    Args:
        names: paths of recordings or names of data sets.
        say: told what a data set's fetching has to say.
        topics: of the bags, where they are named.

    Raises:
        ValueError: what is there is no recording, or a data set cannot be fetched.
        OSError: a folder cannot be read.
    """
    paths: list[Path] = []
    for name in names:
        is_dataset = name in datasets.NAMES and not Path(name).exists()
        folders = datasets.fetch_runs(name, say) if is_dataset else [Path(name)]
        paths += [path for folder in folders for path in find_recordings(folder, topics)]
    return paths


def open_inputs(
    names: Sequence[str],
    settings: Settings,
    say: Callable[[str], None],
    resume: Path | None = None,
) -> list[Input]:
    """Open every recording that was asked for, before anything is computed.

    Args:
        names: paths of recordings or names of data sets; none for the virtual pivot.
        settings: of the run.
        say: told what is assumed about a recording or looks wrong with it.
        resume: the folder of the run that is resumed.

    Returns:
        The recordings, each with a name of its own: that of its file or folder, and as much of what
        is above it as tells it apart.

    Raises:
        ValueError: what is there is no recording, a data set cannot be fetched, or the earlier run
            was given another command.
        OSError: a file cannot be read.
    """
    if not names:
        recording, truth = simulate_pivot(seed=settings.seed)
        earlier = find_earlier(resume, "", recording.source, settings)
        return [Input(recording, truth, *earlier)]
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
        source = open_source(path, settings.images, name, checkpoint)
        for warning in source.warnings:
            say(f"{name}: {warning}")
        inputs.append(Input(source, None, checkpoint, record, str(path)))
    return inputs


def name_folders(names: Sequence[str]) -> list[str]:
    """The names, numbered where two are the same or one is that of the unfinished run."""
    return number_alike([UNFINISHED, *names])[1:]


def find_earlier(
    folder: Path | None, inner: str, source: str, settings: Settings
) -> tuple[Checkpoint | None, Path | None]:
    """Where an earlier run over a source got to, or the record of one that has finished."""
    if folder is None:
        return None, None
    for place in (folder / UNFINISHED / inner / NAME, folder / inner / NAME):
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
    """What must be the same for a run to be resumed, by name."""
    split = split_place(Path(source)) if source else None
    clip = find_clip(Path(source))
    path = clip.video if clip else Path(source) if split is None else split[0]
    stamp = hashlib.sha256()
    if source and path.exists() and not is_camera(path):
        files = sorted(path.iterdir()) if path.is_dir() else [path, path.with_suffix(".csv")]
        for one in filter(Path.exists, files):
            stamp.update(repr((one.name, one.stat().st_size, one.stat().st_mtime_ns)).encode())
    told = {name: repr(value) for name, value in vars(settings).items()}
    return {"source": source, "files": stamp.hexdigest(), "version": __version__} | told


def _expect_same(then: dict[str, str], now: dict[str, str], place: Path) -> None:
    changed = [name for name in now if then.get(name) != now[name]]
    if changed:
        raise ValueError(
            f"{place} was made with another command or from other files ({', '.join(changed)}): "
            "repeat the same command, or leave --resume out and give another folder (--out)"
        )
