"""k of an object on an elastomer of finite thickness, from angles known from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from calibration.information import Z95, invert_information
from calibration.softness.checks import check_sensors
from calibration.softness.layered_checks import check_turns
from calibration.softness.references import Reference
from calibration.softness.trials import stands_still
from estimation.estimators.measurement import Z95 as HALF_WIDTH
from estimation.noise import Noise
from estimation.recording import Recording
from estimation.result import State
from estimation.softness import Contact, Lifting, ScalarSoftness, Validity
from estimation.softness.layered import LayeredSoftness, Matrix
from estimation.softness.lifting import Added, lifting_turns
from estimation.tracker import RIGID_OBJECT, Tracker

LEAST_STICK = 6  # few markers have wide intervals and count little
METHOD = "incremental"
_LEAST_TURN = np.radians(0.5)  # of the elastomer, below which a frame says little about k
_OUTLIER = 2.0  # standard errors from which a frame counts less, far beyond hardly anything
_FILTER_SHARE = 0.005  # of the angle: what the lifting itself may be off by
_GUESSES = (0.1, 0.5, 1.5)  # k for which frames are lifted at first
_ROUNDS = 2
_MOST_SLIPPING = 2.0 / 3.0  # of the frames of a grasp
_LEARNT = 0.7  # of what was known beforehand; less is counted as told by the turns


class Turn(NamedTuple):
    """One frame whose object's angle is known.

    Attributes:
        rotation: φ of what sticks, in the frame as it was lifted for `at` [rad].
        error: its standard error [rad].
        at: k, thickness and depth that it was lifted for.
        contact: of the frame; `as_seen` is what its markers showed.
        points: the markers in the unloaded elastomer [mm].
        reference: the object's angle [rad].
    """

    rotation: float
    error: float
    at: tuple[float, float, float]
    contact: Contact
    points: Float[np.ndarray, "n 2"]
    reference: float

    @property
    def markers(self) -> int:
        """How many stick."""
        return 0 if self.contact.stick is None else int(self.contact.stick.sum())


@dataclass(frozen=True)
class LayeredFit:
    """What was found.

    Attributes:
        softness: to apply.
        low: lower ends of the 95 % intervals of k, thickness and depth.
        high: upper ends.
        determined: whether each was told by the turns, not by what was known beforehand.
        slipping: frames left out, in which the gel stood still under the turning object.
        reference: the object's angle in each turn [rad].
        residual: of it [rad].
    """

    softness: LayeredSoftness
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    determined: Bool[np.ndarray, "3"]
    slipping: int
    reference: Float[np.ndarray, " turns"]
    residual: Float[np.ndarray, " turns"]


class Grasp(NamedTuple):
    """A recording of an object that turns in the grasp, and its angle.

    Attributes:
        recording: from the unloaded state on.
        reference: the object's angle in each frame, NaN where unknown [rad].
        noise: of the markers; None to take the misfit within each frame.
    """

    recording: Recording
    reference: Float[np.ndarray, " frames"]
    noise: Noise | None = None


class _Listener:
    """A softness that lifts frames and keeps what it is asked about."""

    def __init__(self, softness: LayeredSoftness) -> None:
        self.softness = softness
        self.contact: Contact | None = None

    @property
    def stiffness_ratio(self) -> float:
        return self.softness.stiffness_ratio

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> Lifting | None:
        return self.softness.lifting(points)

    def at(self, contact: Contact) -> ScalarSoftness:
        self.contact = contact
        return RIGID_OBJECT

    def content(self) -> dict:
        return {}


class Turns(NamedTuple):
    """What a grasp tells of k.

    Attributes:
        told: the frames in which what sticks has turned by half a degree or more.
        slipping: number of such frames left out, the gel standing still under the object.
    """

    told: list[Turn]
    slipping: int


def gather_turns(grasp: Grasp, guess: LayeredSoftness) -> Turns:
    """The frames of a recording that tell k.

    Args:
        grasp: recording and reference.
        guess: what its frames are lifted for; soft objects on thin elastomers do not seem to stick
            to markers that are not lifted.
    """
    recording, angle = grasp.recording, grasp.reference
    listener = _Listener(guess)
    tracker = Tracker(recording.layout, METHOD, noise=grasp.noise, softness=listener)
    at = (guess.stiffness_ratio, guess.thickness, guess.depth)
    points = recording.layout.reference[:, :2]
    turns: dict[int, Turn] = {}
    rotation = np.full(len(recording), np.nan)
    for number, frame in enumerate(recording):
        found = tracker.update(frame)
        holds = found.state in (State.STICK, State.INCIPIENT)
        if not holds or listener.contact is None or found.stick.sum() < LEAST_STICK:
            continue
        rotation[number] = found.angle
        if np.isfinite(angle[number]) and abs(found.angle) >= _LEAST_TURN:
            error = 0.5 * (found.high - found.low) / HALF_WIDTH
            turns[number] = Turn(
                found.angle, error, at, listener.contact, points, float(angle[number])
            )
    unknown = np.full(len(recording), np.nan)
    reference = Reference(recording.time, angle, unknown, True, True, "reference")
    still = stands_still(recording.time, rotation, reference)
    told = [turn for number, turn in turns.items() if not still[number]]
    return Turns(told, len(turns) - len(told))


def fit_layered_softness(
    grasps: Sequence[Grasp],
    thickness: tuple[float, float],
    depth: tuple[float, float] = (0.0, 0.0),
    *,
    reference_error: float = 1e-3,
) -> LayeredFit:
    """Fit k, and refine thickness and depth as far as the grasps tell more than was known.

    What sticks is sought in frames lifted for several k, and, after a first fit with the k that
    holds most markers together, in frames lifted for what was found. Frames in slip that nobody
    saw read low by many times their errors, and lose their weight.

    Args:
        grasps: of one object, several at once.
        thickness: of the elastomer and its standard deviation, 0 where exact [mm].
        depth: of the markers and its standard deviation [mm].
        reference_error: standard deviation of the reference [rad].

    Raises:
        ValueError: too few frames in which the object turns and sticks, grasps of different
            sensors, or a reference that is not the object's angle.
    """
    best: list[Turns] = []
    most = -1
    lifted = np.isfinite(thickness[0]) or depth[0] > 0.0  # else frames are the same for all k
    for k in _GUESSES if lifted else _GUESSES[:1]:
        guess = LayeredSoftness(k, thickness[0], depth[0])
        found = [gather_turns(grasp, guess) for grasp in grasps]
        held = sum(turn.markers for turns in found for turn in turns.told)
        if held > most:
            best, most = found, held
    _check(grasps, best)
    fit = None
    for _ in range(_ROUNDS if lifted else 1):
        found = best if fit is None else [gather_turns(one, fit.softness) for one in grasps]
        turns = [turn for part in found for turn in part.told]
        if len(turns) < 3:
            raise ValueError(
                f"{len(turns)} frames in which {LEAST_STICK} markers stick and the elastomer has "
                "turned by 0.5° or more; at least 3 are needed: press harder, or turn the object "
                "more"
            )
        slipping = sum(part.slipping for part in found)
        fit = _fit_turns(turns, slipping, (thickness, depth), reference_error)
    assert fit is not None
    return fit


def _check(grasps: Sequence[Grasp], found: Sequence[Turns]) -> None:
    """See that all are of one sensor and follow their references."""
    trials = []
    for grasp, turns in zip(grasps, found, strict=True):
        if turns.slipping > _MOST_SLIPPING * (len(turns.told) + turns.slipping):
            raise ValueError(
                f"{grasp.recording.name}: in {turns.slipping} of "
                f"{len(turns.told) + turns.slipping} frames the gel stands still while the "
                "reference turns: it does not follow this object, or most of the recording is "
                "slip. Check that both are of one grasp and on one clock, or press harder"
            )
        values = (np.array([getattr(turn, name) for turn in turns.told]) for name in _COLUMNS)
        trials.append(check_turns(grasp.recording, *values))
    if trials:
        check_sensors(trials)


def _fit_turns(
    turns: Sequence[Turn],
    slipping: int,
    priors: Sequence[tuple[float, float]],
    reference_error: float,
) -> LayeredFit:
    """Fit the numbers to turns whose markers that stick are taken as known."""
    free = [i for i, (_, spread) in enumerate(priors) if spread > 0.0]
    means, spreads = (np.array([priors[i][j] for i in free]) for j in (0, 1))
    phi, error, angle = (np.array([getattr(t, n) for t in turns]) for n in _COLUMNS)
    lifts = [_Lift.of(turn) for turn in turns]
    there = np.array([lift.turn(*turn.at) for lift, turn in zip(lifts, turns, strict=True)])

    def unpack(x: np.ndarray) -> tuple[float, float, float]:
        whole = [mean for mean, _ in priors]
        for i, value in zip(free, x[1:], strict=True):
            whole[i] = value
        return float(x[0]), whole[0], whole[1]

    def rest(x: np.ndarray) -> np.ndarray:
        here = np.array([lift.turn(*unpack(x)) + lift.load(*unpack(x)) for lift in lifts])
        return (1.0 + x[0]) * (phi + here - there) - angle

    def residual(x: np.ndarray) -> np.ndarray:
        sigma = np.hypot((1.0 + x[0]) * error, np.hypot(reference_error, _FILTER_SHARE * angle))
        return np.concatenate([rest(x) / sigma, (x[1:] - means) / spreads])

    guess = max(_weighted_median(angle / phi, np.abs(phi) / error) - 1.0, 0.01)
    low = [0.0, *((1e-3, 0.0)[i] for i in free)]
    high = [np.inf, *((np.inf, 0.9 * priors[0][0])[i] for i in free)]
    found = least_squares(
        residual,
        np.clip([guess, *means], low, high),
        bounds=(low, high),
        x_scale="jac",
        loss="arctan",
        f_scale=_OUTLIER,
    )
    small, _ = invert_information(found.jac.T @ found.jac)
    places = [0, *(1 + i for i in free)]
    covariance = np.zeros((3, 3))
    covariance[np.ix_(places, places)] = 0.5 * (small + small.T)
    values, errors = np.array(unpack(found.x)), np.sqrt(np.diag(covariance))
    return LayeredFit(
        LayeredSoftness(
            *values.tolist(),
            covariance=_rows(covariance),
            validity=_validity(turns),
            provenance={"turns": len(turns), "contactmodel": version("contactmodel")},
        ),
        values - Z95 * errors,
        values + Z95 * errors,
        errors < _LEARNT * np.array([np.inf, priors[0][1], priors[1][1]]),
        slipping,
        angle,
        rest(found.x),
    )


_COLUMNS = ("rotation", "error", "reference")


class _Lift:
    """The rotation of the markers that stick in one frame, lifted for any k, thickness, depth."""

    def __init__(self, at: np.ndarray, points: np.ndarray, moved: np.ndarray) -> None:
        self.at, self.points, self.moved = at, points, moved
        self._known: tuple[tuple[float, float], Added] | None = None

    @classmethod
    def of(cls, turn: Turn) -> "_Lift":
        stick, moved = turn.contact.stick, turn.contact.as_seen
        if stick is None or moved is None:  # a half-space's frames are seen as they are
            moved = turn.contact.fields.displacement[:, :2]
        stick = turn.contact.fields.contact if stick is None else stick
        known = np.isfinite(moved[:, 0])
        return cls(turn.points[stick & known], turn.points[known], moved[known])

    def turn(self, k: float, thickness: float, depth: float) -> float:
        """What lifting adds to the rotation, without what longitudinal waves do [rad]."""
        turns = self._turns(thickness, depth)
        return turns.below + k / (1.0 + k) * turns.thin

    def load(self, k: float, thickness: float, depth: float) -> float:
        """What longitudinal waves add to it [rad]."""
        return k / (1.0 + k) * self._turns(thickness, depth).along

    def _turns(self, thickness: float, depth: float) -> Added:
        if self._known is None or self._known[0] != (thickness, depth):
            turns = lifting_turns(self.at, self.points, self.moved, thickness, depth)
            self._known = (thickness, depth), turns
        return self._known[1]


def _weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _rows(matrix: np.ndarray) -> Matrix:
    return tuple(tuple(row) for row in matrix.tolist())


def _validity(turns: Sequence[Turn]) -> Validity:
    """The contacts that the turns were seen in."""
    phi = [turn.rotation for turn in turns]
    radius = [turn.contact.radius for turn in turns]
    return Validity(
        rotation=(min(0.0, *phi), max(0.0, *phi)), contact_radius=(min(radius), max(radius))
    )
