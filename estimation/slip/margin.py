"""How far a contact is from macro slip: the moment against the angle, followed to its end.

Under a constant load the moment of a Hertz-like contact follows Lubkin's curve on first loading and
the same curve enlarged twice after a reversal ([Lubkin1951], [Masing1926]). Limit, stiffness and
the moment at which the branch began are fitted to what the branch has shown so far.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from contactmodel.analytic import lubkin_moment, lubkin_twist
from estimation.estimators.measurement import Z95
from estimation.estimators.result import State, Track
from estimation.fields.stick import MIN_STICK_MARKERS

LEAST_STICK_RATIO = 0.1
"""c/a to which Lubkin's curve is followed [-]; it never ends."""

THIRD_MARKER = (0.91, 0.092)
"""Distance of the third-nearest marker of a square grid from a point, in pitches: mean and standard
deviation over the points."""


@dataclass(frozen=True)
class MarginSettings:
    """How branches of moment against angle are found and fitted.

    Attributes:
        turn_deg: rotation back by which a reversal is believed, and forth by which a branch has
            begun [°].
        least_points: points of a branch from which it is fitted [-].
        most_points: a branch of twice as many points is thinned to half of them [-].
        largest_limit: limit over the largest moment seen that a fit may reach [-].
        most_doubt: standard error of the limit's logarithm from which the data cannot tell [-].
        noise_frames: over which the noise is correlated [frames].
    """

    turn_deg: float = 1.0
    least_points: int = 12
    most_points: int = 60
    largest_limit: float = 10.0
    most_doubt: float = 0.25
    noise_frames: float = 3.0


DEFAULT_SETTINGS = MarginSettings()


class Branch(NamedTuple):
    """The branch that an object turns on.

    Attributes:
        start: angle at which it began [rad].
        sign: which way it turns, ±1.
        limit: moment of full slip [N·mm].
        stiffness: dM/dθ without slip [N·mm/rad].
        start_moment: moment at its start, along the turn; below 0 after a reversal [N·mm].
        covariance: of ln limit, ln stiffness and start moment.
        rms: of what the fit leaves [N·mm].
        points: measured points in the fit.
    """

    start: float
    sign: float
    limit: float
    stiffness: float
    start_moment: float
    covariance: Float[np.ndarray, "3 3"]
    rms: float
    points: int

    @classmethod
    def read(cls, content: Mapping[str, Any]) -> "Branch":
        """A branch as `write` gave it."""
        told: dict[str, Any] = {**content, "covariance": np.array(content["covariance"])}
        return cls(**told)

    def write(self) -> dict[str, Any]:
        """The branch, ready for JSON."""
        return self._asdict() | {"covariance": self.covariance.tolist()}

    @property
    def parameters(self) -> Float[np.ndarray, " 3"]:
        """Ln limit, ln stiffness and start moment, what the fit varies."""
        return np.array([np.log(self.limit), np.log(self.stiffness), self.start_moment])

    def moment(self, angle: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Moment at angles on the branch [N·mm]."""
        travel = np.maximum(self.sign * (angle - self.start), 0.0)
        return self.sign * _branch_moment(self.parameters, travel)


class Margin(NamedTuple):
    """What is left before macro slip; NaN where the data cannot tell.

    Attributes:
        angle_left: rotation left [rad].
        angle_low: lower end of its 95 % interval [rad].
        angle_high: upper end [rad].
        moment_left: moment left [N·mm].
        moment_low: lower end of its 95 % interval [N·mm].
        moment_high: upper end [N·mm].
    """

    angle_left: float = np.nan
    angle_low: float = np.nan
    angle_high: float = np.nan
    moment_left: float = np.nan
    moment_low: float = np.nan
    moment_high: float = np.nan


class MarginTracker:
    """Follows angle and moment frame by frame; the cost of a frame is bounded.

    Attributes:
        branch: as known now; None if the data cannot tell one.
        last: as known in the last frame that had a margin.
    """

    def __init__(self, settings: MarginSettings = DEFAULT_SETTINGS) -> None:
        """Begin with nothing known."""
        self.settings = settings
        self.last: Branch | None = None
        self.restart()

    def restart(self) -> None:
        """Begin with nothing known: the object has left."""
        self._points: list[tuple[float, float]] = []
        self._sign = 0.0
        self._guess: Float[np.ndarray, " 3"] | None = None
        self.branch: Branch | None = None

    def follow(self, state: State, angle: float, moment: float, contact_markers: int) -> Margin:
        """What is left after a frame in some state; NaN without contact and in macro slip.

        Args:
            state: of the contact.
            angle: as for `update`, and so the next two.
            moment: about the normal [N·mm].
            contact_markers: markers in contact.
        """
        if state == State.NO_CONTACT:
            self.restart()
            return Margin()
        margin = self.update(angle, moment, contact_markers)
        if state == State.MACRO_SLIP:
            return Margin()
        if np.isfinite(margin.angle_left):
            self.last = self.branch
        return margin

    def update(self, angle: float, moment: float, contact_markers: int) -> Margin:
        """What is left after a frame.

        Args:
            angle: of the object [rad].
            moment: about the normal [N·mm].
            contact_markers: markers in contact; macro slip is when fewer than three of them stick.
        """
        if not self.pass_by(angle, moment):
            return Margin()
        angles, moments = np.array(self._points).T
        self.branch = fit_branch(angles, moments, self._sign, self._guess, self.settings)
        margin = margin_at(self.branch, angle, end_stick_ratio(contact_markers), self.settings)
        # a fit that could not tell is no place to start from
        self._guess = self.branch.parameters if np.isfinite(margin.angle_left) else None
        return margin

    def pass_by(self, angle: float, moment: float) -> bool:
        """Keep the point of a frame, whose margin is not asked for; whether there are enough."""
        if not np.isfinite(angle + moment):
            return False
        self._points.append((angle, moment))
        self._turn()
        if len(self._points) > 2 * self.settings.most_points:
            del self._points[1:-1:2]
        self.branch = None
        return bool(self._sign) and len(self._points) >= self.settings.least_points

    def _turn(self) -> None:
        """Begin a new branch where the object has turned back."""
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
    """Margin and branch after every frame of a recording, from that and earlier frames only.

    Attributes:
        margins: by frame; NaN in macro slip.
        last: the branch as known in the last frame that has a margin; None if there is none.
    """

    margins: list[Margin]
    last: Branch | None


def follow_margin(
    track: Track,
    settings: MarginSettings = DEFAULT_SETTINGS,
    known: Sequence[Margin] | None = None,
    changed: Bool[np.ndarray, " frames"] | None = None,
) -> MarginPath:
    """Margins of a recording, frame by frame.

    Args:
        track: of the chosen method.
        settings: of the fits.
        known: margins found before answers were withdrawn.
        changed: frames whose answer was withdrawn; they change the margins of their contact's later
            frames.
    """
    frames = zip(
        track.state,
        track.angle.tolist(),
        track.moment.tolist(),
        track.contact_markers.tolist(),
        strict=True,
    )
    fitted = np.ones(len(track.time), dtype=bool)
    if known is not None and changed is not None:
        fitted = _is_stale(track, changed)
        told = np.flatnonzero(~fitted & np.isfinite([left.angle_left for left in known]))
        fitted[told[-1:]] = True  # for the branch
    tracker, margins = MarginTracker(settings), list[Margin]()
    for row, (state, angle, moment, contact) in enumerate(frames):
        if fitted[row] or known is None:
            margins.append(tracker.follow(state, angle, moment, contact))
            continue
        margins.append(known[row])
        if state == State.NO_CONTACT:
            tracker.restart()
        else:
            tracker.pass_by(angle, moment)
    return MarginPath(margins, tracker.last)


def _is_stale(track: Track, changed: Bool[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames of contacts in which a frame was changed, from that on."""
    free = np.array([state == State.NO_CONTACT for state in track.state])
    so_far = np.cumsum(changed)
    before = np.maximum.accumulate(np.where(free, so_far, 0))
    return so_far > before


def fit_branch(
    angle: Float[np.ndarray, " points"],
    moment: Float[np.ndarray, " points"],
    sign: float,
    guess: Float[np.ndarray, " 3"] | None = None,
    settings: MarginSettings = DEFAULT_SETTINGS,
) -> Branch:
    """Fit limit, stiffness and first moment of the branch through measured points.

    Args:
        angle: object's angle, from the branch's start on [rad].
        moment: at these angles [N·mm].
        sign: which way the branch turns, ±1.
        guess: ln limit, ln stiffness and first moment to start from.
        settings: of the fit.
    """
    travel = np.maximum(sign * (angle - angle[0]), 0.0)
    along = sign * moment
    largest = max(float(np.abs(along).max()), 1e-6)
    if guess is None:
        rise = max(float(np.ptp(along)), 1e-3 * largest) / max(float(travel.max()), 1e-6)
        guess = np.array([np.log(1.2 * largest), np.log(1.5 * rise), along[0]])
    highest = np.log(largest) + np.log(settings.largest_limit)
    guess = np.append(min(guess[0], highest - 0.1), guess[1:])
    solution = least_squares(
        lambda parameters: (_branch_moment(parameters, travel) - along) / largest,
        guess,
        bounds=([-np.inf] * 3, [highest, np.inf, np.inf]),
        x_scale=[0.1, 0.1, 0.1 * largest],
        diff_step=1e-3,
        max_nfev=30,
    )
    left = solution.fun * largest
    rms = float(np.sqrt(np.mean(left**2)))
    free = max(len(travel) / settings.noise_frames - 3.0, 1.0)
    variance = rms**2 * len(travel) / free
    covariance = np.linalg.pinv(solution.jac.T @ solution.jac) * variance / largest**2
    limit, stiffness, start_moment = solution.x
    return Branch(
        start=float(angle[0]),
        sign=sign,
        limit=float(np.exp(limit)),
        stiffness=float(np.exp(stiffness)),
        start_moment=float(start_moment),
        covariance=covariance,
        rms=rms,
        points=len(travel),
    )


def end_stick_ratio(contact_markers: int) -> float:
    """c/a at which three of the contact's markers stick, at least that of Lubkin's table [-]."""
    radius = np.sqrt(max(contact_markers, MIN_STICK_MARKERS) / np.pi)  # in pitches
    return float(np.clip(THIRD_MARKER[0] / radius, LEAST_STICK_RATIO, 0.99))


def margin_at(
    branch: Branch, angle: float, end: float, settings: MarginSettings = DEFAULT_SETTINGS
) -> Margin:
    """What the branch has left at an angle on it; nothing while its limit cannot be told.

    Args:
        branch: the branch.
        angle: of the object [rad].
        end: c/a that counts as macro slip [-].
        settings: when the limit cannot be told.
    """
    if branch.covariance[0, 0] > settings.most_doubt**2:
        return Margin()
    travel = max(branch.sign * (angle - branch.start), 0.0)
    best = branch.parameters
    steps = np.array([1e-3, 1e-3, 1e-3 * branch.limit])
    middle = _left(best, travel, end)
    slope = np.stack(
        [(_left(best + step, travel, end) - middle) / step.sum() for step in np.diag(steps)],
        axis=1,
    )
    variance = np.einsum("ip,pq,iq->i", slope, branch.covariance, slope).clip(0.0)
    spread = THIRD_MARKER[1] / THIRD_MARKER[0]
    variance += (_left(best, travel, end * (1.0 - spread)) - middle) ** 2
    half = Z95 * np.sqrt(variance)
    # measured and fitted moment differ by the rms; the interval of the moment has it
    half[1] = np.hypot(half[1], Z95 * branch.rms)
    low, high = np.maximum(middle - half, 0.0), np.maximum(middle + half, 0.0)
    middle = np.maximum(middle, 0.0)
    pairs = np.stack([middle, low, high], axis=1).ravel()
    return Margin(*(float(value) for value in pairs))


def _left(
    parameters: Float[np.ndarray, " 3"], travel: float, end: float
) -> Float[np.ndarray, " 2"]:
    """Angle and moment left at a travel along the branch, below 0 beyond its end."""
    limit, stiffness = np.exp(parameters[:2])
    x, _ = _virgin()
    last = float(np.interp(-end, -_stick_ratios(), x))
    start = _virgin_inverse(parameters[2] / limit)
    # beyond twice the start the branch is the first-loading curve
    ends = (last - start if last >= -start else 2.0 * last) * limit / stiffness
    now = _branch_moment(parameters, np.array([travel]))[0]
    at_end = _branch_moment(parameters, np.array([ends]))[0]
    return np.array([ends - travel, at_end - now])


def _branch_moment(
    parameters: Float[np.ndarray, " 3"], travel: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    """Moment along a branch that began at any moment: Masing's rule, then the first-loading curve.

    A branch that began loaded against its turn is enlarged twice until that load is undone and
    mirrored; from there on, and from the start otherwise, it is the first-loading curve.
    """
    limit, stiffness = np.exp(parameters[:2])
    first = parameters[2] / limit
    start = _virgin_inverse(first)
    x = travel * stiffness / limit
    virgin = np.sign(start + x) * _virgin_at(np.abs(start + x))
    if first < 0.0:
        virgin = np.where(x < -2.0 * start, first + 2.0 * _virgin_at(0.5 * x), virgin)
    return limit * virgin


def _virgin_at(x: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """M over its limit, at θ times stiffness over limit, x ≥ 0."""
    twist, moment = _virgin()
    # beyond the table less is left to the limit than at its end
    return np.interp(x, twist, moment)


def _virgin_inverse(moment: float) -> float:
    """Where the first-loading curve has a moment of either sign, as far as its end."""
    x, y = _virgin()
    return float(np.sign(moment) * np.interp(abs(moment), y, x))


def _stick_ratios() -> Float[np.ndarray, " points"]:
    """c/a of the table's points."""
    return np.geomspace(1.0, LEAST_STICK_RATIO, 600)


@cache
def _virgin() -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Lubkin's curve with limit 1 and slope 1 at the origin, to the least stick ratio."""
    kappa = _stick_ratios()
    share = 3.0 * np.pi / 16.0
    twist = np.asarray(lubkin_twist(kappa, 1.0), dtype=float) * (4.0 / np.pi) / share
    moment = np.asarray(lubkin_moment(kappa, 1.0, 1.0, 1.0), dtype=float) / share
    twist[0] = moment[0] = 0.0
    return twist, moment
