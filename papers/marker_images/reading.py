"""What readers wrote of the state of a contact, and how far they agree.

They read single frames, or whole clips in spans. How they read: `readings/README.md`.
"""

import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimation.estimators.result import State

UNCLEAR = "unclear"
ALLOWED = {
    "contact": ("yes", "no", UNCLEAR),
    "motion": ("rest", "moving"),
    "state": (State.NO_CONTACT, State.STICK, State.INCIPIENT, State.MACRO_SLIP, UNCLEAR),
}
"""What a reader may write, by column."""


class Place(NamedTuple):
    """A frame of a clip.

    Attributes:
        clip: path of the video below the folder of all, without its ending.
        frame: number of the frame, from 0.
    """

    clip: str
    frame: int


Reading = dict[Place, dict[str, str]]
"""What one reader wrote: the columns of `ALLOWED`, by frame."""


class Span(NamedTuple):
    """Frames of a clip that look alike.

    Attributes:
        first: frame, from 0.
        last: frame, part of the span.
        words: the columns of `ALLOWED`.
        unsure: by how much the span may begin earlier or later [frames].
    """

    first: int
    last: int
    words: dict[str, str]
    unsure: int


Spans = dict[str, list[Span]]
"""What one reader wrote of whole clips: spans without gaps from the first frame on, by clip."""


def read_reading(path: Path) -> Reading:
    """A table of what a reader saw in single frames.

    Raises:
        ValueError: a word that is not allowed, or a frame twice.
        OSError: the file cannot be read.
    """
    found: Reading = {}
    for line, row, words in _rows(path):
        place = Place(row["clip"], int(row["frame"]))
        if place in found:
            raise ValueError(f"{path}, line {line}: frame {place.frame} is there twice")
        found[place] = words
    return found


def read_spans(path: Path) -> Spans:
    """A table of what a reader saw in whole clips.

    Raises:
        ValueError: a word that is not allowed, numbers that are none, or a gap between spans.
        OSError: the file cannot be read.
    """
    found: Spans = {}
    for line, row, words in _rows(path):
        spans = found.setdefault(row["clip"], [])
        try:
            first, last, unsure = (int(row[name]) for name in ("from", "to", "unsure"))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(
                f"{path}, line {line}: from, to and unsure must be numbers of frames"
            ) from error
        expected = spans[-1].last + 1 if spans else 0
        if first != expected or last < first or unsure < 0:
            raise ValueError(
                f"{path}, line {line}: {first} to {last}, unsure by {unsure}; the span must begin "
                f"at frame {expected}, not end before it, and be unsure by 0 frames or more"
            )
        spans.append(Span(first, last, words, unsure))
    return found


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str], dict[str, str]]]:
    """Line, row, and the words of the row, checked."""
    with path.open(encoding="utf-8", newline="") as opened:
        for line, row in enumerate(csv.DictReader(opened), start=2):
            for name, allowed in ALLOWED.items():
                if row.get(name) not in allowed:
                    raise ValueError(
                        f"{path}, line {line}: {name} is {row.get(name)!r}; it must be one of "
                        f"{', '.join(allowed)}"
                    )
            yield line, row, {name: row[name] for name in ALLOWED}


def read_readings() -> dict[str, Reading]:
    """The readings of single frames that belong to the study, by the reader's name.

    Raises:
        ValueError: they are not of the same frames, or one is damaged.
    """
    with resources.as_file(resources.files("papers.marker_images") / "readings") as folder:
        found = {path.stem: read_reading(path) for path in sorted(folder.glob("*.csv"))}
    return _alike(found)


def read_whole_clips() -> dict[str, Spans]:
    """The readings of whole clips that belong to the study, by the reader's name.

    Raises:
        ValueError: they are not of the same frames, or one is damaged.
    """
    files = resources.files("papers.marker_images") / "readings" / "whole_clips"
    with resources.as_file(files) as folder:
        found = {path.stem: read_spans(path) for path in sorted(folder.glob("*.csv"))}
    _alike({name: spread(spans) for name, spans in found.items()})
    return found


def _alike(readings: dict[str, Reading]) -> dict[str, Reading]:
    if len({frozenset(reading) for reading in readings.values()}) != 1:
        raise ValueError(f"{', '.join(readings)} are not readings of the same frames")
    return readings


def read_frames() -> dict[str, list[int]]:
    """The single frames that were read, by clip."""
    frames: dict[str, list[int]] = {}
    for clip, frame in next(iter(read_readings().values())):
        frames.setdefault(clip, []).append(frame)
    return frames


def spread(spans: Spans, sure: bool = False) -> Reading:
    """A reading of whole clips as one of all their frames.

    Args:
        spans: by clip.
        sure: write `unclear` where a word changes at a time that is not known to the frame.
    """
    found: Reading = {}
    for clip, parts in spans.items():
        for span in parts:
            found |= {Place(clip, t): dict(span.words) for t in range(span.first, span.last + 1)}
        for before, after in pairwise(parts if sure else []):
            for t in range(after.first - after.unsure, after.first + after.unsure):
                for name, word in after.words.items():
                    if word != before.words[name] and Place(clip, t) in found:
                        found[Place(clip, t)][name] = UNCLEAR
    return found


class Run(NamedTuple):
    """Consecutive frames of one state.

    Attributes:
        state: the word for it.
        first: frame.
        last: frame, part of the run.
        unsure: by how much it may begin earlier or later [frames].
    """

    state: str
    first: int
    last: int
    unsure: int = 0


def find_runs(parts: Sequence[Run]) -> list[Run]:
    """Runs, each as long as its state lasts, of shorter ones that follow each other."""
    found: list[Run] = []
    for part in parts:
        if found and found[-1].state == part.state:
            found[-1] = found[-1]._replace(last=part.last)
        else:
            found.append(part)
    return found


def find_alike(run: Run, others: Sequence[Run]) -> Run | None:
    """The run of the same state that shares frames with this one and begins nearest to it."""
    alike = [
        other
        for other in others
        if other.state == run.state and other.first <= run.last and run.first <= other.last
    ]
    return min(alike, key=lambda other: abs(other.first - run.first), default=None)


def kappa(one: Sequence[str], other: Sequence[str]) -> float:
    """Agreement beyond chance [-], [Cohen1960] J. Cohen, "A coefficient of agreement for nominal
    scales"; 1 where both are always the same.
    """
    n = len(one)
    observed = sum(a == b for a, b in zip(one, other, strict=True)) / n
    counts, others = Counter(one), Counter(other)
    chance = sum(counts[word] * others[word] for word in counts) / n**2
    return 1.0 if chance == 1.0 else (observed - chance) / (1.0 - chance)


def compare_readers(readings: Mapping[str, Reading]) -> list[dict[str, object]]:
    """How often two readers agree, in each column; none where there is one reader."""
    rows: list[dict[str, object]] = []
    names = sorted(readings)
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            for column in ALLOWED:
                words = [
                    (row[column], readings[other][place][column])
                    for place, row in readings[one].items()
                ]
                clear = [pair for pair in words if UNCLEAR not in pair]
                rows.append(
                    {
                        "readers": f"{one}, {other}",
                        "column": column,
                        "frames": len(words),
                        "the same [%]": round(100.0 * np.mean([a == b for a, b in words]), 1),
                        "kappa": round(kappa(*zip(*words, strict=True)), 3),
                        "clear to both": len(clear),
                        "of these the same [%]": round(
                            100.0 * np.mean([a == b for a, b in clear]), 1
                        ),
                        "their kappa": round(kappa(*zip(*clear, strict=True)), 3),
                    }
                )
    return rows
