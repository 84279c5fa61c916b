"""The cases of the benchmark by name: tier, group, split and number of frames.

All draws of a group have the same number of frames, so an entry can be checked without simulating
a recording. Importing this module is cheap.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.frames.datasets import list_files
from papers.leaderboard import settings

SPLITS = ("tuning", "scored")
SLIDING = "elongated, sliding"
"""Frames of group `elongated` from macro slip on, when only the outline shows the angle."""


class Case(NamedTuple):
    """A recording to answer."""

    name: str  # name in entries and in the export
    tier: str  # one of `settings.TIERS`
    group: str  # recordings of the same kind; all groups of a tier have the same weight
    split: str  # `tuning` or `scored`
    frames: int  # number of frames
    pictures: bool = False  # whether the case has pictures
    lift: bool = False  # whether to answer if the object slipped, instead of its angle


class Truth(NamedTuple):
    """The right answers to a case.

    Attributes:
        angle: angle of the object [rad]; NaN where unknown.
        counts: mask of the scored frames, by group.
        softness: k of the object [-]; entrants know it.
        relative: whether the true angles have an unknown offset; the errors' median is then
            subtracted.
        slipped: whether the object slipped out; None if the angle is asked for.
    """

    angle: Float[np.ndarray, " frames"]
    counts: Mapping[str, Bool[np.ndarray, " frames"]]
    softness: float = 0.0
    relative: bool = False
    slipped: bool | None = None


def list_cases(split: str) -> dict[str, Case]:
    """The cases of one of `SPLITS` by name.

    Raises:
        ValueError: the split does not exist.
    """
    if split not in SPLITS:
        raise ValueError(f"no split {split!r}; choose from {', '.join(SPLITS)}")
    every = (*_simulated(), *_real())
    return {case.name: case for case in every if case.split == split}


def frames_of(condition: settings.Condition) -> int:
    """Number of frames of a virtual pivot, without the lost ones."""
    whole = settings.UNLOADED + settings.PRESSING + sum(condition.path["frames"])
    return whole - round(condition.lost * whole)


def count_frames(sticking: Int[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Mask of the scored frames of a simulated case.

    Frames count once `settings.LEAST_STICKING` markers stick, until for the first time fewer do.
    """
    enough = sticking >= settings.LEAST_STICKING
    return enough & ~np.logical_or.accumulate(~enough & np.logical_or.accumulate(enough))


def _simulated() -> Iterator[Case]:
    lengths = {group: frames_of(condition) for group, condition in settings.CONDITIONS.items()}
    lengths |= {"elongated": settings.ELONGATED_FRAMES, "rendered": settings.RENDERED_FRAMES}
    steps = settings.GEL_PRESSES + 2 * settings.GEL_PEAK_DEG - settings.GEL_BACK_DEG
    whole = settings.UNLOADED + steps
    gels = dict.fromkeys(settings.GELS, whole - round(settings.GEL_LOST * whole))
    for tier, groups in (("virtual", lengths), ("finite strain", gels)):
        for group, frames in groups.items():
            for draw in range(settings.SCORED_DRAWS + 1):
                split = "scored" if draw else "tuning"
                name = f"{tier}/{group}-{draw}".replace(" ", "-")
                yield Case(name, tier, group, split, frames, pictures=group == "rendered")


def _real() -> Iterator[Case]:
    for group, recordings in (("tac3d-pivot", settings.TAC3D), ("pivot-videos", settings.CLIPS)):
        for name, (split, frames) in recordings.items():
            pictures = group == "pivot-videos"
            yield Case(f"real/{group}/{name}", "real", group, split, frames, pictures)
    files = map(PurePosixPath, list_files("slip-lifts"))
    lifts = Counter(
        file.parent for file in files if file.suffix == ".jpg" and "outside" not in file.parts
    )
    for lift, frames in lifts.items():
        split = "tuning" if lift.parts[0] in settings.TUNING_LIFTS else "scored"
        yield Case(f"real/slip-lifts/{lift}", "real", "slip-lifts", split, frames, True, lift=True)
