"""Onset of macro slip, from the disc of markers that still stick as it closes.

Whether the last markers still move alike shows only after some frames. Here the disc
(`estimation.slip.disc`) is followed over windows of frames. A line through the last of them shows
live that it has closed; looking back, the onset is dated with frames after the event. The moment is
unsuitable: at c/a = 0.2 it grows with 1 % of its first slope (c³/a³), long before and after the
onset.

Contacts that are not round close in other shapes, and real gels creep. If the motion of the markers
differs from that of a disc by more than twice their noise, no onset is reported.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from estimation.estimators.measurement import Z95
from estimation.fields.plane import fit_motion
from estimation.fields.stencils import marker_pitch
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout
from estimation.slip.disc import (
    Disc,
    DiscFit,
    SlipSettings,
    Thickness,
    describe_disc,
    fit_disc,
    has_paused,
    is_still,
    learn_thickness,
    turn_along,
)


class MacroSlip(NamedTuple):
    """A certain or possible macro slip: fewer than three markers stick.

    Attributes:
        onset: time of its onset, or at which the gel came to rest [s].
        low: lower end of its 95 % interval [s].
        high: upper end of its 95 % interval [s]; for a possible slip, the last time at which the
            gel rested.
        regained: time at which markers stuck again [s]; NaN if they did not.
        certain: whether the stick disc closed. Otherwise the gel came to rest while few markers
            stuck, and the object may rest with it or slide on.
    """

    onset: float
    low: float
    high: float
    regained: float = float("nan")
    certain: bool = True

    @property
    def ended(self) -> bool:
        """Whether markers stuck again."""
        return bool(np.isfinite(self.regained))


class Sight(NamedTuple):
    """Evidence of slip in the motion over the window that ends with a frame.

    Attributes:
        disc: the stick disc; None if the motion is not that of a disc.
        rests: whether the contact's markers have hardly moved.
        closed: whether the disc has closed: fewer than three markers stick; None if unknown.
        grips: whether the inner half of the contact has turned as one body in the last frames.
        still: whether the contact's markers have hardly moved in the last frames.
        paused: whether they have stopped in the last frame.
    """

    disc: Disc | None = None
    rests: bool = False
    closed: bool | None = None
    grips: bool = False
    still: bool = False
    paused: bool = False


class SightPath(NamedTuple):
    """Sights of a recording, over frames: the fields of `Disc`, NaN without one, and `rests`."""

    time: Float[np.ndarray, " frames"]
    margin: Float[np.ndarray, " frames"]
    error: Float[np.ndarray, " frames"]
    misfit: Float[np.ndarray, " frames"]
    rests: Bool[np.ndarray, " frames"]

    @classmethod
    def of(cls, *frames: Sight) -> "SightPath":
        """Gather the sight of each frame."""
        discs = np.array([sight.disc or Disc() for sight in frames], dtype=float)
        rests = np.array([sight.rests for sight in frames], dtype=bool)
        return cls(*discs.reshape(-1, len(Disc._fields)).T, rests=rests)


def date_slips(sights: SightPath, settings: SlipSettings = SlipSettings()) -> list[MacroSlip]:
    """The certain macro slips of a recording, dated by its discs."""
    slips: list[MacroSlip] = []
    discs = np.column_stack(sights[:3])[sights.misfit <= settings.round_misfit]
    time, margin, _ = discs.T
    closed, open_again = _begins_to(margin < 0.0), _begins_to(margin > settings.regained)
    row = 0
    for begin in closed:
        if begin < row:
            continue
        around = slice(max(begin - settings.around, 0), begin + settings.around + 1)
        slip = _date(discs[around], time[begin], settings)
        if slip is None:
            continue
        after = np.searchsorted(open_again, begin)  # the disc is closed at `begin` itself
        row = open_again[after] if after < len(open_again) else len(discs)
        slips.append(slip._replace(regained=float(time[row])) if row < len(discs) else slip)
    return slips


def _begins_to(flags: Bool[np.ndarray, " discs"]) -> Int[np.ndarray, " rows"]:
    """Rows from which at least three quarters of two to four flags are True, the first included."""
    rows = np.arange(len(flags))
    stop = np.minimum(rows + 4, len(flags))
    total = np.r_[0, np.cumsum(flags)]
    enough = total[stop] - total[rows] >= 0.75 * (stop - rows)
    return rows[flags & enough & (stop - rows > 1)]


def describe_slips(slips: Sequence[MacroSlip], start: float) -> tuple[str, ...]:
    """A sentence about each slip, in seconds since the first frame, whose time is `start` [s]."""
    return tuple(_describe(slip, start) for slip in slips)


def _describe(slip: MacroSlip, start: float) -> str:
    if not slip.certain:
        return (
            f"From {slip.onset - start:.3f} to {slip.high - start:.3f} s after the first frame the "
            "gel rests, after few markers stuck: the object may have rested with it or slid on."
        )
    return (
        f"Macro slip began at {slip.onset - start:.3f} s "
        f"(95 %: {slip.low - start:.3f} to {slip.high - start:.3f} s), counted from the first frame"
        + (f", and markers stuck again at {slip.regained - start:.3f} s." if slip.ended else ".")
    )


class _Markers(NamedTuple):
    """Markers of one frame.

    Attributes:
        points: positions x + iy [pitches].
        contact: markers of the contact region.
        time: time stamp [s].
    """

    points: Complex[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    time: float


class SlipWatch:
    """Follows the stick disc frame by frame, over all windows whose motion shows one."""

    def __init__(
        self, layout: MarkerLayout, noise: Noise, settings: SlipSettings = SlipSettings()
    ) -> None:
        """Begin without any frame.

        Args:
            layout: the markers of the sensor.
            noise: noise of the markers.
            settings: how the disc is followed.
        """
        self._pitch = marker_pitch(layout)
        self._scale = float(np.sqrt(2.0) * noise.in_plane) / self._pitch
        self._settings = settings
        self._window: deque[_Markers] = deque(maxlen=settings.window + 1)
        # time, margin, error and turn per second of each
        self._discs: deque[tuple[float, ...]] = deque(maxlen=2 * settings.window)
        self._thickness = Thickness(np.log(settings.thickness), settings.thickness_error)
        self._loose = 0  # frames in a row in which the contact has not turned as one body
        self._unround = 0  # frames in a row whose motion was not that of a round disc
        self._lose()

    def update(
        self,
        positions: Float[np.ndarray, "n d"],
        contact: Bool[np.ndarray, " n"],
        time: float,
        printed: bool = False,
    ) -> Sight:
        """The evidence after the next frame.

        Args:
            positions: positions of the markers [mm]; NaN for markers that are not visible.
            contact: markers of the contact region.
            time: time stamp [s].
            printed: whether the object's print shows slip, so that no disc is needed.
        """
        z = (positions[:, 0] + 1j * positions[:, 1]) / self._pitch
        self._window.append(_Markers(z, contact, time))
        if len(self._window) <= self._settings.window:
            return Sight()
        rests = self._is_still(self._window[0])
        if printed:
            self._lose()
            return Sight(rests=rests)
        grips = any(self._grips(first) for first in self._latest)
        if grips and self._loose >= self._settings.latest:  # holds again: the disc opens anew
            self._discs.clear()
            self._slid = False
        self._loose = 0 if grips else self._loose + 1
        still, disc = self._is_still(self._latest[0]), self._find_disc(self._first())
        return Sight(disc, rests, self._is_closed(time), grips, still, self._has_paused())

    def _since(self, first: _Markers) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " m"]]:
        """Markers visible in contact in a frame and in the last one, and how far they moved."""
        last = self._window[-1]
        held = first.contact & last.contact & np.isfinite(last.points - first.points)
        return held, np.abs((last.points - first.points)[held])

    @property
    def _latest(self) -> list[_Markers]:
        """The frames just before the last one, from which `grips` and `still` are judged."""
        return list(self._window)[-1 - self._settings.latest : -1]

    def _is_still(self, first: _Markers) -> bool:
        _, moved = self._since(first)
        enough = len(moved) >= self._settings.least_markers
        return enough and is_still(moved, self._scale, self._settings.at_rest)

    def _has_paused(self) -> bool:
        """Whether the contact's markers stopped in the last frame."""
        steps, points = self._settings.latest, [markers.points for markers in self._window]
        held, _ = self._since(self._window[-3 - steps])
        pace = (points[-3] - points[-3 - steps]) / steps
        return has_paused(pace[held], (points[-1] - points[-2])[held])

    def _grips(self, first: _Markers) -> bool:
        """Whether the inner half of the contact has turned as one body since a frame.

        A closed disc turns hardly more than its middle, and gel that rests does not turn.
        """
        settings, scale = self._settings, max(self._scale, 1e-6)
        held, _ = self._since(first)
        if held.sum() < settings.least_markers:
            return False
        before, after = first.points[held], self._window[-1].points[held]
        distance = np.abs(before - before.mean())
        inner = distance <= np.median(distance)
        before, after = before[inner], after[inner]
        motion = fit_motion(before, after)
        arms = np.abs(before - motion.origin)
        turned = abs(motion.angle) * np.sqrt(arms @ arms)
        residual = np.abs(motion.residual(before, after))
        free = 2 * len(before) - 4
        alike = bool(residual @ residual <= settings.grip_misfit * free * scale**2)
        return alike and bool(turned >= settings.grip_turn * scale)

    def _first(self) -> _Markers:
        """The first frame of the shortest window whose motion is clear of the noise.

        The disc closes meanwhile, so that a long window of a fast motion shows no disc.
        """
        for first in list(self._window)[-3:0:-1]:
            _, moved = self._since(first)
            if len(moved) and not is_still(moved, self._scale, self._settings.clear):
                return first
        return self._window[0]

    def _find_disc(self, first: _Markers) -> Disc | None:
        """The disc that has moved the markers in contact since a frame of the window."""
        settings, scale, last = self._settings, max(self._scale, 1e-6), self._window[-1]
        held = self._since(first)[0] & np.isfinite(first.time + last.time)
        self._pace = np.nan
        few = held.sum() < settings.least_markers
        if few or self._missed > 2 * settings.window:
            self._lose()
        if few:
            self._unround = 0
        either = first.contact | last.contact
        if few or held.sum() < (1.0 - settings.load_change) * either.sum():
            return None
        before, after = first.points[held], last.points[held]
        moved = np.abs(after - before)
        if self._axis is not None:  # markers near the axis move longest
            near = np.argsort(np.abs(before - complex(*self._axis)))
            moved = moved[near[: settings.least_markers]]
        if is_still(moved, scale, settings.at_rest):
            return None
        self._unround += 1
        if self._unround > 2 * settings.window and self._unround % settings.sought_every:
            return None
        best = fit_disc(before, after, scale, self._last, self._axis, self._thickness, settings)
        disc = describe_disc(best, before, after, scale, settings)
        if disc.misfit <= settings.round_misfit:
            self._unround = 0
        self._pace = turn_along(best.parameters, self._window[-2].points[held], after)
        self._pace /= last.time - self._window[-2].time
        self._missed += 1
        largest = np.hypot(settings.largest_error, settings.roundness)
        if disc.misfit > settings.largest_misfit or not disc.error <= largest:
            return None
        x, y, radius = best.parameters[:3]
        if abs(radius) > np.abs(before - complex(x, y)).max():
            return None  # all markers stick
        disc = disc._replace(time=0.5 * (first.time + last.time))
        if disc.misfit <= settings.round_misfit:
            self._believe(best, before)
            self._discs.append((*disc[:3], best.parameters[3] / (last.time - first.time)))
        return disc

    def _is_closed(self, now: float) -> bool | None:
        """Whether a line through the margins of the last discs crossed zero `overdue` frames ago.

        A disc is that of its window's middle, so that the line is continued by half a window. The
        disc closes only while the object turns: the line must have crossed zero when it last did.
        Once closed, the disc counts as open only after a margin at which markers stick again.
        """
        settings, discs = self._settings, np.array(self._discs)
        if len(discs) < settings.window:
            return None
        frame = (now - self._window[0].time) / settings.window
        discs = discs[discs[:, 0] > now - (2.5 * settings.window + 0.5) * frame]
        if len(discs) < settings.window or discs[-1, 0] < now - (settings.window - 0.5) * frame:
            return None
        pace = float(np.median(discs[:, 3]))
        if self._pace * np.sign(pace) >= settings.least_pace * abs(pace):
            self._turned = now
        slope, level = _fit_line(discs[:, :3], now).line
        crossed = self._slid or level < slope * (now - self._turned)
        closed = slope < 0.0 and level < slope * settings.overdue * frame and crossed
        self._slid = closed or (self._slid and discs[-1, 1] <= settings.regained)
        if self._slid or slope >= 0.0 or level < 0.0:
            return True if closed else None
        return False

    def _lose(self) -> None:
        """Restart with the next disc."""
        self._discs.clear()
        self._slid = False
        self._turned = np.nan  # when the object last turned on
        self._last: np.ndarray | None = None
        self._axis: np.ndarray | None = None
        self._missed = 0

    def _believe(self, best: DiscFit, before: Complex[np.ndarray, " m"]) -> None:
        """Use this disc as the next initial guess, and its axis while it holds many markers."""
        disc, settings = best.parameters, self._settings
        self._last, self._missed = disc, 0
        self._thickness = learn_thickness(self._thickness, best, settings)
        inside = np.abs(before - complex(*disc[:2])) < abs(disc[2])
        if inside.sum() >= 3 * MIN_STICK_MARKERS:
            axis = disc[:2] if self._axis is None else self._axis
            self._axis = axis + 0.2 * (disc[:2] - axis)


class _Line(NamedTuple):
    """A line through margins: slope and level, their covariance, and the sum of squares left."""

    line: tuple[float, float]
    covariance: Float[np.ndarray, "2 2"]
    scatter: float


def _fit_line(discs: Float[np.ndarray, "discs 3"], origin: float) -> _Line:
    """The line through the margins over the time since an origin [s], weighted by their errors."""
    time, margin, error = discs.T
    design = np.stack([time - origin, np.ones_like(time)], axis=1) / error[:, None]
    covariance = np.linalg.pinv(design.T @ design)
    slope, level = covariance @ (design.T @ (margin / error))
    residual = design @ [slope, level] - margin / error
    return _Line((float(slope), float(level)), covariance, float(residual @ residual))


def _date(
    discs: Float[np.ndarray, "discs 3"], near: float, settings: SlipSettings
) -> MacroSlip | None:
    """The slip at the time at which a line through the margins crosses zero; None if unclear.

    Args:
        discs: time, margin and error of each disc.
        near: time near which the margin crosses zero [s].
        settings: how slips are dated.
    """
    time = discs[:, 0]
    if len(time) < 3:
        return None
    (slope, level), inverse, scatter = _fit_line(discs, near)
    variance = max(scatter / max(len(time) - 2, 1), 1.0) * settings.correlated
    onset = near - level / slope if slope < 0.0 else near
    onset = float(np.clip(onset, time[0], time[-1]))
    gradient = np.array([onset - near, 1.0]) / slope
    frame = float(np.median(np.diff(time)))  # the true onset lies between two frames
    half = float(np.hypot(Z95 * np.sqrt(gradient @ inverse @ gradient * variance), frame))
    return MacroSlip(onset, onset - half, onset + half) if half < settings.widest * frame else None
