"""The published clips: our angle beside turns of the object's imprint that others registered.

Two GelSight fingers hold an object that is lifted, turned and shaken. Nobody measured its angle
apart from the pictures. `reference_turns.csv`, where it lies beside the clips, has turns of the
imprint between two frames, registered apart from this code and good to `settings.REFERENCE_ERROR`;
for one lift they are in `settings.REGISTERED`, good to a degree.
"""

import textwrap
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from contactmodel.common.inputs import cell_number, cell_whole, read_rows
from estimation.estimators.result import State
from estimation.frames import datasets
from estimation.output.preview import mark_spot
from estimation.output.scene import marker_signs
from estimation.pictures.stream import read_pictures
from estimation.tracking.stream import Answer
from papers.items import Track
from papers.marker_images import settings
from papers.marker_images.answers import answer_pictures

COLUMNS = ("object", "exp_num", "camera", "from_frame", "to_frame", "turn_deg")


class Turn(NamedTuple):
    """How far an object has turned between two frames, by its imprint and by us.

    Attributes:
        clip: its place in the data set.
        start: first frame.
        stop: second frame.
        reference: by the imprint, registered by others [deg, clockwise on the screen].
        angle: by us [deg]; NaN where one of the frames has no angle.
        low: end of the 95 % interval [deg].
        high: end of the 95 % interval [deg].
        imprint: by our own registration [deg]; NaN where lost or counted anew between.
        state: in the second frame.
        reason: why there is no angle, or what speaks against it.
    """

    clip: str
    start: int
    stop: int
    reference: float
    angle: float
    low: float
    high: float
    imprint: float
    state: str
    reason: str

    @property
    def error(self) -> float:
        """Of our angle [deg]."""
        return self.angle - self.reference

    @property
    def outside(self) -> bool:
        """Whether the reference is outside the interval, widened by what it is good to."""
        slack = settings.REFERENCE_ERROR
        return not self.low - slack <= self.reference <= self.high + slack

    @property
    def rest(self) -> bool:
        """Whether the object has hardly turned."""
        return abs(self.reference) < settings.REST_DEG

    def describe(self) -> str:
        """The turn in a sentence."""
        half = 0.5 * (self.high - self.low)
        verdict = "outside the interval" if self.outside else "inside the interval"
        own = (
            "our imprint is lost between"
            if np.isnan(self.imprint)
            else (f"our imprint {self.imprint:+.1f}°")
        )
        why = f", {self.reason}" if self.reason else ""
        return (
            f"{self.clip}, frames {self.start} to {self.stop}: the reference is "
            f"{self.reference:+.1f}°, we measure {self.angle:+.1f} ± {half:.1f}°, {verdict}; "
            f"{own}; {self.state}{why}."
        )


class Clips(NamedTuple):
    """What was found.

    Attributes:
        root: folder of the clips.
        turns: that have a reference.
        answers: by clip.
    """

    root: Path
    turns: list[Turn]
    answers: dict[str, list[Answer]]


def compute(quick: bool = False, track: Track = iter) -> Clips:
    """Answer every clip that has a reference; the two shortest only if quick."""
    root = datasets.fetch("pivot-videos").parents[1]
    pairs = read_references(root)
    there = {clip: root / f"{clip}.avi" for clip in pairs}
    chosen = [clip for clip in pairs if there[clip].is_file()]
    if quick:
        chosen = sorted(chosen, key=lambda clip: there[clip].stat().st_size)[:2]
    answers = {clip: answer_pictures(there[clip]).frames for clip in track(chosen)}
    turns = [_compare(clip, *pair, answers[clip]) for clip in chosen for pair in pairs[clip]]
    return Clips(root, turns, answers)


def read_references(root: Path) -> dict[str, list[tuple[int, int, float]]]:
    """Two frames and the turn between them [deg], by clip.

    Args:
        root: folder of the clips.

    Raises:
        ValueError: the table is damaged.
        OSError: it cannot be read.
    """
    pairs = {
        clip: [(0, frame, turn) for frame, turn in known.items()]
        for clip, known in settings.REGISTERED.items()
    }
    table = root / "reference_turns.csv"
    for at, row in read_rows(table, COLUMNS) if table.is_file() else ():
        clip = f"{row['object']}/exp_num_{row['exp_num']}/camera_{row['camera']}"
        frames = [cell_whole(row[name], f"{at}: {name}") for name in COLUMNS[3:5]]
        turn = cell_number(row["turn_deg"], f"{at}: turn_deg")
        pairs.setdefault(clip, []).append((frames[0], frames[1], turn))
    return pairs


def _compare(clip: str, start: int, stop: int, turn: float, answers: Sequence[Answer]) -> Turn:
    first, last = (answers[frame].estimates["tracked"] for frame in (start, stop))
    imprints = np.array([one.frame.imprint[0] for one in answers[start : stop + 1]])
    whole = np.isfinite(imprints).all() and not (imprints[1:] == 0.0).any()  # counted anew at 0
    angle, low, high = np.degrees(np.array([last.angle, last.low, last.high]) - first.angle)
    return Turn(
        clip=clip,
        start=start,
        stop=stop,
        reference=turn,
        angle=float(angle),
        low=float(low),
        high=float(high),
        imprint=float(np.degrees(imprints[-1] - imprints[0])) if whole else np.nan,
        state=str(last.state),
        reason=last.reason,
    )


def tables(result: Clips) -> dict[str, list[dict[str, object]]]:
    """By object; every turn; every clip; some of its frames; the worst turns in sentences."""
    objects = dict.fromkeys(one.clip.split("/")[0] for one in result.turns)
    by_object = [
        _figures(name, [one for one in result.turns if one.clip.split("/")[0] == name])
        for name in objects
    ]
    return {
        "": [*by_object, _figures("all", result.turns)],
        "_turns": [_row_of_turn(one) for one in result.turns],
        "_clips": [_row_of_clip(clip, found) for clip, found in result.answers.items()],
        "_frames": [
            _row_of_frame(clip, frame, found[frame])
            for clip, found in result.answers.items()
            for frame in settings.CLIP_FRAMES
            if frame < len(found)
        ],
        "_worst": [
            {"number": i, "turn": one.describe()} for i, one in enumerate(find_worst(result), 1)
        ],
    }


def find_worst(result: Clips) -> list[Turn]:
    """The turns that we have most wrong, the worst first; some of each clip at most."""
    known = [one for one in result.turns if np.isfinite(one.error)]
    worst: list[Turn] = []
    for one in sorted(known, key=lambda turn: -abs(turn.error)):
        if sum(other.clip == one.clip for other in worst) < settings.WORST_OF_CLIP:
            worst.append(one)
    return worst[: settings.WORST]


def _figures(name: str, turns: Sequence[Turn]) -> dict[str, object]:
    known = [one for one in turns if np.isfinite(one.error)]
    turned = [one for one in known if not one.rest]
    rests = [one for one in known if one.rest]
    error = np.abs([one.error for one in turned])
    own = np.abs([one.imprint - one.reference for one in turned])
    half = np.array([0.5 * (one.high - one.low) for one in turned])
    own = own[np.isfinite(own)]
    return {
        "object": name,
        "clips": len({one.clip for one in turns}),
        "turns": len(turned),
        "median error [°]": _number(_quantile(error, 0.5), 2),
        "90 % [°]": _number(_quantile(error, 0.9), 2),
        "median ± [°]": _number(_quantile(half, 0.5), 2),
        "outside": sum(one.outside for one in turned),
        "imprint, median error [°]": _number(_quantile(own, 0.5), 2),
        "imprint, 90 % [°]": _number(_quantile(own, 0.9), 2),
        "rests": len(rests),
        "rests missed": sum(one.outside for one in rests),
        "unanswered": len(turns) - len(known),
    }


def _quantile(values: np.ndarray, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else np.nan


def _row_of_turn(one: Turn) -> dict[str, object]:
    return {
        "clip": one.clip,
        "from": one.start,
        "to": one.stop,
        "reference [°]": _number(one.reference, 2),
        "angle [°]": _number(one.angle, 2),
        "low [°]": _number(one.low, 2),
        "high [°]": _number(one.high, 2),
        "imprint [°]": _number(one.imprint, 2),
        "error [°]": _number(one.error, 2),
        "outside": "" if np.isnan(one.error) else "yes" if one.outside else "no",
        "state": one.state,
        "reason": one.reason,
    }


def _row_of_clip(clip: str, answers: Sequence[Answer]) -> dict[str, object]:
    found = [one.estimates["tracked"] for one in answers]
    states = [one.state for one in found]
    answered = [bool(np.isfinite(one.angle)) for one in found]
    half = np.degrees([0.5 * (one.high - one.low) for one in found])
    return {
        "clip": clip,
        "frames": len(found),
        "answered": sum(answered),
        "labelled": sum(bool(one.reason) and not a for one, a in zip(found, answered, strict=True)),
        **{f"{state}": states.count(state) for state in State},
        "at the edge": sum("edge of the view" in one.reason for one in found),
        "not recognised": sum(bool(one.frame.flaw) for one in answers),
        "widest ± [°]": _number(float(np.nanmax(half, initial=-np.inf)), 1),
    }


def _row_of_frame(clip: str, frame: int, answer: Answer) -> dict[str, object]:
    one = answer.estimates["tracked"]
    return {
        "clip": clip,
        "frame": frame,
        "state": str(one.state),
        "angle [°]": _number(np.degrees(one.angle), 1),
        "± [°]": _number(np.degrees(0.5 * (one.high - one.low)), 1),
        "imprint [°]": _number(np.degrees(answer.frame.imprint[0]), 1),
        "registered reference [°]": settings.REGISTERED.get(clip, {}).get(frame),
        "reason": one.reason,
    }


def _number(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None


def plot(result: Clips) -> Figure:
    """The worst turns: both frames of each, the object's contact marked, and a sentence."""
    worst = find_worst(result)
    rows = -(-len(worst) // 2)
    size = (14.0, 3.4 * rows)
    gaps = {"left": 0.01, "right": 0.99, "top": 1.0 - 0.25 / size[1], "bottom": 0.7 / size[1]}
    gaps |= {"wspace": 0.02, "hspace": 0.35}
    figure, axes = plt.subplots(rows, 4, figsize=size, squeeze=False, gridspec_kw=gaps)
    for axis in axes.flat:
        axis.axis("off")
    for number, one in enumerate(worst):
        pair = axes[number // 2, 2 * (number % 2) :][:2]
        for axis, frame in zip(pair, (one.start, one.stop), strict=True):
            axis.imshow(_picture(result, one.clip, frame))
            axis.set_title(f"{frame}", fontsize=7)
        text = textwrap.fill(one.describe(), 105)
        pair[0].text(0.0, -0.04, text, va="top", fontsize=8, transform=pair[0].transAxes)
    return figure


def _picture(result: Clips, clip: str, frame: int) -> np.ndarray:
    """A frame in colour; markers that stick are rings, others of the contact crosses."""
    (picture,) = islice(read_pictures(result.root / f"{clip}.avi"), frame, frame + 1)
    assert picture.image is not None
    answer = result.answers[clip][frame]
    found = answer.estimates["tracked"]
    image = cv2.resize(picture.image, None, fx=2.0, fy=2.0)
    signs = marker_signs(found.stick, found.contact)
    for place, touched, sign in zip(answer.frame.positions, found.contact, signs, strict=True):
        if touched and np.isfinite(place[0]):
            mark_spot(image, 2.0 * place[:2], sign, 13)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
