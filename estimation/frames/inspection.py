"""What is wrong with a recording, told frame by frame and marker by marker.

Nothing is dropped: a frame that cannot be used keeps its row and gets a reason (`flaws`), a
marker that cannot be used is marked (`valid`), and what was found is counted in `notes`.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from estimation.frames.names import counted
from estimation.frames.recording import (
    LARGEST,
    ONSET_MM,
    Frame,
    Recording,
    declared_arrays,
    expect_places,
)

FROZEN_STEPS = 5
"""Steps in a row without any change after which a marker counts as frozen.

One or two do happen to good markers whose coordinates are rounded."""


def inspect_recording(recording: Recording) -> Recording:
    """The recording with its flaws found: `flaws`, `valid` and `notes` filled in.

    A frame is flawed when its time stamp is missing or out of order, when it shows no marker, when
    all its positions are exactly zero, or when they are exactly those of the frame before, as from
    a sensor that hangs (but for the reference itself, which some sensors report while unloaded). A
    marker is not valid where it has no position and where it is frozen (`frozen_markers`). Frames
    missing at the source are counted in the notes. Values that are infinite, or too large to be
    measurements, become NaN, as if they were missing. Lengths that suggest another unit, or a z
    axis the other way round, get a note. Inspecting twice changes nothing, and flaws that a reader
    has set stay.

    Raises:
        ValueError: there are many time stamps, and no two are in order, or a marker at rest is
            where none can be.
    """
    # time stamps from which on, none after another, it is the clock: by chance 1 in 10!
    many_stamps = 10
    expect_places(recording.layout.reference)
    recording, absurd = _take_out_absurd(recording)
    seen = np.all(np.isfinite(recording.positions), axis=-1)
    frozen = frozen_markers(recording.positions, seen)
    valid = recording.valid & seen & ~frozen
    zero = (recording.positions == 0).all(axis=-1)
    blank = seen.any(axis=1) & (zero | ~seen).all(axis=1)
    timed, disordered = np.isfinite(recording.time), disordered_times(recording.time)
    if timed.sum() >= many_stamps and (timed & ~disordered).sum() == 1:
        raise ValueError(
            f"{recording.name}: the clock stands still or runs backwards, none of {timed.sum()} "
            "time stamps is after another: give the frames in order, with their times in seconds"
        )
    reasons = {
        "no time stamp": ~timed,
        "time stamp not after an earlier frame's": disordered,
        "all marker positions are zero": blank,
        "no marker was seen": ~seen.any(axis=1),
        "no marker can be used": ~valid.any(axis=1),
        "repeats the frame before": repeated_frames(recording, seen),
    }
    flaws = list(recording.flaws or ("",) * len(recording))
    for reason, where in reasons.items():
        for frame in np.flatnonzero(where):
            flaws[frame] = flaws[frame] or reason
    found = [
        *absurd,
        *_index_notes(recording),
        *_count("a marker was not seen", ~seen),
        *_count("a marker was frozen while the others moved", frozen),
        *list_flaws(Counter(flaw for flaw in flaws if flaw)),
        *_length_notes(recording, valid & ~blank[:, None]),
    ]
    notes = recording.notes + tuple(note for note in found if note not in recording.notes)
    return replace(recording, valid=valid & ~blank[:, None], flaws=tuple(flaws), notes=notes)


class LiveInspector:
    """Inspects frames as they come, knowing only the past.

    A frame is flawed that shows every marker exactly where the one before did, but for the
    reference; a marker is not valid once it is frozen (`frozen_markers`), which takes
    `FROZEN_STEPS` steps to be seen.
    """

    def __init__(self) -> None:
        """Begin with no frame."""
        self._before: Float[np.ndarray, "n d"] | None = None
        self._still = np.zeros(0, dtype=int)
        self._found: dict[str, tuple[int, Bool[np.ndarray, " n"]]] = {}

    def inspect(self, frame: Frame, reference: Float[np.ndarray, "n d"]) -> Frame:
        """The next frame, with what is found wrong with it.

        Args:
            frame: as it came.
            reference: positions of its markers at rest.
        """
        seen = np.asarray(np.isfinite(frame.positions).all(axis=-1))
        before, self._before = self._before, frame.positions
        if before is None or frame.flaw or before.shape != frame.positions.shape:
            self._still = np.zeros(len(seen), dtype=int)
            return frame
        both = seen & np.isfinite(before).all(axis=-1)
        same = both & (frame.positions == before).all(axis=-1)
        rests = ((frame.positions == reference).all(axis=-1) | ~seen).all()
        if seen.any() and np.array_equal(same, seen) and not rests:
            return replace(frame, flaw="repeats the frame before")
        if 2 * (both & ~same).sum() > both.sum():
            self._still = np.where(same, self._still + 1, 0)
        frozen = np.logical_and(seen, self._still >= FROZEN_STEPS)
        self._count("a marker was not seen", ~seen)
        self._count("a marker was frozen while the others moved", frozen)
        return replace(frame, valid=frame.valid & ~frozen) if frozen.any() else frame

    def notes(self) -> tuple[str, ...]:
        """In how many frames and for how many markers something was wrong."""
        return tuple(
            _say_count(what, int(which.sum()), frames)
            for what, (frames, which) in self._found.items()
        )

    def _count(self, what: str, where: np.ndarray) -> None:
        if where.any():
            frames, which = self._found.get(what, (0, np.zeros_like(where)))
            self._found[what] = frames + 1, which | where


def _take_out_absurd(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with NaN in place of what cannot have been measured, and notes about that."""
    changed, notes = {}, []
    for name, kind in declared_arrays(Recording).items():
        values = getattr(recording, name)
        if values is None or name == "time" or kind.dtype is not Float:
            continue
        absurd = ~(np.isnan(values) | (np.abs(values) < LARGEST))
        if absurd.any():
            changed[name] = np.where(absurd, np.nan, values)
            notes.append(f"{absurd.sum()} values of `{name}` are {LARGEST:g} or more: left out")
    if "positions" in changed:
        changed["valid"] = recording.valid & np.isfinite(changed["positions"]).all(axis=-1)
    return replace(recording, **changed), notes


def frozen_markers(
    positions: Float[np.ndarray, "frames n d"], seen: Bool[np.ndarray, "frames n"]
) -> Bool[np.ndarray, "frames n"]:
    """Markers that stay exactly where they are while more than half of the others move.

    Only steps in which the others move count, and only `FROZEN_STEPS` of them in a row. All frames
    of such a run are marked, its first included: the last frame in which the tracker was right
    cannot be told from the first in which it was not.

    Args:
        positions: marker positions [mm].
        seen: which of them are known.
    """
    frozen = np.zeros(seen.shape, dtype=bool)
    both = seen[1:] & seen[:-1]
    still = both & (positions[1:] == positions[:-1]).all(axis=-1)
    moving = np.flatnonzero(2 * (both & ~still).sum(axis=1) > both.sum(axis=1))
    for marker in np.flatnonzero(still[moving].sum(axis=0) >= FROZEN_STEPS):
        edges = np.diff(still[moving, marker].astype(int), prepend=0, append=0)
        for start, stop in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            if stop - start >= FROZEN_STEPS:
                frozen[moving[start] : moving[stop - 1] + 2, marker] = True
    return frozen & seen


def repeated_frames(
    recording: Recording, seen: Bool[np.ndarray, "frames n"]
) -> Bool[np.ndarray, " frames"]:
    """Frames that show every marker exactly where the frame before does, and not at rest."""
    positions = recording.positions
    changed = (positions[1:] != positions[:-1]).any(axis=-1) & (seen[1:] | seen[:-1])
    at_rest = ((positions == recording.layout.reference).all(axis=-1) | ~seen).all(axis=1)
    repeated = ~changed.any(axis=1) & seen[1:].any(axis=1) & ~at_rest[1:]
    return np.concatenate([[False], repeated])


def disordered_times(time: Float[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames whose time stamp is out of order: as few as possible, so that the others increase.

    One stamp far in the future therefore spoils one frame, not all that follow. Where it is all
    the same, the earlier frame is kept. Missing stamps (NaN) are not out of order.
    """
    known = np.flatnonzero(np.isfinite(time))
    run = np.zeros(len(time), dtype=int)  # frames of the longest increasing run from here on
    starts: list[float] = []  # starts[k] is minus the latest start of a run of k + 1 frames
    for frame in known[::-1]:
        start = -float(time[frame])
        place = bisect_left(starts, start)
        starts[place : place + 1] = [start]
        run[frame] = place + 1
    disordered = np.isfinite(time)
    remaining, latest = len(starts), -np.inf
    for frame in known:
        if run[frame] == remaining and time[frame] > latest:
            disordered[frame] = False
            remaining, latest = remaining - 1, time[frame]
    return disordered


def _index_notes(recording: Recording) -> list[str]:
    """What the source's frame numbers say."""
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


def _length_notes(recording: Recording, valid: Bool[np.ndarray, "frames n"]) -> list[str]:
    """Hints at a wrong unit of length, and at a z axis that points into the pad."""
    pitches = (0.05, 20.0)  # distances between markers that a tactile sensor may have [mm]
    if recording.unit != "mm":
        return []
    reference, notes = recording.layout.reference, []
    pitch = float(np.median(KDTree(reference).query(reference, 2)[0][:, 1]))
    if not pitches[0] <= pitch <= pitches[1]:
        notes.append(f"the markers lie {pitch:.2g} mm apart: are the lengths in mm?")
    if reference.shape[1] == 3 and valid.any():
        inward, outward = np.quantile((recording.positions - reference)[valid, 2], (0.01, 0.99))
        if outward > max(-inward, ONSET_MM):
            notes.append(
                f"the markers move out of the pad, by up to {outward:.2g} mm: does z point out of "
                "the elastomer?"
            )
    return notes


def _count(what: str, where: Bool[np.ndarray, "frames n"]) -> list[str]:
    """In how many frames and for how many markers something holds."""
    if not where.any():
        return []
    frames, markers = int(where.any(axis=1).sum()), int(where.any(axis=0).sum())
    return [_say_count(what, markers, frames)]


def _say_count(what: str, markers: int, frames: int) -> str:
    seen = counted(markers, "marker", "markers")
    return f"{what}: {seen}, in {counted(frames, 'frame', 'frames')}"


def list_flaws(counts: Mapping[str, int]) -> list[str]:
    """The number of frames with each flaw, in words."""
    return [f"{counted(n, 'frame', 'frames')}: {flaw}" for flaw, n in counts.items()]
