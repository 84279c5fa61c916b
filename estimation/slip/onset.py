"""When macro slip began: the disc of markers that still stick, followed as it closes.

A live tracker asks the last markers whether they still move alike, which it can only say some
frames later; the disc (`estimation.slip.disc`) is followed over windows, and dated looking back
with frames from after the event. The moment would not do: with c/a = 0.2 it grows with 1 % of its
first slope (c³/a³), long before and long after.

Contacts that are not round close in other shapes, and real gels creep: where a disc does not move
the markers as they moved, to twice their noise, there is no date.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.measurement import Z95
from estimation.fields.stencils import marker_pitch
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout
from estimation.slip.disc import (
    DEFAULT_SETTINGS,
    Disc,
    SlipSettings,
    describe_disc,
    fit_disc,
    is_still,
)


class MacroSlip(NamedTuple):
    """A time in which fewer than three markers stuck, or may have.

    Attributes:
        onset: when it began, or the gel came to rest [s].
        low: lower end of its 95 % interval [s].
        high: upper end [s]; of a slip that is not certain, when the gel rested last.
        regained: when markers stuck again [s]; NaN if they did not.
        certain: whether a disc was seen to close; else the gel came to rest while few markers
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


def date_slips(discs: Sequence[Disc], settings: SlipSettings = DEFAULT_SETTINGS) -> list[MacroSlip]:
    """When fewer than three markers stuck, by the discs of a whole recording."""
    slips: list[MacroSlip] = []
    slipping = False
    discs = [disc for disc in discs if disc.misfit <= settings.round_misfit]
    for i, disc in enumerate(discs):
        near = [d.margin for d in discs[i : i + 4]]
        changed = [m > settings.regained if slipping else m < 0.0 for m in near]
        if not changed[0] or len(near) < 2 or np.mean(changed) < 0.75:
            continue
        if slipping:
            slips[-1] = slips[-1]._replace(regained=disc.time)
            slipping = False
        elif slip := _date(
            discs[max(i - settings.around, 0) : i + settings.around + 1], disc.time, settings
        ):
            slips.append(slip)
            slipping = True
    return slips


def describe_slips(slips: Sequence[MacroSlip], start: float) -> tuple[str, ...]:
    """A sentence about each, in seconds since a start [s]."""
    return tuple(_describe(slip, start) for slip in slips)


def _describe(slip: MacroSlip, start: float) -> str:
    if not slip.certain:
        return (
            f"From {slip.onset - start:.3f} to {slip.high - start:.3f} s the gel rests, with few "
            "markers that stuck before: the object may have rested with it or slid on."
        )
    return (
        f"Macro slip began at {slip.onset - start:.3f} s "
        f"(95 %: {slip.low - start:.3f} to {slip.high - start:.3f} s), counted from the first frame"
        + (f", and markers stuck again at {slip.regained - start:.3f} s." if slip.ended else ".")
    )


class _Seen(NamedTuple):
    """Markers of one frame.

    Attributes:
        points: x + iy in pitches.
        contact: those of the contact region.
        time: time stamp [s].
    """

    points: Complex[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    time: float


class Sight(NamedTuple):
    """What the motion over the window that ends with a frame shows.

    Attributes:
        disc: the region that sticks; None where the motion shows none.
        rests: whether the contact's markers have hardly moved.
    """

    disc: Disc | None
    rests: bool


class SlipWatch:
    """Follows the disc that sticks frame by frame, over every window whose motion shows one."""

    def __init__(
        self, layout: MarkerLayout, noise: Noise, settings: SlipSettings = DEFAULT_SETTINGS
    ) -> None:
        """Begin with no frame.

        Args:
            layout: of the markers.
            noise: of the markers.
            settings: how the disc is followed.
        """
        self._pitch = marker_pitch(layout)
        self._scale = float(np.sqrt(2.0) * noise.in_plane) / self._pitch
        self._settings = settings
        self._window: deque[_Seen] = deque(maxlen=settings.window + 1)
        self._lose()

    def update(
        self,
        positions: Float[np.ndarray, "n d"],
        contact: Bool[np.ndarray, " n"],
        time: float,
        printed: bool = False,
    ) -> Sight:
        """What is seen after the next frame.

        Args:
            positions: of the markers [mm]; NaN where not seen.
            contact: markers of the contact region.
            time: time stamp [s].
            printed: whether the object's print shows what slips, and no disc is needed.
        """
        z = (positions[:, 0] + 1j * positions[:, 1]) / self._pitch
        self._window.append(_Seen(z, contact, time))
        if len(self._window) <= self._settings.window:
            return Sight(None, False)
        first, last = self._window[0], self._window[-1]
        held = first.contact & last.contact & np.isfinite(last.points - first.points)
        moved = np.abs((last.points - first.points)[held])
        enough = len(moved) >= self._settings.least_markers
        rests = enough and is_still(moved, self._scale, self._settings.at_rest)
        if printed:
            self._lose()
            return Sight(None, rests)
        return Sight(self._find_disc(first, last, held), rests)

    def _find_disc(self, first: _Seen, last: _Seen, held: Bool[np.ndarray, " n"]) -> Disc | None:
        """The disc that moved the markers that are seen in contact at both ends of the window."""
        settings, scale = self._settings, max(self._scale, 1e-6)
        held = held & np.isfinite(first.time + last.time)
        few = held.sum() < settings.least_markers
        if few or self._missed > 2 * settings.window:
            self._lose()
        either = first.contact | last.contact
        if few or held.sum() < (1.0 - settings.load_change) * either.sum():
            return None
        before, after = first.points[held], last.points[held]
        moved = np.abs(after - before)
        if self._axis is not None:  # those near the axis move to the end
            near = np.argsort(np.abs(before - complex(*self._axis)))
            moved = moved[near[: settings.least_markers]]
        if is_still(moved, scale, settings.at_rest):
            return None
        best = fit_disc(before, after, scale, self._last, self._axis, settings)
        disc = describe_disc(best, before, after, scale, settings)
        self._missed += 1
        if disc.misfit > settings.largest_misfit or disc.error > np.hypot(
            settings.largest_error, settings.roundness
        ):
            return None
        if disc.misfit <= settings.round_misfit:
            self._believe(best.parameters, before)
        return disc._replace(time=0.5 * (first.time + last.time))

    def _lose(self) -> None:
        """Begin anew with the next disc."""
        self._last: np.ndarray | None = None
        self._axis: np.ndarray | None = None
        self._missed = 0

    def _believe(self, disc: np.ndarray, before: Complex[np.ndarray, " m"]) -> None:
        """Start from this disc next time, and from its axis while many markers are inside."""
        self._last, self._missed = disc, 0
        inside = np.abs(before - complex(*disc[:2])) < abs(disc[2])
        if inside.sum() >= 3 * MIN_STICK_MARKERS:
            axis = disc[:2] if self._axis is None else self._axis
            self._axis = axis + 0.2 * (disc[:2] - axis)


def _date(discs: Sequence[Disc], near: float, settings: SlipSettings) -> MacroSlip | None:
    """Where a line through the margins crosses zero; None where they do not tell."""
    time, margin, error = np.array([(disc.time, disc.margin, disc.error) for disc in discs]).T
    if len(time) < 3:
        return None
    design = np.stack([time - near, np.ones_like(time)], axis=1) / error[:, None]
    inverse = np.linalg.pinv(design.T @ design)
    slope, level = inverse @ (design.T @ (margin / error))
    left = design @ [slope, level] - margin / error
    # neighbouring windows share frames and noise
    correlated = (settings.window + settings.noise_frames) / 2.0
    variance = max(float(left @ left) / max(len(time) - 2, 1), 1.0) * correlated
    onset = near - level / slope if slope < 0.0 else near
    onset = float(np.clip(onset, time[0], time[-1]))
    gradient = np.array([onset - near, 1.0]) / slope
    frame = float(np.median(np.diff(time)))  # the truth lies between two of them
    half = float(np.hypot(Z95 * np.sqrt(gradient @ inverse @ gradient * variance), frame))
    return MacroSlip(onset, onset - half, onset + half) if half < settings.widest * frame else None
