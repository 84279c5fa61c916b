"""What an estimator found: per frame the state of the contact and the object's angle."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

TOO_FEW_STICK = "too few markers stick"
UNSEEN_TURN = "holds again, but how far the object turned before is unseen"
"""Reasons why an angle is missing that more than one place gives."""


class State(StrEnum):
    """State of the contact in a frame.

    `no_contact`: the stick centre has moved by less than the onset. `stick`: at least the share
    `stick_share` of the contact region's markers stick. `incipient`: fewer, but at least three.
    `macro_slip`: fewer than three; frame by frame it is seen some frames late (3 in the median of
    round virtual pivots, up to 9 in 95 %), since the last markers slip alike, and only
    `estimation.lookback` dates it, looking back. `unknown`: the frame cannot be
    used, or what seems to stick moves as no one body; the reason says which.
    """

    NO_CONTACT = "no_contact"
    STICK = "stick"
    INCIPIENT = "incipient"
    MACRO_SLIP = "macro_slip"
    UNKNOWN = "unknown"


class Estimate(NamedTuple):
    """What is known after a frame.

    Attributes:
        time: time stamp [s].
        source_index: number the source gave the frame.
        state: state of the contact.
        reason: why there is no angle, or what speaks against the one there is; mostly empty.
        angle: the object's angle [rad, counter-clockwise]; NaN where unknown.
        low: lower end of its 95 % interval [rad].
        high: upper end of its 95 % interval [rad].
        moment: moment about the contact normal [N·mm]; NaN where unknown.
        rotation: φ of each marker [rad]; NaN where unknown.
        contact: markers of the contact region.
        stick: markers that stick.
        stiffness_ratio: k that the angle was corrected with [-].
        load_term: L that it was corrected with [rad].
        covered: whether the softness holds for a contact like this one.
    """

    time: float
    source_index: int
    state: State
    reason: str
    angle: float
    low: float
    high: float
    moment: float
    rotation: Float[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    stick: Bool[np.ndarray, " n"]
    stiffness_ratio: float = 0.0
    load_term: float = 0.0
    covered: bool = True


class Withdrawn(NamedTuple):
    """Answers that were given frame by frame and withdrawn once the whole recording was known.

    Attributes:
        state: state that was given; None in frames in which nothing was withdrawn.
        angle: the object's angle that was given [rad]; NaN where nothing was withdrawn.
        low: lower end of its 95 % interval [rad].
        high: upper end [rad].
        stick: markers that seemed to stick; none where nothing was withdrawn.
    """

    state: tuple[State | None, ...]
    angle: Float[np.ndarray, " frames"]
    low: Float[np.ndarray, " frames"]
    high: Float[np.ndarray, " frames"]
    stick: Bool[np.ndarray, "frames n"]

    @property
    def rows(self) -> Bool[np.ndarray, " frames"]:
        """Frames whose answer was withdrawn."""
        return np.isfinite(self.angle)


@dataclass(frozen=True)
class Result:
    """Estimates of a recording, one per frame.

    Attributes:
        method: name of the estimator.
        time: time stamps [s].
        source_index: number the source gave each frame.
        state: state of the contact.
        reason: why there is no angle, or what speaks against the one there is; mostly empty.
        angle: the object's angle [rad, counter-clockwise]; NaN where unknown.
        low: lower ends of the 95 % intervals [rad].
        high: upper ends of the 95 % intervals [rad].
        moment: moment about the contact normal [N·mm]; NaN where unknown.
        rotation: φ of each marker [rad]; NaN where unknown.
        contact: markers of the contact region.
        stick: markers that stick.
        stiffness_ratio: k that each angle was corrected with [-].
        load_term: L that it was corrected with [rad].
        covered: frames for which the softness holds.
        notes: what a reader of the angles should know, in sentences.
        withdrawn: answers that the whole recording speaks against (`estimation.lookback`); None
            where it was not asked.
    """

    method: str
    time: Float[np.ndarray, " frames"]
    source_index: Int[np.ndarray, " frames"]
    state: tuple[State, ...]
    reason: tuple[str, ...]
    angle: Float[np.ndarray, " frames"]
    low: Float[np.ndarray, " frames"]
    high: Float[np.ndarray, " frames"]
    moment: Float[np.ndarray, " frames"]
    rotation: Float[np.ndarray, "frames n"]
    contact: Bool[np.ndarray, "frames n"]
    stick: Bool[np.ndarray, "frames n"]
    stiffness_ratio: Float[np.ndarray, " frames"]
    load_term: Float[np.ndarray, " frames"]
    covered: Bool[np.ndarray, " frames"]
    notes: tuple[str, ...] = ()
    withdrawn: Withdrawn | None = None

    @classmethod
    def gather(
        cls, method: str, estimates: Sequence[Estimate], notes: tuple[str, ...] = ()
    ) -> "Result":
        """Put together the estimates of one recording, at least one."""
        return cls(
            method=method,
            notes=notes,
            withdrawn=None,
            state=tuple(estimate.state for estimate in estimates),
            reason=tuple(estimate.reason for estimate in estimates),
            **{
                name: np.array([getattr(estimate, name) for estimate in estimates])
                for name in Estimate._fields
                if name not in ("state", "reason")
            },
        )

    @property
    def answered(self) -> Bool[np.ndarray, " frames"]:
        """Frames that have an angle."""
        return np.isfinite(self.angle)
