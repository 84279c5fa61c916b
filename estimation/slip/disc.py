"""The disc of markers that still stick, from their motion over a few frames.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".

Whatever the pressure of a round contact, a small further twist moves the elastomer like a rigid
disc with the radius c of the stick region ([Jaeger1995]): by dθ inside, and outside by
(2/π)[asin(c/r) − (c/r)√(1 − c²/r²)] dθ on a half-space, by less on a layer (see `profile`).
The motion of all markers therefore determines c, even if fewer than three of them lie inside. It
also shows the layer's thickness, which is fitted with c and kept for the whole recording.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import leastsq

from estimation.fields.profile import Share, share_around
from estimation.fields.stick import MIN_STICK_MARKERS


@dataclass(frozen=True)
class SlipSettings:
    """How macro slip is dated and suspected, looking back; lengths are in pitches of the markers.

    Attributes:
        window: longest window over which the motion is measured [frames].
        least_markers: fewest markers in contact for the fit of a disc, which has five unknowns [-].
        load_change: largest relative growth or shrinkage of the contact over a window, since a
            change of load moves its markers too [-].
        worst_misfit: misfit over noise from which the motion is not that of a disc [-].
        largest_misfit: largest share of the motion that the disc may leave unexplained [-].
        largest_error: standard error of the disc's radius above which a window gives no disc,
            because the object rests or slides [pitches].
        at_rest: motion of the markers about the axis over its noise, below which the contact rests
            [-].
        clear: motion of the markers over its noise, from which no longer window is needed [-].
        axis_drift: standard deviation of the axis from its position while nine markers stuck
            [pitches].
        thickness: typical thickness of the gel, before the first disc [pitches].
        thickness_error: standard deviation of its logarithm before the first disc [-].
        least_thickness_error: standard error of the logarithm that no number of discs falls below
            [-].
        round_misfit: misfit of a disc, as a share of the motion beyond its noise, above which the
            contact is not round. At 1 µm, nine tenths of the windows of spheres on layers show up
            to 0.04 to 0.10, as the disc closes during a window, and half of those of square and
            elongated contacts from 0.11 to 0.17 on [-].
        sought_every: number of frames per fit of a disc, after more than two windows of fits in a
            row have shown that the contact is not round [-].
        roundness: error of the radius in addition to the noise, measured on virtual pivots
            [pitches].
        regained: margin from which markers stick again; a reversal makes all of them stick
            [pitches].
        around: number of windows before and after the onset through which a line is fitted [-].
        overdue: time since the onset by the line through the last discs, from which the disc counts
            as closed while the object moves. Chosen on 40 virtual pivots [frames].
        least_pace: turn in the last step over that of the last discs, below which the object may
            have stopped or turned back. It is mostly above 0.5 while the disc closes [-].
        latest: frames over which a grip or a rest is noticed live [frames].
        grip_turn: turn of the inner half of the contact as one body over its standard error, from
            which the contact holds [-].
        grip_misfit: mean square of the half's residuals over the noise, up to which it turns as one
            body [-].
        widest: half-width of an onset's interval above which it is not reported [frames].
        noise_frames: frames over which the noise is correlated [frames].
        most_steps: largest number of evaluations of the misfit in one fit of a disc [-].
        firm_share: share of the contact's markers that stick, from which the angle does not count
            as lost [-].
        held_markers: fewest markers that have never slipped, by the law of friction, which show
            that gel at rest rests under the object [-].
        least_margin: radius of the closing disc beyond the third marker, from which gel that comes
            to rest counts as resting under the object. It is continued by a line through the last
            four discs, which close fast before a slide and hardly before a rest. Chosen on 100
            virtual pivots [pitches].
    """

    window: int = 6
    least_markers: int = 12
    load_change: float = 0.15
    worst_misfit: float = 2.0
    largest_misfit: float = 0.5
    largest_error: float = 0.15
    at_rest: float = 1.5
    clear: float = 20.0
    axis_drift: float = 0.05
    thickness: float = 4.0
    thickness_error: float = 1.0
    least_thickness_error: float = 0.02
    round_misfit: float = 0.06
    sought_every: int = 3
    roundness: float = 0.02
    regained: float = 0.5
    around: int = 6
    overdue: float = 0.75
    least_pace: float = 0.3
    latest: int = 3
    grip_turn: float = 6.0
    grip_misfit: float = 2.0
    widest: float = 30.0
    noise_frames: float = 3.0
    most_steps: int = 20
    firm_share: float = 1.0 / 3.0
    held_markers: int = 5
    least_margin: float = 0.15

    @property
    def correlated(self) -> float:
        """Number of neighbouring windows that count as one, for they share frames and noise."""
        return (self.window + self.noise_frames) / 2.0


class Disc(NamedTuple):
    """The stick region, from the markers' motion over a window; NaN for a frame without one.

    Attributes:
        time: middle of the window [s].
        margin: radius less the third marker's distance from the axis [pitches]; below 0, fewer than
            three markers stick.
        error: standard error of the margin [pitches].
        misfit: share of the markers' motion, beyond their noise, that is not the disc's [-].
    """

    time: float = np.nan
    margin: float = np.nan
    error: float = np.nan
    misfit: float = np.nan


class Thickness(NamedTuple):
    """An estimate of the gel's thickness.

    Attributes:
        log: logarithm of the thickness in pitches.
        error: its standard error.
    """

    log: float
    error: float


class DiscFit(NamedTuple):
    """A fitted disc, with the residual and the inverse of its normal matrix.

    Its parameters are the axis' x and y, the radius, the rotation and the logarithm of the
    thickness. The first residuals are those of the points around the axis.
    """

    parameters: Float[np.ndarray, " 5"]
    residual: Float[np.ndarray, " m"]
    covariance: Float[np.ndarray, "5 5"]


def describe_disc(
    best: DiscFit,
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    scale: float,
    settings: SlipSettings,
) -> Disc:
    """The disc of a fit, without its time (NaN)."""
    around = best.residual[: len(before)]
    misfit = float(np.sqrt(np.mean(around**2))) / settings.worst_misfit
    variance = float(best.covariance[2, 2])
    error = np.sqrt(variance) * max(misfit, 1.0) if variance > 0.0 else np.inf
    axis = complex(*best.parameters[:2])
    distance = np.abs(before - axis)
    moved = np.sqrt(np.mean((distance * np.angle((after - axis) / (before - axis))) ** 2))
    beyond = settings.worst_misfit * scale * np.sqrt(max(misfit**2 - 1.0, 0.0))
    return Disc(
        time=np.nan,
        margin=float(abs(best.parameters[2]) - np.sort(distance)[MIN_STICK_MARKERS - 1]),
        error=float(np.hypot(error, settings.roundness)),
        misfit=float(beyond / moved),
    )


def is_still(moved: Float[np.ndarray, " m"], scale: float, at_rest: float) -> bool:
    """Whether markers have moved over a window by hardly more than their noise.

    Args:
        moved: distance that each marker has moved.
        scale: noise of the difference of two positions, per coordinate, in the same unit.
        at_rest: motion over its noise, below which the markers rest [-].
    """
    return bool(np.mean(moved**2) < 2.0 * (at_rest * scale) ** 2)


def has_paused(pace: Complex[np.ndarray, " m"], step: Complex[np.ndarray, " m"]) -> bool:
    """Whether markers have moved in one step by less than half of their pace before.

    Args:
        pace: mean motion in a step before; NaN for markers that were not visible.
        step: motion in the last step.
    """
    seen = np.isfinite(pace + step)
    pace, step = pace[seen], step[seen]
    return bool(np.vdot(pace, step).real < 0.5 * np.vdot(pace, pace).real)


def turn_along(
    disc: Float[np.ndarray, " 5"],
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
) -> float:
    """Turn of a disc of given axis and radius by a small motion, in least squares [rad].

    Args:
        disc: the parameters of its fit.
        before: points before; NaN for those that were not visible [pitches].
        after: points after [pitches].
    """
    seen = np.isfinite(before)
    arm = before[seen] - complex(*disc[:2])
    along = 1j * arm * _share_of(disc, np.maximum(np.abs(arm), 1e-12)).value
    moved = (after - before)[seen]
    return float(np.vdot(along, moved).real / max(np.vdot(along, along).real, 1e-30))


def fit_disc(
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    scale: float,
    last: np.ndarray | None,
    axis: np.ndarray | None,
    thickness: Thickness,
    settings: SlipSettings,
) -> DiscFit:
    """Fit a disc by least squares, from the last disc and, if that is poor, from new guesses."""
    motion = _Motion(before, after, scale, axis, thickness, settings.axis_drift)

    def solve(start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        best, *details = leastsq(
            motion.residual,
            start,
            Dfun=motion.jacobian,
            col_deriv=True,
            full_output=True,  # also avoids a warning when the steps are used up
            ftol=1e-6,
            xtol=1e-6,
            gtol=1e-8,
            maxfev=settings.most_steps,
            diag=1.0 / np.array([0.1, 0.1, 0.1, 0.01, 0.1]),  # typical changes, pitches and rad
        )
        return best, details[1]["fvec"]

    solutions = []
    if last is not None:
        solutions = [solve(last)]
        noisy = is_still(np.abs(after - before), scale, settings.clear)
        if noisy or _squares(solutions[0]) > 2.0 * len(before):  # there may be a better one
            solutions.append(solve(last * [1.0, 1.0, 0.8, 1.0, 1.0]))
    if not solutions or min(map(_squares, solutions)) > len(before) * settings.worst_misfit**2:
        centre = complex(before.mean()) if axis is None else complex(*axis)
        arm = before - centre
        turned = np.sum(np.imag(np.conj(arm) * (after - before))) / np.sum(np.abs(arm) ** 2)
        solutions += [
            solve(np.array([centre.real, centre.imag, radius, turned, thickness.log]))
            for radius in (1.0, 2.0, 4.0)
        ]
    best, residual = min(solutions, key=_squares)
    rows = motion.jacobian(best)
    return DiscFit(best, residual, np.linalg.pinv(rows @ rows.T))


def learn_thickness(before: Thickness, best: DiscFit, settings: SlipSettings) -> Thickness:
    """The estimate of the thickness after another disc.

    Args:
        before: the estimate before, used for this disc.
        best: the disc.
        settings: how discs are followed.
    """
    known = before.error**-2
    both = 1.0 / best.covariance[4, 4]
    share = 1.0 / (max(float(np.mean(best.residual**2)), 1.0) * settings.correlated)
    precision = known + share * (both - known)
    log = known * before.log
    log += share * (both * float(best.parameters[4]) - log)
    return Thickness(log / precision, max(precision**-0.5, settings.least_thickness_error))


def _share_of(disc: Float[np.ndarray, " 5"], distance: Float[np.ndarray, " m"]) -> Share:
    """Rotation of points at distances from the axis, over that of a disc of given parameters."""
    radius = abs(disc[2])
    return share_around(np.minimum(radius / distance, 1.0), radius * np.exp(-disc[4]))


def _squares(solution: tuple[np.ndarray, np.ndarray]) -> float:
    """Sum of the squared residuals of a solution."""
    return float(solution[1] @ solution[1])


class _Motion:
    """The motion a disc is fitted to: points before and after, their noise, and what is known.

    Residuals are those of each point's motion around the axis, of its motion away from it, and of
    the axis and the thickness against what is known of them. Only points that turn with the disc
    keep their distance: gel that slips for the first time gives way to the shear that pressing has
    left in it.
    """

    def __init__(
        self,
        before: Complex[np.ndarray, " m"],
        after: Complex[np.ndarray, " m"],
        scale: float,
        axis: np.ndarray | None,
        thickness: Thickness,
        axis_drift: float,
    ) -> None:
        self._points, self._scale = np.stack([before, after]), scale
        known = np.array([0.0 if axis is None else 1.0 / axis_drift] * 2 + [1.0 / thickness.error])
        self._known = known[:, None] * np.eye(5)[[0, 1, 4]]
        self._expected = known * np.append(np.zeros(2) if axis is None else axis, thickness.log)
        self._turn: _Turn | None = None

    def residual(self, parameters: np.ndarray) -> np.ndarray:
        """The motion that a disc does not explain, over the noise."""
        turn = self._turn_by(parameters)
        around = turn.distance * turn.residual / self._scale
        away = turn.share.value**2 * turn.away / self._scale
        return np.concatenate([around, away, self._known @ parameters - self._expected])

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        """Derivatives of the residual by each parameter, one row each."""
        *_, radius, turned, _ = parameters
        turn = self._turn_by(parameters)
        share, distance, (toward, toward_after) = turn.share, turn.distance, turn.directions
        more = 2.0 * share.value * turn.away
        around = (turned * share.by_distance - turn.residual + 1j) * toward
        around -= 1j * distance / (distance + turn.away) * toward_after
        away = (
            share.value**2 * (toward - toward_after) - more * share.by_distance / distance * toward
        )
        rows = np.empty((5, 2, len(distance)))
        rows[:2, 0] = around.real, around.imag
        rows[:2, 1] = away.real, away.imag
        rows[2::2, 0] = -turned * distance
        rows[2::2, 1] = more
        rows[2] *= share.by_radius / radius
        rows[4] *= share.by_thickness
        rows[3, 0] = -distance * share.value
        rows[3, 1] = 0.0
        rows /= self._scale
        return np.concatenate([rows.reshape(5, -1), self._known.T], axis=1)

    def _turn_by(self, parameters: np.ndarray) -> "_Turn":
        """The turn of the points by a disc; cached, since residual and derivatives share it."""
        if self._turn is None or self._turn.parameters != parameters.tobytes():
            x, y, _, turned, _ = parameters
            arms = self._points - complex(x, y)
            lengths = np.abs(arms)
            lengths[lengths < 1e-9] = 1e-9
            toward, toward_after = directions = arms / lengths
            distance, after = lengths
            share = _share_of(parameters, distance)
            residual = np.angle(toward_after * toward.conj()) - turned * share.value
            self._turn = _Turn(
                parameters.tobytes(), directions, distance, share, residual, after - distance
            )
        return self._turn


class _Turn(NamedTuple):
    """Turn of points by a disc.

    Attributes:
        parameters: bytes of the disc's parameters.
        directions: unit vectors from the axis to each point, before and after.
        distance: distance of each point from the axis [pitches].
        share: rotation of each point over that of the disc [-].
        residual: rotation of each point that the disc does not explain [rad].
        away: motion of each point away from the axis [pitches].
    """

    parameters: bytes
    directions: Complex[np.ndarray, "2 m"]
    distance: Float[np.ndarray, " m"]
    share: Share
    residual: Float[np.ndarray, " m"]
    away: Float[np.ndarray, " m"]
