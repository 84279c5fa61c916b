"""The cases of the benchmark by name: tier, group, split and number of frames.

Every draw of a group has as many frames as any other, so that an entry is checked without making a
recording. Importing this module is cheap.
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
"""Frames of `elongated` after macro slip has begun: only the outline still shows the angle."""


class Case(NamedTuple):
    """A recording to answer.

    Attributes:
        name: as in an entry and in the export.
        tier: one of `settings.TIERS`.
        group: recordings of the same kind; each group of a tier has the same weight.
        split: `tuning` or `scored`.
        frames: how many there are.
        pictures: whether there are pictures of it.
        lift: whether the question is if the object slipped, in place of its angle.
    """

    name: str
    tier: str
    group: str
    split: str
    frames: int
    pictures: bool = False
    lift: bool = False


class Truth(NamedTuple):
    """The right answers to a case.

    Attributes:
        angle: of the object [rad]; NaN where unknown.
        counts: frames that are scored, by group.
        softness: k of the object, which entrants are told [-].
        relative: whether angles are known up to a constant, which is then taken from the errors.
        slipped: whether the object slipped out; None where the question is the angle.
    """

    angle: Float[np.ndarray, " frames"]
    counts: Mapping[str, Bool[np.ndarray, " frames"]]
    softness: float = 0.0
    relative: bool = False
    slipped: bool | None = None


def list_cases(split: str) -> dict[str, Case]:
    """The cases of a split by name.

    Args:
        split: one of `SPLITS`.

    Raises:
        ValueError: there is no such split.
    """
    if split not in SPLITS:
        raise ValueError(f"no split {split!r}; choose from {', '.join(SPLITS)}")
    every = (*_simulated(), *_real())
    return {case.name: case for case in every if case.split == split}


def frames_of(condition: settings.Condition) -> int:
    """Frames of a virtual pivot, those that are lost left out."""
    whole = settings.UNLOADED + settings.PRESSING + sum(condition.path["frames"])
    return whole - round(condition.lost * whole)


def count_frames(sticking: Int[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames of a simulated case that count: from enough sticking markers on, until too few stick.

    Args:
        sticking: markers under the object that do not slip.
    """
    enough = sticking >= settings.LEAST_STICKING
    return enough & ~np.logical_or.accumulate(~enough & np.logical_or.accumulate(enough))


def _simulated() -> Iterator[Case]:
    lengths = {group: frames_of(one) for group, one in settings.CONDITIONS.items()}
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
