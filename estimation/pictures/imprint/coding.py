"""How coarsely a video codes the changes between its pictures.

A codec drops changes that are weaker than its quantizer's step, and shows an earlier picture in
their place. At a low bit rate the step is large, so a print that turns fast is shown where it was.
"""

from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

if TYPE_CHECKING:
    from av.sidedata.sidedata import SideDataContainer
    from av.video.frame import VideoFrame


class Coding:
    """Reads the quantizer's step of the pictures of a video, in order of time."""

    options: ClassVar = {"export_side_data": "venc_params"}
    """Options of a decoder, with which its pictures have their quantizers."""

    def __init__(self) -> None:
        """Begin before the first picture."""
        self._step = 0.0

    def update(self, frame: "VideoFrame") -> float:
        """Step of the coefficients of the blocks of the next picture [grey levels]; 0 if unknown.

        Only videos in H.264, MPEG-4 and MPEG-2 give their quantizers. A picture of type B is
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
    `AVVideoEncParams`. In H.264 a step doubles with every sixth quantizer (ITU-T H.264, 8.5.9).
    """
    h264, mpeg2 = 1, 2
    held = cast("SideDataContainer", frame.side_data)  # its stub names another type
    found = [bytes(data) for data in held if data.type.name == "VIDEO_ENC_PARAMS"]
    if not found:
        return 0.0
    count = int(np.frombuffer(found[0], np.uint32, 1)[0])
    offset, size = np.frombuffer(found[0], np.uint64, 2, 8).tolist()
    kind, quantizer = np.frombuffer(found[0], np.int32, 2, 24).tolist()
    blocks = np.frombuffer(found[0], np.uint8, count * size, offset).reshape(count, size)
    own = blocks[:, 16:20].copy().view(np.int32)
    mean = quantizer + (float(own.mean()) if count else 0.0)
    if kind == h264:
        return 0.625 * 2.0 ** (mean / 6.0)
    return mean if kind == mpeg2 else 0.0
