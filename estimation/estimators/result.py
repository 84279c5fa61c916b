"""Results of an estimator: state of the contact and angle of the object in each frame."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.frames.recording import UNHELD_FLAWS

TOO_FEW_STICK = "too few markers stick"
"""Reason for a missing angle: fewer markers stick than a rotation requires."""
UNSEEN_TURN = "holds again after an unobserved rotation"
"""Reason for a withdrawn or missing angle: the object may have turned while it slid."""
RESTS_OR_SLIDES = "the gel rests with few markers sticking: the object may rest or slide"
"""Reason for an uncertain angle: with so few sticking markers, a slide cannot be excluded."""

MOVES_ON = "markers that stuck may move on: the object may hold or slip"
"""Reason for an unknown state: too few move as one body, but they go on, or noise hides it."""


def may_slip(reason: str) -> bool:
    """Whether the object holds by few markers or slips, and the data do not tell which."""
    return reason in (RESTS_OR_SLIDES, MOVES_ON)


class State(StrEnum):
    """State of the contact in a frame.

    - `no_contact`: the stick centre has moved by less than the onset.
    - `stick`: at least the share `stick_share` of the contact region's markers stick.
    - `incipient`: fewer markers stick, but at least three; with a print in view also fewer, as
      long as it shows no slip of the whole contact.
    - `macro_slip`: fewer than three markers stick. On virtual pivots it is mostly detected within
      two frames; `estimation.slip.lookback` dates it afterwards. Once the gel rests, without a
      print or an outline that turns, the state is `unknown`: the object may slide or rest.
    - `unknown`: the frame cannot be used, or the markers that seem to stick do not move as one
      rigid body. The reason distinguishes the two.

    If pictures show the object's print on the gel, the print decides (`estimation.slip.shear`):
    `stick` if nine tenths of it have stayed on the gel lately, `macro_slip` if it moves over the
    gel in shear, twist or both, and at most `incipient` otherwise.

    Examples:
        >>> from estimation import State, estimate_angles, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> states = estimate_angles(recording).state
        >>> print(*dict.fromkeys(states), State.MACRO_SLIP in states)
        no_contact stick incipient False
    """

    NO_CONTACT = "no_contact"
    STICK = "stick"
    INCIPIENT = "incipient"
    MACRO_SLIP = "macro_slip"
    UNKNOWN = "unknown"


def show_plain(values: Iterable[Any]) -> list[str]:
    """Table cells of whole numbers or words."""
    return [str(value) for value in values]


def show_numbers(values: Iterable[float]) -> list[str]:
    """Table cells of numbers with six decimals; 0 has no sign."""
    return [f"{value:z.6f}" for value in np.asarray(values).tolist()]


def show_degrees(values: Iterable[float]) -> list[str]:
    """Table cells in degrees of angles in rad."""
    return show_numbers(np.degrees(np.asarray(values)))


class Column(NamedTuple):
    """How tables show a quantity of each frame.

    Attributes:
        name: name of its column, with the unit; empty if it has no column.
        show: formats its values as table cells.
        answer: whether it is withdrawn with the frame's answer.
    """

    name: str = ""
    show: Callable[[Iterable[Any]], list[str]] = show_plain
    answer: bool = False


def per_frame(
    name: str = "", show: Callable[[Iterable[Any]], list[str]] = show_plain, *, answer: bool = False
) -> dict[str, Column]:
    """Metadata of a dataclass field with a value in each frame; the arguments of `Column`."""
    return {"column": Column(name, show, answer)}


Number = TypeVar("Number")
Whole = TypeVar("Whole")
Flag = TypeVar("Flag")
Label = TypeVar("Label")
Text = TypeVar("Text")
Values = TypeVar("Values")
Mask = TypeVar("Mask")
Kept = TypeVar("Kept", bound="Track")


@dataclass(frozen=True, kw_only=True)
class Record(Generic[Number, Whole, Flag, Label, Text]):
    """Quantities of one frame, or of several.

    This is their only declaration: batches, tables, the record of a stream and withdrawn answers
    follow from it. Values are those of one frame in an `Estimate`, and arrays or tuples over frames
    in a `Track`.

    Attributes:
        time: time stamp [s].
        source_index: number of the frame in its source.
        state: state of the contact.
        reason: reason for a missing or uncertain angle; mostly empty.
        angle: the object's angle [rad, counter-clockwise]; NaN if unknown.
        low: lower end of its 95 % interval [rad].
        high: upper end of its 95 % interval [rad].
        since: time stamp of the frame that the angle counts from [s]: the last frame without
            contact, or the frame in which the count restarted. NaN in a recording that starts in
            contact, whose angles count from the unloaded shape.
        restarts: number of restarts of the angle's count since the object touched.
        stick_markers: number of markers that stick.
        contact_markers: number of markers in the contact region.
        contact_radius: radius of a disc as large as the contact [mm], from the fitted edge
            (`estimation.fields.edge`); NaN if no edge fits.
        gel_thinness: a/(a + h) of the contact's radius a and the gel's thickness h, from the same
            fit [-].
        flat_share: radius of the flat part of the object's face over that of the contact, from the
            same fit [-].
        elongation: long over short axis of the contact's outline, from the same fit [-].
        disc_ratio: radius of the disc that sticks over that of the contact, c/a, by the law of
            friction [-]; NaN if it does not explain the frame.
        disc_error: its standard error [-].
        disc_twist: rotation at which the contact holds this disc on first loading [rad].
        moment: moment about the contact normal [N·mm]; NaN if unknown.
        centre_moment: moment about the contact's centre [N·mm]; NaN unless the forces are known.
        shear_moment_x: shear force along x times the arm of the contact's friction [N·mm].
        shear_moment_y: the same along y [N·mm].
        gel_moment: the moment from the markers, up to a factor, as the turn of a large disc that
            would take it [rad] (`estimation.slip.gel_moment`); NaN if unknown.
        gel_low: φ of the gel that has turned furthest clockwise since the frame that the angle
            counts from [rad]; NaN with too few markers.
        gel_high: φ of the gel that has turned furthest counter-clockwise [rad].
        stiffness_ratio: k of the angle's softness correction [-].
        load_term: L of the angle's softness correction [rad].
        covered: whether the softness is valid for this contact.
    """

    time: Number = field(metadata=per_frame("time_s", show_numbers))
    source_index: Whole = field(metadata=per_frame("source_index"))
    state: Label = field(metadata=per_frame("state", answer=True))
    reason: Text = field(metadata=per_frame("reason"))
    angle: Number = field(metadata=per_frame("angle_deg", show_degrees, answer=True))
    low: Number = field(metadata=per_frame("angle_low_deg", show_degrees, answer=True))
    high: Number = field(metadata=per_frame("angle_high_deg", show_degrees, answer=True))
    since: Number = field(metadata=per_frame("since_s", show_numbers))
    restarts: Whole = field(metadata=per_frame("restarts"))
    stick_markers: Whole = field(metadata=per_frame("stick_markers", answer=True))
    contact_markers: Whole = field(metadata=per_frame("contact_markers"))
    contact_radius: Number = field(metadata=per_frame("contact_radius_mm", show_numbers))
    gel_thinness: Number = field(metadata=per_frame())
    flat_share: Number = field(metadata=per_frame())
    elongation: Number = field(metadata=per_frame())
    disc_ratio: Number = field(metadata=per_frame())
    disc_error: Number = field(metadata=per_frame())
    disc_twist: Number = field(metadata=per_frame())
    moment: Number = field(metadata=per_frame("moment_Nmm", show_numbers))
    centre_moment: Number = field(metadata=per_frame())
    shear_moment_x: Number = field(metadata=per_frame())
    shear_moment_y: Number = field(metadata=per_frame())
    gel_moment: Number = field(metadata=per_frame("gel_moment_deg", show_degrees))
    gel_low: Number = field(metadata=per_frame())
    gel_high: Number = field(metadata=per_frame())
    stiffness_ratio: Number = field(metadata=per_frame())
    load_term: Number = field(metadata=per_frame())
    covered: Flag = field(metadata=per_frame())

    @classmethod
    def columns(cls) -> dict[str, Column]:
        """The quantities that have a value in each frame, by name."""
        return {
            item.name: item.metadata["column"] for item in fields(cls) if "column" in item.metadata
        }

    def quantities(self) -> dict[str, Any]:
        """The values of the quantities that have a value in each frame, by name."""
        return {name: getattr(self, name) for name in self.columns()}


@dataclass(frozen=True, kw_only=True, repr=False)
class Markers(Generic[Values, Mask]):
    """Quantities of each marker; a long stream does not keep them.

    Attributes:
        stick: markers that stick.
        contact: markers of the contact region.
        rotation: φ of each marker [rad]; NaN where unknown.
    """

    stick: Mask = field(metadata=per_frame(answer=True))
    contact: Mask = field(metadata=per_frame())
    rotation: Values = field(metadata=per_frame())


@dataclass(frozen=True, kw_only=True)
class Estimate(
    Markers[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]], Record[float, int, bool, State, str]
):
    """The estimate for a frame: state, angle with its interval, markers.

    `Record` and `Markers` describe the attributes.

    Examples:
        >>> import numpy as np
        >>> from estimation import Tracker, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> tracker = Tracker(recording.layout)
        >>> first, *_, last = [tracker.update(frame) for frame in recording]
        >>> print(first.state, first.reason)
        no_contact no contact: moved by less than 0.1 mm
        >>> print(f"{last.state} {np.degrees(last.angle):.1f}°, {last.stick_markers} markers stick")
        incipient 10.0°, 13 markers stick
    """


_OverFrames = Record[
    Float[np.ndarray, " frames"],
    Int[np.ndarray, " frames"],
    Bool[np.ndarray, " frames"],
    tuple[Any, ...],
    tuple[str, ...],
]


@dataclass(frozen=True, kw_only=True)
class Withdrawn(_OverFrames):
    """Answers given frame by frame and withdrawn once the whole recording was known.

    Frames without a withdrawn answer have state None, NaN for numbers, and no sticking markers.
    """

    @property
    def rows(self) -> Bool[np.ndarray, " frames"]:
        """Frames whose answer was withdrawn."""
        return np.isfinite(self.angle)


@dataclass(frozen=True, kw_only=True, repr=False)
class Track(_OverFrames):
    """Estimates of a recording or stream, without single markers; see `Record` for quantities.

    Attributes:
        method: name of the estimator.
        notes: notes about the angles, in sentences.
        withdrawn: answers withdrawn in view of the whole recording; None before that check
            (`estimation.slip.lookback`).

    Raises:
        ValueError: the quantities differ in their number of frames.

    Examples:
        >>> import numpy as np
        >>> from estimation import estimate_angles, simulate_pivot
        >>> track = estimate_angles(simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))[0])
        >>> print(f"{track.answered.sum()} of {len(track.angle)} frames have an angle")
        33 of 43 frames have an angle
        >>> print(np.degrees(track.take(slice(-3, None)).angle).round(1))  # in the last three, in °
        [ 9.   9.5 10. ]
    """

    method: str
    notes: tuple[str, ...] = ()
    withdrawn: Withdrawn | None = None

    def __post_init__(self) -> None:
        """Check that all quantities have the same number of frames."""
        for name, values in self.quantities().items():
            if len(values) != len(self.time):
                raise ValueError(f"`{name}` has {len(values)} frames, `time` {len(self.time)}")

    def __repr__(self) -> str:
        """The method, and how many frames have an angle."""
        some, all_frames = self.answered.sum(), len(self.time)
        return f"{type(self).__name__}({self.method}: {some} of {all_frames} frames have an angle)"

    @classmethod
    def gather(
        cls: type[Kept], method: str, estimates: Sequence[Estimate], notes: tuple[str, ...] = ()
    ) -> Kept:
        """Join the estimates of a recording's frames, at least one."""
        columns = {name: [getattr(item, name) for item in estimates] for name in cls.columns()}
        batch: dict[str, Any] = {
            name: tuple(values) if isinstance(values[0], str) else np.array(values)
            for name, values in columns.items()
        }
        return cls(method=method, notes=notes, **batch)

    def take(self: Kept, rows: slice | Int[np.ndarray, " rows"]) -> Kept:
        """The result for some of the frames, given as a slice or by their rows."""
        withdrawn = self.withdrawn
        if withdrawn is not None:
            withdrawn = replace(withdrawn, **_take(withdrawn, rows))
        return replace(self, withdrawn=withdrawn, **_take(self, rows))

    @property
    def answered(self) -> Bool[np.ndarray, " frames"]:
        """Frames that have an angle."""
        return np.isfinite(self.angle)

    @property
    def slipping(self) -> Bool[np.ndarray, " frames"]:
        """Frames in macro slip."""
        return np.array([state == State.MACRO_SLIP for state in self.state], dtype=bool)

    @property
    def free(self) -> Bool[np.ndarray, " frames"]:
        """Frames between two contacts: nothing touches, or nothing that the gel holds."""
        reasons = zip(self.state, self.reason, strict=True)
        return np.array([s == State.NO_CONTACT or why in UNHELD_FLAWS for s, why in reasons], bool)

    @property
    def contacts(self) -> Int[np.ndarray, " frames"]:
        """Number of the contact that a frame belongs to, the last one where nothing touches."""
        touches = ~self.free
        begins = touches & ~np.concatenate([[False], touches[:-1]])
        return np.cumsum(begins)

    def with_one_start(self: Kept, weighty: Bool[np.ndarray, " frames"]) -> tuple[Kept, int]:
        """The track with the angles that count from one start in each contact.

        Returns:
            The track with the start of most angles, and the number of the angles left out.

        Args:
            weighty: frames that count twice in the choice.
        """
        weight = np.where(self.answered, 1.0 + weighty, 0.0)
        contacts = self.contacts
        lost = np.zeros(len(self.time), dtype=bool)
        for contact in np.unique(contacts):
            rows = contacts == contact
            most = np.argmax(np.bincount(self.restarts[rows], weight[rows]))
            lost |= rows & self.answered & (self.restarts != most)
        return replace(self, **self.without(lost)), int(lost.sum())

    def without(self, rows: Bool[np.ndarray, " frames"]) -> dict[str, Any]:
        """The quantities of an answer, by name, blank in the given frames."""
        return {
            name: _blank(getattr(self, name), rows)
            for name, column in self.columns().items()
            if column.answer
        }


@dataclass(frozen=True, kw_only=True, repr=False)
class Result(Markers[Float[np.ndarray, "frames n"], Bool[np.ndarray, "frames n"]], Track):
    """Estimates of a recording, one per frame, with the state of each marker.

    Examples:
        >>> from estimation import estimate_angles, simulate_pivot
        >>> recording, truth = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> result = estimate_angles(recording)
        >>> result.stick.shape  # frames and markers
        (43, 400)
        >>> wrong = result.stick[-1] & ~truth.stick[-1]
        >>> print(f"{result.stick[-1].sum()} markers stick at the end, {wrong.sum()} wrongly")
        13 markers stick at the end, 0 wrongly
    """


def _take(record: Track | Withdrawn, rows: slice | Int[np.ndarray, " rows"]) -> dict[str, Any]:
    return {name: take_rows(values, rows) for name, values in record.quantities().items()}


def take_rows(values: Any, rows: slice | Int[np.ndarray, " rows"]) -> Any:
    """Some of the values over frames, an array or a tuple."""
    if isinstance(values, tuple) and not isinstance(rows, slice):
        return tuple(values[row] for row in rows)
    return values[rows]


def _blank(values: Any, rows: Bool[np.ndarray, " frames"]) -> Any:
    """Values over frames, with None, NaN, False or 0 in the given rows."""
    if isinstance(values, tuple):
        return tuple(None if blank else value for value, blank in zip(values, rows, strict=True))
    blank = values.copy()
    blank[rows] = np.nan if values.dtype.kind == "f" else 0
    return blank
