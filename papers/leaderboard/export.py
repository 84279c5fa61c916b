"""Export for entrants: recordings of both splits, and the truth of the tuning cases only."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimation.frames.archive import write_archive
from estimation.frames.files import write_whole
from estimation.virtual.clip import write_pictures
from papers.items import Track
from papers.leaderboard.sources import Source

BASELINE = Path(__file__).with_name("baseline.csv")
"""The entry of the rigid fit `kabsch` in the practice round."""


def export_cases(sources: Sequence[Source], folder: Path, track: Track = iter) -> None:
    """Write the recordings, the rules and a list of the cases.

    `SPLIT/CASE.npz` is a recording; for a rendered clip, the folder `SPLIT/CASE` has its pictures.
    `cases.csv` lists all cases, `truth.csv` has the truth of the tuning cases, and `baseline.csv`
    is an entry to compare with.

    Raises:
        OSError: a file cannot be written.
    """
    listed = ["case,split,frames,softness,pictures,question"]
    truths = ["case,frame,angle_deg,slipped"]
    for source in track(sources):
        case, truth = source.case, source.truth
        place = folder / case.split / case.name
        recording = replace(source.read(), name=case.name, source=f"leaderboard case {case.name}")
        write_archive(recording, place.with_name(f"{place.name}.npz"))
        if source.clip is not None:
            write_pictures(source.clip, place)
        shown = "" if source.draw is None else case.name if source.clip is not None else "fetch"
        question = "slipped" if case.lift else "angle"
        listed.append(
            f"{case.name},{case.split},{case.frames},{truth.softness:g},{shown},{question}"
        )
        if case.split == "tuning":
            truths += _write_truth(source)
    write_whole(folder / "cases.csv", "\n".join(listed) + "\n")
    write_whole(folder / "truth.csv", "\n".join(truths) + "\n")
    rules = BASELINE.with_name("README.md").read_text(encoding="utf-8")
    plain = re.sub(r"\[([^]]*)\]\((?!https?:)[^)]*\)", r"\1", rules)  # its links lead elsewhere
    write_whole(folder / "README.md", plain)
    write_whole(folder / BASELINE.name, BASELINE.read_text(encoding="utf-8"))


def _write_truth(source: Source) -> list[str]:
    """The CSV lines of a case: the scored frames with their truth."""
    case, truth = source.case, source.truth
    if truth.slipped is not None:
        return [f"{case.name},0,,{int(truth.slipped)}"]
    counts = np.logical_or.reduce(list(truth.counts.values()))
    return [
        f"{case.name},{frame},{np.degrees(truth.angle[frame]):.4f},"
        for frame in np.flatnonzero(counts)
    ]
