"""Whether an object was held or has slipped, over a whole recording."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import RESTS_OR_SLIDES, Track


class Outcome(NamedTuple):
    """Outcome of a grasp.

    Attributes:
        word: `held` or `slipped`; `unknown` without contact, if the object may have slid over gel
            at rest, or if its print does not show a slip along the gel's shear or turn.
        probability: probability that the object slipped [-]; a half if the outcome is unknown, NaN
            if it comes from the states of the contact alone.
        onset: time at which a slip became more likely than not, or of the first macro slip [s]; NaN
            without slip.
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


def conclude(slip_probability: Float[np.ndarray, " frames"], track: Track) -> Outcome:
    """The outcome of a recording's grasp.

    Without a print in most of the contact's frames, it comes from the states of the contact.

    Args:
        slip_probability: probability of a slip in each frame [-].
        track: track of the chosen method.
    """
    told = np.isfinite(slip_probability)
    if told.any() and 2 * told.sum() >= (track.contact_markers > 0).sum():
        probability, over = float(np.nanmax(slip_probability)), slip_probability > 0.5
    else:
        probability = np.nan
        over = track.slipping
        certain = track.contact_markers.any() and RESTS_OR_SLIDES not in track.reason
        if not (over.any() or certain):
            return Outcome("unknown", 0.5, np.nan)
    if not over.any():
        word = "unknown" if probability >= 0.5 else "held"  # the print shows no slip
        return Outcome(word, probability, np.nan)
    slips = int((np.diff(over.astype(int), prepend=0) > 0).sum())
    return Outcome("slipped", probability, float(track.time[over.argmax()]), slips)


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
