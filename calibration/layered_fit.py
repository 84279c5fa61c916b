"""k of an object on an elastomer of finite thickness, from angles known from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from calibration.field_fit import Z95, invert_information
from estimation.estimators.measurement import Z95 as HALF_WIDTH
from estimation.layered_softness import LayeredSoftness, Matrix, missed_rotation
from estimation.noise import Noise
from estimation.recording import Recording
from estimation.result import State
from estimation.softness import Contact, ScalarSoftness, Validity
from estimation.tracker import RIGID_OBJECT, Tracker

LEAST_STICK = 10
METHOD = "incremental"
_LEAST_TURN = np.radians(0.5)  # of the elastomer, below which a frame says little about k
_OUTLIER = 2.0  # standard errors at which a residual begins to count less
_FILTER_SHARE = 0.01  # of the angle: what the correction itself may be off by
_LEARNT = 0.7  # of what was known beforehand; less is counted as told by the turns


class Turn(NamedTuple):
    """One frame whose object's angle is known.

    Attributes:
        rotation: φ of what sticks [rad].
        error: its standard error [rad].
        contact: of the frame.
        reference: the object's angle [rad].
    """

    rotation: float
    error: float
    contact: Contact
    reference: float


@dataclass(frozen=True)
class LayeredFit:
    """What was found.

    Attributes:
        softness: to apply.
        low: lower ends of the 95 % intervals of k, thickness and depth.
        high: upper ends.
        determined: whether each was told by the turns, not by what was known beforehand.
        residual: of the object's angle in each turn [rad].
    """

    softness: LayeredSoftness
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    determined: Bool[np.ndarray, "3"]
    residual: Float[np.ndarray, " turns"]


class _Listener:
    """A softness that corrects nothing and keeps what it is asked about."""

    stiffness_ratio = 0.0

    def __init__(self) -> None:
        self.contact: Contact | None = None

    def at(self, contact: Contact) -> ScalarSoftness:
        self.contact = contact
        return RIGID_OBJECT

    def content(self) -> dict:
        return {}


def gather_turns(
    recording: Recording, reference: Float[np.ndarray, " frames"], noise: Noise | None = None
) -> list[Turn]:
    """The frames of a recording that tell k: what sticks, turned by half a degree or more.

    Args:
        recording: of an object that turns in the grasp, from the unloaded state on.
        reference: the object's angle in each frame, NaN where unknown [rad].
        noise: of the markers; without it errors come from the misfit within each frame.
    """
    listener = _Listener()
    tracker = Tracker(recording.layout, METHOD, noise=noise, softness=listener)
    turns = []
    for frame, angle in zip(recording, reference, strict=True):
        found = tracker.update(frame)
        holds = found.state in (State.STICK, State.INCIPIENT)
        if not holds or listener.contact is None or found.stick.sum() < LEAST_STICK:
            continue
        if np.isfinite(angle) and abs(found.angle) >= _LEAST_TURN:
            error = 0.5 * (found.high - found.low) / HALF_WIDTH
            turns.append(Turn(found.angle, error, listener.contact, float(angle)))
    return turns


def fit_layered_softness(
    turns: Sequence[Turn],
    thickness: tuple[float, float],
    depth: tuple[float, float] = (0.0, 0.0),
    *,
    reference_error: float = 1e-3,
) -> LayeredFit:
    """Fit k, and refine thickness and depth as far as the turns tell more than was known.

    Args:
        turns: of one object, several grasps at once.
        thickness: of the elastomer and its standard deviation, 0 where exact [mm].
        depth: of the markers and its standard deviation [mm].
        reference_error: standard deviation of the reference [rad].

    Raises:
        ValueError: too few turns.
    """
    if len(turns) < 3:
        raise ValueError(
            f"{len(turns)} frames in which {LEAST_STICK} markers stick and the elastomer has "
            "turned by 0.5° or more; at least 3 are needed: press harder, or turn the object more"
        )
    priors = (thickness, depth)
    free = [i for i, (_, spread) in enumerate(priors) if spread > 0.0]
    means, spreads = (np.array([priors[i][j] for i in free]) for j in (0, 1))
    phi, error, angle = (np.array([getattr(t, n) for t in turns]) for n in _COLUMNS)

    def unpack(x: np.ndarray) -> tuple[float, float, float]:
        whole = [mean for mean, _ in priors]
        for i, value in zip(free, x[1:], strict=True):
            whole[i] = value
        return float(x[0]), whole[0], whole[1]

    def rest(x: np.ndarray) -> np.ndarray:
        k, h, z = unpack(x)
        below, thin = np.array([missed_rotation(t.contact, h, z) for t in turns]).T
        return (1.0 + k) * phi + below + k * thin - angle

    def residual(x: np.ndarray) -> np.ndarray:
        sigma = np.hypot((1.0 + x[0]) * error, np.hypot(reference_error, _FILTER_SHARE * angle))
        return np.concatenate([rest(x) / sigma, (x[1:] - means) / spreads])

    guess = max(float(np.median(angle / phi)) / 1.2 - 1.0, 0.05)  # a thin one turns more
    low = [0.0, *((1e-3, 0.0)[i] for i in free)]
    high = [np.inf, *((np.inf, 0.9 * thickness[0])[i] for i in free)]
    found = least_squares(
        residual,
        np.clip([guess, *means], low, high),
        bounds=(low, high),
        x_scale="jac",
        loss="soft_l1",
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
        errors < _LEARNT * np.array([np.inf, thickness[1], depth[1]]),
        rest(found.x),
    )


_COLUMNS = ("rotation", "error", "reference")


def _rows(matrix: np.ndarray) -> Matrix:
    return tuple(tuple(row) for row in matrix.tolist())


def _validity(turns: Sequence[Turn]) -> Validity:
    """The contacts that the turns were seen in."""
    phi = [turn.rotation for turn in turns]
    radius = [turn.contact.radius for turn in turns]
    return Validity(
        rotation=(min(0.0, *phi), max(0.0, *phi)), contact_radius=(min(radius), max(radius))
    )
