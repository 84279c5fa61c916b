"""The published clips: our angles compared with registered turns of the object's imprint.

Two GelSight fingers hold an object that is lifted, turned and shaken. Its angle was not measured
independently of the pictures. `reference_turns.csv` in the clips' folder is optional. It has turns
of the imprint between two frames, registered independently of this code and accurate to
`settings.REFERENCE_ERROR`. For one lift, turns accurate to a degree are in `settings.REGISTERED`.
"""

import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
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
from papers.tables import cell

COLUMNS = ("object", "exp_num", "camera", "from_frame", "to_frame", "turn_deg")


class Turn(NamedTuple):
    """The turn of an object between two frames, by its imprint and by our angle."""

    clip: str  # path of the clip in the data set
    start: int  # first frame
    stop: int  # second frame
    reference: float  # turn of the imprint by another method [deg, clockwise on the screen]
    # turn by our angle [deg]; NaN if a frame has no angle, or it is counted anew between them
    angle: float
    low: float  # lower end of its 95 % interval [deg]
    high: float  # upper end of its 95 % interval [deg]
    # turn by our own registration of the imprint [deg]; NaN if it was lost or restarted from zero
    # between the frames
    imprint: float
    state: str  # state in the second frame
    reason: str  # reason for a missing or doubtful angle
    empty: bool = False  # whether one of the frames has no contact, by our state

    @property
    def error(self) -> float:
        """Error of our angle [deg]."""
        return self.angle - self.reference

    @property
    def outside(self) -> bool:
        """Whether the reference is outside the interval, widened by the reference's error."""
        slack = settings.REFERENCE_ERROR
        return not self.low - slack <= self.reference <= self.high + slack

    @property
    def wrong(self) -> bool:
        """Whether our angle is confidently wrong."""
        half = 0.5 * (self.high - self.low)
        return abs(self.error) > settings.WRONG_DEG and half < settings.SURE_DEG

    @property
    def rest(self) -> bool:
        """Whether the object turned by less than `settings.REST_DEG`."""
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
    """Answers and turns of the clips."""

    root: Path
    turns: list[Turn]
    answers: dict[str, list[Answer]]


def compute(quick: bool = False, track: Track = iter) -> Clips:
    """Answer every clip with a reference; if quick, only the two shortest clips."""
    root = datasets.fetch("pivot-videos").parents[1]
    pairs = read_references(root)
    videos = {clip: root / f"{clip}.avi" for clip in pairs}
    videos = {clip: video for clip, video in videos.items() if video.is_file()}
    if quick:
        videos = take_shortest(videos)
    answers = {clip: answer_pictures(videos[clip]).frames for clip in track(videos)}
    turns = [compare_turn(clip, *pair, answers[clip]) for clip in videos for pair in pairs[clip]]
    return Clips(root, turns, answers)


def take_shortest(videos: Mapping[str, Path]) -> dict[str, Path]:
    """The two smallest files of the videos by clip."""
    return dict(sorted(videos.items(), key=lambda item: item[1].stat().st_size)[:2])


def read_references(root: Path) -> dict[str, list[tuple[int, int, float]]]:
    """The reference turns by clip: first frame, second frame, and the turn between them [deg].

    Raises:
        ValueError: the table is damaged.
        OSError: the table cannot be read.
    """
    pairs = {
        clip: [(0, frame, turn) for frame, turn in turns.items()]
        for clip, turns in settings.REGISTERED.items()
    }
    table = root / "reference_turns.csv"
    for at, row in read_rows(table, COLUMNS) if table.is_file() else ():
        clip = f"{row['object']}/exp_num_{row['exp_num']}/camera_{row['camera']}"
        frames = [cell_whole(row[name], f"{at}: {name}") for name in COLUMNS[3:5]]
        turn = cell_number(row["turn_deg"], f"{at}: turn_deg")
        pairs.setdefault(clip, []).append((frames[0], frames[1], turn))
    return pairs


def compare_turn(clip: str, start: int, stop: int, turn: float, answers: Sequence[Answer]) -> Turn:
    """Our angle between two frames beside the turn of the imprint [deg]; NaN if counted anew."""
    first, last = (answers[frame].estimates["tracked"] for frame in (start, stop))
    imprints = np.array([answer.frame.imprint[0] for answer in answers[start : stop + 1]])
    continuous = np.isfinite(imprints).all() and not (imprints[1:] == 0.0).any()  # 0: restarted
    alike = np.isclose(first.since, last.since, equal_nan=True)
    base = first.angle if alike else np.nan
    angle, low, high = np.degrees(np.array([last.angle, last.low, last.high]) - base)
    return Turn(
        clip=clip,
        start=start,
        stop=stop,
        reference=turn,
        angle=float(angle),
        low=float(low),
        high=float(high),
        imprint=float(np.degrees(imprints[-1] - imprints[0])) if continuous else np.nan,
        state=str(last.state),
        reason=last.reason,
        empty=State.NO_CONTACT in (first.state, last.state),
    )


def tables(result: Clips) -> dict[str, list[dict[str, object]]]:
    """Tables by object, turn, clip and frame (some frames only), and the worst turns as text."""
    return tabulate_turns(result) | {
        "_clips": [_row_of_clip(clip, answers) for clip, answers in result.answers.items()],
        "_frames": [
            _row_of_frame(clip, frame, answers[frame])
            for clip, answers in result.answers.items()
            for frame in settings.CLIP_FRAMES
            if frame < len(answers)
        ],
    }


def tabulate_turns(result: Clips) -> dict[str, list[dict[str, object]]]:
    """Tables by object and turn, and the worst turns as text."""
    objects = dict.fromkeys(turn.clip.split("/")[0] for turn in result.turns)
    by_object = [
        {
            "object": name,
            **summarise([turn for turn in result.turns if turn.clip.split("/")[0] == name]),
        }
        for name in objects
    ]
    return {
        "": [*by_object, {"object": "all", **summarise(result.turns)}],
        "_turns": [row_of_turn(turn) for turn in result.turns],
        "_worst": [
            {"number": i, "turn": turn.describe()} for i, turn in enumerate(find_worst(result), 1)
        ],
    }


def find_worst(result: Clips) -> list[Turn]:
    """The turns with the largest errors, worst first; at most `WORST_OF_CLIP` per clip."""
    known = [turn for turn in result.turns if np.isfinite(turn.error)]
    worst: list[Turn] = []
    for turn in sorted(known, key=lambda turn: -abs(turn.error)):
        if sum(other.clip == turn.clip for other in worst) < settings.WORST_OF_CLIP:
            worst.append(turn)
    return worst[: settings.WORST]


def summarise(turns: Sequence[Turn]) -> dict[str, object]:
    """A row of a table: errors and intervals of turns, and how many are outside or unanswered."""
    answered = [turn for turn in turns if np.isfinite(turn.error)]
    turned = [turn for turn in answered if not turn.rest]
    rests = [turn for turn in answered if turn.rest]
    error = np.abs([turn.error for turn in turned])
    own = np.abs([turn.imprint - turn.reference for turn in turned])
    half = [0.5 * (turn.high - turn.low) for turn in turned]
    most = partial(np.quantile, q=0.9)
    return {
        "clips": len({turn.clip for turn in turns}),
        "turns": len(turned),
        "median error [°]": cell(error, 2, np.median),
        "90 % [°]": cell(error, 2, most),
        "median ± [°]": cell(half, 2, np.median),
        "outside": sum(turn.outside for turn in turned),
        "confidently wrong": sum(turn.wrong for turn in turned),
        "imprint, median error [°]": cell(own, 2, np.median),
        "imprint, 90 % [°]": cell(own, 2, most),
        "rests": len(rests),
        "rests missed": sum(turn.outside for turn in rests),
        "unanswered": len(turns) - len(answered),
        "of these without contact": sum(turn.empty for turn in turns if np.isnan(turn.error)),
    }


def row_of_turn(turn: Turn) -> dict[str, object]:
    """A row of a table: a turn."""
    return {
        "clip": turn.clip,
        "from": turn.start,
        "to": turn.stop,
        **{
            f"{name} [°]": cell(getattr(turn, name), 2)
            for name in ("reference", "angle", "low", "high", "imprint", "error")
        },
        "outside": "" if np.isnan(turn.error) else "yes" if turn.outside else "no",
        "state": turn.state,
        "reason": turn.reason,
    }


def _row_of_clip(clip: str, answers: Sequence[Answer]) -> dict[str, object]:
    estimates = [answer.estimates["tracked"] for answer in answers]
    states = [estimate.state for estimate in estimates]
    half = np.degrees([0.5 * (estimate.high - estimate.low) for estimate in estimates])
    return {
        "clip": clip,
        "frames": len(estimates),
        "answered": sum(bool(np.isfinite(estimate.angle)) for estimate in estimates),
        "labelled": sum(bool(e.reason) and not np.isfinite(e.angle) for e in estimates),
        **{f"{state}": states.count(state) for state in State},
        "at the edge": sum("edge of the view" in estimate.reason for estimate in estimates),
        "not recognised": sum(bool(answer.frame.flaw) for answer in answers),
        "widest ± [°]": cell(half, 1, np.max),
    }


def _row_of_frame(clip: str, frame: int, answer: Answer) -> dict[str, object]:
    estimate = answer.estimates["tracked"]
    return {
        "clip": clip,
        "frame": frame,
        "state": str(estimate.state),
        "angle [°]": cell(np.degrees(estimate.angle), 1),
        "± [°]": cell(np.degrees(0.5 * (estimate.high - estimate.low)), 1),
        "imprint [°]": cell(np.degrees(answer.frame.imprint[0]), 1),
        "registered reference [°]": settings.REGISTERED.get(clip, {}).get(frame),
        "reason": estimate.reason,
    }


def plot(result: Clips) -> Figure:
    """The worst turns: both frames with the contact's markers, and a sentence."""
    worst = find_worst(result)
    rows = max(-(-len(worst) // 2), 1)  # empty where no turn is answered, as in short clips
    size = (14.0, 3.4 * rows)
    gaps = {"left": 0.01, "right": 0.99, "top": 1.0 - 0.25 / size[1], "bottom": 0.7 / size[1]}
    gaps |= {"wspace": 0.02, "hspace": 0.35}
    figure, axes = plt.subplots(rows, 4, figsize=size, squeeze=False, gridspec_kw=gaps)
    for axis in axes.flat:
        axis.axis("off")
    for number, turn in enumerate(worst):
        pair = axes[number // 2, 2 * (number % 2) :][:2]
        for axis, frame in zip(pair, (turn.start, turn.stop), strict=True):
            axis.imshow(_picture(result, turn.clip, frame))
            axis.set_title(f"{frame}", fontsize=7)
        text = textwrap.fill(turn.describe(), 105)
        pair[0].text(0.0, -0.04, text, va="top", fontsize=8, transform=pair[0].transAxes)
    return figure


def _picture(result: Clips, clip: str, frame: int) -> np.ndarray:
    """A frame in colour; rings: sticking markers, crosses: other markers of the contact."""
    (picture,) = islice(read_pictures(result.root / f"{clip}.avi"), frame, frame + 1)
    assert picture.image is not None
    answer = result.answers[clip][frame]
    estimate = answer.estimates["tracked"]
    image = cv2.resize(picture.image, None, fx=2.0, fy=2.0)
    signs = marker_signs(estimate.stick, estimate.contact)
    for place, touched, sign in zip(answer.frame.positions, estimate.contact, signs, strict=True):
        if touched and np.isfinite(place[0]):
            mark_spot(image, 2.0 * place[:2], sign, 13)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
