"""Which reader a path is for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

from contactmodel.common.inputs import naming
from estimation.frames.archive import SUFFIX, read_archive
from estimation.frames.inspection import inspect_recording
from estimation.frames.names import name_recordings, natural_key
from estimation.frames.recording import Recording
from estimation.frames.tac3d import is_tac3d, read_tac3d
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource, read_images
from estimation.pictures.stream import ignored_rate, is_camera, is_pictures
from estimation.stream import SOURCE_FACTS, Checkpoint, FrameStream, Source

EXPECTED = (
    f"a folder of Tac3D arrays (3D_Positions.npy, …), a recording archive (*{SUFFIX}), a video, a "
    "folder of images or a camera (camera:0)"
)


def read_recording(path: str | Path, images: ImageSettings | None = None) -> Recording:
    """Read the one recording at `path` and inspect it; it is named after its file or folder.

    Args:
        path: a folder of Tac3D arrays, an archive of ours, or pictures of markers.
        images: what is known of the pictures.

    Raises:
        FileNotFoundError: there is nothing there, or an array is missing.
        ValueError: no recording, several, or a damaged one.
        OSError: something there cannot be read.
    """
    found = find_recordings(path)
    if len(found) > 1:
        names = ", ".join(one.name for one in found)
        raise ValueError(f"{path} holds {len(found)} recordings ({names}): name one of them")
    with naming(found[0]):
        if is_pictures(found[0]):
            return inspect_recording(read_images(found[0], images))
        reader = read_tac3d if found[0].is_dir() else read_archive
        recording = replace(reader(found[0]), name=name_recordings(found)[0])
        if images is not None and images.rate is not None:
            warning = ignored_rate(images.rate, "the recording")
            recording = replace(recording, warnings=(*recording.warnings, warning))
        return inspect_recording(recording)


def read_recordings(
    paths: Sequence[Path], images: ImageSettings, say: Callable[[str], None]
) -> list[Recording]:
    """Read recordings, each with a name of its own.

    Args:
        paths: of one recording each.
        images: what is known of pictures.
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
    path: Path, images: ImageSettings, name: str, checkpoint: Checkpoint | None = None
) -> Source:
    """Open the one recording at a path: pictures give their frames as they are read.

    Args:
        path: a folder of Tac3D arrays, an archive of ours, or pictures of markers.
        images: what is known of pictures.
        name: of the recording.
        checkpoint: where an earlier run got to; the frames after it are given.

    Raises:
        ValueError: no recording, or a damaged one.
        OSError: it cannot be read.
    """
    with naming(path):
        if is_camera(path):
            after = (0.0, 0) if checkpoint is None else checkpoint.clock_now()
            return PictureSource(path, images, name=name, after=after)
        if is_pictures(path):
            state, row = (None, 0) if checkpoint is None else (checkpoint.pictures, checkpoint.row)
            return PictureSource(path, images, name=name, state=state, skip=row)
        recording = replace(read_recording(path, images), name=name)
        if checkpoint is None:
            return recording
        about = {name: getattr(recording, name) for name in SOURCE_FACTS}
        return FrameStream(recording.layout, islice(recording, checkpoint.row, None), **about)


def find_recordings(path: str | Path) -> list[Path]:
    """The recordings at `path`: itself, or those in it, in the natural order of their names.

    Raises:
        FileNotFoundError: there is nothing there.
        ValueError: there is something else there.
        OSError: the folder cannot be read.
    """
    path = Path(path)
    if is_camera(path):
        return [path]
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: give {EXPECTED}")
    if not path.is_dir():
        if path.suffix == SUFFIX or is_pictures(path):
            return [path]
        hint = f"; give its folder, {path.parent}" if path.suffix == ".npy" else ""
        raise ValueError(f"{path} is a file of another kind{hint}: expected {EXPECTED}")
    if is_tac3d(path) or is_pictures(path):
        return [path]
    inside = sorted(path.iterdir(), key=natural_key)
    found = [
        one
        for one in inside
        if one.suffix == SUFFIX or is_pictures(one) or (one.is_dir() and is_tac3d(one))
    ]
    if not found:
        what = "holds no recording" if inside else "is empty"
        raise ValueError(f"{path} {what}: expected {EXPECTED}, or a folder of those")
    return found
