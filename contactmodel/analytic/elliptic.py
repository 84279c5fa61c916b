"""Complete elliptic integrals, of NumPy or JAX arrays."""

from typing import Any

import numpy as np
import scipy

from contactmodel.common.arrays import AnyArray, Value, as_arrays

_TINY = 1e-9  # κ below which K = ln(4/κ) and E = 1 to rounding


def complete_elliptic(kappa: Value) -> tuple[AnyArray, AnyArray]:
    """Complete elliptic integrals K and E of parameter m = 1 − κ², for 0 < κ ≤ 1."""
    xp, ratio = as_arrays(kappa)
    tiny = ratio < _TINY
    safe = xp.where(tiny, 1.0, ratio)
    if xp is np:
        first, second = scipy.special.ellipkm1(safe**2), scipy.special.ellipe(1.0 - safe**2)
    else:
        first, second = _by_mean(xp, safe)
    limit = xp.log(4.0 / xp.where(tiny, ratio, 1.0))
    return xp.where(tiny, limit, first), xp.where(tiny, 1.0, second)


def _by_mean(xp: Any, kappa: AnyArray) -> tuple[AnyArray, AnyArray]:
    """K and E by the arithmetic–geometric mean, which JAX can differentiate."""
    mean, geometric = xp.ones_like(kappa), kappa
    total, power = 0.5 * (1.0 - geometric**2), 0.5
    for _ in range(8):  # converges quadratically: exact to rounding above _TINY
        half = 0.5 * (mean - geometric)
        mean, geometric = 0.5 * (mean + geometric), xp.sqrt(mean * geometric)
        power *= 2.0
        total = total + power * half**2
    first = np.pi / (2.0 * mean)
    return first, first * (1.0 - total)
