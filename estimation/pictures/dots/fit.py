"""Blurred ellipses fitted to windows of a picture, many at once.

The profile across the rim is that of a straight edge under a Gaussian blur, ½ erfc(t/√2 s), t the
distance from the rim: exact for radii large against the blur, and symmetric about the centre for
all, so that the position is not biased by it.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def model_dots(
    p: Float[Array, "n 10"], dx: Float[Array, " pixels"], dy: Float[Array, " pixels"]
) -> tuple[Float[Array, "n pixels"], Float[Array, "n 10 pixels"]]:
    """Grey levels of blurred ellipses, and their derivatives.

    Args:
        p: centre, inverse shape (xx, yy, xy), blur, then what is linear: the dot's grey level less
            the background's, the background and its two slopes.
        dx: of the pixels, from the window's middle.
        dy: the same.
    """
    x, y = dx - p[:, :1], dy - p[:, 1:2]
    gx = p[:, 2:3] * x + p[:, 4:5] * y
    gy = p[:, 4:5] * x + p[:, 3:4] * y
    size = jnp.sqrt(gx**2 + gy**2 + 1e-6)
    nx = (p[:, 2:3] * gx + p[:, 4:5] * gy) / size
    ny = (p[:, 4:5] * gx + p[:, 3:4] * gy) / size
    slope = jnp.sqrt(nx**2 + ny**2 + 1e-9)
    t = (size - 1.0) / (slope * p[:, 5:6])
    inner = 0.5 * jax.lax.erfc(t * np.float32(np.sqrt(0.5)))
    linear = p[:, 6:7] * inner + p[:, 7:8] + p[:, 8:9] * dx + p[:, 9:10] * dy
    edge = -p[:, 6:7] * jnp.exp(-0.5 * t**2) * np.float32(1 / np.sqrt(2 * np.pi)) / p[:, 5:6]
    across = edge / (slope * size)
    columns = [
        -edge * nx / slope,
        -edge * ny / slope,
        across * gx * x,
        across * gy * y,
        across * (gx * y + gy * x),
        -edge * t,
        inner,
        jnp.ones_like(inner),
        jnp.broadcast_to(dx, inner.shape),
        jnp.broadcast_to(dy, inner.shape),
    ]
    return linear, jnp.stack(columns, axis=1)


@partial(jax.jit, static_argnames="half")
def fit_windows(
    windows: Float[Array, "n side side"], radius: Float[Array, ""], half: int
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Fit dots in windows around them, Gauss–Newton in all at once.

    Args:
        windows: grey levels, NaN outside the picture.
        radius: typical, of the dots [px].
        half: pixels from a window's middle to its edge.

    Returns:
        Offset from the window's middle [px], its covariance [px²], inverse shape [1/px], contrast,
        blur [px] and the share of the variance that the fit explains [-].
    """
    gauss_newton_steps = 5
    steps = jnp.arange(-half, half + 1)
    dy, dx = (a.ravel().astype(jnp.float32) for a in jnp.meshgrid(steps, steps, indexing="ij"))
    value = windows.reshape(len(windows), -1)
    inside = jnp.isfinite(value) & (dx**2 + dy**2 <= (half + 0.5) ** 2)
    value = jnp.where(inside, value, 0.0)
    weight = inside.astype(jnp.float32)

    equations = partial(_equations, value=value, weight=weight, pixels=(dx, dy))

    def step(_, p):
        matrix, right, _ = equations(p)
        change = jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(matrix), True), right[..., None])
        change = change[..., 0]
        limit = jnp.concatenate(
            [jnp.full(2, 0.3) * radius, jnp.full(3, 0.25) / radius, jnp.full(1, 0.4)]
        ).astype(jnp.float32)
        share = jnp.max(jnp.abs(change[:, :6]) / limit, axis=1, keepdims=True)
        p = p + change / jnp.maximum(share, 1.0)
        return p.at[:, 5].set(jnp.clip(p[:, 5], 0.3, 0.8 * radius))

    total = weight.sum(axis=1)
    mean = (value * weight).sum(axis=1) / total
    p = jax.lax.fori_loop(0, gauss_newton_steps, step, _start(value, mean, radius))
    matrix, _, residual = equations(p)
    variance = (residual**2).sum(axis=1) / jnp.maximum(total - 10.0, 1.0)
    columns = jnp.broadcast_to(jnp.eye(10, 2, dtype=jnp.float32), (len(p), 10, 2))
    inverse = jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(matrix), True), columns)
    spread = (((value - mean[:, None]) * weight) ** 2).sum(axis=1)
    shape = jnp.stack([p[:, 2], p[:, 4], p[:, 4], p[:, 3]], axis=1).reshape(-1, 2, 2)
    return (
        p[:, :2],
        inverse[:, :2] * variance[:, None, None],
        shape,
        -p[:, 6],
        p[:, 5],
        1.0 - (residual**2).sum(axis=1) / jnp.maximum(spread, 1e-6),
    )


def _start(value: Array, mean: Array, radius: Array) -> Array:
    """Round dots of the typical radius, their grey levels from middle and mean of the windows."""
    middle = value[:, value.shape[1] // 2]
    edge_level = 1.5 * mean - 0.5 * middle
    zero, one = jnp.zeros_like(mean), jnp.full_like(mean, 1.0)
    shape = (one / radius, one / radius, zero, one)  # xx, yy, xy and blur
    return jnp.stack([zero, zero, *shape, middle - edge_level, edge_level, zero, zero], axis=1)


def _equations(
    p: Array, value: Array, weight: Array, pixels: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Matrix and right side of a Gauss–Newton step, a little damped, and the residual."""
    fitted, jacobian = model_dots(p, *pixels)
    jacobian = jacobian * weight[:, None]
    residual = (value - fitted) * weight
    matrix = jacobian @ jacobian.transpose(0, 2, 1)
    damping = 1e-5 * jnp.einsum("nii->ni", matrix) + 1e-6
    matrix = matrix + damping[:, :, None] * jnp.eye(10, dtype=jnp.float32)
    return matrix, jnp.einsum("nip,np->ni", jacobian, residual), residual
