"""The state of the contact against a table read by eye, twice, from clips of real objects.

How frames were drawn and read: `readings/README.md`. Ours are scored where both readers agree. At
rest the readers write `stick`, since pictures at rest do not show what has slipped before; ours
may say `incipient` there, and only `macro_slip`, `no_contact` and `unknown` count as wrong.
"""

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from estimation.estimators.result import State
from estimation.frames import datasets
from papers.items import Track
from papers.marker_images.answers import answer_pictures

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


class Ours(NamedTuple):
    """What we answer in a frame.

    Attributes:
        state: of the contact.
        reason: why there is no angle, or what speaks against it.
    """

    state: str
    reason: str

    @property
    def contact(self) -> str:
        """The contact in the readers' words; `unclear` where the state is unknown."""
        return {State.NO_CONTACT: "no", State.UNKNOWN: UNCLEAR}.get(State(self.state), "yes")


@dataclass(frozen=True)
class Scored:
    """Readings and our answers.

    Attributes:
        readings: by the reader's name.
        ours: by frame; may lack frames, and clips.
    """

    readings: Mapping[str, Reading]
    ours: Mapping[Place, Ours]

    @property
    def agreed(self) -> Reading:
        """What all readers wrote alike, by frame and column, where it is not unclear."""
        first, *others = self.readings.values()
        return {
            place: {
                name: word
                for name, word in row.items()
                if word != UNCLEAR and all(other[place][name] == word for other in others)
            }
            for place, row in first.items()
            if place in self.ours
        }


def read_reading(path: Path) -> Reading:
    """A table of what a reader saw.

    Raises:
        ValueError: a word that is not allowed, or a frame twice.
        OSError: the file cannot be read.
    """
    found: Reading = {}
    with path.open(encoding="utf-8", newline="") as opened:
        for line, row in enumerate(csv.DictReader(opened), start=2):
            for name, allowed in ALLOWED.items():
                if row.get(name) not in allowed:
                    raise ValueError(
                        f"{path}, line {line}: {name} is {row.get(name)!r}; it must be one of "
                        f"{', '.join(allowed)}"
                    )
            place = Place(row["clip"], int(row["frame"]))
            if place in found:
                raise ValueError(f"{path}, line {line}: frame {place.frame} is there twice")
            found[place] = {name: row[name] for name in ALLOWED}
    return found


def read_readings() -> dict[str, Reading]:
    """The readings that belong to the study, by the reader's name.

    Raises:
        ValueError: they are not of the same frames, or one is damaged.
    """
    with resources.as_file(resources.files("papers.marker_images") / "readings") as folder:
        found = {path.stem: read_reading(path) for path in sorted(folder.glob("*.csv"))}
    if len({frozenset(reading) for reading in found.values()}) != 1:
        raise ValueError(f"{', '.join(found)} are not readings of the same frames")
    return found


def read_frames() -> dict[str, list[int]]:
    """The frames that were read, by clip."""
    frames: dict[str, list[int]] = {}
    for clip, frame in next(iter(read_readings().values())):
        frames.setdefault(clip, []).append(frame)
    return frames


def compute(quick: bool = False, track: Track = iter) -> Scored:
    """Answer all clips of the table; the two shortest only if quick."""
    root = datasets.fetch("state-videos")
    readings, frames = read_readings(), read_frames()
    clips = sorted(frames, key=lambda clip: max(frames[clip]))[: 2 if quick else None]
    ours: dict[Place, Ours] = {}
    for clip in track(clips):
        answers = answer_pictures(root / f"{clip}.avi").frames
        for frame in frames[clip]:
            one = answers[frame].estimates["tracked"]
            ours[Place(clip, frame)] = Ours(one.state, one.reason)
    return Scored(readings, ours)


def kappa(one: Sequence[str], other: Sequence[str]) -> float:
    """Agreement beyond chance [-], [Cohen1960] J. Cohen, "A coefficient of agreement for nominal
    scales"; 1 where both are always the same.
    """
    n = len(one)
    observed = sum(a == b for a, b in zip(one, other, strict=True)) / n
    counts, others = Counter(one), Counter(other)
    chance = sum(counts[word] * others[word] for word in counts) / n**2
    return 1.0 if chance == 1.0 else (observed - chance) / (1.0 - chance)


def is_right(read: str, motion: str, ours: str) -> bool:
    """Whether our state is right, by what was read."""
    return ours == read or (read == State.STICK and motion == "rest" and ours == State.INCIPIENT)


def tables(result: Scored) -> dict[str, list[dict[str, object]]]:
    """Figures; our states by what was read; the readers' agreement; frames we have wrong."""
    return {
        "": _figures(result),
        "_states": _confusion(result),
        "_readers": _compare_readers(result.readings),
        "_wrong": _wrong(result),
    }


def _figures(result: Scored) -> list[dict[str, object]]:
    agreed, ours = result.agreed, result.ours
    contact = [
        UNCLEAR if ours[place].contact == UNCLEAR else ours[place].contact == row["contact"]
        for place, row in agreed.items()
        if "contact" in row
    ]
    rest = [ours[place].state for place, row in agreed.items() if row.get("motion") == "rest"]
    return [
        _figure("frames of the clips that were answered", len(agreed), len(agreed)),
        _figure("contact right", contact.count(True), len(contact)),
        _figure("contact wrong", contact.count(False), len(contact)),
        _figure("macro_slip at rest", rest.count(State.MACRO_SLIP), len(rest)),
    ]


def _figure(name: str, count: int, of: int) -> dict[str, object]:
    return {"": name, "frames": count, "of": of, "share [%]": round(100.0 * count / max(of, 1), 1)}


def _confusion(result: Scored) -> list[dict[str, object]]:
    """A row for each state that was read, stick apart for rest and motion."""
    kinds: dict[str, list[tuple[str, bool]]] = {}
    for place, row in result.agreed.items():
        read, motion = row.get("state"), row.get("motion", "moving")
        if read is None:
            continue
        state = result.ours[place].state
        kind = f"{read}, {motion}" if read == State.STICK else read
        kinds.setdefault(kind, []).append((state, is_right(read, motion, state)))
    return [
        {
            "read": kind,
            "frames": len(found),
            **{f"ours {state}": sum(one == state for one, _ in found) for state in State},
            "right [%]": round(100.0 * np.mean([right for _, right in found]), 1),
        }
        for kind, found in sorted(kinds.items())
    ]


def _compare_readers(readings: Mapping[str, Reading]) -> list[dict[str, object]]:
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


def _wrong(result: Scored) -> list[dict[str, object]]:
    rows = []
    for place, row in result.agreed.items():
        ours = result.ours[place]
        contact = row.get("contact")
        read = row.get("state", "")
        right = not read or is_right(read, row.get("motion", ""), ours.state)
        if contact and ours.contact not in (contact, UNCLEAR):
            right = False
        if not right:
            rows.append(
                {
                    **place._asdict(),
                    "contact": contact,
                    "motion": row.get("motion"),
                    "state": read,
                    "ours": ours.state,
                    "reason": ours.reason,
                }
            )
    return rows


def plot(result: Scored) -> Figure:
    """Our states by what was read: shares of each row, with the number of frames."""
    rows = _confusion(result)
    figure, axes = plt.subplots(figsize=(6.5, 0.6 * len(rows) + 1.5), layout="constrained")
    counts = np.array([[row[f"ours {state}"] for state in State] for row in rows], dtype=float)
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0.0, vmax=1.0)
    for (i, j), count in np.ndenumerate(counts):
        axes.text(j, i, f"{count:.0f}", ha="center", va="center")
    axes.set_xticks(range(len(State)), [str(state) for state in State], rotation=30, ha="right")
    axes.set_yticks(range(len(rows)), [str(row["read"]) for row in rows])
    axes.set_xlabel("ours")
    axes.set_ylabel("read by eye")
    return figure
