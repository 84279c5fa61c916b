"""Withdrawal of angles, and dates of macro slips, in view of the whole recording.

A causal tracker detects macro slip some frames late. Under low friction it may miss it: the gel
comes to rest under an object that slides on, and a round contact looks the same in both cases.
Looking back, the closing disc dates the slip (`estimation.slip.onset`), and gel that came to rest
while few markers stuck casts doubt on the angle. In both cases the angle is unknown from there
until the contact ends, unless the tracker followed a visible outline or imprint. Withdrawn answers
are kept in `Result.withdrawn`.

Where the object prints, a slip is reported once it has moved the print by part of itself. Looking
back, the frames since its onset (`estimation.slip.outcome.find_onset`) are in macro slip, too. So
are the frames before it in which the object moved too fast for its markers to be recognised. All
states from the print are two frames late, since two frames must confirm them. Looking back, a frame
takes the state reported two frames later. Partial slip is none if a later print, compared with one
from before it, shows that all of the contact has stuck.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.estimators.result import (
    RESTS_OR_SLIDES,
    TOO_FEW_STICK,
    UNSEEN_TURN,
    Kept,
    Result,
    State,
    Track,
    Withdrawn,
)
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.frames.stretches import find_stretches
from estimation.slip.disc import SlipSettings
from estimation.slip.onset import MacroSlip, SightPath, SlipWatch, date_slips
from estimation.slip.outcome import find_onset
from estimation.slip.shear import ShearPath


def find_slips(
    recording: Recording, result: Result, noise: Noise, settings: SlipSettings = SlipSettings()
) -> list[MacroSlip]:
    """Macro slips of a recording, certain and possible ones, in order of time.

    Args:
        recording: the recording.
        result: result of one method, for the contact and the markers that stick.
        noise: noise of the markers.
        settings: how slips are dated and suspected.
    """
    watch = SlipWatch(recording.layout, noise, settings)
    frames = zip(recording.positions, result.contact, result.time, strict=True)
    sights = [watch.update(positions, contact, float(time)) for positions, contact, time in frames]
    return date_doubts(result, SightPath.of(*sights), settings)


def date_doubts(
    track: Track, sights: SightPath, settings: SlipSettings = SlipSettings()
) -> list[MacroSlip]:
    """Macro slips, certain and possible ones, from the sights recorded frame by frame.

    Args:
        track: track of one method.
        sights: sights of a `SlipWatch`, by frame.
        settings: how slips are dated and suspected.
    """
    slips = date_slips(sights, settings)
    begins, ends = np.array([(slip.onset, _end(slip)) for slip in slips]).reshape(-1, 2).T
    doubts = [
        doubt
        for doubt in _find_doubts(track, sights, settings)
        if not ((begins < doubt.high) & (doubt.low < ends)).any()
    ]
    return sorted(slips + doubts)


def withdraw(
    result: Kept,
    slips: Sequence[MacroSlip],
    outline: Float[np.ndarray, " frames"],
    *,
    keep: bool = False,
) -> Kept:
    """The result without angles reported while the object may have been sliding unnoticed.

    A slip withdraws no angle if a third of the contact's markers stick throughout its beginning, or
    if the outline is visible.

    Args:
        result: result of a method that follows the object.
        slips: slips of the recording.
        outline: direction of the contact's outline in each frame [rad]; NaN if rejected.
        keep: keep angles and states as answered frame by frame. The reasons then give the doubt,
            and `Result.withdrawn` marks the answers.

    Returns:
        The result. States and reasons explain missing angles, and `Result.withdrawn` holds the
        withdrawn answers.
    """
    state, reason = list(result.state), list(result.reason)
    doubtful, answered = np.zeros(len(result.time), dtype=bool), result.answered
    known = np.where(np.isnan(result.time), -np.inf, result.time)
    so_far, free = np.maximum.accumulate(known), _find_free(result)
    for slip in slips:
        begun = int(np.searchsorted(so_far, slip.onset))  # clocks may jump back
        if begun == len(doubtful) or not _lets_go(result, begun, SlipSettings()):
            continue
        rows = np.arange(begun, _contact_end(free, begun))
        sliding = result.time[rows] < _end(slip)
        if np.isfinite(outline[rows][sliding]).sum() > 0.5 * sliding.sum():
            continue
        for row, slides in zip(rows, sliding, strict=True):
            if not answered[row] or doubtful[row]:
                continue
            doubtful[row] = True
            if slides and slip.certain:
                state[row], reason[row] = State.MACRO_SLIP, TOO_FEW_STICK
            else:
                state[row], reason[row] = State.UNKNOWN, RESTS_OR_SLIDES if slides else UNSEEN_TURN
    quantities = result.quantities() | result.without(~doubtful)
    withdrawn = Withdrawn(**{name: quantities[name] for name in Withdrawn.columns()})
    result = replace(result, reason=tuple(reason), withdrawn=withdrawn)
    if keep:
        return result
    slips_now = doubtful & np.array([s == State.MACRO_SLIP for s in state])
    sticking = _release(result, slips_now)  # gel that rests may stick
    return replace(result, **(result.without(doubtful) | {"state": tuple(state)} | sticking))


def backdate(result: Kept, shears: ShearPath) -> Kept:
    """The result with each state from the object's print in the frames in which it began.

    Each state moves to the frames that it confirms. Macro slip is also dated back to its onset, or
    to the first of the frames before it whose markers were not recognised; a frame whose markers
    stick is not changed, and ends the stretch.

    Args:
        result: result of a method, as answered frame by frame.
        shears: shear of the gel and correlation of the print in each frame.
    """
    earlier = np.zeros(len(result.time), dtype=bool)
    may_slip = State.INCIPIENT, State.UNKNOWN
    for reported, _ in find_stretches(result.slipping):
        row, onset = reported, find_onset(shears, reported)
        if np.isfinite(shears.print_correlation[reported]):
            onset = _find_unread(result, shears, onset)
        while row > onset and result.state[row - 1] in may_slip:
            row -= 1
            earlier[row] = True
    confirmed = _take_confirmed(result, np.isfinite(shears.print_correlation))
    state = [
        State.MACRO_SLIP if slips else state
        for state, slips in zip(confirmed.state, earlier, strict=True)
    ]
    return replace(confirmed, state=tuple(state), **_release(confirmed, earlier))


def _find_unread(result: Track, shears: ShearPath, onset: int) -> int:
    """The first of the frames in contact before a slip whose markers were not recognised.

    It is the onset if there are none, or if they last so long that the object may have come to rest
    between.
    """
    longest = 16  # frames: age of the print that shows the slip
    unread = np.isnan(shears.shear) & (result.contact_markers > 0) & ~result.free
    known = np.flatnonzero(~unread[:onset])
    first = int(known[-1]) + 1 if len(known) else 0
    return first if onset - first <= longest else onset


def _take_confirmed(result: Kept, printed: Bool[np.ndarray, " frames"]) -> Kept:
    """The result with the states, and the markers that stick, of the frames that confirm them.

    Frames without a state or a print keep theirs, and the frames before take none from beyond them.
    """
    confirming = 2  # frames: the next one, and one more in a median of three
    certain = State.STICK, State.INCIPIENT, State.MACRO_SLIP
    shown = printed & np.array([state in certain for state in result.state])
    source = np.arange(len(shown))
    for _ in range(confirming):
        later = np.minimum(source + 1, len(shown) - 1)
        source = np.where(shown[source] & shown[later], later, source)
    source = _find_stuck(result, shown)[source]
    moved: dict[str, Any] = {
        "state": tuple(result.state[row] for row in source),
        "stick_markers": np.minimum(result.stick_markers[source], result.contact_markers),
    }
    if isinstance(result, Result):
        stick = result.stick[source] & result.contact
        moved |= {"stick": stick, "stick_markers": stick.sum(axis=1)}
    return replace(result, **moved)


def _find_stuck(result: Track, shown: Bool[np.ndarray, " frames"]) -> Int[np.ndarray, " frames"]:
    """For each row the one whose state it has: itself, or a later one that shows that it stuck.

    A contact sticks if its print is that of six frames before. A shorter partial slip between the
    two has moved no print: noise, such as that of a video's key frames, seemed to.
    """
    compared = 6  # frames: age of that print, `HoldSettings.lately`
    state = np.array(result.state)
    stuck = np.arange(len(state))
    for first, stop in find_stretches(shown & (state == State.INCIPIENT)):
        after = stop < len(state) and shown[stop] and state[stop] == State.STICK
        if after and stop - first < compared:
            stuck[first:stop] = stop
    return stuck


def _release(result: Track, rows: Bool[np.ndarray, " frames"]) -> dict[str, Any]:
    """The markers that stick, by name, with none in the given rows."""
    names = ("stick", "stick_markers")
    return {name: values for name, values in result.without(rows).items() if name in names}


def _find_doubts(track: Track, sights: SightPath, settings: SlipSettings) -> list[MacroSlip]:
    """Possible slips: times of gel at rest that came to rest while few markers stuck."""
    time, doubts, free = track.time, list[MacroSlip](), _find_free(track)
    for first, stop in find_stretches(sights.rests):
        last = stop - 1
        begin = first - settings.window  # the window's first frame
        moved = begin > 0 and track.contact_markers[begin - 1] > 0
        if last - first < settings.window or not moved:
            continue
        before = max(begin - settings.window, 0)
        near = slice(before, first + settings.window + 1)
        seen = (time[before] <= sights.time[near]) & (sights.time[near] <= time[first])
        margin = _continue(sights.margin[near][seen][-4:])
        closing = _lets_go(track, begin, settings) and margin < settings.least_margin
        if closing and not _is_held(track, slice(begin, last + 1), settings):
            moves_again = last < _contact_end(free, begin) - 1
            doubts.append(
                MacroSlip(
                    onset=float(time[begin]),
                    low=float(time[begin]),
                    high=float(time[last]),
                    regained=float(time[last]) if moves_again else np.nan,
                    certain=False,
                )
            )
    return doubts


def _is_held(track: Track, rows: slice, settings: SlipSettings) -> bool:
    """Whether a few markers are known to hold throughout a rest.

    The law of friction counts the markers that have never slipped, and excludes a slide. Without
    it, gel at rest seems to stick all over, or the interval widens by the possible slide.
    """
    wider = 1.5  # width of an interval over that of the first, from which it counts a slide
    stick, width = track.stick_markers[rows], (track.high - track.low)[rows]
    few = stick < settings.firm_share * track.contact_markers[rows]
    return bool(np.all(few & (stick >= settings.held_markers) & (width < wider * width[0])))


def _continue(margins: Float[np.ndarray, " discs"]) -> float:
    """The margin that a line through the last ones reaches a disc later; 0 without any."""
    if len(margins) < 2:
        return float(min(margins, default=0.0))
    place = np.arange(len(margins))
    return float(np.polyval(np.polyfit(place, margins, 1), len(margins)))


def _lets_go(result: Track, row: int, settings: SlipSettings) -> bool:
    """Whether few markers stuck in any of the frames around a row."""
    around = slice(max(row - settings.window, 0), row + settings.window + 1)
    stick, contact = result.stick_markers[around], result.contact_markers[around]
    return bool((stick < settings.firm_share * contact).any())


def _end(slip: MacroSlip) -> float:
    return slip.regained if slip.ended else np.inf


def _find_free(result: Track) -> Int[np.ndarray, " rows"]:
    """The rows without contact, and the one after the last."""
    return np.array([*np.flatnonzero(result.free), len(result.time)])


def _contact_end(free: Int[np.ndarray, " rows"], row: int) -> int:
    """The first row without contact after this one."""
    return int(free[np.searchsorted(free, row, side="right")])
