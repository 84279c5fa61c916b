"""Cases of the real tier: published recordings that have been fetched."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from estimation.fields.outline import follow_outline
from estimation.frames import datasets
from estimation.frames.extras import MissingExtraError, require_extra
from estimation.sources import read_recording
from papers.leaderboard.cases import Case, Truth
from papers.marker_images.settings import REGISTERED
from papers.slip_lifts.lifts import read_labels

CLIP = "screw_driver_blue_gray/exp_num_1"


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
