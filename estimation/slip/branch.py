"""The load–angle curve of a turning object under a constant normal force.

The load is the moment, with the shear where forces are measured (`estimation.slip.load_path`). On
first loading it follows a curve that depends on the contact's pressure
(`estimation.slip.pressures`), Lubkin's for a moment under Hertz's pressure ([Lubkin1951]), and
after a reversal the same curve enlarged twice ([Masing1926]). A branch is the part of the curve
since the last reversal. Its limit, stiffness and start moment are fitted to the points so far, for
each of several pressures, which then are weighed by how well they fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, leastsq

from estimation.estimators.measurement import StickDisc
from estimation.slip.load_path import Direction, LoadPath
from estimation.slip.pressures import HERTZ_NAME, LEAST_STICK_RATIO, LoadCurve, pressure_curve


@dataclass(frozen=True)
class MarginSettings:
    """How branches of the moment–angle curve are detected and fitted.

    Attributes:
        turn_deg: rotation that confirms a reversal, or the start of the first branch [°].
        least_points: fewest points whose bend determines a branch [-].
        fewest_points: fewest points for a fit where the disc that sticks is known [-].
        most_points: a branch with twice as many points is thinned to half of them [-].
        largest_limit: largest fitted limit over the largest measured moment [-].
        most_doubt: standard error of the limit's logarithm from which the data cannot determine the
            limit [-].
        noise_frames: frames over which the noise is correlated [frames].
        curve_error: error of the moments by any of the curves, over the largest moment [-].
        travel_error: relative standard error of the twist at the end of a curve, for gels of any
            thickness [-].
        face_travel_error: the same where the contact's edge is fitted, which gives the thickness
            [-].
        shear_travel_error: what shear adds to it, over √(w (1 − w)) of the moment's share w in the
            square of the load [-].
        flat_shear_error: relative growth of that with the square of the face's flat part [-].
        elongation_error: what the logarithm of the outline's elongation adds to it, since the
            curves are of round contacts [-].
        stretched_moment_error: relative standard error of the moment that remains, over the
            logarithm of the outline's elongation [-].
        flat_moment_error: the same over the square of the face's flat part, since flat faces may
            have corners [-].
        flat_disc_error: standard error of c/a over the square of the face's flat part [-].
        disc_error: relative standard error of the twist at which a curve reaches a known disc [-].
        most_against: twice the logarithm of the odds against a disc, above which the moments
            contradict it and it does not count [-].
        worst_disc: standard error of c/a from which a disc does not count [-].
        discs: last frames whose discs are compared [frames].
    """

    turn_deg: float = 1.0
    least_points: int = 12
    fewest_points: int = 4
    most_points: int = 60
    largest_limit: float = 10.0
    most_doubt: float = 0.25
    noise_frames: float = 3.0
    curve_error: float = 0.008
    travel_error: float = 0.08
    face_travel_error: float = 0.05
    shear_travel_error: float = 0.25
    flat_shear_error: float = 3.0
    elongation_error: float = 0.25
    stretched_moment_error: float = 0.8
    flat_moment_error: float = 1.0
    flat_disc_error: float = 0.35
    disc_error: float = 0.08
    most_against: float = 4.0
    worst_disc: float = 0.1
    discs: int = 5


class Branch(NamedTuple):
    """A fitted branch of the load–angle curve.

    The load is along its direction (`LoadPath`). Without shear it is the moment along the turn.

    Attributes:
        start: angle at its start [rad].
        sign: direction of the turn, ±1.
        limit: load of full slip [N·mm].
        stiffness: slope of the load over the angle without slip [N·mm/rad].
        start_moment: load at its start; below 0 after a reversal [N·mm].
        covariance: covariance of ln limit, ln stiffness and start moment.
        rms: root mean square of the residuals [N·mm].
        points: number of measured points in the fit.
        pressure: name of the pressure whose curve it is.
        by_markers: whether the moments come from the markers: they are then turns in rad instead of
            moments in N·mm (`estimation.slip.gel_moment`).
        direction: direction of the load.
    """

    start: float
    sign: float
    limit: float
    stiffness: float
    start_moment: float
    covariance: Float[np.ndarray, "3 3"]
    rms: float
    points: int
    pressure: str = HERTZ_NAME
    by_markers: bool = False
    direction: Direction = Direction()

    @classmethod
    def read(cls, content: Mapping[str, Any]) -> "Branch":
        """The branch that `write` returned."""
        values: dict[str, Any] = {**content, "covariance": np.array(content["covariance"])}
        values["direction"] = Direction(*content["direction"])
        return cls(**values)

    def write(self) -> dict[str, Any]:
        """The branch, ready for JSON."""
        return self._asdict() | {"covariance": self.covariance.tolist()}

    @property
    def parameters(self) -> Float[np.ndarray, " 3"]:
        """The fitted parameters: ln limit, ln stiffness and start moment."""
        return np.array([np.log(self.limit), np.log(self.stiffness), self.start_moment])

    def moment(self, angle: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Moment at angles on the branch [N·mm]."""
        travel = np.maximum(self.sign * (angle - self.start), 0.0)
        along = _branch_moment(self.parameters, travel, self.curve)
        return self.sign * (self.direction.offset + self.direction.turning * along)

    @property
    def curve(self) -> LoadCurve:
        """The curve of first loading."""
        return pressure_curve(self.pressure, self.direction.twist_share)


def fit_branch(
    angle: Float[np.ndarray, " points"],
    load: LoadPath,
    sign: float,
    guess: Float[np.ndarray, " 3"] | None = None,
    settings: MarginSettings = MarginSettings(),
    pressure: str = HERTZ_NAME,
    discs: Sequence[StickDisc] = (),
) -> Branch:
    """Fit limit, stiffness and start moment of a branch to measured points.

    Args:
        angle: angles of the object from the branch's start on [rad].
        load: loads at these angles.
        sign: direction of the turn, ±1.
        guess: initial ln limit, ln stiffness and start moment.
        settings: settings of the fit.
        pressure: name of the pressure.
        discs: the disc that sticks in the last frames, which gives the limit over the stiffness.
    """
    travel = np.maximum(sign * (angle - angle[0]), 0.0)
    along = load.along
    largest = max(float(np.abs(along).max()), 1e-6)
    if guess is None:
        rise = max(float(np.ptp(along)), 1e-3 * largest) / max(float(travel.max()), 1e-6)
        guess = np.array([np.log(1.2 * largest), np.log(1.5 * rise), along[0]])
    highest = np.log(largest) + np.log(settings.largest_limit)
    guess = np.append(min(guess[0], highest - 0.1), guess[1:])
    curve = pressure_curve(pressure, load.direction.twist_share)
    points = _Points(travel, along, largest, curve)
    fit, inverse, error = _solve(points, guess, highest)
    variance, bends = _measure_variance(error, settings), len(travel) >= settings.least_points
    unknown = 0.0 if bends else 1e3  # variance of the limit's logarithm
    scale, spread = _read_discs(discs, curve, settings)
    if np.isfinite(scale):
        guess = np.array([min(scale + fit[1], highest - 0.1), *fit[1:]])
        # the bend of few points does not count
        pull = scale, float(np.sqrt(variance)) / (spread if bends else 0.01)
        fit_too, inverse_too, error_too = _solve(points, guess, highest, pull)
        # twice the logarithm of the odds against the disc
        against = float(error_too @ error_too - error @ error) / variance
        if against < settings.most_against:
            fit, inverse, error = fit_too, inverse_too, error_too[:-1]
            variance = max(variance, _measure_variance(error, settings))
            unknown = 0.0 if bends else spread**2
    rms = float(np.sqrt(np.mean((error * largest) ** 2)))
    covariance = inverse * variance + np.diag([unknown, 0.0, 0.0])
    limit, stiffness, start_moment = fit
    return Branch(
        start=float(angle[0]),
        sign=sign,
        limit=float(np.exp(limit)),
        stiffness=float(np.exp(stiffness)),
        start_moment=float(start_moment),
        covariance=covariance,
        rms=rms,
        points=len(travel),
        pressure=pressure,
        direction=load.direction,
    )


def _measure_variance(error: Float[np.ndarray, " points"], settings: MarginSettings) -> float:
    """Variance of a point, times the frames over which it is correlated.

    Args:
        error: residuals over the largest moment [-].
        settings: settings of the fit.
    """
    independent = len(error) / settings.noise_frames
    variance = float(np.mean(error**2)) * independent / max(independent - 3.0, 1.0)
    return (variance + settings.curve_error**2) * settings.noise_frames


def _read_discs(
    discs: Sequence[StickDisc], curve: LoadCurve, settings: MarginSettings
) -> tuple[float, float]:
    """Logarithm of limit over stiffness [rad] by the disc that sticks, and its standard error.

    It stays the same while the object turns, as long as the discs are right. So the error contains
    its range over the last frames.
    """
    least, known = 2, [disc for disc in discs if disc.error < settings.worst_disc]
    if len(known) < least or not discs[-1].error < settings.worst_disc:
        return np.nan, np.nan
    ratio, error, twist = np.array(known).T
    near = ratio + np.outer([0.0, 1.0, -1.0], error)
    near = np.clip(near, LEAST_STICK_RATIO, 0.999)
    place, *ends = np.log(np.interp(-near, -curve.stick_ratio, curve.motion))
    scale, spread = np.log(twist) - place, np.abs(np.array(ends) - place).max(axis=0)[-1]
    errors = spread, np.ptp(scale), settings.disc_error
    return float(scale[-1]), float(np.linalg.norm(errors))


class _Points(NamedTuple):
    """Measured points of a branch, and the curve that is fitted to them."""

    travel: Float[np.ndarray, " points"]  # rotation since the start [rad]
    along: Float[np.ndarray, " points"]  # moment in the direction of the turn [N·mm]
    largest: float  # largest moment [N·mm]
    curve: LoadCurve

    def residual(
        self, parameters: Float[np.ndarray, " 3"], pull: tuple[float, float] | None
    ) -> Float[np.ndarray, " residuals"]:
        """Residuals over the largest moment, and that of limit over stiffness.

        Args:
            parameters: ln limit, ln stiffness and start moment.
            pull: logarithm of limit over stiffness where a disc gives it, and its weight.
        """
        error = (_branch_moment(parameters, self.travel, self.curve) - self.along) / self.largest
        if pull is None:
            return error
        scale, weight = pull
        return np.append(error, weight * (parameters[0] - parameters[1] - scale))

    def slope(
        self, parameters: Float[np.ndarray, " 3"], pull: tuple[float, float] | None
    ) -> Float[np.ndarray, "3 residuals"]:
        """Derivatives of the residuals by each parameter."""
        slope = _branch_slope(parameters, self.travel, self.curve) / self.largest
        if pull is None:
            return slope
        return np.column_stack([slope, pull[1] * np.array([1.0, -1.0, 0.0])])


def _solve(
    points: _Points,
    guess: Float[np.ndarray, " 3"],
    highest: float,
    pull: tuple[float, float] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The least-squares solution, the inverse of its normal matrix, and its residual.

    It is solved without a bound, which takes a third of the time, and again with the bound if the
    limit exceeds it.
    """
    typical = np.array([0.1, 0.1, 0.1 * points.largest])
    # steps of the solver may go too far
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        best, *details = leastsq(
            points.residual,
            guess,
            args=(pull,),
            Dfun=points.slope,
            col_deriv=True,
            full_output=True,
            diag=1.0 / typical,
            factor=10,
            maxfev=30,
        )
        inverse, info = details[:2]
        if inverse is not None and best[0] <= highest:
            return best, inverse, info["fvec"]
        solution = least_squares(
            points.residual,
            guess,
            jac=lambda parameters, pull: points.slope(parameters, pull).T,  # pyright: ignore[reportArgumentType]
            args=(pull,),
            bounds=([-np.inf] * 3, [highest, np.inf, np.inf]),
            x_scale=typical,
            max_nfev=30,
        )
    return solution.x, np.linalg.pinv(solution.jac.T @ solution.jac), solution.fun


def weigh_branches(
    branches: Sequence[Branch],
    likely: Float[np.ndarray, " branches"],
    largest: float,
    settings: MarginSettings = MarginSettings(),
) -> Float[np.ndarray, " branches"]:
    """Probability of each branch, fitted to the same points for another pressure.

    Args:
        branches: the branches.
        likely: probabilities of their pressures before the fit [-].
        largest: largest moment among the points [N·mm].
        settings: settings of the fits.
    """
    squares = np.array([branch.rms for branch in branches]) ** 2
    independent = branches[0].points / settings.noise_frames
    variance = float(squares.min()) * independent / max(independent - 3.0, 1.0)
    variance += (settings.curve_error * largest) ** 2
    weight = likely * np.exp(-0.5 * independent * (squares - squares.min()) / variance)
    return weight / weight.sum()


def margin_after(
    branch: Branch, parameters: Float[np.ndarray, " 3"], travel: float, end: float
) -> Float[np.ndarray, " 2"]:
    """Remaining angle [rad] and load [N·mm] at a travel along the branch; below 0 past its end.

    Args:
        branch: gives the curve.
        parameters: ln limit, ln stiffness and start moment.
        travel: rotation since the start of the branch [rad].
        end: c/a at the end of the branch [-].
    """
    limit, stiffness = np.exp(parameters[:2])
    curve = branch.curve
    last = float(np.interp(-end, -curve.stick_ratio, curve.motion))
    start = _virgin_inverse(parameters[2] / limit, curve)
    # beyond twice the start the branch is the first-loading curve
    ends = (last - start if last >= -start else 2.0 * last) * limit / stiffness
    at = np.array([travel, ends])
    now, at_end = _branch_moment(parameters, at, curve)
    return np.array([ends - travel, at_end - now])


def _branch_moment(
    parameters: Float[np.ndarray, " 3"], travel: Float[np.ndarray, " points"], curve: LoadCurve
) -> Float[np.ndarray, " points"]:
    """Moment along a branch with any start moment, by Masing's rule.

    A branch with a start moment against its turn is the curve enlarged twice, until the moment is
    mirrored. From there on, and in other branches from the start, it is the first-loading curve.
    """
    limit, stiffness = np.exp(parameters[:2])
    first = parameters[2] / limit
    start = _virgin_inverse(first, curve)
    x = travel * stiffness / limit
    # beyond the table the moment is closer to the limit than at its end
    virgin = np.sign(start + x) * np.interp(np.abs(start + x), curve.motion, curve.load)
    if first < 0.0:
        turned = first + 2.0 * np.interp(0.5 * x, curve.motion, curve.load)
        virgin = np.where(x < -2.0 * start, turned, virgin)
    return limit * virgin


def _branch_slope(
    parameters: Float[np.ndarray, " 3"], travel: Float[np.ndarray, " points"], curve: LoadCurve
) -> Float[np.ndarray, "3 points"]:
    """Derivatives of the moment along a branch by each parameter."""
    limit, stiffness = np.exp(parameters[:2])
    first = parameters[2] / limit
    start = _virgin_inverse(first, curve)
    x = travel * stiffness / limit
    slope = np.interp(np.abs(start + x), curve.motion, curve.slope, right=0.0)
    by_start = slope / max(float(np.interp(abs(start), curve.motion, curve.slope)), 1e-3)
    if first < 0.0:
        turned = x < -2.0 * start
        slope = np.where(turned, np.interp(0.5 * x, curve.motion, curve.slope, right=0.0), slope)
        by_start = np.where(turned, 1.0, by_start)
    by_stiffness = limit * slope * x
    moment = _branch_moment(parameters, travel, curve)
    return np.stack([moment - by_stiffness - by_start * parameters[2], by_stiffness, by_start])


def _virgin_inverse(moment: float, curve: LoadCurve) -> float:
    """Twist over limit, times stiffness, at which the first-loading curve has a moment."""
    return float(np.sign(moment) * np.interp(abs(moment), curve.load, curve.motion))
