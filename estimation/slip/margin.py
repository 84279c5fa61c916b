"""Margin to macro slip, from the moment–angle curve extrapolated to its end."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.estimators.measurement import Z95
from estimation.estimators.result import State, Track
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.slip.branch import (
    LEAST_STICK_RATIO,
    Branch,
    MarginSettings,
    fit_branch,
    margin_after,
)

THIRD_MARKER_DISTANCE = (0.91, 0.092)
"""Distance from a point to the third-nearest marker of a square grid, in pitches.

Mean and standard deviation over all points."""


class Margin(NamedTuple):
    """Remaining angle and moment before macro slip; NaN where the data cannot determine them.

    Attributes:
        angle: remaining rotation [rad].
        angle_low: lower end of its 95 % interval [rad].
        angle_high: upper end [rad].
        moment: remaining moment [N·mm].
        moment_low: lower end of its 95 % interval [N·mm].
        moment_high: upper end [N·mm].

    Examples:
        >>> import numpy as np
        >>> from estimation import Margin, Noise, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers()
        >>> margin: Margin = last.margin
        >>> low, angle, high = np.degrees([margin.angle_low, margin.angle, margin.angle_high])
        >>> print(f"{angle:.1f}° ({low:.1f}° to {high:.1f}°) and {margin.moment:.1f} N·mm remain")
        7.7° (5.9° to 9.6°) and 0.5 N·mm remain
    """

    angle: float = np.nan
    angle_low: float = np.nan
    angle_high: float = np.nan
    moment: float = np.nan
    moment_low: float = np.nan
    moment_high: float = np.nan


class MarginTracker:
    """Follows angle and moment frame by frame; the cost of a frame is bounded.

    Attributes:
        branch: the fitted branch; None if the data cannot determine one.
        last: the branch of the last frame with a margin; None before it.
    """

    def __init__(self, settings: MarginSettings = MarginSettings()) -> None:
        """Begin without any frame."""
        self.settings = settings
        self.last: Branch | None = None
        self.restart()

    def restart(self) -> None:
        """Discard all points: the object has left."""
        self._points: list[tuple[float, float]] = []
        self._sign = 0.0
        self._guess: Float[np.ndarray, " 3"] | None = None
        self.branch: Branch | None = None
        self._enough = False  # whether the points suffice for a fit

    def follow(self, state: State, angle: float, moment: float, contact_markers: int) -> Margin:
        """The margin after a frame; NaN without contact and in macro slip.

        Args:
            state: state of the contact.
            angle: angle of the object [rad].
            moment: moment about the normal [N·mm].
            contact_markers: number of markers in contact; in macro slip fewer than three stick.
        """
        self.add(state, angle, moment)
        return self.tell(state, angle, contact_markers)

    def add(self, state: State, angle: float, moment: float) -> None:
        """Add the point of a frame, without a fit; discard all points if the object has left."""
        if state == State.NO_CONTACT:
            self.restart()
            return
        self._enough = False
        if not np.isfinite(angle + moment):
            return
        self._points.append((angle, moment))
        self._turn()
        if len(self._points) > 2 * self.settings.most_points:
            del self._points[1:-1:2]
        self.branch = None
        self._enough = bool(self._sign) and len(self._points) >= self.settings.least_points

    def tell(self, state: State, angle: float, contact_markers: int) -> Margin:
        """The margin after the frame added last, as in `follow`."""
        if not self._enough:
            return Margin()
        angles, moments = np.array(self._points).T
        self.branch = fit_branch(angles, moments, self._sign, self._guess, self.settings)
        margin = margin_at(self.branch, angle, end_stick_ratio(contact_markers), self.settings)
        # an undetermined fit is no good initial guess
        self._guess = self.branch.parameters if np.isfinite(margin.angle) else None
        if state == State.MACRO_SLIP:
            return Margin()
        if np.isfinite(margin.angle):
            self.last = self.branch
        return margin

    def _turn(self) -> None:
        """Begin a new branch if the object has turned back."""
        angles = np.array([angle for angle, _ in self._points])
        least = np.radians(self.settings.turn_deg)
        if not self._sign:
            travel = angles[-1] - angles[0]
            self._sign = float(np.sign(travel)) if abs(travel) > least else 0.0
            return
        furthest = int(np.argmax(self._sign * angles))
        if self._sign * (angles[furthest] - angles[-1]) > least:
            self._points = self._points[furthest:]
            self._sign, self._guess = -self._sign, None


class MarginPath(NamedTuple):
    """Margins of a recording, each from its own and earlier frames only; NaN in macro slip.

    Fields are as in `Margin`, over frames, and `last` is the branch of the last frame with a
    margin; None without one.
    """

    angle: Float[np.ndarray, " frames"]
    angle_low: Float[np.ndarray, " frames"]
    angle_high: Float[np.ndarray, " frames"]
    moment: Float[np.ndarray, " frames"]
    moment_low: Float[np.ndarray, " frames"]
    moment_high: Float[np.ndarray, " frames"]
    last: Branch | None

    @classmethod
    def of(cls, *frames: Margin) -> "MarginPath":
        """Gather the margin of each frame."""
        return cls(*np.array(frames).reshape(-1, len(Margin._fields)).T, last=None)

    def take(self, rows: slice) -> "MarginPath":
        """The path for a slice of the frames."""
        *numbers, last = self
        return MarginPath(*(values[rows] for values in numbers), last=last)


def follow_margin(
    track: Track,
    settings: MarginSettings = MarginSettings(),
    known: MarginPath | None = None,
    changed: Bool[np.ndarray, " frames"] | None = None,
) -> MarginPath:
    """Margins of a recording, frame by frame.

    Args:
        track: track of the chosen method.
        settings: settings of the fits.
        known: margins computed before answers were withdrawn.
        changed: frames whose answer was withdrawn, which changes the margins of later frames of the
            same contact.
    """
    frames = zip(
        track.state,
        map(float, track.angle),
        map(float, track.moment),
        map(int, track.contact_markers),
        strict=True,
    )
    fitted = np.ones(len(track.time), dtype=bool)
    if known is not None and changed is not None:
        fitted = _is_stale(track, changed)
        determined = np.flatnonzero(~fitted & np.isfinite(known.angle))
        fitted[determined[-1:]] = True  # gives the last branch
    tracker, margins = MarginTracker(settings), np.full((len(fitted), len(Margin._fields)), np.nan)
    if known is not None:
        margins[:] = np.stack(known[:-1], axis=1)
    for row, (state, angle, moment, contact) in enumerate(frames):
        if fitted[row]:
            margins[row] = tracker.follow(state, angle, moment, contact)
        else:
            tracker.add(state, angle, moment)
    return MarginPath(*margins.T, last=tracker.last)


def _is_stale(track: Track, changed: Bool[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames at or after a changed frame of the same contact."""
    free = np.array([state == State.NO_CONTACT for state in track.state])
    so_far = np.cumsum(changed)
    before = np.maximum.accumulate(np.where(free, so_far, 0))
    return so_far > before


def end_stick_ratio(contact_markers: int) -> float:
    """c/a at which three of the contact's markers stick, at least that of Lubkin's table [-]."""
    radius = np.sqrt(max(contact_markers, MIN_STICK_MARKERS) / np.pi)  # in pitches
    return float(np.clip(THIRD_MARKER_DISTANCE[0] / radius, LEAST_STICK_RATIO, 0.99))


def margin_at(
    branch: Branch, angle: float, end: float, settings: MarginSettings = MarginSettings()
) -> Margin:
    """The margin at an angle on a branch; NaN while the branch's limit is undetermined.

    Args:
        branch: the branch.
        angle: angle of the object [rad].
        end: c/a that counts as macro slip [-].
        settings: when the limit counts as undetermined.
    """
    far = branch.limit > 2.0 * np.pi * branch.stiffness  # the stiffness is almost 0
    if far or branch.covariance[0, 0] > settings.most_doubt**2:
        return Margin()
    travel = max(branch.sign * (angle - branch.start), 0.0)
    best = branch.parameters
    steps = np.array([1e-3, 1e-3, 1e-3 * branch.limit])
    middle = margin_after(best, travel, end)
    slope = np.stack(
        [(margin_after(best + step, travel, end) - middle) / step.sum() for step in np.diag(steps)],
        axis=1,
    )
    variance = np.einsum("ip,pq,iq->i", slope, branch.covariance, slope).clip(0.0)
    spread = THIRD_MARKER_DISTANCE[1] / THIRD_MARKER_DISTANCE[0]
    variance += (margin_after(best, travel, end * (1.0 - spread)) - middle) ** 2
    half = Z95 * np.sqrt(variance)
    # the moment's interval includes the rms difference of measured and fitted moments
    half[1] = np.hypot(half[1], Z95 * branch.rms)
    low, high = np.maximum(middle - half, 0.0), np.maximum(middle + half, 0.0)
    middle = np.maximum(middle, 0.0)
    pairs = np.stack([middle, low, high], axis=1).ravel()
    return Margin(*(float(value) for value in pairs))
