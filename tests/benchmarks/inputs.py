"""Long streams as inputs of the benchmarks."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2

from estimation.frames.recording import Frame, Recording
from estimation.pictures.render import Camera


def repeat(recording: Recording, count: int) -> Iterator[Frame]:
    """The frames of a recording, repeated with increasing times."""
    frames = list(recording)
    period = frames[-1].time - frames[0].time + 1.0
    for number in range(count):
        turn, row = divmod(number, len(frames))
        frame = frames[row]
        yield replace(frame, time=frame.time + turn * period, source_index=number)


def write_loop(folder: Path, count: int) -> None:
    """Write a folder with `count` pictures: a pivot there and back, repeated."""
    from tests.benchmarks.pictures import render_dot_pictures  # sets numbers of threads

    folder.mkdir()
    images = render_dot_pictures(Camera(), (7, 10), 62.0).pictures
    for number, image in enumerate([*images, *images[-2:0:-1]]):
        cv2.imwrite(str(folder.parent / f"{number}.png"), image)
    for number in range(count):
        shown = folder.parent / f"{number % (2 * len(images) - 2)}.png"
        (folder / f"{number:07}.png").symlink_to(shown)
