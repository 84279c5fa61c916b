"""Effect of a rigid base: the displacement of a bonded layer minus that of a half-space.

The difference is smooth where the half-space's displacement is singular, and cancels it far away.
`transfer` gives it by wave number. Its Hankel transforms are integrated once for a body and
evaluated by Chebyshev series.
"""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float
from scipy.special import jv, roots_legendre

from contactmodel.common.arrays import AnyArray
from contactmodel.elasticity.transfer import base_transfer

REACH = 40.0  # in thicknesses; beyond, a layer's displacement is below 1e-12 of the half-space's
_WAVES = 22.0  # the integrands fall at least like e^{−x}
_NODES = 960
_TERMS = 64  # of the series in asinh(r/2h); its error is 2e-13 of the largest value


class Kernels(NamedTuple):
    """Displacement under a point force times 2πGh, minus the half-space's, as functions of r/h."""

    mean: Array  # half the sum of the displacements along and across r under a force in the plane
    split: Array  # their difference, across minus along, over (r/h)²
    normal: Array  # w under a pressing force
    pull: Array  # −u along r under a pressing force, over r/h
    lift: Array  # w under a force along r, over r/h
    turn: Array  # ½ rot u under a force across r, times h, over r/h


def base_kernels(
    distance: Float[AnyArray, "*shape"],
    poisson_ratio: ArrayLike,
    depth: ArrayLike,
    cell: ArrayLike,
) -> Kernels:
    """Displacement of a layer under a force on a small square, minus the half-space's.

    Args:
        distance: r/h, up to `REACH` [-].
        poisson_ratio: ν [-].
        depth: z/h [-].
        cell: side of the square over h [-].
    """
    x, weight, bessel = _quadrature()
    base = base_transfer(jnp.asarray(x), poisson_ratio, depth)
    mean = weight * (1.0 - (x * jnp.asarray(cell)) ** 2 / 24.0)  # over the square
    order_0, order_1, order_2 = (jnp.asarray(matrix) for matrix in bessel)
    values = [
        order_0 @ (mean * 0.5 * (base.transverse + base.longitudinal)),
        order_2 @ (mean * (base.longitudinal - base.transverse)),
        order_0 @ (mean * base.normal),
        order_1 @ (mean * base.pull),
        order_1 @ (mean * base.lift),
        order_1 @ (mean * 0.5 * x * base.transverse),
    ]
    series = jnp.asarray(_to_series()) @ jnp.stack(values, axis=-1)
    top = np.arcsinh(0.5 * REACH)
    u = jnp.arcsinh(0.5 * jnp.minimum(jnp.asarray(distance), REACH)) / top
    return Kernels(*_evaluate(series, 2.0 * u**2 - 1.0))


@jax.custom_jvp
def _evaluate(series: Float[Array, "terms kernels"], v: Array) -> Array:
    """Σ series_k T_k(v) by Clenshaw's recurrence; the kernels are the first axis."""

    def step(carry, term):
        after, later = carry
        return (2.0 * v * after - later + term.reshape(-1, *[1] * v.ndim), after), None

    zero = jnp.zeros((series.shape[1], *v.shape), series.dtype)
    (first, second), _ = jax.lax.scan(step, (zero, zero), series[:0:-1])
    return v * first - second + series[0].reshape(-1, *[1] * v.ndim)


@_evaluate.defjvp
def _evaluate_jvp(primals, tangents):
    """The derivative as a series, so that reverse mode stores no steps of the recurrence."""
    (series, v), (dseries, dv) = primals, tangents
    slope = _evaluate(jnp.asarray(_derivative()) @ series, v)
    return _evaluate(series, v), _evaluate(dseries, v) + slope * dv


@lru_cache(maxsize=1)
def _quadrature() -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Gauss nodes and weights in x, and J_i(xρ)/ρ^i at the Chebyshev points ρ."""
    nodes, weights = roots_legendre(_NODES)
    x = 0.5 * _WAVES * (nodes + 1.0)
    v = np.polynomial.chebyshev.chebpts1(_TERMS)
    rho = 2.0 * np.sinh(np.arcsinh(0.5 * REACH) * np.sqrt(0.5 * (v + 1.0)))
    bessel = [jv(i, np.outer(rho, x)) / rho[:, None] ** i for i in range(3)]
    return x, 0.5 * _WAVES * weights, bessel


@lru_cache(maxsize=1)
def _to_series() -> np.ndarray:
    """Matrix from values at the Chebyshev points to the series' coefficients."""
    v = np.polynomial.chebyshev.chebpts1(_TERMS)
    matrix = 2.0 / _TERMS * np.polynomial.chebyshev.chebvander(v, _TERMS - 1).T
    matrix[0] *= 0.5
    return matrix


@lru_cache(maxsize=1)
def _derivative() -> np.ndarray:
    """Matrix from the coefficients of a series to those of its derivative."""
    slope = np.polynomial.chebyshev.chebder(np.eye(_TERMS))
    return np.concatenate([slope, np.zeros((1, _TERMS))])
