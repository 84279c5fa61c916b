"""Recordings opened by their paths, or found by the names of data sets and folders."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

from contactmodel.common.inputs import naming
from estimation.frames import datasets
from estimation.frames.archive import is_archive, read_archive
from estimation.frames.bags.bag import is_bag, split_place
from estimation.frames.bags.source import BagSource
from estimation.frames.bags.topics import find_topic, list_topics
from estimation.frames.columns.episodes import find_clip, is_lerobot, list_episodes, list_features
from estimation.frames.columns.lerobot import is_ours, open_lerobot
from estimation.frames.columns.rows import stream_rows
from estimation.frames.columns.zarr_folder import is_zarr, open_zarr
from estimation.frames.inspection import inspect_recording
from estimation.frames.names import name_recordings, natural_key
from estimation.frames.recording import Recording
from estimation.frames.source import FrameStream, Source, describe_source, record_source
from estimation.frames.tac3d import is_tac3d, read_tac3d
from estimation.output.record import RECORD_NAME
from estimation.output.result_folder import has_results
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource, read_images
from estimation.pictures.still import advise_on
from estimation.pictures.stream import Picture, is_camera, is_pictures
from estimation.pictures.video import VIDEO_SUFFIXES
from estimation.tracking.stream import Checkpoint


def read_recording(path: str | Path, images: ImageSettings | None = None) -> Recording:
    """Read the recording at `path`, name it after its file or folder, and inspect it.

    Args:
        path: a folder of Tac3D arrays, an archive by `write_archive`, a bag, or pictures of
            markers.
        images: properties of the pictures.

    Raises:
        FileNotFoundError: the path does not exist, or an array is missing.
        ValueError: the path holds no recording, several, or a damaged one.
        OSError: a file cannot be read.

    Examples:
        >>> import numpy as np
        >>> from estimation import estimate_angles, read_recording, simulate_pivot, write_archive
        >>> write_archive(simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))[0], "lift.npz")
        >>> recording = read_recording("lift.npz")
        >>> angle = estimate_angles(recording).angle[-1]
        >>> print(f"{recording.name}: {len(recording)} frames, {np.degrees(angle):.1f}° at the end")
        lift: 43 frames, 10.0° at the end
    """
    places = find_recordings(path)
    if len(places) > 1:
        names = ", ".join(place.name for place in places)
        raise ValueError(f"{path} holds {len(places)} recordings ({names}): name one of them")
    place, (name,) = places[0], name_recordings(places)
    with naming(place):
        if is_pictures(place):
            return inspect_recording(read_images(place, images))
        if split_place(place):
            source = BagSource(place, unloaded=_unloaded_number(images))
            return inspect_recording(record_source(source, list(source)))
        if is_rows(place):
            source = _open_rows(place, name)
            return inspect_recording(record_source(source, list(source)))
        reader = read_tac3d if place.is_dir() else read_archive
        recording = replace(reader(place), name=name)
        if images is not None:
            warnings = (*recording.warnings, *images.describe_unused())
            recording = replace(recording, warnings=warnings)
        return inspect_recording(recording)


def _unloaded_number(images: ImageSettings | None) -> int | None:
    """The number of the unloaded frame, if the settings name one."""
    unloaded = None if images is None else images.unloaded
    return unloaded if isinstance(unloaded, int) else None


def read_recordings(
    paths: Sequence[Path], images: ImageSettings, say: Callable[[str], None]
) -> list[Recording]:
    """Read recordings and give each a unique name; `say` receives their warnings.

    Raises:
        ValueError: a path holds no recording, several, or a damaged one.
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
    """Open the recording at a path; pictures are read one by one.

    Args:
        path: a folder of Tac3D arrays, an archive by `write_archive`, a bag, or pictures of
            markers.
        images: properties of the pictures.
        name: name of the recording.
        checkpoint: state of an earlier run; the source starts with the frame after it.
        feed: passes pictures on as they arrive; see `PictureSource`.

    Raises:
        ValueError: the path holds no recording, or a damaged one.
        OSError: a file cannot be read.
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
        recording = replace(read_recording(path), name=name)
        if checkpoint is None:
            return recording
        frames = islice(recording, row, None)
        return FrameStream(recording.layout, frames, **describe_source(recording))


def list_contents(path: Path) -> list[str]:
    """The topics of a bag or the videos of a LeRobot data set, one line each.

    Raises:
        ImportError: an extra is not installed.
        ValueError: the path holds neither, or a damaged one.
        OSError: a file cannot be read.
    """
    if not is_lerobot(path):
        return [topic.describe() for topic in list_topics(path)]
    videos = list_features(path)
    counts = [len(list_episodes(path, (video,))) for video in videos]
    return [f"{video}: video ({n} episodes)" for video, n in zip(videos, counts, strict=True)]


def is_rows(path: Path) -> bool:
    """Whether the path holds a Zarr group, or a LeRobot data set that `--sink` wrote."""
    return is_zarr(path) or is_ours(path)


def _holds_episodes(path: Path) -> bool:
    """Whether the path holds a LeRobot data set of another program."""
    return is_lerobot(path) and not is_ours(path)


def _open_rows(path: Path, name: str, skip: int = 0) -> FrameStream:
    file = open_zarr(path) if is_zarr(path) else open_lerobot(path)
    return stream_rows(file, str(path), name, skip)


def find_recordings(path: str | Path, topics: Sequence[str] = ()) -> list[Path]:
    """Paths of the recordings at `path` or in its folder, in the natural order of their names.

    Args:
        path: a recording, a folder of recordings, or a bag.
        topics: topics of the bag, or videos of the LeRobot data set; may be omitted if only one can
            be read.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: the path holds no recording.
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
    expected = (
        "a folder of Tac3D arrays (3D_Positions.npy, …), a recording archive (*.npz), a video "
        f"({', '.join(f'*{suffix}' for suffix in VIDEO_SUFFIXES)}), a folder of images, a bag "
        "(*.mcap, *.bag, a ROS 2 folder), what --sink writes (*.zarr, lerobot), a LeRobot data "
        "set or, for `live`, a camera (camera:0) or a Tac3D sensor (tac3d:PORT)"
    )
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
        raise FileNotFoundError(f"{path} does not exist: give {expected}")
    if is_pictures(path) and (path / RECORD_NAME).is_file():
        raise ValueError(
            f"{path} is the output folder of a run: give the recording itself, or make the report "
            f"again with `python -m estimation report {path}`"
        )
    if _is_recording(path):
        return [path]
    if not path.is_dir():
        raise ValueError(f"{path} is a file of another kind{advise_on(path)}: expected {expected}")
    return _find_inside(path, expected)


def _is_recording(path: Path) -> bool:
    """Whether the path itself is a recording; bags and other LeRobot data sets are not counted."""
    archive = path.is_file() and is_archive(path)
    return archive or is_tac3d(path) or is_rows(path) or is_pictures(path)


def _find_inside(path: Path, expected: str) -> list[Path]:
    """The recordings in a folder; folders of results are left out."""
    inside = [entry for entry in sorted(path.iterdir(), key=natural_key) if not has_results(entry)]
    recordings = [
        entry for entry in inside if is_bag(entry) or is_lerobot(entry) or _is_recording(entry)
    ]
    if not recordings:
        what = "holds no recording" if inside else "is empty"
        folders = [f"{entry}/" for entry in inside if _holds_recording(entry)]
        if folders:
            what += f"; give its folders that do: {' '.join(folders)}"
        raise ValueError(f"{path} {what}: expected {expected}, or a folder of these")
    return [
        place
        for entry in recordings
        for place in (list_episodes(entry) if _holds_episodes(entry) else [entry])
    ]


def _holds_recording(path: Path) -> bool:
    """Whether a recording lies directly in the path."""
    return path.is_dir() and any(map(_is_recording, path.iterdir()))


def find_paths(
    names: Sequence[str], say: Callable[[str], None], topics: Sequence[str] = ()
) -> list[Path]:
    """Paths of the recordings that the names stand for.

    Args:
        names: paths of recordings or names of data sets.
        say: receives the messages of a data set's download.
        topics: topics to read from bags; may be omitted if only one can be read.

    Raises:
        ValueError: a path holds no recording, its name is not UTF-8, or a data set cannot be
            fetched.
        OSError: a folder cannot be read.
    """
    paths: list[Path] = []
    for name in names:
        is_dataset = name in datasets.list_names() and not Path(name).exists()
        folders = datasets.fetch_runs(name, say) if is_dataset else [Path(name)]
        paths += [path for folder in folders for path in find_recordings(folder, topics)]
    for path in paths:
        if str(path) != str(path).encode(errors="ignore").decode():
            raise ValueError(
                f"the name {str(path)!a} is not UTF-8, in which results are written: rename "
                "the file or folder, or set PYTHONUTF8=1 if your locale is not UTF-8"
            )
    return paths
