"""The cases with their recordings and truths, each made only when needed."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from estimation.fields.outline import follow_outline
from estimation.frames import datasets
from estimation.frames.extras import MissingExtraError, require_extra
from estimation.frames.recording import Recording
from estimation.pictures.stream import read_pictures
from estimation.sources import read_recording
from estimation.virtual.clip import VirtualClip
from papers.leaderboard import strained, virtual
from papers.leaderboard.cases import Case, Truth
from papers.marker_images.settings import REGISTERED
from papers.slip_lifts.lifts import read_labels

Grey = UInt8[np.ndarray, "h w"]
CLIP = "screw_driver_blue_gray/exp_num_1"


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
    roots = {group: find_group(group, say) for group in groups}
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
    path = find_path(case, root)  # its markers are detected as in `estimation run`
    draw = partial(_load, path) if case.pictures else None
    return Source(case, find_truth(case, root), partial(read_recording, path), draw)


def _draw(clip: VirtualClip) -> Iterator[Grey]:
    return (_grey(clip.draw(frame)) for frame in range(len(clip)))


def _load(path: Path) -> Iterator[Grey]:
    return (_grey(shot.image) for shot in read_pictures(path) if shot.image is not None)


def _grey(image: np.ndarray) -> Grey:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image


def find_group(group: str, say: Callable[[str], None]) -> Path | None:
    """The folder of a data set; None if it was not fetched, or its extra is not installed.

    Then `say` is called with a line that names what is missing and how to get it.
    """
    folder = datasets.find(group)
    if folder is None:
        say(f"{group} left out: not downloaded; run `python -m estimation fetch {group}`")
        return None
    try:
        if group == "pivot-videos":
            require_extra("video", group)
    except MissingExtraError as error:
        say(f"{group} left out: {error}")
        return None
    return folder


def find_path(case: Case, root: Path) -> Path:
    """The folder or video of a case."""
    name = case.name.removeprefix(f"real/{case.group}/")
    return root / f"{name}.avi" if case.group == "pivot-videos" else root / name


def find_truth(case: Case, root: Path) -> Truth:
    """The truth of a case, from sources other than the twist of its markers.

    `tac3d-pivot`: the outline of the elongated contact, tracked from frame to frame. The clips: the
    object's imprint, registered by others in a few frames. The lifts: their labels.

    Raises:
        ValueError: the data set has no label for the lift.
    """
    if case.lift:
        return Truth(
            np.zeros(1), {case.group: np.ones(1, dtype=bool)}, slipped=_slipped(case, root)
        )
    if case.group == "tac3d-pivot":
        angle = follow_outline(read_recording(find_path(case, root))).angle
    else:
        turns = {0: 0.0} | REGISTERED[f"{CLIP}/{case.name.rpartition('/')[2]}"]
        angle = np.full(case.frames, np.nan)
        angle[list(turns)] = np.radians(list(turns.values()))
    return Truth(angle, {case.group: np.isfinite(angle)}, relative=True)


def _slipped(case: Case, root: Path) -> bool:
    folder, lift = case.name.split("/")[-2:]
    for label in read_labels(root / f"{folder}_result.dat"):
        if label.lift == lift:
            return label.slipped
    raise ValueError(f"{root / folder}_result.dat has no label for {lift}")
