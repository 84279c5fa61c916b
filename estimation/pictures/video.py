"""What a video declares about its pictures: times, turn, end, and how coarsely they are coded.

A codec drops changes that are weaker than its quantizer's step, and shows an earlier picture in
their place. At a low bit rate the step is large, so a print that turns fast is shown where it was.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.sidedata.sidedata import SideDataContainer
    from av.video.frame import VideoFrame

VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".mpg", ".mpeg")
"""Suffixes of the videos that are read."""


def doubt_videos(folder: Path) -> tuple[str, ...]:
    """A warning about videos in a folder of pictures, which are not read; or none."""
    videos = sorted(file.name for file in folder.iterdir() if file.suffix.lower() in VIDEO_SUFFIXES)
    if not videos:
        return ()
    return (
        f"The folder also holds videos ({', '.join(videos[:3])}{', …' * (len(videos) > 3)}), which "
        "are not read: a folder that holds pictures counts as one recording of these. To read the "
        "videos, name them, or move the pictures elsewhere.",
    )


def doubt_coding(container: "InputContainer") -> tuple[str, ...]:
    """A doubt about a video that may be coded coarsely, where its codec does not tell; or none."""
    telling = ("h264", "mpeg4", "mpeg2video", "vp9")  # codecs that give each quantizer
    coarse = 0.05  # bits per pixel, below which H.264 shows the print of an earlier picture
    stream = container.streams.video[0]
    codec, rate = stream.codec_context.codec, float(stream.average_rate or 0.0)
    pixels = stream.width * stream.height * rate
    bits = (stream.bit_rate or container.bit_rate or 0) / max(pixels, 1.0)
    if not 0.0 < bits < coarse or codec.intra_only or codec.canonical_name in telling:
        return ()
    return (
        f"The video has {bits:.2g} bits per pixel, and its codec ({codec.canonical_name}) does not "
        "tell how coarsely it codes them. Where the object turns fast, such a video may show its "
        "print up to 7° late, which the intervals do not cover. Record with constant quality or a "
        "higher bit rate.",
    )


def read_turn(frame: "VideoFrame") -> tuple[int, int, int, int]:
    """How a picture of a video is turned or mirrored to be shown, as `turn_upright` takes it."""
    matrix = cast("SideDataContainer", frame.side_data).get("DISPLAYMATRIX")
    if matrix is None:
        return 1, 0, 0, 1
    a, b, _, c, d = np.frombuffer(matrix, np.int32)[:5].tolist()
    return a, b, c, d


class VideoClock:
    """Numbers and times of a video's pictures, and whether it ends before its declared end.

    Attributes:
        number: number of the last picture, counted from 0; −1 at first.
    """

    def __init__(self, rate: float, stamps: Mapping[int, float]) -> None:
        """Begin before the first picture.

        Args:
            rate: pictures per second [1/s].
            stamps: times by number that replace those of the video [s]; may be empty.
        """
        self._interval = self._longest = 1.0 / rate
        self.number, self._time, self._stamps = -1, -self._interval, stamps

    def advance(self, time_s: float | None) -> float:
        """Time of the next picture [s], one interval later if the video gives it no time.

        It is NaN if there are stamps, but none for this picture.
        """
        before, self._time = self._time, self._time + self._interval if time_s is None else time_s
        self.number += 1
        if self.number:
            self._longest = max(self._longest, self._time - before)
        return self._stamps.get(self.number, np.nan) if self._stamps else self._time

    def find_missing(self, container: "InputContainer") -> str:
        """Which part of the declared video is missing after the last picture; or empty."""
        import av

        stream = container.streams.video[0]
        declared, short = stream.frames, stream.frames - (self.number + 1)
        if declared and stream.duration and stream.time_base:
            # frames that an edit leaves out or a recorder dropped are declared, but not missing
            end = float((stream.duration + (stream.start_time or 0)) * stream.time_base)
            missing = short > 0 and end - self._time > 1.5 * self._longest
            text = f"{short} of the {declared} frames it declares are missing"
        else:  # only the length of the longest track is known
            end = (container.duration or 0) / av.time_base
            missing = end - self._time > 3.0 * self._longest
            text = f"{end - self._time:.2g} s of the {end:.3g} s it declares are missing"
        return f"the video ends here: {text}" if missing else ""


class Coding:
    """Reads the quantizer's step of the pictures of a video, in order of time."""

    options: ClassVar = {"export_side_data": "venc_params"}
    """Options of a decoder, with which its pictures have their quantizers."""

    def __init__(self) -> None:
        """Begin before the first picture."""
        self._step = 0.0

    def update(self, frame: "VideoFrame") -> float:
        """Step of the coefficients of the blocks of the next picture [grey levels]; 0 if unknown.

        Only videos in H.264, MPEG-4, MPEG-2 and VP9 give their quantizers. A picture of type B is
        interpolated between two others, whose step counts; one of type I is coded by itself.
        """
        whole, predicted = 1, 2  # types I and P
        if frame.pict_type == whole:
            self._step = 0.0
        elif frame.pict_type == predicted:
            self._step = _read_step(frame)
        return self._step


def _read_step(frame: "VideoFrame") -> float:
    """Mean step over the blocks of a picture.

    Each block's quantizer is the picture's plus its own difference, as in FFmpeg's
    `AVVideoEncParams`. In H.264 a step doubles with every sixth quantizer (ITU-T H.264, 8.5.9). In
    VP9 the steps are a table (VP9 specification, 8.6.1), here between some of its entries, and
    coefficients are 8 times those of H.264.
    """
    vp9, h264, mpeg2 = 0, 1, 2
    vp9_quantizers = 0, 1, 95, 120, 137, 150, 169, 182, 201, 217, 231, 245, 255
    vp9_steps = 4, 8, 102, 152, 203, 255, 359, 456, 651, 881, 1151, 1508, 1828
    # its stub names another type; what iteration gives differs between versions of PyAV
    found = cast("SideDataContainer", frame.side_data).get("VIDEO_ENC_PARAMS")
    if found is None:
        return 0.0
    held = bytes(found)
    count = int(np.frombuffer(held, np.uint32, 1)[0])
    offset, size = np.frombuffer(held, np.uint64, 2, 8).tolist()
    kind, quantizer = np.frombuffer(held, np.int32, 2, 24).tolist()
    blocks = np.frombuffer(held, np.uint8, count * size, offset).reshape(count, size)
    own = blocks[:, 16:20].copy().view(np.int32)
    mean = quantizer + (float(own.mean()) if count else 0.0)
    if kind == vp9:
        return float(np.interp(mean, vp9_quantizers, vp9_steps)) / 8.0
    if kind == h264:
        return 0.625 * 2.0 ** (mean / 6.0)
    return mean if kind == mpeg2 else 0.0
