"""Our states of the contact compared with states read by eye, from clips of real objects.

Two readers read single frames of many clips, and two whole clips; `readings/README.md` describes
how. Our states are scored where both readers agree; in whole clips also only where the time of a
change is sure. A reader judges the motion over eight frames: for each frame of slip, the motion on
the sheet shows when the print slips. At rest the readers write `stick`, since a picture at rest
does not show which markers slipped before. There our `incipient` counts as right too, and only
`macro_slip`, `no_contact` and `unknown` count as wrong.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from estimation.estimators.result import State, Track
from estimation.frames import datasets
from estimation.output.scene import STATE_COLOURS
from estimation.slip.lookback import backdate
from estimation.slip.shear import ShearPath
from papers.items import Track as Progress
from papers.marker_images.answers import answer_pictures
from papers.marker_images.reading import (
    UNCLEAR,
    Place,
    Reading,
    Run,
    Spans,
    compare_readers,
    find_agreed,
    find_alike,
    find_runs,
    read_readings,
    read_whole_clips,
    spread,
)
from papers.marker_images.settings import SHEETS
from papers.marker_images.sheets import follow_slip, read_clip


class Ours(NamedTuple):
    """Our answer in a frame.

    Attributes:
        state: of the contact.
        reason: why the angle is missing or doubtful.
        touched: whether markers are in contact, which may be known without the state.
    """

    state: str
    reason: str
    touched: bool

    @classmethod
    def take(cls, track: Track, row: int) -> "Ours":
        """The answer in a frame of a track."""
        return cls(track.state[row], track.reason[row], bool(track.contact_markers[row] > 0))

    @property
    def contact(self) -> str:
        """Contact in the readers' words: `yes`, `no`, or `unclear`."""
        if self.state == State.UNKNOWN and not self.touched:
            return UNCLEAR
        return "no" if self.state == State.NO_CONTACT else "yes"


@dataclass(frozen=True)
class Scored:
    """Readings and our answers."""

    readings: Mapping[str, Reading]  # readings of single frames, by the reader's name
    ours: Mapping[Place, Ours]  # our answers by frame; frames and clips may be missing
    # spans of whole clips, by the reader's name
    whole: Mapping[str, Spans] = field(default_factory=dict)
    live: Mapping[Place, Ours] = field(default_factory=dict)  # answers given frame by frame
    # by frame that the readers call slip: slip on the sheet, as from `follow_slip` [px]
    slips: Mapping[Place, Float[np.ndarray, " later"]] = field(default_factory=dict)

    @property
    def agreed(self) -> Reading:
        """The words on which all readers agree, in the frames with our answers."""
        agreed = find_agreed(self.readings)
        return {place: row for place, row in agreed.items() if place in self.ours}

    @property
    def on_whole_clips(self) -> "Scored":
        """Readings and answers of all frames of the whole clips, without unsure changes."""
        readings = {name: spread(spans, sure=True) for name, spans in self.whole.items()}
        return Scored(readings, self.ours, live=self.live)

    @property
    def as_live(self) -> "Scored":
        """The same readings, with the answers given frame by frame."""
        return replace(self, ours=self.live)

    @property
    def whole_clips(self) -> list[str]:
        """The whole clips with both readings and answers."""
        clips = {place.clip for place in self.ours}
        return [clip for clip in next(iter(self.whole.values()), {}) if clip in clips]


def compute(quick: bool = False, track: Progress = iter) -> Scored:
    """Answer all clips of the tables; if quick, only the two shortest clips."""
    root = datasets.fetch("state-videos")
    readings, whole = read_readings(), read_whole_clips()
    frames: dict[str, list[int]] = {}
    for clip, frame in {**next(iter(readings.values())), **spread(next(iter(whole.values())))}:
        frames.setdefault(clip, []).append(frame)
    clips = sorted(frames, key=lambda clip: max(frames[clip]))[: 2 if quick else None]
    near = range(-SHEETS.reach, SHEETS.reach + 1)
    agreed = find_agreed(readings)
    ours: dict[Place, Ours] = {}
    first: dict[Place, Ours] = {}
    slips: dict[Place, np.ndarray] = {}
    for clip in track(clips):
        path = root / f"{clip}.avi"
        answers = answer_pictures(path).frames
        live = Track.gather("tracked", [answer.estimates["tracked"] for answer in answers])
        dated = backdate(live, ShearPath.of(*(answer.shear for answer in answers)))
        seen = {frame + later for frame in frames[clip] for later in near}
        rows = sorted(seen & set(range(len(answers))))
        ours |= {Place(clip, row): Ours.take(dated, row) for row in rows}
        first |= {Place(clip, row): Ours.take(live, row) for row in rows}
        slipping = [
            place.frame
            for place, row in agreed.items()
            if place.clip == clip and row.get("state") in (State.INCIPIENT, State.MACRO_SLIP)
        ]
        if slipping:
            pictures = read_clip(path)
            slips |= {Place(clip, frame): follow_slip(pictures, frame) for frame in slipping}
    return Scored(readings, ours, whole, first, slips)


def is_right(read: str, motion: str, ours: str) -> bool:
    """Whether our state agrees with the read state and motion."""
    return ours == read or (read == State.STICK and motion == "rest" and ours == State.INCIPIENT)


def tables(result: Scored) -> dict[str, list[dict[str, object]]]:
    """Tables of shares, our states by the read state, the readers' agreement, and wrong frames.

    Then the moments of the slips, and our states as given frame by frame. If whole clips were
    answered, also these tables for them, and the changes of state.
    """
    shown = {
        "": _figures(result),
        "_states": _confusion(result),
        "_readers": compare_readers(result.readings),
        "_wrong": _wrong(result),
        "_slips": _find_moments(result),
        "_live": _confusion(result.as_live) if result.live else [],
    }
    if result.whole_clips:
        shown |= {
            "_whole": _figures(result.on_whole_clips),
            "_whole_states": _confusion(result.on_whole_clips),
            "_whole_live": _confusion(result.on_whole_clips.as_live) if result.live else [],
            "_whole_readers": compare_readers({k: spread(v) for k, v in result.whole.items()}),
            "_changes": _changes(result),
        }
    return shown


def _figures(result: Scored) -> list[dict[str, object]]:
    agreed, ours = result.agreed, result.ours
    contact = [
        UNCLEAR if ours[place].contact == UNCLEAR else ours[place].contact == row["contact"]
        for place, row in agreed.items()
        if "contact" in row
    ]
    rest = [ours[place].state for place, row in agreed.items() if row.get("motion") == "rest"]
    slips = [place for place, row in agreed.items() if row.get("state") == State.MACRO_SLIP]
    nearby = [
        any(
            near in ours and ours[near].state == State.MACRO_SLIP
            for near in (Place(clip, frame + later) for later in range(SHEETS.reach + 1))
        )
        for clip, frame in slips
    ]
    return [
        _figure("frames of the clips that were answered", len(agreed), len(agreed)),
        _figure("contact right", contact.count(True), len(contact)),
        _figure("contact wrong", contact.count(False), len(contact)),
        _figure("macro_slip at rest", rest.count(State.MACRO_SLIP), len(rest)),
        _figure("macro_slip read, ours within the frames seen", sum(nearby), len(slips)),
    ]


def _figure(name: str, count: int, of: int) -> dict[str, object]:
    return {"": name, "frames": count, "of": of, "share [%]": round(100.0 * count / max(of, 1), 1)}


def _confusion(result: Scored) -> list[dict[str, object]]:
    """Our states: a row for each read state, with separate rows for stick at rest and in motion."""
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
            "frames": len(states),
            **{f"ours {state}": sum(ours == state for ours, _ in states) for state in State},
            "right [%]": round(100.0 * np.mean([right for _, right in states]), 1),
        }
        for kind, states in sorted(kinds.items())
    ]


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


def _find_moments(result: Scored) -> list[dict[str, object]]:
    """When the print slips in the time that the readers saw, and our state then."""
    rows: list[dict[str, object]] = []
    for place, slip in result.slips.items():
        clip, frame = place
        known, steps = bool(np.isfinite(slip).all()), np.diff(slip, prepend=0.0)
        fastest = Place(clip, frame - SHEETS.reach + 1 + int(np.argmax(steps)))
        rows.append(
            {
                **place._asdict(),
                "read": result.agreed[place]["state"],
                "slip until it [px]": round(float(slip[SHEETS.reach - 1]), 1),
                "slip in the frames seen [px]": round(float(slip[-1]), 1),
                "ours": result.ours[place].state,
                "fastest in": fastest.frame if known else "",
                "ours then": result.ours[fastest].state if known else "",
            }
        )
    return rows


def _runs_of_readers(result: Scored, clip: str) -> list[list[Run]]:
    return [
        find_runs(
            [Run(span.words["state"], span.first, span.last, span.unsure) for span in spans[clip]]
        )
        for spans in result.whole.values()
    ]


def _runs_of_ours(result: Scored, clip: str) -> list[Run]:
    last = max(span.last for spans in result.whole.values() for span in spans[clip])
    return find_runs([Run(result.ours[Place(clip, t)].state, t, t) for t in range(last + 1)])


def _find_begun(run: Run, before: Run, others: Sequence[Run]) -> Run | None:
    """The matching run; None if it began before `before`, since its state then never changed."""
    match = find_alike(run, others)
    return None if match is None or match.first < before.first - before.unsure else match


def _changes(result: Scored) -> list[dict[str, object]]:
    """Times of the changes of state: a row for each change of the first reader.

    Ours is late if it is after the latest time that a reader allows, and early (negative) if before
    the earliest.
    """
    rows: list[dict[str, object]] = []
    for clip in result.whole_clips:
        first, *others = _runs_of_readers(result, clip)
        ours = _runs_of_ours(result, clip)
        for before, run in pairwise(first):
            seen = [run, *(begun for other in others if (begun := _find_begun(run, before, other)))]
            match = _find_begun(run, before, ours)
            low, high = (
                min(begun.first - begun.unsure for begun in seen),
                max(begun.first + begun.unsure for begun in seen),
            )
            words = [result.ours[Place(clip, t)].state for t in range(run.first, run.last + 1)]
            rows.append(
                {
                    "clip": clip,
                    "from": before.state,
                    "to": run.state,
                    "frames": len(words),
                    "frame": run.first,
                    "unsure": run.unsure,
                    "other reader": "" if len(seen) == 1 else seen[1].first,
                    "ours": "" if match is None else match.first,
                    "late": ""
                    if match is None
                    else max(match.first - high, 0) + min(match.first - low, 0),
                    "ours mostly": max(words, key=words.count),
                    "ours the same [%]": round(100.0 * words.count(run.state) / len(words), 1),
                }
            )
    return rows


def plot(result: Scored) -> Figure:
    """Top: our states by the read state, coloured by share of the row, with numbers of frames.

    Below, for whole clips: states over time, the readers' and ours. A black line is the uncertainty
    of the time of a change.
    """
    clips = result.whole_clips
    rows = _confusion(result)
    heights = [0.6 * len(rows) + 1.5, *[1.5] * len(clips)]
    figure, axes = plt.subplots(
        len(heights),
        figsize=(6.5 if not clips else 9.0, sum(heights)),
        height_ratios=heights,
        squeeze=False,
        layout="constrained",
    )
    _plot_confusion(axes[0, 0], rows)
    for axis, clip in zip(axes[1:, 0], clips, strict=True):
        _plot_times(axis, result, clip)
    if clips:
        axes[-1, 0].set_xlabel("frame")
        colours = [(str(state), colour) for state, colour in STATE_COLOURS.items()]
        handles = [
            Patch(facecolor=colour, edgecolor="0.5", label=name)
            for name, colour in [*colours, (UNCLEAR, "white")]
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize="small")
    return figure


def _plot_times(axis: Axes, result: Scored, clip: str) -> None:
    names = [f"reader: {name}" for name in result.whole]
    lines = [*_runs_of_readers(result, clip), _runs_of_ours(result, clip)]
    colours = {str(state): colour for state, colour in STATE_COLOURS.items()}
    for i, runs in enumerate(lines):
        bars = [(run.first, run.last + 1 - run.first) for run in runs]
        faces = [colours.get(str(run.state), "white") for run in runs]
        axis.broken_barh(bars, (i - 0.4, 0.8), facecolors=faces, lw=0)
        unsure = [run for run in runs if run.unsure]
        axis.errorbar(
            [run.first for run in unsure],
            [i] * len(unsure),
            xerr=[run.unsure for run in unsure],
            fmt="none",
            ecolor="black",
            elinewidth=1.0,
        )
    axis.set_yticks(range(len(lines)), [*names, "ours"])
    axis.invert_yaxis()
    axis.set_title(clip, fontsize="medium")


def _plot_confusion(axes: Axes, rows: Sequence[Mapping[str, object]]) -> None:
    counts = np.array([[row[f"ours {state}"] for state in State] for row in rows], dtype=float)
    shares = counts / counts.sum(axis=1, keepdims=True)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for (i, j), count in np.ndenumerate(counts):
        colour = "white" if shares[i, j] > 0.6 else "black"
        axes.text(j, i, f"{count:.0f}", ha="center", va="center", color=colour)
    axes.set_xticks(range(len(State)), [str(state) for state in State], rotation=30, ha="right")
    axes.set_yticks(range(len(rows)), [str(row["read"]) for row in rows])
    axes.set(xlabel="ours", ylabel="read by eye")
