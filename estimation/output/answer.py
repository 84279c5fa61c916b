"""A run's answer in words: how far the object turned, and whether it was held."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import RESTS_OR_SLIDES, State
from estimation.frames.names import counted
from estimation.output.found import Run
from estimation.output.missing import count_missing

Angles = Float[np.ndarray, " frames"]
_NO_TURN = "no clear turn"


def describe_run(run: Run) -> str:
    """How far the object turned and whether it was held, in a sentence."""
    return f"{_describe_turns_of(run)}; {describe_outcome(run)}"


def describe_turns(angle: Angles, low: Angles, high: Angles) -> str:
    """The turning points of the object's angle, each with its 95 % interval, as a phrase.

    The path begins at 0, which the angle counts from. A motion is a turn if it exceeds a fifth of
    the whole range, and three half-widths of the interval at both ends.

    Args:
        angle: angle of the object [rad]; NaN where unknown.
        low: lower end of its 95 % interval [rad].
        high: upper end of its 95 % interval [rad].
    """
    answered = np.flatnonzero(np.isfinite(angle))
    if not len(answered):
        return "no angle"
    angles, lows, highs = (np.degrees(values[answered]) for values in (angle, low, high))
    half_widths = np.insert(np.nan_to_num(highs - lows) / 2.0, 0, 0.0)
    path = np.insert(angles, 0, 0.0)
    least = max(0.2 * float(np.ptp(path)), 0.2)  # smallest turn [deg]
    turns = [row - 1 for row in find_turns(path, np.maximum(3.0 * half_widths, least))]

    def show(row: int) -> str:
        return show_angle(angles[row], lows[row], highs[row])

    if not any(lows[row] > 0.0 or highs[row] < 0.0 or np.isnan(lows[row]) for row in turns):
        return f"{_NO_TURN} (largest angle {show(int(np.abs(angles).argmax()))})"
    if len(turns) > 4:  # too many to list
        ends = (int(angles.argmin()), int(angles.argmax()))
        swings = f"turned back and forth between {show(ends[0])} and {show(ends[1])}"
        return f"{swings}; last {show(len(angles) - 1)}"
    first, *others = map(show, turns)
    back = [f"{'then' if number else 'back'} to {turn}" for number, turn in enumerate(others)]
    return ", ".join([f"turned to {first}", *back])


def find_turns(values: Sequence[float] | np.ndarray, least: Angles) -> list[int]:
    """Rows of the turning points of a path, including its last extreme; empty without a turn.

    Args:
        values: values of the path, without NaN.
        least: change from which a value is another turning point than the one before, in the unit
            of the values; of two values the larger one counts.
    """
    turns: list[int] = []
    start = low = high = extreme = 0
    sign = 0.0

    def differ(first: int, second: int) -> bool:
        return bool(abs(values[first] - values[second]) > max(least[first], least[second]))

    for row, value in enumerate(values):
        if not sign:
            low, high = (
                min(low, row, key=values.__getitem__),
                max(high, row, key=values.__getitem__),
            )
            if differ(low, high):
                start, extreme = sorted((low, high))
                sign = float(np.sign(values[extreme] - values[start]))
        elif sign * (value - values[extreme]) > 0.0:
            extreme = row
        elif differ(row, extreme):
            turns.append(extreme)
            extreme, sign = row, -sign
    return [*turns, extreme] if sign else []


def show_angle(angle: float, low: float, high: float) -> str:
    """An angle with its 95 % interval as text, rounded to significant digits [deg]."""
    below, above = angle - low, high - angle
    if not np.isfinite(below + above):
        return f"{_signed(angle, 1)}°"
    half = max(below, above)
    digits = _count_digits(half, 1)
    if half > 1.5 * min(below, above) + 10.0**-digits:
        return f"{_signed(angle, digits)}° ({_signed(low, digits)}° to {_signed(high, digits)}°)"
    return f"{_signed(angle, digits)}° ± {half:.{digits}f}°"


def describe_outcome(run: Run) -> str:
    """Whether the object was held, or when it slipped, in a few words."""
    outcome, start = run.outcome, run.main.time[0]
    if outcome.word == "unknown":
        return _describe_unknown(run)
    likely = ""
    if np.isfinite(outcome.probability):
        likely = f" (probability of a slip {outcome.probability:.2f})"
    if outcome.word == "held":
        return f"{outcome.phrase} {_describe_end(run)}{likely}{_describe_gaps(run)}"
    word = "first slipped" if outcome.slips > 1 else "slipped"
    if outcome.phrase != outcome.word:
        word = f"{outcome.phrase}, for the first time" if outcome.slips > 1 else outcome.phrase
    dated = [slip for slip in run.slips if slip.certain and slip.onset <= outcome.onset]
    if np.isnan(outcome.probability) and dated:
        # the slip during which macro slip was first detected
        slip = dated[-1]
        words = f"{word} {show_time(slip.onset, start)}"
        return words + (f", held again from {slip.regained - start:.2f} s" if slip.ended else "")
    when = word if likely else "slipped, first seen"
    return f"{when} {show_time(outcome.onset, start)}{_describe_slide(run)}{likely}"


def show_time(time: float, start: float) -> str:
    """A time since the first frame in words, with the time stamp if that differs.

    Args:
        time: time stamp [s].
        start: time stamp of the first frame [s].
    """
    stamp = f", at time_s {time:.2f}" if start else ""
    return f"{time - start:.2f} s after the first frame{stamp}"


def _describe_end(run: Run) -> str:
    """Until when the object was held: the end of the recording or contact, or its last sight."""
    unseen = 2  # frames without a known state, which noise may cause in a contact that holds
    state, time = np.array(run.main.state), run.main.time
    known = np.flatnonzero(state != State.UNKNOWN)
    touching = known[state[known] != State.NO_CONTACT]
    if len(touching) and touching[-1] != known[-1]:
        return f"until the contact ended, {show_time(float(time[touching[-1]]), time[0])}"
    if len(known) and len(state) - 1 - known[-1] > unseen:
        return f"until last seen, {show_time(float(time[known[-1]]), time[0])}"
    return "so far" if run.unfinished else "to the end"


def _describe_gaps(run: Run) -> str:
    """The number of frames in contact without an angle, in which a turn may have gone unseen."""
    touching = [state not in (State.NO_CONTACT, State.UNKNOWN) for state in run.main.state]
    gaps = int((np.array(touching) & ~run.main.answered).sum())
    if not gaps or not run.main.answered.any():
        return ""
    return f", but without an angle in {counted(gaps, 'frame', 'frames')} of the contact"


def _describe_slide(run: Run) -> str:
    """The last known slip of the object over the gel; empty unless it is clearly above 0."""
    rows = np.flatnonzero(np.isfinite(run.shears.slip + run.shears.slip_error))
    if not len(rows):
        return ""
    last = rows[-1]
    slip, error = float(run.shears.slip[last]), float(run.shears.slip_error[last])
    if slip < 1.5 * error:
        return ""
    digits = _count_digits(error, 0)
    end = " by the end" if run.outcome.slips > 1 else ""
    return f", slid by {slip:.{digits}f} ± {error:.{digits}f} {run.unit}{end}"


def _describe_turns_of(run: Run) -> str:
    """The turns of the chosen method's angle, in each stretch of frames with the same zero."""
    track = run.main
    if not track.answered.any():
        counts = count_missing(track).items()
        missing = ", ".join(f"{counted(n, 'frame', 'frames')} {why}" for why, n in counts)
        return f"No angle in any of {counted(len(track.time), 'frame', 'frames')} ({missing})"
    words: list[str] = []
    starts = np.stack([track.contacts, track.restarts], axis=1)
    contact, still = starts[track.answered][0, 0], 0
    for start in np.unique(starts[track.answered], axis=0):
        rows = (starts == start).all(axis=1)
        turns = describe_turns(track.angle[rows], track.low[rows], track.high[rows])
        since = show_time(track.since[rows & track.answered][0], track.time[0])
        begins = "angle restarted" if start[0] == contact else "new contact"
        if words and start[0] != contact and turns.startswith(_NO_TURN):
            still += 1
        else:
            words.append(f"{begins} {since}: {turns}" if words else turns)
        contact = start[0]
    text = "; ".join(words[:3]) + ("; …" if len(words) > 3 else "")
    text += f"; {_NO_TURN} in {counted(still, 'later contact', 'later contacts')}" if still else ""
    return text[0].upper() + text[1:]


def _describe_unknown(run: Run) -> str:
    """Why it is unknown whether the object was held."""
    track = run.main
    if RESTS_OR_SLIDES in track.reason:
        return "outcome unknown: the object may have slid over gel at rest"
    if all(state in (State.NO_CONTACT, State.UNKNOWN) for state in track.state):
        empty = sum(state == State.NO_CONTACT for state in track.state)
        if not empty:
            return "no frame could be used"
        if 2 * empty >= len(track.state):
            return "nothing touched"
    return "outcome unknown"


def _count_digits(half: float, least: int) -> int:
    """Number of decimals up to a half-width's first significant digit, three at most."""
    return int(np.clip(np.ceil(-np.log10(max(half, 1e-9)) - 1e-6), least, 3))


def _signed(value: float, digits: int) -> str:
    """A number with its sign, with a typographic minus; 0 has no sign."""
    text = f"{value:+.{digits}f}"
    return text.lstrip("+-") if not float(text) else text.replace("-", "−")
