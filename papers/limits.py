"""The Cramér–Rao bound of the angle, and the errors of the linear model at finite rotations.

No unbiased estimate from one frame has a smaller standard deviation than the Cramér–Rao bound.
Everything else in `papers` assumes linear elasticity at small strain: a homogeneous elastomer, dry
friction with one coefficient. The last three functions give its errors under a finite rotation; at
20° they exceed the noise. The model leaves out, and this module does not estimate: the silicone's
nonlinear stress–strain curve, creep, adhesion, a friction coefficient that falls with pressure, and
contacts that slide far.
"""

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.profile import share_around

Angles = Float[np.ndarray, "*angles"]

MEAN_ABSOLUTE = float(np.sqrt(2.0 / np.pi))
"""Mean absolute error of a normal error of standard deviation 1."""


def angle_limit(
    points: Float[np.ndarray, "n 2"], stick: Bool[np.ndarray, " n"], noise: float
) -> float:
    """Least standard deviation of an unbiased angle from the sticking markers, σ/(r_rms √n).

    It assumes an exact reference, an unknown centre, and white normal noise of the markers.

    Args:
        points: positions of the markers [mm].
        stick: mask of the markers that move with the object.
        noise: σ, standard deviation of each coordinate [mm].

    Returns:
        The standard deviation [rad]; infinite for fewer than two markers.
    """
    arms = points[stick] - points[stick].mean(axis=0) if stick.sum() > 1 else np.zeros((1, 2))
    moment = float(np.sum(arms**2))
    return noise / np.sqrt(moment) if moment > 0 else np.inf


def contact_limit(
    points: Float[np.ndarray, "n 2"], radius: float, thickness: float, noise: float
) -> float:
    """Least standard deviation of an unbiased angle from all markers, sticking and slipping.

    A small twist moves the gel like a disc as large as the region that sticks. Everything else,
    such as friction and pressure, is assumed to be known exactly, and the contact to be round.

    Args:
        points: positions of the markers from the axis [mm].
        radius: radius of the disc that sticks [mm].
        thickness: of the layer [mm].
        noise: σ, standard deviation of each coordinate [mm].

    Returns:
        The standard deviation [rad]; infinite if nothing sticks.
    """
    distance = np.maximum(np.hypot(*points.T), 1e-9)
    share = share_around(np.minimum(radius / distance, 1.0), radius / thickness).value
    information = float(np.sum((share * distance) ** 2))
    return noise / np.sqrt(information) if information > 0.0 else np.inf


def line_shortfall(theta: Angles) -> Angles:
    """Error of the angle of a line element under the linear twist θ × r, atan θ − θ [rad]."""
    return np.arctan(theta) - theta


def curl_shortfall(theta: Angles) -> Angles:
    """Error of half the curl under a true rotation (R − I) r, sin θ − θ [rad]."""
    return np.sin(theta) - theta


def traction_excess(theta: Angles, poisson_ratio: float) -> Angles:
    """Relative excess of the traction if (R − I) r is imposed on a linear half-space [-].

    The half-space takes the contraction 1 − cos θ for strain and adds an inward traction:
    tan(θ/2)/(1−ν) times the traction of the twist.
    """
    return np.sqrt(1.0 + (np.tan(0.5 * theta) / (1.0 - poisson_ratio)) ** 2) - 1.0
