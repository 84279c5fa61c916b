"""What no estimator can do better: the Cramér–Rao bound of the angle."""

import numpy as np
from jaxtyping import Bool, Float

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
