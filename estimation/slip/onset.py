"""When macro slip began: the disc of markers that still stick, followed as it closes.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".

Whatever the pressure of a round contact, a small further twist moves the elastomer as a rigid disc
does that has the radius c of the region that sticks ([Jaeger1995]): by dθ inside, and outside by
(2/π)[asin(c/r) − (c/r)√(1 − c²/r²)] dθ. The motion of all markers over a few frames thus tells c,
however few of them are inside, and when fewer than three are. A live tracker asks the last markers
whether they still move alike, which it can only say some frames later; this looks back, and needs
frames from after the event. The moment would not do: with c/a = 0.2 it grows with 1 % of its first
slope (c³/a³), long before and long after.

Contacts that are not round close in other shapes, and real gels creep: where a disc does not move
the markers as they moved, to twice their noise, there is no date.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.optimize import leastsq

from estimation.estimators.measurement import Z95
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout


@dataclass(frozen=True)
class SlipSettings:
    """How macro slip is dated and doubted, looking back; lengths are in pitches of the markers.

    Attributes:
        window: over which the motion is taken [frames].
        least_markers: markers in contact from which a disc is fitted, which has four unknowns.
        load_change: share by which the contact may grow or shrink over a window: pressing moves its
            markers too [-].
        worst_misfit: misfit over noise from which the motion is not a disc's [-].
        largest_misfit: share of the motion that the disc may leave unexplained [-].
        largest_error: standard error of the disc's radius beyond which a window says nothing: the
            object rests, or slides [pitches].
        at_rest: motion of the markers about the axis, over its noise, below which the contact rests
            [-].
        axis_drift: how far the axis may be from where it was while nine markers stuck [pitches].
        round_misfit: misfit of a disc, as a share of the motion beyond its noise, from which the
            contact is not round. The disc closes while a window lasts: round virtual pivots without
            noise show up to 0.056, contacts of 2:1 from 0.16 on [-].
        roundness: error of the radius beyond the noise; what markers of the virtual pivots show
            [pitches].
        regained: margin from which markers stick again: a turn back makes all of them stick
            [pitches].
        around: windows before and after the date through which a line is laid [-].
        widest: half-width of a date's interval beyond which it is no date [frames].
        noise_frames: over which the noise is correlated [frames].
        most_steps: evaluations of the misfit in one fit of a disc [-].
        firm_share: share of the contact's markers that stick beyond which the angle is not believed
            to be lost [-].
        least_margin: radius of the closing disc beyond the third marker from which gel that comes
            to rest is believed to rest under the object. On virtual pivots the last four discs
            before an unseen slip come below it; before a true rest they do where hardly more than
            three markers stick [pitches].
    """

    window: int = 6
    least_markers: int = 12
    load_change: float = 0.15
    worst_misfit: float = 2.0
    largest_misfit: float = 0.5
    largest_error: float = 0.15
    at_rest: float = 1.5
    axis_drift: float = 0.05
    round_misfit: float = 0.06
    roundness: float = 0.02
    regained: float = 0.5
    around: int = 6
    widest: float = 30.0
    noise_frames: float = 3.0
    most_steps: int = 20
    firm_share: float = 1.0 / 3.0
    least_margin: float = 0.25


DEFAULT_SETTINGS = SlipSettings()


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


class Disc(NamedTuple):
    """The region that sticks, as the markers' motion over a window shows it.

    Attributes:
        time: middle of the window [s].
        margin: radius less the third marker's distance from the axis, in pitches; below 0 fewer
            than three stick.
        error: its standard error, in pitches.
        misfit: share of the markers' motion, beyond their noise, that is not the disc's [-].
    """

    time: float
    margin: float
    error: float
    misfit: float = 0.0


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
        f"Looking back, macro slip began at {slip.onset - start:.3f} s "
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
        self._pitch = _pitch(layout)
        self._scale = float(np.sqrt(2.0) * noise.in_plane) / self._pitch
        self._settings = settings
        self._window: deque[_Seen] = deque(maxlen=settings.window + 1)
        self._lose()

    def update(
        self,
        positions: Float[np.ndarray, "n d"],
        contact: Bool[np.ndarray, " n"],
        time: float,
    ) -> Sight:
        """What is seen after the next frame.

        Args:
            positions: of the markers [mm]; NaN where not seen.
            contact: markers of the contact region.
            time: time stamp [s].
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
        best = _fit_best(before, after, scale, self._last, self._axis, settings)
        disc = _describe_disc(best, before, after, scale, settings)
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


class _Fit(NamedTuple):
    """Axis x and y, radius and rotation of a disc, and what they leave of the motion."""

    parameters: Float[np.ndarray, " 4"]
    residual: Float[np.ndarray, " m"]
    jacobian: Float[np.ndarray, "m 4"]

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residual @ self.residual)


def _describe_disc(
    best: _Fit,
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    scale: float,
    settings: SlipSettings,
) -> Disc:
    """The disc of a fit; its time is not known here."""
    misfit = float(np.sqrt(np.mean(best.residual**2))) / settings.worst_misfit
    error = np.sqrt(np.linalg.pinv(best.jacobian.T @ best.jacobian)[2, 2]) * max(misfit, 1.0)
    distance = np.sort(np.abs(before - complex(*best.parameters[:2])))
    moved = float(np.sqrt(0.5 * np.mean(np.abs(after - before) ** 2)))  # per coordinate
    beyond = settings.worst_misfit * scale * np.sqrt(max(misfit**2 - 1.0, 0.0))
    return Disc(
        time=np.nan,
        margin=float(abs(best.parameters[2]) - distance[MIN_STICK_MARKERS - 1]),
        error=float(np.hypot(error, settings.roundness)),
        misfit=float(beyond / moved),
    )


def is_still(moved: Float[np.ndarray, " m"], scale: float, at_rest: float) -> bool:
    """Whether markers have moved over a window by hardly more than their noise.

    Args:
        moved: by how much each.
        scale: noise of the difference of two positions, per coordinate.
        at_rest: motion over its noise that is hardly more [-].
    """
    return bool(np.mean(moved**2) < 2.0 * (at_rest * scale) ** 2)


def _fit_best(
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    scale: float,
    last: np.ndarray | None,
    axis: np.ndarray | None,
    settings: SlipSettings,
) -> _Fit:
    """Axis x and y, radius and rotation of the disc; least squares, from the last and afresh."""

    def stack(left: Complex[np.ndarray, "m ..."], drift: Float[np.ndarray, "2 ..."]) -> np.ndarray:
        parts = [np.real(left) / scale, np.imag(left) / scale]
        return np.concatenate(parts if axis is None else [*parts, drift / settings.axis_drift])

    def residual(parameters: np.ndarray) -> np.ndarray:
        x, y, radius, turned = parameters
        arm = before - complex(x, y)
        left = after - before - np.expm1(1j * turned * _share(np.abs(arm), abs(radius))) * arm
        return stack(left, parameters[:2] - (0.0 if axis is None else axis))

    def jacobian(parameters: np.ndarray) -> np.ndarray:
        x, y, radius, turned = parameters
        arm = before - complex(x, y)
        distance = np.maximum(np.abs(arm), 1e-12)
        share, slope = _share(distance, abs(radius)), _share_slope(distance, abs(radius))
        spin = np.exp(1j * turned * share)
        outwards = 1j * turned * slope * spin * arm  # by d ln(radius), less d ln(distance)
        moved = spin - 1.0
        columns = (
            moved - outwards * arm.real / distance**2,
            1j * moved - outwards * arm.imag / distance**2,
            -outwards / radius,
            -1j * share * spin * arm,
        )
        return stack(np.stack(columns, axis=1), np.eye(2, 4))

    def solve(start: np.ndarray) -> _Fit:
        found, *_ = leastsq(
            residual,
            start,
            Dfun=jacobian,
            full_output=True,  # and no warning where the steps are used up
            ftol=1e-8,
            xtol=1e-8,
            gtol=1e-8,
            maxfev=settings.most_steps,
            diag=1.0 / np.array([0.1, 0.1, 0.1, 0.01]),  # typical changes, pitches and rad
        )
        return _Fit(found, residual(found), jacobian(found))

    solutions = []
    if last is not None:
        solutions = [solve(last), solve(last * [1.0, 1.0, 0.8, 1.0])]
    if (
        not solutions
        or min(s.squares for s in solutions) > 2.0 * len(before) * settings.worst_misfit**2
    ):
        centre = complex(before.mean()) if axis is None else complex(*axis)
        arm = before - centre
        turned = np.sum(np.imag(np.conj(arm) * (after - before))) / np.sum(np.abs(arm) ** 2)
        solutions += [
            solve(np.array([centre.real, centre.imag, radius, turned]))
            for radius in (1.0, 2.0, 4.0)
        ]
    return min(solutions, key=lambda solution: solution.squares)


def _share(distance: Float[np.ndarray, " m"], radius: float) -> Float[np.ndarray, " m"]:
    """Rotation about the axis, over that of the disc, of points of the surface ([Jaeger1995])."""
    q = np.minimum(radius / np.maximum(distance, 1e-12), 1.0)
    return 2.0 / np.pi * (np.arcsin(q) - q * np.sqrt(1.0 - q * q))


def _share_slope(distance: Float[np.ndarray, " m"], radius: float) -> Float[np.ndarray, " m"]:
    """Derivative of the share by the logarithm of the radius; at the rim, where it has no bound,
    that of a twentieth."""
    q = np.minimum(radius / np.maximum(distance, 1e-12), 1.0)
    root = np.sqrt(1.0 - q * q)
    return np.where(q < 1.0, 4.0 / np.pi * q**3 / np.maximum(root, 0.05), 0.0)


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


def _pitch(layout: MarkerLayout) -> float:
    """Distance between neighbouring markers, the unit of this module's bounds."""
    inner, slot = np.nonzero(layout.neighbours >= 0)
    pairs = layout.reference[inner] - layout.reference[layout.neighbours[inner, slot]]
    return float(np.median(np.linalg.norm(pairs, axis=1)))
