"""The moment–angle curve of a turning object under a constant load.

The moment of a Hertz-like contact follows Lubkin's curve on first loading, and the same curve
enlarged twice after a reversal ([Lubkin1951], [Masing1926]). A branch is the part of the curve
since the last reversal. Its limit, stiffness and start moment are fitted to the points so far.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, leastsq

from contactmodel.analytic import lubkin_moment, lubkin_twist

LEAST_STICK_RATIO = 0.1
"""c/a to which Lubkin's curve is tabulated [-]; the curve has no end."""


@dataclass(frozen=True)
class MarginSettings:
    """How branches of the moment–angle curve are detected and fitted.

    Attributes:
        turn_deg: rotation that confirms a reversal, or the start of the first branch [°].
        least_points: fewest points for a fit [-].
        most_points: a branch with twice as many points is thinned to half of them [-].
        largest_limit: largest fitted limit over the largest measured moment [-].
        most_doubt: standard error of the limit's logarithm from which the data cannot determine the
            limit [-].
        noise_frames: frames over which the noise is correlated [frames].
    """

    turn_deg: float = 1.0
    least_points: int = 12
    most_points: int = 60
    largest_limit: float = 10.0
    most_doubt: float = 0.25
    noise_frames: float = 3.0


class Branch(NamedTuple):
    """A fitted branch of the moment–angle curve.

    Attributes:
        start: angle at its start [rad].
        sign: direction of the turn, ±1.
        limit: moment of full slip [N·mm].
        stiffness: dM/dθ without slip [N·mm/rad].
        start_moment: moment at its start, along the turn; below 0 after a reversal [N·mm].
        covariance: covariance of ln limit, ln stiffness and start moment.
        rms: root mean square of the residuals [N·mm].
        points: number of measured points in the fit.
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
        """The branch that `write` returned."""
        values: dict[str, Any] = {**content, "covariance": np.array(content["covariance"])}
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
        return self.sign * _branch_moment(self.parameters, travel)


def fit_branch(
    angle: Float[np.ndarray, " points"],
    moment: Float[np.ndarray, " points"],
    sign: float,
    guess: Float[np.ndarray, " 3"] | None = None,
    settings: MarginSettings = MarginSettings(),
) -> Branch:
    """Fit limit, stiffness and start moment of a branch to measured points.

    Args:
        angle: angles of the object from the branch's start on [rad].
        moment: moments at these angles [N·mm].
        sign: direction of the turn, ±1.
        guess: initial ln limit, ln stiffness and start moment.
        settings: settings of the fit.
    """
    travel = np.maximum(sign * (angle - angle[0]), 0.0)
    along = sign * moment
    largest = max(float(np.abs(along).max()), 1e-6)
    if guess is None:
        rise = max(float(np.ptp(along)), 1e-3 * largest) / max(float(travel.max()), 1e-6)
        guess = np.array([np.log(1.2 * largest), np.log(1.5 * rise), along[0]])
    highest = np.log(largest) + np.log(settings.largest_limit)
    guess = np.append(min(guess[0], highest - 0.1), guess[1:])

    def residual(parameters: np.ndarray) -> np.ndarray:
        return (_branch_moment(parameters, travel) - along) / largest

    with np.errstate(over="ignore", invalid="ignore"):  # steps of the solver may go too far
        fit, inverse, error = _solve(residual, guess, np.array([0.1, 0.1, 0.1 * largest]), highest)
    rms = float(np.sqrt(np.mean((error * largest) ** 2)))
    free = max(len(travel) / settings.noise_frames - 3.0, 1.0)
    covariance = inverse * rms**2 * len(travel) / free / largest**2
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
    )


def _solve(
    residual: Callable[[np.ndarray], np.ndarray],
    guess: Float[np.ndarray, " 3"],
    typical: Float[np.ndarray, " 3"],
    highest: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The least-squares solution, the inverse of its normal matrix, and its residual.

    It is solved without a bound, which takes a third of the time, and again with the bound if the
    limit exceeds it.
    """
    best, *details = leastsq(
        residual, guess, full_output=True, epsfcn=1e-6, diag=1.0 / typical, factor=10, maxfev=120
    )
    inverse, info = details[:2]
    if inverse is not None and best[0] <= highest:
        return best, inverse, info["fvec"]
    bounds = ([-np.inf] * 3, [highest, np.inf, np.inf])
    solution = least_squares(
        residual, guess, bounds=bounds, x_scale=typical, diff_step=1e-3, max_nfev=30
    )
    return solution.x, np.linalg.pinv(solution.jac.T @ solution.jac), solution.fun


def margin_after(
    parameters: Float[np.ndarray, " 3"], travel: float, end: float
) -> Float[np.ndarray, " 2"]:
    """Remaining angle [rad] and moment [N·mm] at a travel along the branch; below 0 past its end.

    Args:
        parameters: ln limit, ln stiffness and start moment.
        travel: rotation since the start of the branch [rad].
        end: c/a at the end of the branch [-].
    """
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
    """Moment along a branch with any start moment, by Masing's rule.

    A branch with a start moment against its turn is the curve enlarged twice, until the moment is
    mirrored. From there on, and in other branches from the start, it is the first-loading curve.
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
    """M over its limit, at x = θ times stiffness over limit, x ≥ 0."""
    twist, moment = _virgin()
    # beyond the table the moment is closer to the limit than at its end
    return np.interp(x, twist, moment)


def _virgin_inverse(moment: float) -> float:
    """The x at which the first-loading curve has a moment of either sign, up to its end."""
    x, y = _virgin()
    return float(np.sign(moment) * np.interp(abs(moment), y, x))


@cache
def _stick_ratios() -> Float[np.ndarray, " points"]:
    """c/a of the table's points."""
    return np.geomspace(1.0, LEAST_STICK_RATIO, 600)


@cache
def _virgin() -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Lubkin's curve with limit 1 and slope 1 at the origin, up to the least stick ratio."""
    kappa = _stick_ratios()
    share = 3.0 * np.pi / 16.0
    twist = np.asarray(lubkin_twist(kappa, 1.0), dtype=float) * (4.0 / np.pi) / share
    moment = np.asarray(lubkin_moment(kappa, 1.0, 1.0, 1.0), dtype=float) / share
    twist[0] = moment[0] = 0.0
    return twist, moment
