"""Inspection of recordings: unusable frames and markers are flagged.

Nothing is dropped. A frame that cannot be used keeps its row and gets a reason in `flaws`. A marker
that cannot be used is not `valid`. The `notes` count both.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from contactmodel.common.arrays import declared_arrays
from estimation.frames.names import counted
from estimation.frames.noise import Noise, find_rounding
from estimation.frames.recording import (
    LARGEST_VALUE,
    ONSET_MM,
    Frame,
    Recording,
    expect_places,
)
from estimation.frames.stretches import find_stretches

FROZEN_STEPS = 5
"""Number of consecutive steps without motion after which a marker counts as frozen.

Good markers with rounded coordinates have one or two such steps."""


class Fault(StrEnum):
    """Faults of a frame that are found in whole recordings and in streams."""

    NO_TIME = "no time stamp"
    ZERO = "all marker positions are zero"
    REPEATS = "repeats the frame before"


class MarkerFault(StrEnum):
    """Faults of markers, in words that follow "3 markers were"."""

    UNSEEN = "not seen at times"
    FROZEN = "frozen at times while others moved"


def inspect_recording(recording: Recording) -> Recording:
    """Inspect a recording, and fill in its `flaws`, `valid`, `notes` and `warnings`.

    A frame is flagged if its time stamp is missing or out of order, if it shows no marker, if all
    its positions are exactly zero, or if each visible marker is exactly where it was in the
    previous frame, as from a sensor that hangs. Repetitions of the reference are not flagged, since
    some sensors report it while unloaded. A marker is not valid where it has no position or is
    frozen (`frozen_markers`). Notes count the frames that are missing at the source. Warnings point
    out lengths and times that suggest another unit, coarse rounding, a reversed z axis or force,
    and frames out of order. Infinite values, and values too large to be measurements, become NaN. A
    second inspection changes nothing, and flaws that a reader has set stay.

    Raises:
        ValueError: the recording has many time stamps and no two are in order, or a position at
            rest is not finite or too large.
    """
    expect_places(recording.layout.reference)
    recording, absurd = _take_out_absurd(recording)
    seen = np.all(np.isfinite(recording.positions), axis=-1)
    frozen = frozen_markers(recording.positions, seen)
    valid = recording.valid & seen & ~frozen
    zero = (recording.positions == 0).all(axis=-1)
    blank = seen.any(axis=1) & (zero | ~seen).all(axis=1)
    timed, disordered = np.isfinite(recording.time), expect_clock(recording.name, recording.time)
    repeats = find_repeats(
        recording.positions[1:], recording.positions[:-1], recording.layout.reference
    )
    reasons = {
        Fault.NO_TIME: ~timed,
        "time stamp not after an earlier frame's": disordered,
        Fault.ZERO: blank,
        "no marker was seen": ~seen.any(axis=1),
        "no marker can be used": ~valid.any(axis=1),
        Fault.REPEATS: np.append(False, repeats),
    }
    flaws = list(recording.flaws or ("",) * len(recording))
    for reason, where in reasons.items():
        for frame in np.flatnonzero(where):
            flaws[frame] = flaws[frame] or reason
    remarks = [
        *absurd,
        *_index_notes(recording),
        *_count(MarkerFault.UNSEEN, ~seen),
        *_count(MarkerFault.FROZEN, frozen),
        *list_flaws(Counter(flaw for flaw in flaws if flaw)),
    ]
    valid &= ~blank[:, None]
    doubts = [*_doubt_values(recording, valid), *doubt_times(recording.time[~disordered])]
    if 2 * disordered.sum() > timed.sum():
        doubts.append(
            f"{disordered.sum()} of {timed.sum()} frames are out of order and are not used: sort "
            "them by time"
        )
    notes, warnings = (
        before + tuple(text for text in new if text not in before)
        for before, new in ((recording.notes, remarks), (recording.warnings, doubts))
    )
    return replace(recording, valid=valid, flaws=tuple(flaws), notes=notes, warnings=warnings)


class LiveInspector:
    """Inspects frames as they arrive, by earlier frames only.

    A frame is flagged if it repeats the previous one (`find_repeats`). A marker is not valid once
    it is frozen (`frozen_markers`), which is detected after `FROZEN_STEPS` steps.
    """

    def __init__(self) -> None:
        """Start without a frame."""
        self._before: Float[np.ndarray, "n d"] | None = None
        self._still = np.zeros(0, dtype=int)
        self._found: dict[str, tuple[int, Bool[np.ndarray, " n"]]] = {}

    def inspect(self, frame: Frame, reference: Float[np.ndarray, "n d"]) -> Frame:
        """Inspect the next frame, and set its `flaw` and `valid`."""
        seen = np.asarray(np.isfinite(frame.positions).all(axis=-1))
        before, self._before = self._before, frame.positions
        if before is None or frame.flaw or before.shape != frame.positions.shape:
            self._still = np.zeros(len(seen), dtype=int)
            return frame
        shared = seen & np.isfinite(before).all(axis=-1)
        same = shared & (frame.positions == before).all(axis=-1)
        if find_repeats(frame.positions, before, reference):
            return replace(frame, flaw=Fault.REPEATS)
        if 2 * (shared & ~same).sum() > shared.sum():
            self._still = np.where(same, self._still + 1, 0)
        frozen = np.logical_and(seen, self._still >= FROZEN_STEPS)
        self._count(MarkerFault.UNSEEN, ~seen)
        self._count(MarkerFault.FROZEN, frozen)
        return replace(frame, valid=frame.valid & ~frozen) if frozen.any() else frame

    def notes(self) -> tuple[str, ...]:
        """Number of frames and markers with each problem, in sentences."""
        return tuple(
            _say_count(what, int(which.sum()), frames)
            for what, (frames, which) in self._found.items()
        )

    def _count(self, what: str, where: np.ndarray) -> None:
        if where.any():
            frames, which = self._found.get(what, (0, np.zeros_like(where)))
            self._found[what] = frames + 1, which | where


def _take_out_absurd(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with NaN in place of values too large to be measurements, and notes."""
    changed, notes = {}, []
    for name, kind in declared_arrays(Recording).items():
        values = getattr(recording, name)
        if values is None or name == "time" or kind.dtype is not Float:
            continue
        absurd = ~(np.isnan(values) | (np.abs(values) < LARGEST_VALUE))
        if absurd.any():
            changed[name] = np.where(absurd, np.nan, values)
            notes.append(
                f"{absurd.sum()} values of `{name}` are {LARGEST_VALUE:g} or more: left out"
            )
    if "positions" in changed:
        changed["valid"] = recording.valid & np.isfinite(changed["positions"]).all(axis=-1)
    return replace(recording, **changed), notes


def frozen_markers(
    positions: Float[np.ndarray, "frames n d"], seen: Bool[np.ndarray, "frames n"]
) -> Bool[np.ndarray, "frames n"]:
    """Find markers that stay exactly in place while more than half of the others move.

    Only steps in which the others move count, and at least `FROZEN_STEPS` of them in a row are
    required. All frames of such a run are marked, including its first: the last frame with a
    correct position cannot be distinguished from the first wrong one.
    """
    frozen = np.zeros(seen.shape, dtype=bool)
    shared = seen[1:] & seen[:-1]
    still = shared & (positions[1:] == positions[:-1]).all(axis=-1)
    moving = np.flatnonzero(2 * (shared & ~still).sum(axis=1) > shared.sum(axis=1))
    for marker in np.flatnonzero(still[moving].sum(axis=0) >= FROZEN_STEPS):
        for start, stop in find_stretches(still[moving, marker]):
            if stop - start >= FROZEN_STEPS:
                frozen[moving[start] : moving[stop - 1] + 2, marker] = True
    return frozen & seen


def find_repeats(
    positions: Float[np.ndarray, "*frames n d"],
    last: Float[np.ndarray, "*frames n d"],
    reference: Float[np.ndarray, "n d"],
) -> Bool[np.ndarray | np.bool, "*frames"]:
    """Find frames in which each visible marker is exactly where it was in the last, not at rest.

    A marker that appears shows something new; one that becomes hidden does not.
    """
    hidden = ~np.isfinite(positions).all(axis=-1)
    same = (positions == last).all(axis=-1) | hidden
    at_rest = (positions == reference).all(axis=-1) | hidden
    return same.all(axis=-1) & ~at_rest.all(axis=-1)


def expect_clock(name: str, time: Float[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """The frames of a recording whose time stamps are out of order, as in `disordered_times`.

    Raises:
        ValueError: there are many time stamps and no two are in order.
    """
    many_stamps = 10  # disordered ones that prove a fault of the clock: by chance 1 in 10!
    timed, disordered = np.isfinite(time), disordered_times(time)
    if timed.sum() >= many_stamps and (timed & ~disordered).sum() == 1:
        raise ValueError(
            f"{name}: the clock stands still or runs backwards, none of {timed.sum()} "
            "time stamps is later than another: give the frames in order, with times in seconds"
        )
    return disordered


def disordered_times(time: Float[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Find the fewest frames without which the time stamps increase.

    A single stamp far in the future therefore spoils one frame, not all later ones. Among equal
    choices, earlier frames are kept. Missing stamps (NaN) are not out of order.
    """
    stamped = np.flatnonzero(np.isfinite(time))
    run = np.zeros(len(time), dtype=int)  # length of the longest increasing run from each frame on
    starts: list[float] = []  # starts[k] is minus the latest start of a run of k + 1 frames
    for frame in stamped[::-1]:
        start = -float(time[frame])
        place = bisect_left(starts, start)
        starts[place : place + 1] = [start]
        run[frame] = place + 1
    disordered = np.isfinite(time)
    remaining, latest = len(starts), -np.inf
    for frame in stamped:
        if run[frame] == remaining and time[frame] > latest:
            disordered[frame] = False
            remaining, latest = remaining - 1, time[frame]
    return disordered


def _index_notes(recording: Recording) -> list[str]:
    """Notes on gaps and disorder in the source's frame numbers."""
    steps = np.diff(recording.source_index)
    notes = []
    if (steps > 1).any():
        missing, gaps = int((steps[steps > 1] - 1).sum()), int((steps > 1).sum())
        notes.append(
            f"{counted(missing, 'frame was', 'frames were')} dropped at the source "
            f"({counted(gaps, 'gap', 'gaps')} in the frame numbers, the largest step {steps.max()})"
        )
    if (steps < 1).any():
        notes.append(f"the frame numbers do not increase in {int((steps < 1).sum())} places")
    return notes


def doubt_times(time: Float[np.ndarray, " frames"], longest: float = 5.0) -> list[str]:
    """A warning of time stamps that suggest another unit than seconds.

    Args:
        time: time stamps [s].
        longest: time between two frames above which the unit is doubted [s].
    """
    shortest = 1e-5  # time between two frames of a tactile sensor [s]
    steps = np.diff(time[np.isfinite(time)])
    step = float(np.median(steps)) if len(steps) else longest
    if shortest <= step <= longest:
        return []
    return [f"the frames are {step:.2g} s apart: are the time stamps in s?"]


class ClockWatch:
    """Doubts the unit of a live clock once, after some frames.

    Frames further apart than the alert `act` comes before a slip come too late for it, whatever
    the unit is.
    """

    def __init__(self, act_s: float) -> None:
        """Start before the first frame; `act` comes `act_s` before a slip [s]."""
        self._act_s, self._times = act_s, list[float]()

    def update(self, time: float) -> list[str]:
        """Doubts after the next frame's time stamp [s]; those out of order do not count."""
        enough = 10  # frames, so that one late frame or a pause is no evidence
        if len(self._times) == enough or not time > max(self._times, default=-np.inf):
            return []
        self._times.append(time)
        if len(self._times) < enough:
            return []
        return [
            f"{doubt} Alerts assume seconds, and otherwise come late or not at all: divide times "
            "in ms by 1e3, in ns by 1e9. In seconds, frames are further apart than `act` comes "
            f"before a slip, {self._act_s:g} s (act_s)."
            for doubt in doubt_times(np.array(self._times), self._act_s)
        ]


def doubt_scale(reference: Float[np.ndarray, "n d"], noise: Noise | None, unit: str) -> list[str]:
    """Warnings of marker distances, and of a noise, that suggest another unit."""
    pitches = (0.05, 20.0)  # range of distances between a tactile sensor's markers [mm]
    sure = 5.0  # standard errors beyond which no marker of a recording lies
    pitch = _pitch(reference)
    if unit == "mm" and not pitches[0] <= pitch <= pitches[1]:
        return [f"the markers lie {pitch:.2g} mm apart: are the lengths in mm?"]
    if noise is not None and 2 * sure * noise.in_plane > pitch:
        return [
            f"with the given noise of {noise.in_plane:g} {unit}, markers {pitch:.2g} {unit} apart "
            f"would be mistaken for each other: is the noise in {unit}?"
        ]
    return []


def _doubt_values(recording: Recording, valid: Bool[np.ndarray, "frames n"]) -> list[str]:
    """Warnings of positions and forces that seem to be in other units or axes, or too coarse."""
    return [
        *_doubt_lengths(recording, valid),
        *_doubt_rounding(recording),
        *_doubt_force(recording),
    ]


def _doubt_lengths(recording: Recording, valid: Bool[np.ndarray, "frames n"]) -> list[str]:
    """Warnings of lengths that suggest a wrong unit, or a z axis that points into the pad."""
    if recording.unit != "mm":
        return []
    reference = recording.layout.reference
    notes = doubt_scale(reference, None, recording.unit)
    if reference.shape[1] == 3 and valid.any():
        inward, outward = np.quantile((recording.positions - reference)[valid, 2], (0.01, 0.99))
        if outward > max(-inward, ONSET_MM):
            notes.append(
                f"the markers move out of the pad, by up to {outward:.2g} mm: does z point out of "
                "the elastomer? If not, change the sign of z, and that of y too if x, y and z are "
                "right-handed: else all angles have the wrong sign"
            )
    return notes


def _doubt_rounding(recording: Recording) -> list[str]:
    """A warning of positions rounded so coarsely that small turns move no marker."""
    coarse = 0.03  # share of the markers' distance: intervals hold at 0.02, and fail at 0.05
    step = float(find_rounding(recording)[:2].max())
    pitch = _pitch(recording.layout.reference)
    if step <= coarse * pitch:
        return []
    return [
        f"the positions are rounded to {step:.2g} {recording.unit}, and markers lie {pitch:.2g} "
        f"{recording.unit} apart: angles may be wrong beyond their intervals. Give positions with "
        "more digits, such as centroids of the markers' pixels"
    ]


def _pitch(reference: Float[np.ndarray, "n d"]) -> float:
    """Typical distance of a marker from the next."""
    return float(np.median(KDTree(reference).query(reference, 2)[0][:, 1]))


def _doubt_force(recording: Recording) -> list[str]:
    """A warning of forces that pull at the pad, as those on the object do in our axes."""
    least = 0.2  # no drift of a sensor at rest [N]
    if recording.force is None or not np.isfinite(recording.force[:, 2]).any():
        return []
    press, pull = np.nanquantile(recording.force[:, 2], (0.01, 0.99))
    if pull <= max(-press, least):
        return []
    return [
        f"the normal force Fz is above 0, up to {pull:.2g} N, as if the object pulled at the pad: "
        "no friction is found. Pressing makes Fz negative. If your force and moment act on the "
        "object, change the signs of both"
    ]


def _count(what: str, where: Bool[np.ndarray, "frames n"]) -> list[str]:
    """A note on the number of frames and markers with a problem."""
    if not where.any():
        return []
    frames, markers = int(where.any(axis=1).sum()), int(where.any(axis=0).sum())
    return [_say_count(what, markers, frames)]


def _say_count(what: str, markers: int, frames: int) -> str:
    were = counted(markers, "marker was", "markers were")
    least = "at least one " if markers > 1 else ""
    return f"{were} {what}, {least}in {counted(frames, 'frame', 'frames')}"


def list_flaws(counts: Mapping[str, int]) -> list[str]:
    """The number of frames with each flaw, in words."""
    return [f"{counted(n, 'frame', 'frames')}: {flaw}" for flaw, n in counts.items()]
