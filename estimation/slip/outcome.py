"""Whether an object was held or has slipped, over a whole recording, and since when."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import State, Track, may_slip
from estimation.frames.recording import Flaw, Hidden
from estimation.frames.stretches import find_stretches
from estimation.slip.motion import accumulate_slip
from estimation.slip.shear import ShearPath, ShearSettings


class Outcome(NamedTuple):
    """Outcome of a grasp.

    Attributes:
        word: `held` or `slipped`; `unknown` if fewer than two frames show the contact or its state,
            if the contact was hidden in most of its frames, if the object may have slid over gel at
            rest or with few markers sticking, if it has left without a slip that was seen, if its
            print does not show a slip along the gel's shear or turn, or if its print has turned
            over the gel too slowly to be seen as a slip.
        probability: probability that the object slipped [-]; a half if the outcome is unknown, NaN
            if it comes from the states of the contact alone.
        onset: time at which the first slip began, by the frames before and after it, or of the
            first macro slip [s]; NaN without slip.
        slips: number of slips.
    """

    word: str
    probability: float
    onset: float
    slips: int = 0

    @property
    def phrase(self) -> str:
        """The outcome in words: its word, after "probably" where the other one is not unlikely."""
        unlikely = 0.1  # probability of the other outcome up to which it is not mentioned [-]
        doubtful = unlikely < self.probability < 1.0 - unlikely
        return f"probably {self.word}" if doubtful and self.word != "unknown" else self.word


def conclude(shears: ShearPath, track: Track) -> Outcome:
    """The outcome of a recording's grasp.

    Without a print in most of the contact's frames with a known state, it comes from the states.

    Args:
        shears: shear of the gel and probability of a slip in each frame.
        track: track of the chosen method.
    """
    least = 2  # frames: a single picture shows no motion
    touched = track.contact_markers > 0
    judged = touched & [state != State.UNKNOWN for state in track.state]
    hidden = sum(reason in tuple(Hidden) for reason in track.reason)
    if touched.sum() < least or 2 * hidden > touched.sum():
        return Outcome("unknown", 0.5, np.nan)
    slip_probability = shears.slip_probability
    known = np.isfinite(slip_probability)
    if known.any() and 2 * known.sum() >= judged.sum():
        probability, over = float(np.nanmax(slip_probability)), slip_probability > 0.5
    else:
        probability = np.nan
        over = track.slipping
        holds = sum(state in (State.STICK, State.INCIPIENT) for state in track.state)
        if not over.any() and (holds < least or any(map(may_slip, track.reason))):
            return Outcome("unknown", 0.5, np.nan)
    if not over.any():
        if Flaw.DEPARTED in track.reason:  # it was released, or has slipped out unseen
            return Outcome("unknown", 0.5, np.nan)
        doubtful = probability >= 0.5 or (known.any() and _has_turned_over_gel(track))
        word = "unknown" if doubtful else "held"  # the print shows no slip
        return Outcome(word, probability, np.nan)
    slips = find_stretches(over)
    onset = find_onset(shears, slips[0][0])
    return Outcome("slipped", probability, float(track.time[onset]), len(slips))


def _has_turned_over_gel(track: Track) -> bool:
    """Whether the object has turned over all of the gel, further than any error explains.

    Markers below the surface turn less than the gel's surface, but by less than half.
    """
    least, frames = np.radians(2.0), 3  # least turn [rad], and frames that show it
    slip, error = np.abs(accumulate_slip(track)), track.high - track.low
    return int(((slip - error > least) & (slip > 0.5 * np.abs(track.angle))).sum()) >= frames


def find_onset(shears: ShearPath, reported: int) -> int:
    """The frame in which a slip began, in view of the frames before and after it.

    From the onset on, the print moves over the gel, and the gel no longer follows the object. The
    print's correlation and the shear therefore have a corner there. The later corner counts: the
    print may move earlier over a part of the contact, and the gel may have rested earlier because
    the object did.

    Args:
        shears: shear of the gel and correlation of the print in each frame.
        reported: frame in which the slip was reported, which is the latest onset.
    """
    first = max(reported - ShearSettings().memory, 0)
    unknown = np.flatnonzero(np.isnan(shears.print_correlation[first : reported + 1]))
    first += int(unknown[-1]) + 1 if len(unknown) else 0
    if first >= reported:
        return reported
    print_moves = first + _find_corner(shears.print_correlation[first : reported + 1])
    touched = max(first - 1, 0)  # the shear is 0 before contact
    after = shears.shear[reported : 2 * reported - first + 1]
    gone = np.flatnonzero(np.isnan(after))  # the object has left
    last = reported + (int(gone[0]) if len(gone) else len(after))
    shear = np.nan_to_num(shears.shear[touched:last])
    gel_rests = touched + _find_corner(shear)
    # both are medians of three frames, and change a frame late
    return min(max(print_moves, gel_rests) - 1, reported)


def _find_corner(values: Float[np.ndarray, " frames"]) -> int:
    """Index of the value furthest above the line from the first to the last value."""
    above = values - np.linspace(values[0], values[-1], len(values))
    return len(above) - 1 - int(above[::-1].argmax())


def join_outcomes(first: Outcome, second: Outcome) -> Outcome:
    """The outcome of a grasp by two fingers: `slipped` if the object slipped at either finger.

    Otherwise it is `unknown` if either finger's is, and else `held`. The fingers hold one object
    under one load, so their slips are not independent. The probability is therefore the larger one
    of the fingers with that outcome: a slip at either finger is at least as probable.

    Args:
        first: outcome at the first finger.
        second: outcome at the second finger, its onset on the first one's clock.
    """
    words = first.word, second.word
    word = next((word for word in ("slipped", "unknown") if word in words), "held")
    decisive = [finger for finger in (first, second) if finger.word == word]
    return Outcome(
        word,
        float(np.fmax.reduce([finger.probability for finger in decisive])),
        float(np.fmin.reduce([finger.onset for finger in decisive])),
        max(finger.slips for finger in decisive),
    )
