"""Margin to macro slip, from the load–angle curve extrapolated to its end.

The bend of the curve shows its limit once much of the contact slips. The disc that still sticks, by
the law of friction, shows it earlier. Both are weighed by their errors.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr

from estimation.estimators.measurement import StickDisc
from estimation.estimators.result import State, Track
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.slip.branch import Branch, MarginSettings, fit_branch, margin_after, weigh_branches
from estimation.slip.load_path import Loads, follow_load, since_turn
from estimation.slip.pressures import LEAST_STICK_RATIO, Face, likely_pressures, typical_face

THIRD_MARKER_DISTANCE = (0.91, 0.092)
"""Distance from a point to the third-nearest marker of a square grid, in pitches.

Mean and standard deviation over all points."""


class Margin(NamedTuple):
    """Remaining angle and moment before macro slip; NaN where the data cannot determine them.

    The moment is NaN too where no moment is measured: the angle then follows from the markers.

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
        7.5° (4.8° to 10.4°) and 0.5 N·mm remain
    """

    angle: float = np.nan
    angle_low: float = np.nan
    angle_high: float = np.nan
    moment: float = np.nan
    moment_low: float = np.nan
    moment_high: float = np.nan


class MarginWatch:
    """Follows angle and moment frame by frame; the cost of a frame is bounded.

    Attributes:
        branch: the branch for the most probable pressure, with the covariance over all; None if the
            data cannot determine one.
        last: the branch of the last frame with a margin; None before it.
    """

    def __init__(self) -> None:
        """Begin without any frame."""
        self.settings = MarginSettings()
        self.last: Branch | None = None
        self._measured = self._forced = False  # whether moments and forces are measured
        self.restart()

    def restart(self) -> None:
        """Discard all points: the object has left."""
        self._points: list[tuple[float, ...]] = []
        self._faces: list[Face] = []
        self._discs: deque[StickDisc] = deque(maxlen=self.settings.discs)
        self._sign = 0.0
        self._guesses: dict[int, Float[np.ndarray, " 3"]] = {}
        self.branch: Branch | None = None
        self._enough = False  # whether the points suffice for a fit
        self._restarts = 0

    def add(
        self,
        state: State,
        angle: float,
        moment: float,
        gel_moment: float = np.nan,
        restarts: int = 0,
        face: Face | None = None,
        disc: StickDisc | None = None,
        loads: Loads | None = None,
    ) -> None:
        """Add the point of a frame, without a fit.

        All points are discarded if the object has left, or if the angle counts anew.

        Args:
            state: state of the contact.
            angle: angle of the object [rad].
            moment: measured moment about the normal [N·mm]; NaN if unknown.
            gel_moment: moment from the markers, used if none is measured [rad].
            restarts: number of restarts of the angle's count.
            face: the fitted face of the object.
            disc: the disc that sticks.
            loads: moment and shear, where forces are measured; else the contact has no shear.
        """
        if state == State.NO_CONTACT:
            self.restart()
            return
        measured = self._measured or bool(np.isfinite(moment))
        loads = loads or Loads()
        forced = self._forced or bool(np.isfinite(loads.moment))
        if (measured, forced, restarts) != (self._measured, self._forced, self._restarts):
            self.restart()
            self._measured, self._forced, self._restarts = measured, forced, restarts
        self._enough = False
        disc = disc or StickDisc()
        self._discs.append(disc)
        if not self._forced:
            loads = Loads(moment if self._measured else gel_moment, 0.0, 0.0)
        if not np.isfinite([angle, *loads]).all():
            return
        self._points.append((angle, *loads))
        self._faces.append(face or Face())
        self._turn()
        if len(self._points) > 2 * self.settings.most_points:
            del self._points[1:-1:2], self._faces[1:-1:2]
        self.branch = None
        known = np.isfinite(disc.ratio)
        least = self.settings.fewest_points if known else self.settings.least_points
        self._enough = bool(self._sign) and len(self._points) >= least

    def predict(self, state: State, angle: float, contact_markers: int) -> Margin:
        """The margin after the frame added last; NaN unless the contact is known to hold.

        Args:
            state: state of the contact.
            angle: angle of the object [rad].
            contact_markers: number of markers in contact; in macro slip fewer than three stick.
        """
        if not self._enough:
            return Margin()
        points = np.array(self._points)
        if self._forced:
            points = since_turn(points, self._sign, np.radians(self.settings.turn_deg))
        if len(points) < self.settings.fewest_points:
            return Margin()
        angles, load = points[:, 0], follow_load(points[:, 1:], self._sign)
        face = typical_face(self._faces)
        likely = likely_pressures(face)
        discs = [widen_disc(disc, face, self.settings) for disc in self._discs]
        branches = [
            fit_branch(
                angles, load, self._sign, self._guesses.get(order), self.settings, name, discs
            )._replace(by_markers=not self._measured)
            for order, name in enumerate(likely)
        ]
        # an undetermined fit is no good initial guess
        self._guesses = {
            order: one.parameters
            for order, one in enumerate(branches)
            if is_determined(one, self.settings)
        }
        weights = weigh_branches(
            branches, np.array([*likely.values()]), float(np.abs(load.along).max()), self.settings
        )
        self.branch = join_branches(branches, weights)
        lost = state in (State.MACRO_SLIP, State.UNKNOWN)
        if lost or not is_determined(self.branch, self.settings):
            return Margin()
        self.last = self.branch
        end = end_stick_ratio(contact_markers)
        travel = travel_error(face, self.settings, load.direction.twist_share)
        errors = travel, moment_error(face, self.settings)
        margin = margin_at(branches, weights, angle, end, errors)
        if self._measured:
            return margin
        return margin._replace(moment=np.nan, moment_low=np.nan, moment_high=np.nan)

    def _turn(self) -> None:
        """Begin a new branch if the object has turned back."""
        angles = np.array([angle for angle, *_ in self._points])
        least = np.radians(self.settings.turn_deg)
        if not self._sign:
            travel = angles[-1] - angles[0]
            self._sign = float(np.sign(travel)) if abs(travel) > least else 0.0
            return
        furthest = int(np.argmax(self._sign * angles))
        if self._sign * (angles[furthest] - angles[-1]) > least:
            self._points, self._faces = self._points[furthest:], self._faces[furthest:]
            self._sign, self._guesses = -self._sign, {}


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
    *,
    known: MarginPath | None = None,
    changed: Bool[np.ndarray, " frames"] | None = None,
) -> MarginPath:
    """Margins of a recording, frame by frame.

    Args:
        track: track of the chosen method.
        known: margins computed before answers were withdrawn.
        changed: frames whose answer was withdrawn, which changes the margins of later frames of the
            same contact.
    """
    faces = track.gel_thinness, track.flat_share, track.elongation
    discs = track.disc_ratio, track.disc_error, track.disc_twist
    loads = track.centre_moment, track.shear_moment_x, track.shear_moment_y
    frames = zip(
        track.state,
        map(float, track.angle),
        map(float, track.moment),
        map(float, track.gel_moment),
        map(int, track.restarts),
        map(Face, *(map(float, values) for values in faces)),
        map(StickDisc, *(map(float, values) for values in discs)),
        map(Loads, *(map(float, values) for values in loads)),
        map(int, track.contact_markers),
        strict=True,
    )
    fitted = np.ones(len(track.time), dtype=bool)
    if known is not None and changed is not None:
        fitted = _is_stale(track, changed)
        determined = np.flatnonzero(~fitted & np.isfinite(known.angle))
        fitted[determined[-1:]] = True  # gives the last branch
    tracker, margins = MarginWatch(), np.full((len(fitted), len(Margin._fields)), np.nan)
    if known is not None:
        margins[:] = np.stack(known[:-1], axis=1)
    for row, (state, angle, *others, contact) in enumerate(frames):
        tracker.add(state, angle, *others)
        if fitted[row]:
            margins[row] = tracker.predict(state, angle, contact)
    return MarginPath(*margins.T, last=tracker.last)


def _is_stale(track: Track, changed: Bool[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames at or after a changed frame of the same contact."""
    so_far = np.cumsum(changed)
    before = np.maximum.accumulate(np.where(track.free, so_far, 0))
    return so_far > before


def travel_error(face: Face, settings: MarginSettings, twist_share: float = 1.0) -> float:
    """Relative standard error of the angle at the end of a face's curve [-].

    Args:
        face: the face.
        settings: the errors.
        twist_share: share of the moment in the square of the load [-].
    """
    sheared = settings.shear_travel_error * np.sqrt(twist_share * (1.0 - twist_share))
    if not np.isfinite(face.thinness):
        return float(np.hypot(settings.travel_error, sheared))
    sheared *= 1.0 + settings.flat_shear_error * face.flat**2
    stretched = settings.elongation_error * np.log(face.elongation)
    return float(np.linalg.norm([settings.face_travel_error, stretched, sheared]))


def moment_error(face: Face, settings: MarginSettings) -> float:
    """Relative standard error of the moment that remains on a face's curve [-]."""
    if not np.isfinite(face.thinness):
        return 0.0  # several pressures are tried
    stretched = settings.stretched_moment_error * np.log(face.elongation)
    return float(np.hypot(stretched, settings.flat_moment_error * face.flat**2))


def widen_disc(disc: StickDisc, face: Face, settings: MarginSettings) -> StickDisc:
    """The disc, with the error under a flat face, on which slip moves inwards all at once."""
    if not np.isfinite(face.thinness):
        return StickDisc()
    error = np.hypot(disc.error, settings.flat_disc_error * face.flat**2)
    return disc._replace(error=float(error))


def end_stick_ratio(contact_markers: int) -> float:
    """c/a at which three of the contact's markers stick, at least that of the curves' table [-]."""
    seen = np.sqrt(max(contact_markers, MIN_STICK_MARKERS) / np.pi)  # in pitches
    ratio = THIRD_MARKER_DISTANCE[0] / seen
    return float(np.clip(ratio, LEAST_STICK_RATIO, 0.99))


def is_determined(branch: Branch, settings: MarginSettings) -> bool:
    """Whether the data determine the branch's limit."""
    far = branch.limit > 2.0 * np.pi * branch.stiffness  # the stiffness is almost 0
    return not (far or branch.covariance[0, 0] > settings.most_doubt**2)


def join_branches(branches: Sequence[Branch], weights: Float[np.ndarray, " branches"]) -> Branch:
    """The most probable branch, with the covariance over all of them."""
    best = branches[int(np.argmax(weights))]
    away = np.array([branch.parameters for branch in branches]) - best.parameters
    within = np.einsum("b,bij->ij", weights, [branch.covariance for branch in branches])
    return best._replace(covariance=within + np.einsum("b,bi,bj->ij", weights, away, away))


def margin_at(
    branches: Sequence[Branch],
    weights: Float[np.ndarray, " branches"],
    angle: float,
    end: float,
    curve_errors: tuple[float, float],
) -> Margin:
    """The margin at an angle, over all pressures: medians and 95 % intervals.

    Args:
        branches: branches fitted to the same points, one for each pressure.
        weights: their probabilities [-].
        angle: angle of the object [rad].
        end: c/a that counts as macro slip [-].
        curve_errors: relative standard errors of the twist at the end of a curve and of the moment
            that remains [-].
    """
    likely = weights > 1e-3
    margins = [
        _margin_on(branch, angle, end, curve_errors)
        for branch, counts in zip(branches, likely, strict=True)
        if counts
    ]
    middles, errors = np.swapaxes(np.array(margins), 0, 1)
    values = []
    for middle, error in zip(middles.T, errors.T, strict=True):
        values += _quantiles(middle, error, weights[likely], (0.5, 0.025, 0.975))
    return Margin(*values)


def _margin_on(
    branch: Branch, angle: float, end: float, curve_errors: tuple[float, float]
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Remaining angle [rad] and moment [N·mm] on a branch, and their standard errors."""
    travel = max(branch.sign * (angle - branch.start), 0.0)
    best = branch.parameters
    steps = np.diag([1e-3, 1e-3, 1e-3 * branch.limit])
    middle = margin_after(branch, best, travel, end)
    slope = np.stack(
        [(margin_after(branch, best + s, travel, end) - middle) / s.sum() for s in steps], axis=1
    )
    variance = np.einsum("ip,pq,iq->i", slope, branch.covariance, slope).clip(0.0)
    spread = THIRD_MARKER_DISTANCE[1] / THIRD_MARKER_DISTANCE[0]
    variance += (margin_after(branch, best, travel, end * (1.0 - spread)) - middle) ** 2
    variance[0] += (curve_errors[0] * (travel + middle[0])) ** 2
    variance[1] += branch.rms**2 + (curve_errors[1] * middle[1]) ** 2
    # the moment's share of the load that remains, and its error
    turning, rise, *_ = branch.direction
    rise, bend = max(rise, 0.0), 0.5 * abs(turning - rise)
    variance[1] = rise**2 * variance[1] + (bend * middle[1]) ** 2
    return np.array([1.0, rise]) * middle, np.sqrt(variance)


def _quantiles(
    middle: Float[np.ndarray, " branches"],
    error: Float[np.ndarray, " branches"],
    weights: Float[np.ndarray, " branches"],
    shares: tuple[float, ...],
) -> list[float]:
    """Quantiles of a mixture of normal distributions, at least 0."""
    reach = 4.0 * np.maximum(error, 1e-12)
    at = np.linspace(np.min(middle - reach), np.max(middle + reach), 400)
    below = weights @ ndtr((at - middle[:, None]) / np.maximum(error, 1e-12)[:, None])
    return [max(float(value), 0.0) for value in np.interp(shares, below, at)]
