"""The results of a run over a recording or stream, assembled from the record of its frames."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.estimators.result import State, Track
from estimation.output.record import KeptMarkers, RecordReader
from estimation.slip.alert import GripPath
from estimation.slip.branch import Branch
from estimation.slip.lookback import backdate, date_doubts, withdraw
from estimation.slip.margin import MarginPath, follow_margin
from estimation.slip.motion import describe_counts
from estimation.slip.onset import MacroSlip, describe_slips
from estimation.slip.outcome import Outcome, conclude
from estimation.slip.shear import ShearPath


class KnownTruth(NamedTuple):
    """The truth of a virtual recording.

    Attributes:
        angle: angle of the object [rad, counter-clockwise]; NaN before it touched.
        stick_markers: number of markers that have stuck ever since full load.
    """

    angle: Float[np.ndarray, " frames"]
    stick_markers: Int[np.ndarray, " frames"]


class Tracks(Mapping[str, Track]):
    """Answers by method, read on demand; only the chosen method's answers stay in memory."""

    def __init__(self, methods: Sequence[str], main: Track, make: Callable[[str], Track]) -> None:
        """Keep the answers of the chosen method, the first; others are made when needed."""
        self._methods, self._main, self._make = tuple(methods), main, make

    def __getitem__(self, method: str) -> Track:
        """The answers of a method."""
        if method == self._methods[0]:
            return self._main
        if method not in self._methods:
            raise KeyError(method)
        return self._make(method)

    def __iter__(self) -> Iterator[str]:
        """The methods, the chosen one first."""
        return iter(self._methods)

    def __len__(self) -> int:
        """The number of methods."""
        return len(self._methods)


@dataclass(frozen=True)
class Run:
    """The results of a run over a recording or stream."""

    name: str  # name of the recording
    source: str  # origin of its frames
    convention: str  # directions of its axes
    unit: str  # unit of lengths, mm or px
    reference: Float[np.ndarray, "n d"]  # unloaded positions of its markers [unit]
    settings: Mapping[str, Any]  # settings of the run, for the summary
    sha256: str  # hash of the inputs of the angles
    notes: Sequence[str]  # notes about the angles, in sentences
    # tracks by method, all over the same frames, the chosen method first
    results: Mapping[str, Track]
    method: str  # the chosen method
    # direction of the contact's long axis, or rotation of the imprint [rad]
    outline: Float[np.ndarray, " frames"]
    imprint: Float[np.ndarray, " frames"]  # rotation of the imprint [rad]; NaN where unknown
    # returns the stored markers, of some or all frames
    markers: Callable[[], Iterator[KeptMarkers]]
    truth: KnownTruth | None = None  # truth of a virtual recording; otherwise None
    slips: Sequence[MacroSlip] = ()  # macro slips, by the whole recording
    # angle and moment that remain before macro slip, by the chosen method
    margin: MarginPath = field(default_factory=MarginPath.of)
    # shear of the gel and slip of the object along it, in each frame
    shears: ShearPath = field(default_factory=ShearPath.of)
    grips: GripPath = field(default_factory=GripPath.of)  # friction and alerts, in each frame
    unfinished: str = ""  # how many frames were done so far, in a sentence; empty if all were

    @property
    def outcome(self) -> Outcome:
        """Whether the object was held to the end, or slipped."""
        return conclude(self.shears, self.main)

    @property
    def turns(self) -> str:
        """The object of which `outline` is the direction."""
        return "imprint" if np.isfinite(self.imprint).any() else "contact outline"

    @property
    def main(self) -> Track:
        """The answers of the chosen method."""
        return self.results[self.method]


def find_in_record(record: RecordReader) -> Run:
    """The results of a record, in view of all its frames.

    Raises:
        ValueError: the record has no frames, or is damaged.
    """
    if not len(record):
        raise ValueError(f"{record.path} has no frames")
    about = record.about
    methods, imprint = about["methods"], record.column("imprint")
    outline = imprint if np.isfinite(imprint).any() else record.column("axis")
    live, shears = record.track(methods[0]), record.shears()
    slips = date_doubts(live, record.sights()) if about["looks_back"] else []

    def look_back(track: Track) -> Track:
        keep = about["settings"]["keep_withdrawn"]
        track = track if keep else backdate(track, shears)
        # only methods that follow the object can have lost it
        if track.method not in ("tracked", "incremental"):
            return track
        return withdraw(track, slips, outline, keep=keep)

    main = look_back(live)
    results = Tracks(methods, main, lambda method: look_back(record.track(method)))
    margin, branch = record.margins(), about["branch"]
    changed = ~np.isclose(main.angle, live.angle, equal_nan=True)
    if changed.any():
        margin = follow_margin(main, known=margin, changed=changed)
    else:
        margin = margin._replace(last=None if branch is None else Branch.read(branch))
    notes = [*about["warnings"], *about["source_notes"], *about["notes"]]
    unfinished = _describe_progress(about, len(record))
    notes += [*filter(None, [unfinished]), *_clock_notes(main), *_reference_notes(main)]
    notes += [*describe_counts(main), *describe_softness(main, imprint)]
    notes += describe_slips(slips, main.time[0])
    truth = about.get("truth")
    rows = slice(len(main.time))
    return Run(
        name=about["name"],
        source=about["source"],
        convention=about["convention"],
        unit=about["unit"],
        reference=np.array(about["reference"]),
        settings=about["settings"],
        sha256=about["sha256"],
        notes=notes,
        results=results,
        method=methods[0],
        outline=outline,
        imprint=imprint,
        markers=record.markers,
        truth=None if truth is None else KnownTruth(*(np.array(values)[rows] for values in truth)),
        slips=slips,
        margin=margin,
        shears=shears,
        grips=record.grips(),
        unfinished=unfinished,
    )


def _describe_progress(about: Mapping[str, Any], frames: int) -> str:
    """How many frames were done of a run that is going on or was interrupted; else empty."""
    if about["complete"]:
        return ""
    done = f"{frames} of {about['total']}" if about["total"] else str(frames)
    resumed = " The same command with --resume continues." if about.get("resumes", True) else ""
    return f"Interrupted: {done} frames were done.{resumed}"


def _clock_notes(track: Track) -> tuple[str, ...]:
    """The time stamp of the first frame, unless it is 0."""
    if not abs(track.time[0]) > 0.0:
        return ()
    return (
        f"Times in this report count from the first frame, whose time_s is {track.time[0]:.3f} s.",
    )


def _reference_notes(track: Track) -> tuple[str, ...]:
    """The shape or frame that the angles are relative to."""
    states = [state for state in track.state if state != State.UNKNOWN]
    if not states:
        return ("No frame of this recording can be used.",)
    if all(state == State.NO_CONTACT for state in states):
        return (f"There is no contact in the {len(states)} usable frames of {len(track.state)}.",)
    if loaded := describe_loaded_start(track):
        return (loaded,)
    return ("Angles are relative to the unloaded reference shape, from the onset of contact on.",)


def describe_loaded_start(track: Track) -> str:
    """The zero of the angles if a recording starts in contact, in a sentence; else empty."""
    usable = [i for i, state in enumerate(track.state) if state != State.UNKNOWN]
    if not usable or track.state[usable[0]] == State.NO_CONTACT:
        return ""
    start = "There is contact from the first usable frame on"
    if track.restarts[usable[0]]:
        return (
            start + ", and the object's earlier rotation is unknown: all angles are measured "
            "from the first usable frame."
        )
    return (
        start + ", and its markers have turned as one body since the gel was unloaded: angles "
        "are relative to the reference (the gel's unloaded shape, recorded or estimated), not "
        "to the first usable frame, and exclude rotation before the object stuck."
    )


def choose_notes(run: Run) -> list[str]:
    """The notes that also belong beside the printed answer."""
    main, last = run.main, run.main.reason[-1]
    notes = [describe_loaded_start(main), describe_printed(main, run.imprint)]
    if not main.contact_markers[-1] and f"1 frame: {last}" in run.notes:
        notes.append(f"last frame: {last}")  # a source that ends early says why in a last frame
    return list(filter(None, notes))


def describe_softness(track: Track, imprint: Float[np.ndarray, " frames"]) -> Iterator[str]:
    """Notes on angles outside the range of the softness, and on those that do not need it."""
    answers = int(track.answered.sum())
    printed = find_printed(track, imprint)
    if note := describe_printed(track, imprint):
        yield note
    if beyond := int((track.answered & ~track.covered & ~printed).sum()):
        yield (
            f"{beyond} of {answers} angles come from contacts unlike those in the softness "
            "measurement (larger rotation, other force or other size), or wider than 0.45 of the "
            "object's radius: these angles and their intervals are extrapolated."
        )


def find_printed(
    track: Track, imprint: Float[np.ndarray, " frames"]
) -> Bool[np.ndarray, " frames"]:
    """Frames whose angle is the print's, which shows the object itself, so that k is not needed."""
    return track.answered & np.isfinite(imprint) & (track.method == "tracked")


def describe_printed(track: Track, imprint: Float[np.ndarray, " frames"]) -> str:
    """For a soft object, how many angles are the print's and not scaled by k, in a sentence."""
    printed = int((find_printed(track, imprint) & (track.stiffness_ratio > 0.0)).sum())
    if not printed:
        return ""
    return (
        f"{printed} of {int(track.answered.sum())} angles come from the object's print, which "
        "shows its own rotation: k does not scale them."
    )
