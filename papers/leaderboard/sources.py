"""The cases with their recordings and truths, each made only when needed."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from estimation.frames.recording import Recording
from estimation.pictures.stream import read_pictures
from estimation.sources import read_recording
from estimation.virtual.clip import VirtualClip
from papers.leaderboard import real, strained, virtual
from papers.leaderboard.cases import Case, Truth

Grey = UInt8[np.ndarray, "h w"]


class Source(NamedTuple):
    """A case with its truth and its recording.

    Attributes:
        case: the case.
        truth: the right answers.
        read: returns the recording.
        draw: returns the grey pictures; None without pictures.
        clip: the virtual clip that renders the pictures; None if none are rendered.
    """

    case: Case
    truth: Truth
    read: Callable[[], Recording]
    draw: Callable[[], Iterator[Grey]] | None = None
    clip: VirtualClip | None = None


def open_cases(
    cases: Mapping[str, Case], seed: int, say: Callable[[str], None] = lambda line: None
) -> Iterator[Source]:
    """The available cases with their truths; cases of missing data sets are left out."""
    groups = dict.fromkeys(case.group for case in cases.values() if case.tier == "real")
    roots = {group: real.find_group(group, say) for group in groups}
    for case in cases.values():
        if case.tier == "real":
            if (root := roots[case.group]) is not None:
                yield _open_real(case, root)
        elif case.pictures:
            clip, truth = virtual.make_clip(case, seed)
            yield Source(case, truth, partial(virtual.read_clip, clip), partial(_draw, clip), clip)
        else:
            simulate = virtual.simulate if case.tier == "virtual" else strained.simulate
            recording, truth = simulate(case, seed)
            yield Source(case, truth, lambda recording=recording: recording)


def _open_real(case: Case, root: Path) -> Source:
    path = real.find_path(case, root)  # its markers are detected as in `estimation run`
    draw = partial(_load, path) if case.pictures else None
    return Source(case, real.find_truth(case, root), partial(read_recording, path), draw)


def _draw(clip: VirtualClip) -> Iterator[Grey]:
    return (_grey(clip.draw(frame)) for frame in range(len(clip)))


def _load(path: Path) -> Iterator[Grey]:
    return (_grey(shot.image) for shot in read_pictures(path) if shot.image is not None)


def _grey(image: np.ndarray) -> Grey:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
