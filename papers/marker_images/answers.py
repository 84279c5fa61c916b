"""Pictures answered as `python -m estimation run` does, by the default method alone."""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from estimation.frames.noise import Noise
from estimation.pictures.reading import PictureSource
from estimation.settings import Settings
from estimation.tracking.stream import Answer, Stream
from estimation.virtual.clip import VirtualClip, write_pictures


class Answers(NamedTuple):
    """What a run answers.

    Attributes:
        frames: the answer to each frame, the last where some were given anew.
        noise: of the markers, found in the first frames.
    """

    frames: list[Answer]
    noise: Noise | None


class _OneMethod(Settings):
    """Settings of a run without the methods that are not asked for."""

    @property
    def methods(self) -> dict[str, Mapping[str, object]]:
        return {self.method: self.constants}


def answer_pictures(path: Path) -> Answers:
    """Answers to a video or a folder of pictures.

    Raises:
        ValueError: no pictures with markers.
        OSError: they cannot be read.
    """
    stream = Stream(PictureSource(path), _OneMethod())
    found: dict[int, Answer] = {}
    for answer in stream.answers():  # some are given anew
        found[answer.row] = answer
    return Answers([found[row] for row in sorted(found)], stream.follower.noise)


def answer_clip(clip: VirtualClip) -> Answers:
    """Answers to the pictures of a virtual clip."""
    with TemporaryDirectory() as folder:
        write_pictures(clip, Path(folder))
        return answer_pictures(Path(folder))
