"""Rendered clips with truth: the command line's answers on objects that print through the gel.

`estimation.virtual.clip` renders every clip to pictures, and `python -m estimation run` answers
them without options. The scene gives the truth.
"""

from functools import partial
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators.result import State, Track
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.slip.lookback import backdate, date_doubts, withdraw
from estimation.slip.motion import accumulate_slip
from estimation.slip.onset import SightPath
from estimation.slip.outcome import conclude
from estimation.slip.shear import ShearPath
from estimation.virtual.clip import ClipTruth, VirtualClip
from papers.items import Track as Progress
from papers.marker_images.answers import answer_clip
from papers.marker_images.scenes import CONDITIONS, draw_scene
from papers.marker_images.settings import CLIP_DRAWS, QUICK_CLIPS, SURE_DEG, WRONG_DEG
from papers.tables import cell, finish

LATE = 3
"""A state counts as right if it is early or late by up to so many frames."""


class ClipAnswers(NamedTuple):
    """The answers to a rendered clip, the angle of the imprint [rad] and the outcome."""

    condition: str
    truth: ClipTruth
    track: Track
    imprint: Float[np.ndarray, " frames"]
    outcome: str


def answer_scene(condition: str, draw: int) -> ClipAnswers:
    """Render a clip, and answer its pictures as the command line does."""
    clip = VirtualClip(draw_scene(condition, draw))
    answers, noise = answer_clip(clip)
    live = Track.gather("tracked", [answer.estimates["tracked"] for answer in answers])
    imprint = np.array([answer.frame.imprint[0] for answer in answers])
    sights = SightPath.of(*(answer.sight for answer in answers))
    slips = [] if noise is None else date_doubts(live, sights)
    shears = ShearPath.of(*(answer.shear for answer in answers))
    track = withdraw(backdate(live, shears), slips, imprint)
    outcome = conclude(shears, track).word
    return ClipAnswers(condition, clip.truth, track, imprint, outcome)


def compute(quick: bool = False, track: Progress = iter) -> list[ClipAnswers]:
    """Render and answer the clips of every condition."""
    conditions, draws = (QUICK_CLIPS, 1) if quick else (list(CONDITIONS), CLIP_DRAWS)
    cases = [(condition, draw) for condition in conditions for draw in range(draws)]
    return [answer_scene(*case) for case in track(cases)]


class Judged(NamedTuple):
    """Answers compared with the truth, in the frames in contact.

    Attributes:
        error: error of the angle since its zero [deg]; NaN without an answer.
        half: half-width of the 95 % interval [deg].
        inside: whether the interval holds the truth.
        anew: whether the angle was lost earlier in this contact and restarted.
        slip_error: error of the turn over the gel [deg].
    """

    error: Float[np.ndarray, " frames"]
    half: Float[np.ndarray, " frames"]
    inside: Bool[np.ndarray, " frames"]
    anew: Bool[np.ndarray, " frames"]
    slip_error: Float[np.ndarray, " frames"]


def judge(clip: ClipAnswers) -> Judged:
    """Compare angles with the truth, both since the zero of the angle.

    The zero is the last frame without contact. If the pad was loaded before the clip, or the angle
    was lost and restarted, the zero is the first frame with an answer.
    """
    track, truth = clip.track, clip.truth
    touching, answered = np.isfinite(truth.angle), np.isfinite(track.angle)
    slip, true_slip = accumulate_slip(track), truth.slip_angle
    zero, slip_zero = np.zeros((2, len(touching)))
    anew, first_count = np.zeros(len(touching), dtype=bool), {}
    touch = np.cumsum(np.diff(touching, prepend=False) & touching)
    counts = np.column_stack([touch, track.restarts, np.nan_to_num(track.since)])
    for count in np.unique(counts[touching & answered], axis=0):
        rows = (counts == count).all(axis=1) & touching & answered
        first = int(np.argmax(rows))
        anew[rows] = first_count.setdefault(count[0], first) != first
        if count[1] or np.isnan(track.since[first]):
            zero[rows] = track.angle[first] - truth.angle[first]
            slip_zero[rows] = slip[first] - true_slip[first]
    low, high = track.low - zero, track.high - zero
    return Judged(
        error=np.degrees(track.angle - zero - truth.angle)[touching],
        half=np.degrees(0.5 * (high - low))[touching],
        inside=((low <= truth.angle) & (truth.angle <= high))[touching],
        anew=anew[touching],
        slip_error=np.degrees(slip - slip_zero - true_slip)[touching],
    )


def judge_states(clip: ClipAnswers) -> tuple[Bool[np.ndarray, " frames"], int, int]:
    """Mask of the frames with a right state, and the numbers of false and missed macro slips.

    A state is right if it is true within `LATE` frames; macro slip is also right if fewer than
    three dots stick.
    """
    estimated, true = (
        np.array([str(state) for state in states])
        for states in (clip.track.state, clip.truth.state)
    )
    slipping = str(State.MACRO_SLIP)
    near = [true[max(i - LATE, 0) : i + LATE + 1] for i in range(len(true))]
    right = np.array([state in states for state, states in zip(estimated, near, strict=True)])
    few = (clip.truth.holding < MIN_STICK_MARKERS) & (true != str(State.NO_CONTACT))
    right |= (estimated == slipping) & few
    called, missed = ~right & (estimated == slipping), ~right & (true == slipping)
    return right, int(called.sum()), int(missed.sum())


def has_right_outcome(clip: ClipAnswers) -> bool:
    """Whether the clip is reported as held or slipped as the truth says."""
    return clip.outcome == ("slipped" if State.MACRO_SLIP in clip.truth.state else "held")


def tables(result: list[ClipAnswers]) -> dict[str, list[dict[str, object]]]:
    """A row for each condition, and one for each clip."""
    names = list(dict.fromkeys(clip.condition for clip in result))
    rows = [_row(name, [clip for clip in result if clip.condition == name]) for name in names]
    clips = [_row(f"{clip.condition} {i}", [clip]) for i, clip in enumerate(result)]
    return {"": [*rows, _row("all", result)], "_clips": clips}


def _row(name: str, clips: list[ClipAnswers]) -> dict[str, object]:
    judged = [judge(clip) for clip in clips]
    parts = zip(*judged, strict=True)
    error, half, inside, anew, slip_error = (np.concatenate(part) for part in parts)
    answered = np.isfinite(error)
    wrong = answered & (np.abs(error) > WRONG_DEG) & (half < SURE_DEG)
    right, called, missed = zip(*(judge_states(clip) for clip in clips), strict=True)

    size, most = np.abs(error), partial(np.percentile, q=90)
    return {
        "condition": name,
        "clips": len(clips),
        "frames": len(error),
        "median error [°]": cell(size, 2, np.median),
        "90 % [°]": cell(size, 2, most),
        "interval holds [%]": cell(100.0 * inside[answered], 1),
        "median half-width [°]": cell(half[answered], 2, np.median),
        "confidently wrong": int(wrong.sum()),
        "unanswered [%]": cell(100.0 * ~answered, 1),
        "counted anew [%]": cell(100.0 * anew, 1),
        "states right [%]": cell(100.0 * np.concatenate(right), 1),
        "falsely macro slip": sum(called),
        "macro slip missed": sum(missed),
        "outcomes right": sum(map(has_right_outcome, clips)),
        "median error of slip [°]": cell(np.abs(slip_error), 2, np.median),
    }


def plot(result: list[ClipAnswers]) -> Figure:
    """Angle and interval with the truth, in the first clip of each condition."""
    shown = {clip.condition: clip for clip in reversed(result)}
    rows = -(-len(shown) // 3)
    figure, axes = plt.subplots(
        rows, 3, figsize=(13, 2.6 * rows), squeeze=False, layout="constrained"
    )
    for axis, clip in zip(axes.ravel(), reversed(shown.values()), strict=False):
        frames = np.arange(len(clip.truth.angle))
        axis.plot(frames, np.degrees(clip.truth.angle), "k", lw=1, label="truth")
        axis.plot(frames, np.degrees(clip.truth.gel_angle), "k:", lw=1, label="gel, truth")
        axis.plot(frames, np.degrees(clip.track.angle), "C0", lw=1, label="tracked")
        axis.fill_between(
            frames, *np.degrees([clip.track.low, clip.track.high]), color="C0", alpha=0.3, lw=0
        )
        finish(axis, title=clip.condition)
    axes[0, 0].legend(fontsize=7)
    axes[0, 0].set_ylabel("angle [°]")
    axes[-1, 0].set_xlabel("frame")
    return figure
