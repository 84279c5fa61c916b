"""Pictures in order of time, from a folder of images, a video, a bag or a camera.

A folder is read in natural order. The number in a picture's name is its frame number. If the names
do not number the pictures, they are counted from 0, like the frames of a video.

Time stamps come from a table (`times.csv` in the folder, `CLIP.csv` beside `CLIP.avi`; columns
`frame` and `time_s`), else from the video's container or the camera's clock. In a folder without a
table, the time is the frame number over the rate (`DEFAULT_RATE` by default), so that missing
frames leave a gap.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from jaxtyping import Shaped

from estimation.frames.bags.bag import split_place
from estimation.frames.bags.topics import find_topic, holds_pictures, read_topic
from estimation.frames.columns.episodes import Clip, find_clip
from estimation.frames.extras import require_extra
from estimation.frames.inspection import doubt_times
from estimation.frames.names import (
    Numbering,
    counted,
    natural_key,
    number_pictures,
    read_times,
    table_beside,
)
from estimation.pictures.part import SMALLEST_SIDE_PX, Part
from estimation.pictures.still import (
    MOST_PIXELS,
    check_size,
    doubt_depth,
    find_exposure_flaw,
    find_usual_size,
    is_image,
    kind_of,
    load_picture,
    sample_pictures,
    turn_upright,
    unpack_picture,
)
from estimation.pictures.video import (
    VIDEO_SUFFIXES,
    Coding,
    VideoClock,
    doubt_coding,
    doubt_videos,
    read_turn,
)

if TYPE_CHECKING:
    from av.container import InputContainer

DEFAULT_RATE = 30.0
"""Assumed rate of a folder's pictures if neither a table nor a rate is given [1/s]."""


class Picture(NamedTuple):
    """A picture of a source.

    Attributes:
        image: grey or BGR, 8 or 16 bit; None if there is none.
        time: time stamp [s].
        number: frame number, from the picture's name or counted from 0.
        flaw: why the picture cannot be used; empty if it can.
        whole: width and height of the whole picture [px] if `image` is a part of it; else None.
        quantizer: step of a compressed video's quantizer [grey levels of 255]; 0 if unknown.
    """

    image: Shaped[np.ndarray, "h w *colour"] | None
    time: float
    number: int
    flaw: str = ""
    whole: tuple[int, int] | None = None
    quantizer: float = 0.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole picture [px]; 0 if there is no picture."""
        if self.whole is not None or self.image is None:
            return self.whole or (0, 0)
        return self.image.shape[1], self.image.shape[0]


def is_camera(path: Path) -> bool:
    """Whether the path names a camera: `camera:0`, or its device `/dev/video0`."""
    return str(path).startswith(("camera:", "/dev/video"))


def is_pictures(path: Path) -> bool:
    """Whether the path holds pictures: a video, a folder of images, a bag or a camera.

    Raises:
        ValueError: the bag has no topic of a tactile sensor, or is damaged.
        OSError: the bag cannot be read.
    """
    if is_camera(path) or path.suffix.lower() in VIDEO_SUFFIXES or find_clip(path):
        return True
    return holds_pictures(path) or (path.is_dir() and bool(_list_images(path)))


def count_pictures(path: Path) -> int:
    """Number of pictures at a path; 0 if it is unknown before they are read."""
    if is_camera(path):
        return 0
    if split_place(path):
        return find_topic(path)[1].channel.messages
    if clip := find_clip(path):
        return clip.pictures
    if path.is_dir():
        return len(_list_images(path))
    with _open_video(path) as container:
        return container.streams.video[0].frames


def describe_pictures(path: Path, rate: float | None = None) -> tuple[str, ...]:
    """Assumptions and doubts about the pictures at a path, in sentences.

    Args:
        path: as for `read_pictures`.
        rate: as for `read_pictures`.

    Raises:
        ValueError: the folder has no pictures, or the table has no valid time stamps.
    """
    clock = "the camera's clock" if is_camera(path) else "the bag" if split_place(path) else ""
    if clock:
        return () if rate is None else (ignored_rate(rate, clock),)
    warnings, table = [], table_beside(path)
    stamps = read_times(table)
    warnings += doubt_times(np.array([stamps[number] for number in sorted(stamps)]))
    if path.is_dir():
        files, (numbers, doubts) = _number_folder(path)
        warnings += (*doubts, *doubt_depth(sample_pictures(files)), *doubt_videos(path))
        if unused := sorted(set(stamps) - set(numbers)):
            warnings.append(
                f"{table.name} has times of {counted(len(unused), 'frame', 'frames')} without a "
                f"picture; the first is frame {unused[0]}. The column `frame` must hold frame "
                "numbers."
            )
        if rate is None and not stamps:
            warnings.append(
                f"No rate is known: {DEFAULT_RATE:g} pictures per second are assumed. All times, "
                "time_s included, rest on this assumption. Give the true rate "
                f"(`run --fps`), or the times in {table.name} (columns frame, time_s)."
            )
    else:
        clip = find_clip(path)
        video = clip.video if clip else path
        if video.is_file():
            with _open_video(video) as container:
                warnings += doubt_coding(container)
    if rate is not None and (stamps or not path.is_dir()):
        other = f"the video; {table.name} (columns frame, time_s) would replace them"
        warnings.append(ignored_rate(rate, table.name if stamps else other))
    return tuple(warnings)


def ignored_rate(rate: float, clock: str) -> str:
    """The warning that a given rate is not used because the recording has time stamps."""
    return f"The rate of {rate:g} pictures per second (--fps) is not used: times come from {clock}."


def read_pictures(path: Path, rate: float | None = None, part: Part = Part()) -> Iterator[Picture]:
    """Read the pictures at a path in order.

    A picture that cannot be read has a flaw. So has one whose size, or whether it is grey, differs
    from that of the first usable picture or, in a folder, of most. If a source ends early, because
    it is damaged or the camera was disconnected, the flaw of its last picture gives the reason.

    Args:
        path: a video, a folder of images, a topic in a bag, or a camera: `camera:0` or its device,
            `/dev/video0`.
        rate: pictures per second of a folder without a table of times [1/s].
        part: of each picture that is read.

    Raises:
        ValueError: there are no pictures, a picture has more than `MOST_PIXELS` pixels, or the part
            does not fit them.
        ImportError: the path is a video and PyAV is not installed.
        OSError: the path cannot be opened.
    """
    cutter = Cutter(part)
    if is_camera(path):
        source = _read_camera(str(path))
    elif split_place(path):
        source = _read_bag(path)
    elif clip := find_clip(path):
        source = _read_clip(clip)
    elif path.is_dir():
        source = _read_folder(path, DEFAULT_RATE if rate is None else rate)
        images = sample_pictures(_number_folder(path)[0])
        if size := find_usual_size(images):
            part.expect(*size)
            kinds = [kind_of(image) for image in images]
            cutter = Cutter(part, size, max(kinds, key=kinds.count))
    else:
        source = _read_video(path)
    for picture in source:
        if picture.image is not None and not picture.flaw:
            picture = cutter.cut(picture)
        yield picture


class Cutter:
    """Cuts pictures to the part that is read, and flags those that are not like the first."""

    def __init__(self, part: Part, size: tuple[int, int] | None = None, kind: str = "") -> None:
        """Begin before the first picture.

        Args:
            part: the part that is read.
            size: width and height that the pictures have [px]; those of the first if None.
            kind: `kind_of` the pictures; that of the first if empty.
        """
        self._part, self._size, self._kind = part, size, kind

    def cut(self, picture: Picture) -> Picture:
        """The part of the next picture that has an image, with its flaw if it cannot be used.

        Raises:
            ValueError: the picture has neither 8 nor 16 bit, or the first picture does not contain
                the part.
        """
        assert picture.image is not None
        if picture.image.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"the picture has values of type {picture.image.dtype}, expected uint8 (0 to 255) "
                "or uint16 (0 to 65535): convert it, for example "
                "(255 * image).astype(np.uint8) for values from 0 to 1"
            )
        (width, height), kind = picture.size, kind_of(picture.image)
        if min(width, height) < SMALLEST_SIDE_PX:
            flaw = f"the picture is {width}×{height}, too small to show markers"
            return picture._replace(flaw=flaw)
        if self._size is None:
            self._part.expect(width, height)
        elif self._size != (width, height):
            usual, high = self._size
            flaw = f"the picture is {width}×{height}, the others are {usual}×{high}"
            return picture._replace(flaw=flaw)
        if self._kind not in ("", kind):
            return picture._replace(flaw=f"the picture is {kind}, the others are {self._kind}")
        self._size, self._kind = (width, height), kind
        return take_part(picture, self._part)


def take_part(picture: Picture, part: Part) -> Picture:
    """Cut a picture to a part, and set its flaw if the part is black or saturated."""
    assert picture.image is not None
    image = part.cut(picture.image)
    return picture._replace(image=image, flaw=find_exposure_flaw(image), whole=picture.size)


def _list_images(folder: Path) -> list[Path]:
    """The images in a folder, without hidden files."""
    return [file for file in folder.iterdir() if is_image(file) and not file.name.startswith(".")]


def _number_folder(folder: Path) -> tuple[list[Path], Numbering]:
    """The images in a folder in natural order, and their frame numbers."""
    files = sorted(_list_images(folder), key=natural_key)
    if not files:
        raise ValueError(f"{folder} holds no images")
    return files, number_pictures(files)


def _read_folder(folder: Path, rate: float) -> Iterator[Picture]:
    files, (numbers, _) = _number_folder(folder)
    stamps = read_times(table_beside(folder))
    before = None
    for number, file in zip(numbers, files, strict=True):
        stamp = stamps.get(number, np.nan) if stamps else number / rate
        if number == before:
            yield Picture(None, stamp, number, "the picture has the same number as the one before")
            continue
        before = number
        image, flaw = load_picture(file)
        yield Picture(image, stamp, number, flaw and f"{file.name} {flaw}")


@contextmanager
def _open_video(path: Path) -> Iterator["InputContainer"]:
    """Open a video and check that it has pictures of a valid size."""
    require_extra("video", f"reading the video {path}")
    import av
    from av.error import FFmpegError

    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist")
    try:
        container = av.open(str(path.absolute()))  # else `13:06.mkv` is a protocol
    except (FFmpegError, OSError) as error:
        advice = ". MP4 and MOV cannot be read if the recording broke off: record in MKV"
        advice = advice if path.suffix.lower() in (".mp4", ".mov") else ""
        raise ValueError(f"{path} is no video, empty, or damaged{advice}") from error
    with container:
        if not container.streams.video:
            raise ValueError(f"{path} has no pictures, only sound or text")
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise ValueError(f"{path} is damaged: it declares no codec or an unknown one")
        check_size(stream.width, stream.height, path)
        yield container


def _read_video(path: Path, start: float = 0.0) -> Iterator[Picture]:
    """The pictures of a video, from the last key frame before `start` [s] on."""
    with _open_video(path) as container:
        import av
        from av.error import FFmpegError
        from av.video.reformatter import VideoReformatter

        stream = container.streams.video[0]
        stream.codec_context.thread_count = 1
        stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)} | Coding.options
        rate = float(stream.average_rate or DEFAULT_RATE)
        colours = VideoReformatter()  # one for all frames, since its set-up is slow
        coding, clock = Coding(), VideoClock(rate, read_times(table_beside(path)))
        try:
            if start:
                container.seek(int(start * av.time_base))
            for frame in container.decode(stream):
                check_size(frame.width, frame.height, path)
                grey = frame.format.name.startswith("gray")
                wanted = ("gray16le" if "16" in frame.format.name else "gray") if grey else "bgr24"
                flaw = "the picture is damaged" if frame.is_corrupt else ""
                image = colours.reformat(frame, format=wanted).to_ndarray()
                image = turn_upright(image, read_turn(frame))
                time_s = clock.advance(frame.time)
                yield Picture(image, time_s, clock.number, flaw, quantizer=coding.update(frame))
            why = clock.find_missing(container)
        except FFmpegError as error:
            why = f"the video is damaged from here on ({error})"
        if why:
            yield Picture(None, clock.advance(None), clock.number, why)


def _read_clip(clip: Clip) -> Iterator[Picture]:
    """The pictures of one part of a video; numbers and times count from the part's start."""
    half = 0.5 * (clip.stop - clip.start) / clip.pictures  # time of half a picture
    number, why = 0, "the video ends here"
    for picture in _read_video(clip.video, clip.start):
        if picture.image is None:
            why = picture.flaw
            break
        if picture.time < clip.start - half:
            continue  # between the preceding key frame and the start
        if number == clip.pictures or picture.time > clip.stop - half:
            break
        yield picture._replace(time=picture.time - clip.start, number=number)
        number += 1
    if number < clip.pictures:
        missing = clip.pictures - number
        why = f"{missing} of the episode's {clip.pictures} frames are missing: {why}"
        yield Picture(None, number * 2.0 * half, number, why)


def _read_bag(place: Path) -> Iterator[Picture]:
    for message in read_topic(place):
        image, flaw = None, message.damage
        if not flaw:
            image, flaw = unpack_picture(message.content, place)
        if image is not None:
            check_size(image.shape[1], image.shape[0], place)
        yield Picture(image, message.time, message.number, flaw)


def _read_camera(name: str) -> Iterator[Picture]:
    device = name.removeprefix("camera:")
    capture = cv2.VideoCapture(int(device) if device.isdigit() else device)
    if not capture.isOpened():
        raise OSError(
            f"{name} cannot be opened: give a camera's number (camera:0) or device (/dev/video0), "
            "and check that it is plugged in and free"
        )
    patience = 2.0  # longest time over which reads may fail, as while a bus is busy [s]
    start, number, failing = time.monotonic(), 0, np.inf
    try:
        while True:
            there, image = capture.read()
            now = time.monotonic() - start
            failing = np.inf if there else min(failing, now)
            if now - failing > patience:
                yield Picture(None, now, number, "the camera was disconnected")
                return
            if not there:
                time.sleep(0.01)
                continue
            yield Picture(image, now, number)
            number += 1
    finally:
        capture.release()
