"""What no estimator can do better, and what the linear model leaves out.

Below the Cramér–Rao bound of the angle no unbiased estimate from one frame can go. Everything else
in `papers` is linear elasticity at small strain: a homogeneous elastomer, dry friction with one
coefficient. A finite rotation costs it what the last three functions say, which at 20° is more than
the noise. Not in it at all, and not estimated: the silicone's own stress–strain curve, creep,
adhesion, a friction coefficient that falls with pressure, and contacts that slide far.
"""

import numpy as np
from jaxtyping import Bool, Float

Angles = Float[np.ndarray, "*angles"]

MEAN_ABSOLUTE = float(np.sqrt(2.0 / np.pi))
"""Mean absolute error of a normal error of standard deviation 1."""


def angle_limit(
    points: Float[np.ndarray, "n 2"], stick: Bool[np.ndarray, " n"], noise: float
) -> float:
    """Least standard deviation of an unbiased angle, σ/(r_rms √n), from the markers that stick.

    The reference is exact, the centre unknown, the markers' noise white and normal.

    Args:
        points: markers [mm].
        stick: which of them move with the object.
        noise: σ of each coordinate [mm].

    Returns:
        The standard deviation [rad]; infinite for fewer than two markers.
    """
    arms = points[stick] - points[stick].mean(axis=0) if stick.sum() > 1 else np.zeros((1, 2))
    moment = float(np.sum(arms**2))
    return noise / np.sqrt(moment) if moment > 0 else np.inf


def line_shortfall(theta: Angles) -> Angles:
    """Error of the angle that lines show under the linear twist θ × r, atan θ − θ [rad]."""
    return np.arctan(theta) - theta


def curl_shortfall(theta: Angles) -> Angles:
    """Error of half the curl under a true rotation (R − I) r, sin θ − θ [rad]."""
    return np.sin(theta) - theta


def traction_excess(theta: Angles, poisson_ratio: float) -> Angles:
    """Relative excess of the traction where (R − I) r is imposed on a linear half-space [-].

    It reads the contraction 1 − cos θ as strain: an inward traction of tan(θ/2)/(1−ν) times the
    twist's.
    """
    return np.sqrt(1.0 + (np.tan(0.5 * theta) / (1.0 - poisson_ratio)) ** 2) - 1.0
