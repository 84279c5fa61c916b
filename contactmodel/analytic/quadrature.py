"""Gauss–Legendre quadrature of smooth functions, of NumPy or JAX arrays."""

from functools import cache

import numpy as np
import scipy
from jaxtyping import Float

from contactmodel.common.arrays import AnyArray, Value, as_arrays


@cache
def gauss(count: int) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Gauss–Legendre points and weights on [0, 1]."""
    points, weights = scipy.special.roots_legendre(count)
    points, weights = 0.5 * (points + 1.0), 0.5 * weights
    points.flags.writeable = weights.flags.writeable = False
    return points, weights


def space_by_ratio(low: Value, high: Value) -> tuple[Float[AnyArray, "*batch q"], AnyArray]:
    """Points and weights from `low` to `high`, spaced by ratio because f falls like 1/s."""
    xp, start, end = as_arrays(low, high)
    place, weight = gauss(32)
    start, end = start[..., None], end[..., None]
    ratio = xp.log(end / start)
    points = start * xp.exp(ratio * place)
    return points, points * ratio * weight
