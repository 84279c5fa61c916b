"""States of a contact as read by eye, and the agreement of the readers.

Readers describe single frames, or whole clips in spans; `readings/README.md` is their guide.
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
"""The allowed words, by column."""


class Place(NamedTuple):
    """A frame of a clip."""

    clip: str  # path of the video in the data set, without its suffix
    frame: int  # number of the frame, from 0


Reading = dict[Place, dict[str, str]]
"""One reader's words for single frames: the columns of `ALLOWED`, by frame."""


class Span(NamedTuple):
    """Consecutive frames of a clip with the same words."""

    first: int  # first frame, from 0
    last: int  # last frame
    words: dict[str, str]  # the columns of `ALLOWED`
    unsure: int  # the span may begin earlier or later by so many frames


Spans = dict[str, list[Span]]
"""One reader's words for whole clips: spans without gaps from the first frame on, by clip."""


def read_reading(path: Path) -> Reading:
    """Read a reader's table of single frames.

    Raises:
        ValueError: a word is not allowed, or a frame is listed twice.
        OSError: the file cannot be read.
    """
    reading: Reading = {}
    for line, row, words in _rows(path):
        place = Place(row["clip"], int(row["frame"]))
        if place in reading:
            raise ValueError(
                f"{path}, line {line}: frame {place.frame} is listed twice: remove one line"
            )
        reading[place] = words
    return reading


def read_spans(path: Path) -> Spans:
    """Read a reader's table of whole clips.

    Raises:
        ValueError: a word is not allowed, a number is missing, or there is a gap between spans.
        OSError: the file cannot be read.
    """
    clips: Spans = {}
    for line, row, words in _rows(path):
        spans = clips.setdefault(row["clip"], [])
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
    return clips


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str], dict[str, str]]]:
    """Line number, row, and the row's checked words."""
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
    """The study's readings of single frames, by the reader's name.

    Raises:
        ValueError: they cover different frames, or one is damaged.
    """
    with resources.as_file(resources.files("papers.marker_images") / "readings") as folder:
        readings = {path.stem: read_reading(path) for path in sorted(folder.glob("*.csv"))}
    return _alike(readings)


def read_whole_clips() -> dict[str, Spans]:
    """The study's readings of whole clips, by the reader's name.

    Raises:
        ValueError: they cover different frames, or one is damaged.
    """
    files = resources.files("papers.marker_images") / "readings" / "whole_clips"
    with resources.as_file(files) as folder:
        clips = {path.stem: read_spans(path) for path in sorted(folder.glob("*.csv"))}
    _alike({name: spread(spans) for name, spans in clips.items()})
    return clips


def _alike(readings: dict[str, Reading]) -> dict[str, Reading]:
    if len({frozenset(reading) for reading in readings.values()}) != 1:
        raise ValueError(f"the readings {', '.join(readings)} must cover the same frames")
    return readings


def read_frames() -> dict[str, list[int]]:
    """The single frames that were read, by clip."""
    frames: dict[str, list[int]] = {}
    for clip, frame in next(iter(read_readings().values())):
        frames.setdefault(clip, []).append(frame)
    return frames


def spread(spans: Spans, sure: bool = False) -> Reading:
    """Expand the spans of whole clips to a reading of all their frames.

    If `sure`, frames near an unsure change of a word read `unclear`.
    """
    reading: Reading = {}
    for clip, parts in spans.items():
        for span in parts:
            reading |= {Place(clip, t): dict(span.words) for t in range(span.first, span.last + 1)}
        for before, after in pairwise(parts if sure else []):
            for t in range(after.first - after.unsure, after.first + after.unsure):
                for name, word in after.words.items():
                    if word != before.words[name] and Place(clip, t) in reading:
                        reading[Place(clip, t)][name] = UNCLEAR
    return reading


def find_agreed(readings: Mapping[str, Reading]) -> Reading:
    """The words on which all readers agree, by frame and column, without `unclear`."""
    first, *others = readings.values()
    return {
        place: {
            name: word
            for name, word in row.items()
            if word != UNCLEAR and all(other[place][name] == word for other in others)
        }
        for place, row in first.items()
    }


class Run(NamedTuple):
    """Consecutive frames of one state; it may begin earlier or later by `unsure` frames."""

    state: str
    first: int
    last: int
    unsure: int = 0


def find_runs(parts: Sequence[Run]) -> list[Run]:
    """Join consecutive runs of the same state."""
    runs: list[Run] = []
    for part in parts:
        if runs and runs[-1].state == part.state:
            runs[-1] = runs[-1]._replace(last=part.last)
        else:
            runs.append(part)
    return runs


def find_alike(run: Run, others: Sequence[Run]) -> Run | None:
    """The run of the same state that overlaps this one and begins nearest to it; None without."""
    alike = [
        other
        for other in others
        if other.state == run.state and other.first <= run.last and run.first <= other.last
    ]
    return min(alike, key=lambda other: abs(other.first - run.first), default=None)


def kappa(one: Sequence[str], other: Sequence[str]) -> float:
    """Agreement beyond chance [-], [Cohen1960] J. Cohen, "A coefficient of agreement for nominal
    scales"; 1 if both sequences are constant and equal.
    """
    n = len(one)
    observed = sum(a == b for a, b in zip(one, other, strict=True)) / n
    counts, others = Counter(one), Counter(other)
    chance = sum(counts[word] * others[word] for word in counts) / n**2
    return 1.0 if chance == 1.0 else (observed - chance) / (1.0 - chance)


def compare_readers(readings: Mapping[str, Reading]) -> list[dict[str, object]]:
    """Agreement of each pair of readers in each column; empty with one reader."""
    rows: list[dict[str, object]] = []
    names = sorted(readings)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            for column in ALLOWED:
                words = [
                    (row[column], readings[second][place][column])
                    for place, row in readings[first].items()
                ]
                clear = [pair for pair in words if UNCLEAR not in pair]
                rows.append(
                    {
                        "readers": f"{first}, {second}",
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
