"""Rendered clips with truth: the command line's answers on objects that print through the gel.

Every clip is drawn by `estimation.virtual.clip`, written as pictures, and answered by the stream of
`python -m estimation run` without options. The truth is the scene's.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators.result import State, Track
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.slip.lookback import date_doubts, withdraw
from estimation.slip.motion import accumulate_slip
from estimation.virtual.clip import ClipTruth, VirtualClip
from papers.items import Track as Progress
from papers.marker_images.answers import answer_clip
from papers.marker_images.scenes import CONDITIONS, draw_scene
from papers.marker_images.settings import CLIP_DRAWS, QUICK_CLIPS

WRONG_DEG, SURE_DEG = 2.0, 1.5
"""Error above which, and half-width below which, an answer is confidently wrong [deg]."""
LATE = 3
"""Frames by which a state may be early or late and is still right."""


class ClipAnswers(NamedTuple):
    """A rendered clip, answered.

    Attributes:
        condition: it is of.
        truth: of each frame.
        track: answers of the command line.
        imprint: angle of the imprint [rad].
    """

    condition: str
    truth: ClipTruth
    track: Track
    imprint: Float[np.ndarray, " frames"]


def answer_scene(condition: str, draw: int) -> ClipAnswers:
    """Draw a clip, and run over its pictures as the command line does."""
    clip = VirtualClip(draw_scene(condition, draw))
    answers, noise = answer_clip(clip)
    live = Track.gather("tracked", [answer.estimates["tracked"] for answer in answers])
    imprint = np.array([answer.frame.imprint[0] for answer in answers])
    slips = [] if noise is None else date_doubts(live, [answer.sight for answer in answers])
    return ClipAnswers(condition, clip.truth, withdraw(live, slips, imprint), imprint)


def compute(quick: bool = False, track: Progress = iter) -> list[ClipAnswers]:
    """Draw and answer the clips of every condition."""
    conditions, draws = (QUICK_CLIPS, 1) if quick else (list(CONDITIONS), CLIP_DRAWS)
    cases = [(condition, draw) for condition in conditions for draw in range(draws)]
    return [answer_scene(*case) for case in track(cases)]


class Judged(NamedTuple):
    """Answers beside the truth, in the frames in which the object touches.

    Attributes:
        error: of the angle since it is counted [deg]; NaN without an answer.
        half: half the 95 % interval [deg].
        inside: whether that holds the truth.
        anew: whether the angle was lost in this contact before and is counted anew.
        slip_error: of the turn over the gel [deg].
    """

    error: Float[np.ndarray, " frames"]
    half: Float[np.ndarray, " frames"]
    inside: Bool[np.ndarray, " frames"]
    anew: Bool[np.ndarray, " frames"]
    slip_error: Float[np.ndarray, " frames"]


def judge(one: ClipAnswers) -> Judged:
    """Angles beside the truth, both since the frame that the angle is counted from.

    That is the last one without contact; where the pad was loaded before, or the angle was lost and
    counted anew, it is the first that has an answer.
    """
    track, truth = one.track, one.truth
    touching, known = np.isfinite(truth.angle), np.isfinite(track.angle)
    slip, true_slip = accumulate_slip(track), truth.slip_angle
    zero, slip_zero = np.zeros((2, len(touching)))
    anew, first_count = np.zeros(len(touching), dtype=bool), {}
    touch = np.cumsum(np.diff(touching, prepend=False) & touching)
    counts = np.column_stack([touch, track.anew, np.nan_to_num(track.since)])
    for count in np.unique(counts[touching & known], axis=0):
        rows = (counts == count).all(axis=1) & touching & known
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


def judge_states(one: ClipAnswers) -> tuple[Bool[np.ndarray, " frames"], int, int]:
    """Frames whose state is right; of those that are not, called macro slip, and missed as such.

    The true state within `LATE` frames is right, and macro slip where fewer than three dots hold.
    """
    found, true = (
        np.array([str(state) for state in states]) for states in (one.track.state, one.truth.state)
    )
    slipping = str(State.MACRO_SLIP)
    near = [true[max(i - LATE, 0) : i + LATE + 1] for i in range(len(true))]
    right = np.array([state in those for state, those in zip(found, near, strict=True)])
    few = (one.truth.holding < MIN_STICK_MARKERS) & (true != str(State.NO_CONTACT))
    right |= (found == slipping) & few
    called, missed = ~right & (found == slipping), ~right & (true == slipping)
    return right, int(called.sum()), int(missed.sum())


def tables(result: list[ClipAnswers]) -> dict[str, list[dict[str, object]]]:
    """A row for each condition, and one for each clip."""
    names = list(dict.fromkeys(one.condition for one in result))
    rows = [_row(name, [one for one in result if one.condition == name]) for name in names]
    clips = [_row(f"{one.condition} {i}", [one]) for i, one in enumerate(result)]
    return {"": [*rows, _row("all", result)], "_clips": clips}


def _row(name: str, clips: list[ClipAnswers]) -> dict[str, object]:
    judged = [judge(one) for one in clips]
    parts = zip(*judged, strict=True)
    error, half, inside, anew, slip_error = (np.concatenate(part) for part in parts)
    known = np.isfinite(error)
    wrong = known & (np.abs(error) > WRONG_DEG) & (half < SURE_DEG)
    states = [judge_states(one) for one in clips]
    right = np.concatenate([one[0] for one in states])

    def show(values: np.ndarray, digits: int = 2) -> float | None:
        return round(float(values), digits) if np.isfinite(values) else None

    def share(flags: np.ndarray) -> float | None:
        return round(100.0 * float(flags.mean()), 1) if len(flags) else None

    size = np.abs(error[known]) if known.any() else np.array([np.nan])
    return {
        "condition": name,
        "clips": len(clips),
        "frames": len(error),
        "median error [°]": show(np.median(size)),
        "90 % [°]": show(np.percentile(size, 90)),
        "interval holds [%]": share(inside[known]),
        "median half-width [°]": show(np.median(half[known])) if known.any() else None,
        "confidently wrong": int(wrong.sum()),
        "unanswered [%]": share(~known),
        "counted anew [%]": share(anew),
        "states right [%]": share(right),
        "falsely macro slip": sum(one[1] for one in states),
        "macro slip missed": sum(one[2] for one in states),
        "median error of slip [°]": show(np.nanmedian(np.abs(slip_error))) if known.any() else None,
    }


def plot(result: list[ClipAnswers]) -> Figure:
    """Angle and interval beside the truth, in the first clip of each condition."""
    shown = {one.condition: one for one in reversed(result)}
    rows = -(-len(shown) // 3)
    figure, axes = plt.subplots(
        rows, 3, figsize=(13, 2.6 * rows), squeeze=False, layout="constrained"
    )
    for axis, one in zip(axes.ravel(), reversed(shown.values()), strict=False):
        frames = np.arange(len(one.truth.angle))
        axis.plot(frames, np.degrees(one.truth.angle), "k", lw=1, label="truth")
        axis.plot(frames, np.degrees(one.truth.gel_angle), "k:", lw=1, label="gel, truth")
        axis.plot(frames, np.degrees(one.track.angle), "C0", lw=1, label="tracked")
        axis.fill_between(
            frames, *np.degrees([one.track.low, one.track.high]), color="C0", alpha=0.3, lw=0
        )
        axis.set_title(one.condition, fontsize=9)
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7)
    axes[0, 0].set_ylabel("angle [°]")
    axes[-1, 0].set_xlabel("frame")
    return figure
