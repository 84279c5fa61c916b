"""Answers to pictures as from `python -m estimation run`, by the default method only."""

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
    """The answers of a run."""

    frames: list[Answer]  # the last answer to each frame; the stream may revise an answer
    noise: Noise | None  # noise of the markers, estimated from the first frames


class _OneMethod(Settings):
    """Settings of a run with the selected method only."""

    @property
    def methods(self) -> dict[str, Mapping[str, object]]:
        return {self.method: self.constants}


def answer_pictures(path: Path) -> Answers:
    """Answers to a video or a folder of pictures.

    Raises:
        ValueError: no picture has markers.
        OSError: the pictures cannot be read.
    """
    stream = Stream(PictureSource(path), _OneMethod())
    answers: dict[int, Answer] = {}
    for answer in stream.answers():  # a later answer may revise an earlier one
        answers[answer.row] = answer
    return Answers([answers[row] for row in sorted(answers)], stream.follower.noise)


def answer_clip(clip: VirtualClip) -> Answers:
    """Answers to the pictures of a virtual clip."""
    with TemporaryDirectory() as folder:
        write_pictures(clip, Path(folder))
        return answer_pictures(Path(folder))
