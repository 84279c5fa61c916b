"""Pace of the markers that stuck last, where macro slip is suspected.

Fits that find no body, and a law of friction that does not hold, suggest macro slip also under an
object that shifts as it turns, while a few markers beside the contact's middle still stick. These
go on with the object. Once all of the contact slips, the gel falls behind within a frame or two.
A marker counts as slipping only if it is slower than its noise explains. Where noise hides the
pace, nothing tells whether the object slips. A marker that goes on while the rest of the gel slows
down shows that the object does not rest. An outline that turns ahead of all gel in contact shows
that no marker goes on with the object, whatever its pace.

Where the object turns about the contact's middle, the fits are right, and the pace, which noise
makes slow to measure, would only delay the slip.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.measurement import Measurement
from estimation.estimators.result import (
    MOVES_ON,
    RESTS_OR_SLIDES,
    TOO_FEW_STICK,
    UNSEEN_TURN,
    State,
)
from estimation.fields.measure import Fields
from estimation.fields.outline import measure_axis, turn_error, unwrap
from estimation.fields.plane import fit_motion, in_contact_plane
from estimation.fields.stencils import Stencils
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.noise import Noise


class _Past(NamedTuple):
    """A frame: its fields, its time stamp [s], and its sticking markers; None with too few."""

    fields: Fields
    time: float
    stick: Bool[np.ndarray, " n"] | None


class _Pace(NamedTuple):
    """Velocities of some markers while they stuck, under an object that shifts."""

    stick: Bool[np.ndarray, " n"]
    over: int  # frames that show the pace of one of them; 0 if noise hides it
    velocity: Complex[np.ndarray, " m"]  # in the contact's plane [mm/s]
    error: float  # its standard error per coordinate [mm/s]


class PaceWatch:
    """Judges the frames of one method that seem to be in macro slip."""

    longest = 8  # frames over which a pace is measured, at most
    coarse = 0.15  # error of a marker's pace, over the pace, above which it is not judged [-]
    slower = 0.85  # pace over that while the markers stuck, below which they have slipped [-]
    moves = 0.5  # pace over that while the markers stuck, above which they go on [-]
    sure = 1.645  # standard errors by which a pace is clearly slower or faster (95 %, one-sided)
    beside = 0.15  # distance of the turn's axis from the middle, over the radius, that counts [-]

    def __init__(self, stencils: Stencils, noise: Noise | None, gain: float = 1.0) -> None:
        """Begin without contact; without the noise of the markers, nothing is judged.

        The gain is the rotation of the object over that of the sticking elastomer [-].
        """
        self._gain = gain
        self._stencils, self._noise = stencils, 0.0 if noise is None else noise.in_plane
        self._past: deque[_Past] = deque(maxlen=self.longest + 1)
        # of the markers that stuck last, until then; None where the pace says nothing
        self._held: _Pace | None = None

    def judge(
        self, state: State, reason: str, gel: Measurement, fields: Fields, time: float
    ) -> tuple[State, str]:
        """State and reason of a frame, given those by its sticking markers.

        Args:
            state: state of the contact.
            reason: reason for a missing angle.
            gel: rotation of the gel, with the markers that stick, or that move as one body while
                the angle is lost.
            fields: fields of the frame.
            time: time stamp [s].
        """
        if not fields.contact.any():
            self._past.clear()
            self._held = None
            return state, reason
        holds = state in (State.STICK, State.INCIPIENT) or reason == UNSEEN_TURN
        stick = gel.alike if holds and gel.alike.sum() >= MIN_STICK_MARKERS else None
        if stick is None and self._past and self._past[-1].stick is not None:
            self._held = self._find_pace(self._stuck_lately())
        self._past.append(_Past(fields, time, stick))
        held = self._held
        if held and state == State.MACRO_SLIP and not fields.closed and self._may_move_on(held):
            shown = np.isfinite(gel.angle) and self._is_overtaken()
            return (state, reason) if shown else (State.UNKNOWN, MOVES_ON)
        if held and reason == RESTS_OR_SLIDES and self._lets_go(held):
            return State.MACRO_SLIP, "" if np.isfinite(gel.angle) else TOO_FEW_STICK
        return state, reason

    def _stuck_lately(self) -> Bool[np.ndarray, " n"]:
        """Markers that stuck in any frame in memory, visible in the first and the last of them.

        The last fit before a loss may have found only some that stick, or others.
        """
        stuck = [frame.stick for frame in self._past if frame.stick is not None]
        return self._seen(np.any(stuck, axis=0), self._past[-1].fields, self._past[0].fields)

    def _shifts(self, stick: Bool[np.ndarray, " n"]) -> bool:
        """Whether the object, of which some markers stick, does not turn about the middle.

        Its motion is that of these markers over all frames in memory.
        """
        last, first = self._past[-1].fields, self._past[0].fields
        before, after = in_contact_plane(self._stencils, last, stick, first)
        motion = fit_motion(before[stick], after[stick])
        touched = before[last.contact]
        middle = touched.mean()
        radius = np.sqrt(2.0 * np.mean(np.abs(touched - middle) ** 2))
        turn = motion.turn / abs(motion.turn)
        shift = abs(motion.image + turn * (middle - motion.origin) - middle)
        return bool(shift > self.beside * radius * abs(np.angle(turn)))

    def _find_pace(self, stick: Bool[np.ndarray, " n"]) -> _Pace | None:
        """Pace of some markers, from all frames in memory; None unless the object shifts.

        The fewest frames that show it are compared with it later, since they show a slip soon.
        """
        if not self._noise or stick.sum() < MIN_STICK_MARKERS or not self._shifts(stick):
            return None
        longest = len(self._past) - 1
        velocity, error = self._measure(stick, longest), self._error(longest)
        size = float(np.median(np.abs(velocity)))
        shown = (n for n in range(2, longest + 1) if self._error(n) <= self.coarse * size)
        return _Pace(stick, next(shown, 0), velocity, error)

    def _may_move_on(self, held: _Pace) -> bool:
        """Whether three of the markers that stuck last may go on at the pace that they had then."""
        if not held.over:
            return True
        return bool(np.sum(self._keep_up(*self._compare(held, held.over))) >= MIN_STICK_MARKERS)

    def _is_overtaken(self) -> bool:
        """Whether the outline has turned ahead of the gel, in two frames: one reading may err."""
        return all(self._leads(frame.fields) for frame in list(self._past)[-2:])

    def _leads(self, last: Fields) -> bool:
        """Whether the outline has clearly turned further than the lines between neighbours.

        Three markers that stick span two lines, which turn with the object. Noise turns some lines
        further, and so hides a lead.
        """
        doubt = 3.0  # standard errors of the outline's turn
        first = self._past[0].fields
        axes = measure_axis(first), measure_axis(last)
        seen = self._seen(first.contact & last.contact, last, first)
        if seen.sum() < MIN_STICK_MARKERS or np.isnan(axes[0].angle + axes[1].angle):
            return False
        turn = unwrap(axes[1].angle, axes[0].angle) - axes[0].angle
        before, after = in_contact_plane(self._stencils, last, seen, first)
        neighbours = self._stencils.neighbours
        one, slot = np.nonzero((neighbours >= 0) & seen[:, None] & seen[neighbours])
        other = neighbours[one, slot]
        one, other = one[one < other], other[one < other]
        lines = np.angle((after[other] - after[one]) / (before[other] - before[one]))
        behind = np.sort(np.sign(turn) * (turn - self._gain * lines))
        return len(behind) > 1 and bool(behind[1] > doubt * turn_error(*axes))

    def _lets_go(self, held: _Pace) -> bool:
        """Whether one or two of these markers clearly go on, and none of the others."""
        if not held.over:
            return False
        both = self._compare(held, held.over), self._compare(held, 2)
        goes = np.all([self.moves + self.sure * error < pace for pace, error in both], axis=0)
        keeps = self._keep_up(*both[0])
        return bool(np.sum(keeps) < MIN_STICK_MARKERS and np.any(keeps & goes))

    def _keep_up(
        self, pace: Float[np.ndarray, " m"], error: Float[np.ndarray, " m"]
    ) -> Bool[np.ndarray, " m"]:
        """Whether markers are not clearly slower than while they stuck, or not visible."""
        return ~(pace < np.minimum(self.slower, 1.0 - self.sure * error))

    def _compare(
        self, held: _Pace, over: int
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Pace of the markers that stuck last over that until then, and its standard error [-]."""
        before = held.velocity
        along = np.real(np.conj(before) * self._measure(held.stick, over))
        error = np.hypot(self._error(over), held.error)
        return along / np.abs(before) ** 2, error / np.abs(before)

    def _error(self, over: int) -> float:
        """Standard error of a velocity over the last frames, per coordinate [mm/s]."""
        time = self._past[-1].time - self._past[-1 - over].time
        return float(np.sqrt(2.0) * self._noise / max(time, 1e-9))

    def _measure(self, stick: Bool[np.ndarray, " n"], over: int) -> Complex[np.ndarray, " m"]:
        """Velocity of some markers in the contact's plane, over the last frames [mm/s]."""
        last, first = self._past[-1], self._past[-1 - over]
        seen = self._seen(stick, last.fields, first.fields)
        if not seen.any():
            return np.full(int(stick.sum()), np.nan * 1j)
        before, after = in_contact_plane(self._stencils, last.fields, seen, first.fields)
        return (after - before)[stick] / max(last.time - first.time, 1e-9)

    def _seen(
        self, markers: Bool[np.ndarray, " n"], last: Fields, first: Fields
    ) -> Bool[np.ndarray, " n"]:
        """Those of some markers that are visible in both frames."""
        known = last.positions + first.positions
        if not self._stencils.flat:
            known = known + last.normals + first.normals
        return markers & np.isfinite(known).all(axis=1)
