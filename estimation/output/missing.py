"""Counts of frames without an angle, by reason."""

from collections import Counter
from collections.abc import Container

import numpy as np

from estimation.estimators.result import RESTS_OR_SLIDES, UNSEEN_TURN, State, Track
from estimation.frames.names import counted


def count_missing(result: Track) -> dict[str, int]:
    """Number of frames without an angle by reason, the most frequent reason first."""
    touched = np.maximum.accumulate([state != State.NO_CONTACT for state in result.state])
    withdrawn = np.zeros(len(touched), dtype=bool)
    if result.withdrawn is not None:
        withdrawn = result.withdrawn.rows
    flags = (values.tolist() for values in (touched, withdrawn, result.answered))
    frames = zip(result.state, result.reason, *flags, strict=True)
    counts = Counter(_name_reason(*frame[:4]) for frame in frames if not frame[4])
    return dict(counts.most_common())


def describe_answers(result: Track, most: int = 3) -> str:
    """Number of frames with an angle by state, and of frames without one by reason, as a phrase.

    Args:
        result: track of one method.
        most: number of reasons to list; frames with rarer reasons are counted together.
    """
    answered = result.answered
    states = Counter(state for state, has in zip(result.state, answered, strict=True) if has)
    text = f"{answered.sum()} of {len(answered)} frames answered"
    if states:
        text += f" (of these, {_list({str(state): n for state, n in states.most_common()})})"
    missing = list(count_missing(result).items())
    if not missing:
        return text
    named, others = dict(missing[:most]), sum(n for _, n in missing[most:])
    if others:
        named["for other reasons"] = others
    reasons = {_shorten(reason) for reason in result.reason if reason}
    return f"{text}; {(~answered).sum()} without an angle: {_list(named, reasons)}"


def _name_reason(state: State, reason: str, touched: bool, withdrawn: bool) -> str:
    if state == State.NO_CONTACT:
        return "without contact" if touched else "before contact"
    if state == State.MACRO_SLIP:
        return "withdrawn in macro slip" if withdrawn else "in macro slip"
    if reason == RESTS_OR_SLIDES:
        return "withdrawn after a pause" if withdrawn else "while the gel rests"
    if reason == UNSEEN_TURN:
        return "withdrawn after an unseen turn" if withdrawn else "after an unseen turn"
    return _shorten(reason)


def _shorten(reason: str) -> str:
    return reason.split(":")[0]


def _list(counts: dict[str, int], quoted: Container[str] = ()) -> str:
    """Counts by name, as a phrase; names that are whole sentences follow a colon."""
    return ("; " if any(name in quoted for name in counts) else ", ").join(
        f"{counted(n, 'frame', 'frames')}: {name}" if name in quoted else f"{n} {name}"
        for name, n in counts.items()
    )
