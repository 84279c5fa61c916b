"""How large the core is that still sticks, to a fraction of the markers' pitch.

What slips under a constant load keeps its traction, friction times pressure. What changes while the
object turns on is therefore the traction of the core alone, and the gel moves as under a disc that
is glued to it and turned, its radius shrinking: the field of Reissner and Sagoci outside
([Johnson1985] K. L. Johnson, "Contact Mechanics", Section 3.9). Markers that slip tell in this way
how many still stick, and how far they turn, when those few no longer tell it themselves.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.optimize import OptimizeResult, least_squares

from estimation.estimators.plane import fit_motion, in_contact_plane
from estimation.fields import Fields
from estimation.stencils import Stencils

WINDOW = 12
"""Frames over which the gel's motion is taken."""

LARGEST = 20
"""Markers that stick, from which on they tell the rotation themselves."""

MOST_DOUBT = 0.1
"""Standard error of the radius beyond which the data do not tell it, by the pitch [-]."""

WORST_FIT = 1.3
"""Misfit beyond which it is no disc that turns, by the noise [-]."""

MOST_JUMP = 0.3
"""Change of the radius from frame to frame beyond which it is not followed, by the pitch [-]."""

_SHRINKS, _SHRINK_DOUBT = 0.4, 0.3  # ln(radius before / now), as expected
_CENTRE_DOUBT = 0.3, 0.05  # of the first centre and from window to window, by the pitch
_WELL = 0.5 * 1.1**2  # cost by the number of residuals up to which a fit needs no other start
_RESTARTS = np.array([[1, 1, 1, 1, 1, f, 1] for f in (0.85, 1.18)])
_SHARPEST = 0.05  # cosine at the rim
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Core(NamedTuple):
    """A disc that sticks while what surrounds it slips.

    Attributes:
        radius: of the disc now [mm].
        radius_error: its standard error [mm].
        turn: rotation of the gel under it since the window began [rad].
        centre: in the contact's plane, x + iy [mm].
        misfit: root mean square by the noise [-].
        markers: those in contact that are within the radius.
    """

    radius: float
    radius_error: float
    turn: float
    centre: complex
    misfit: float
    markers: Bool[np.ndarray, " n"]


class CoreTracker:
    """Fits the core over a sliding window of frames, each time from the last."""

    def __init__(self, stencils: Stencils, noise_mm: float) -> None:
        """Make a tracker.

        Args:
            stencils: of the layout.
            noise_mm: noise per in-plane coordinate and frame [mm]; 0 where unknown, no fit then.
        """
        self.stencils = stencils
        self.noise_mm = np.sqrt(2.0) * noise_mm
        reach = np.linalg.norm(stencils.offsets, axis=2)
        self.pitch = float(np.median(reach[stencils.neighbours >= 0]))
        self._frames: deque[Fields] = deque(maxlen=WINDOW + 1)
        self._last: Float[np.ndarray, " 7"] | None = None

    def restart(self) -> None:
        """Forget everything: the object has left."""
        self._frames.clear()
        self._last = None

    def update(self, fields: Fields, stick: Bool[np.ndarray, " n"]) -> Core | None:
        """The core after the next frame.

        Args:
            fields: of the frame.
            stick: markers that seem to stick.

        Returns:
            None where many markers stick, where the gel has moved too little to tell, where it does
            not move as under a disc that turns, and in the first frame of those where it does.
        """
        self._frames.append(fields)
        full = len(self._frames) == self._frames.maxlen
        if not full or not 0 < stick.sum() <= LARGEST or not self.noise_mm:
            self._last = None
            return None
        since = self._frames[0]
        before, after = in_contact_plane(self.stencils, fields, stick, since)
        seen = fields.contact & since.contact & np.isfinite(before + after)
        if seen.sum() < LARGEST:
            return None
        place, motion = 0.5 * (before + after), after - before
        first = self._last is None
        guess = self._guess(place[stick], motion[stick]) if self._last is None else self._last
        doubt = self.pitch * _CENTRE_DOUBT[0 if first else 1]
        known = (place[seen], motion[seen], self.noise_mm, guess[3:5], doubt)
        found = _fit(guess, known)
        if found.cost > _WELL * found.fun.size:  # the markers' cells make local minima
            others = [_fit(guess * factors, known) for factors in _RESTARTS]
            found = min([found, *others], key=lambda one: one.cost)
        misfit = float(np.sqrt(2.0 * found.cost / found.fun.size))
        error = max(misfit, 1.0) * _errors(found.jac)[5]
        if misfit > WORST_FIT or not error < MOST_DOUBT * self.pitch:
            self._last = None
            return None
        _, _, turn, x, y, radius, _ = found.x
        radius = abs(float(radius))
        jumped = not first and abs(radius - abs(float(guess[5]))) > MOST_JUMP * self.pitch
        self._last = None if jumped else found.x
        if first or jumped:
            return None
        within = seen & (np.abs(place - complex(x, y)) < radius)
        return Core(radius, error, float(turn), complex(x, y), misfit, within)

    def _guess(
        self, place: Complex[np.ndarray, " m"], motion: Complex[np.ndarray, " m"]
    ) -> Float[np.ndarray, " 7"]:
        """Parameters to begin with: the markers that seem to stick, as a disc."""
        rigid = fit_motion(place, place + motion, np.ones(len(place)))
        radius = self.pitch * np.sqrt(len(place) / np.pi)
        centre = rigid.origin
        return np.array(
            [0.0, 0.0, np.angle(rigid.turn), centre.real, centre.imag, radius, _SHRINKS]
        )


def _errors(jacobian: Float[np.ndarray, "r p"]) -> Float[np.ndarray, " p"]:
    """Standard errors of the parameters; infinite where the data do not tell them."""
    _, size, vectors = np.linalg.svd(jacobian, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.nansum((vectors / size[:, None]) ** 2, axis=0))


def _fit(guess: Float[np.ndarray, " 7"], known: tuple) -> OptimizeResult:
    """Levenberg–Marquardt from a guess."""
    return least_squares(
        _residual,
        guess,
        _jacobian,  # pyright: ignore[reportArgumentType] SciPy declares words only
        method="lm",
        max_nfev=40,
        args=known,
    )


def _residual(
    parameters: Float[np.ndarray, " 7"],
    place: Complex[np.ndarray, " m"],
    motion: Complex[np.ndarray, " m"],
    noise: float,
    centre: Float[np.ndarray, " 2"],
    doubt: float,
) -> Float[np.ndarray, " r"]:
    """Motion of the markers that the disc's leaves over, and what is known beforehand."""
    left = (disc_motion(parameters, place)[0] - motion) / noise
    known = (parameters[3:5] - centre) / doubt, (parameters[6:] - _SHRINKS) / _SHRINK_DOUBT
    return np.concatenate([left.real, left.imag, *known])


def _jacobian(
    parameters: Float[np.ndarray, " 7"],
    place: Complex[np.ndarray, " m"],
    motion: Complex[np.ndarray, " m"],
    noise: float,
    centre: Float[np.ndarray, " 2"],
    doubt: float,
) -> Float[np.ndarray, "r 7"]:
    """Derivative of `_residual`."""
    slope = disc_motion(parameters, place)[1] / noise
    known = np.zeros((3, 7))
    known[[0, 1], [3, 4]] = 1.0 / doubt
    known[2, 6] = 1.0 / _SHRINK_DOUBT
    return np.concatenate([slope.real, slope.imag, known])


def disc_motion(
    parameters: Float[np.ndarray, " 7"], place: Complex[np.ndarray, " m"]
) -> tuple[Complex[np.ndarray, " m"], Complex[np.ndarray, "m 7"]]:
    """Motion of the surface under a glued disc that turns and shifts as it shrinks [mm].

    Args:
        parameters: shift along x and y [mm], turn [rad], centre along x and y [mm], radius at the
            end [mm], logarithm of the radius at the start by that at the end.
        place: points, x + iy [mm].

    Returns:
        The motion, and its derivative with respect to the parameters.
    """
    shift, turn, centre = complex(*parameters[:2]), parameters[2], complex(*parameters[3:5])
    shares = 0.5 * (1.0 + _NODES)  # of the way back to the start
    radius = max(abs(parameters[5]), 1e-6) * np.exp(parameters[6] * shares)
    arm = place - centre
    distance = np.maximum(np.abs(arm), 1e-9)
    ratio = np.minimum(radius[:, None] / distance, 1.0)
    cosine = np.sqrt(1.0 - ratio**2)
    angle = np.arcsin(ratio)
    weights = _WEIGHTS / np.pi  # half the weight, by the field's 2/π
    shifted, turned = weights @ angle, weights @ (angle - ratio * cosine)
    # by the logarithm of the radius, each node for itself; a root begins at the disc's rim
    steep = np.where(ratio < 1.0, ratio / np.maximum(cosine, _SHARPEST), 0.0)
    whole, later = np.stack([weights, weights * shares])
    motion = shift * shifted + 1j * turn * turned * arm
    grown, aged = (
        shift * (by @ steep) + 1j * turn * arm * (by @ (2.0 * ratio**2 * steep))
        for by in (whole, later)
    )
    slope = [
        shifted,
        1j * shifted,
        1j * turned * arm,
        -1j * turn * turned + grown * arm.real / distance**2,
        turn * turned + grown * arm.imag / distance**2,
        grown / max(abs(parameters[5]), 1e-6) * np.sign(parameters[5]),
        aged,
    ]
    return motion, np.stack(slope, axis=1)
