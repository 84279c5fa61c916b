"""X-corners: the fit of a blurred saddle, its position and both edge angles, batched.

The model is the product of two straight edges under a Gaussian blur. With t₁, t₂ the distances
from the edges over the blur and ρ the cosine between their normals, the mean of sgn·sgn under the
blur is 4 Φ₂(t₁, t₂; ρ) − 2 Φ(t₁) − 2 Φ(t₂) + 1, of which the expansion in ρ (Mehler's) is taken to
first order: erf(t₁/√2) erf(t₂/√2) + 4 ρ φ(t₁) φ(t₂). What is left out is symmetric about the corner
and biases neither its position nor the mean of its angles.
"""

from functools import partial
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from estimation.images.rings import Rings, find_saddles, half_edges, read_rings

STEPS = 5
"""Most steps of a fit; corners that have settled before take no more."""
LONGEST = np.array([1.0, 1.0, 0.3, 0.3, 0.4], dtype=np.float32)
"""Longest step in x and y [px], both angles [rad] and the blur [px]."""
SETTLED = 0.12
"""Share of the longest step that the last may have: the next one is then below the noise."""
BATCH = 32
"""Corners fitted at a time: one size is compiled, and its arrays stay in the processor's cache."""
SIZES = (5, 9)
"""Pixels on each side of the middle that are looked at: two sizes are compiled."""
LARGEST_WINDOW = 9.5
"""Radius of the window about a corner [px]; a smaller pattern takes `WINDOW` of its pitch."""
WINDOW = 0.41
ROUND = 1.2
"""The window is a square less what lies farther from the corner than this, in its half sides."""
EXPLAINED = 0.8
"""Share of the picture around a corner that its fit must explain [-]."""
ODD = 15.0
"""Share that a fit may leave unexplained, over that of the typical corner: the rim of what covers
the pattern makes corners of its own."""


class CornerStyle(NamedTuple):
    """What the corners of a sensor look like.

    Attributes:
        pitch: typical distance between corners [px].
        blur: typical standard deviation of the point spread [px].
    """

    pitch: float
    blur: float = 1.0

    @property
    def radius(self) -> float:
        """Half the side of the window about a corner [px], in steps of half a pixel."""
        return min(LARGEST_WINDOW, float(np.floor(2.0 * WINDOW * self.pitch)) / 2.0)


class Corners(NamedTuple):
    """X-corners of a picture.

    Attributes:
        position: of each [px], x right and y down, the first pixel's middle at 0.
        angles: of the rising and the falling edge [rad, from x to y, modulo π].
        covariance: of x, y and both angles, from the misfit of the fit [px, rad].
        blur: standard deviation of the point spread, the pixel's own width included [px].
        contrast: grey level of bright minus dark cells.
        level: grey level half-way between them.
        explained: share of the picture's variance around the corner that the fit explains [-]; 0
            where it has not settled.
    """

    position: Float[np.ndarray, "n 2"]
    angles: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 4 4"]
    blur: Float[np.ndarray, " n"]
    contrast: Float[np.ndarray, " n"]
    level: Float[np.ndarray, " n"]
    explained: Float[np.ndarray, " n"]

    @property
    def directions(self) -> Float[np.ndarray, "n 4"]:
        """Of the four half edges, rising and falling in turn, in ascending order [rad]."""
        return half_edges(self.angles)

    def take(self, which: Shaped[np.ndarray, " m"]) -> "Corners":
        """Some of the corners."""
        return Corners(*(value[which] for value in self))


def find_corners(grey: Float[np.ndarray, "h w"], style: CornerStyle) -> Corners:
    """The corners of a picture: saddles that both rings confirm and the fit explains.

    Args:
        grey: the picture, 0 to 255.
        style: what the corners look like.
    """
    rings = find_rings(grey, style)
    corners = fit_corners(grey, rings, style)
    good = (corners.explained > EXPLAINED) & (corners.contrast > 0.0)
    good &= np.linalg.norm(corners.position - rings.position, axis=1) < 0.2 * style.radius
    good &= np.isfinite(corners.covariance).all(axis=(1, 2))
    if good.any():
        good &= corners.contrast > 0.3 * np.median(corners.contrast[good])
        left = 1.0 - corners.explained
        good &= left < ODD * np.median(left[good])
    return corners.take(good)


def find_rings(grey: Float[np.ndarray, "h w"], style: CornerStyle) -> Rings:
    """The saddles of a picture that both rings confirm."""
    rings = read_rings(grey, find_saddles(grey, style.radius).astype(float), style.radius)
    return rings.take(rings.good)


def fit_corners(grey: Float[np.ndarray, "h w"], start: Rings, style: CornerStyle) -> Corners:
    """Fit position, both angles, blur, contrast and a sloping background.

    Args:
        grey: the picture, 0 to 255.
        start: corners to start from, each good to a tenth of the window.
        style: what the corners look like.
    """
    half = min(size for size in SIZES if size >= int(style.radius))
    middle = np.rint(start.position).astype(int)
    padded = cv2.copyMakeBorder(grey, half, half, half, half, cv2.BORDER_CONSTANT, value=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * half + 1, 2 * half + 1))
    rising, falling = start.angles.T
    falling = rising + (falling - rising) % np.pi  # bright lies between the two, in this order
    p = np.zeros((len(middle), 9), dtype=np.float32)
    p[:, :2] = start.position - middle
    p[:, 2:5] = np.column_stack([rising, falling, np.full_like(rising, style.blur)])
    p[:, 5:7] = np.column_stack([0.5 * start.contrast, start.level])
    covariance, explained = np.zeros((len(p), 4, 4)), np.zeros(len(p))
    left = np.arange(len(p))
    for _ in range(STEPS):
        if not len(left):
            break
        stepped = [
            _step_batch(windows, middle[some], p[some], style.radius, half)
            for some in np.split(left, range(BATCH, len(left), BATCH))
        ]
        parts = [np.concatenate(one) for one in zip(*stepped, strict=True)]
        p[left], covariance[left], explained[left], share = parts
        left = left[share > SETTLED]
    explained[left] = 0.0
    p = p.astype(float)
    return Corners(
        position=middle + p[:, :2],
        angles=p[:, 2:4] % np.pi,
        covariance=covariance,
        blur=p[:, 4],
        contrast=2.0 * p[:, 5],
        level=p[:, 6],
        explained=explained,
    )


def _step_batch(
    windows: np.ndarray, middle: np.ndarray, p: np.ndarray, radius: float, half: int
) -> list[np.ndarray]:
    """A step of some corners, filled up to the one size that is compiled."""
    count = len(p)
    where, full = np.zeros((BATCH, 2), dtype=int), np.ones((BATCH, 9), dtype=np.float32)
    where[:count], full[:count] = middle, p
    found = _step(windows[where[:, 1], where[:, 0]], full, np.float32(radius), half)
    return [np.asarray(one)[:count] for one in found]


@partial(jax.jit, static_argnames="half")
def _step(
    windows: Float[Array, "n side side"],
    p: Float[Array, "n 9"],
    radius: Float[Array, ""],
    half: int,
) -> tuple[Array, Array, Array, Array]:
    """Gauss–Newton in all corners at once; parameters: x, y, angles, blur, half contrast, light.

    Returns:
        The parameters, the covariance of the first four, the share of the variance that is
        explained, and the step over the longest one allowed.
    """
    steps = jnp.arange(-half, half + 1)
    dy, dx = (a.ravel().astype(jnp.float32) for a in jnp.meshgrid(steps, steps, indexing="ij"))
    value = windows.reshape(len(windows), -1)
    inside = jnp.isfinite(value) & (dx**2 + dy**2 <= (ROUND * radius) ** 2)
    inside &= jnp.maximum(jnp.abs(dx), jnp.abs(dy)) <= radius
    value = jnp.where(inside, value, 0.0)
    weight = inside.astype(jnp.float32)
    root_half, density = np.float32(np.sqrt(0.5)), np.float32(1.0 / np.sqrt(2.0 * np.pi))

    x, y = dx - p[:, :1], dy - p[:, 1:2]
    c1, s1, c2, s2 = (f(p[:, i : i + 1]) for i in (2, 3) for f in (jnp.cos, jnp.sin))
    blur, half_contrast = p[:, 4:5], p[:, 5:6]
    t1, t2 = (c1 * y - s1 * x) / blur, (c2 * y - s2 * x) / blur
    e1, e2 = jax.lax.erf(t1 * root_half), jax.lax.erf(t2 * root_half)
    f1, f2 = density * jnp.exp(-0.5 * t1**2), density * jnp.exp(-0.5 * t2**2)
    e1, e2, f1, f2 = jax.lax.optimization_barrier((e1, e2, f1, f2))  # once, not for each column
    rho = c1 * c2 + s1 * s2
    both = 4.0 * f1 * f2
    saddle = e1 * e2 + rho * both
    by_t1 = 2.0 * f1 * e2 - rho * t1 * both
    by_t2 = 2.0 * f2 * e1 - rho * t2 * both
    by_rho = both * (s1 * c2 - c1 * s2)  # times dρ/dα₁ = −sin(α₁ − α₂)
    scale = -half_contrast / blur
    along1, along2 = (c1 * x + s1 * y), (c2 * x + s2 * y)
    columns = [
        scale * (s1 * by_t1 + s2 * by_t2),
        -scale * (c1 * by_t1 + c2 * by_t2),
        -scale * along1 * by_t1 + half_contrast * by_rho,
        -scale * along2 * by_t2 - half_contrast * by_rho,
        -scale * (t1 * by_t1 + t2 * by_t2),
        -saddle,
        jnp.ones_like(saddle),
        jnp.broadcast_to(dx, saddle.shape),
        jnp.broadcast_to(dy, saddle.shape),
    ]
    fitted = p[:, 6:7] + p[:, 7:8] * dx + p[:, 8:9] * dy - half_contrast * saddle
    columns = jnp.stack([*columns, value - fitted], axis=1) * weight[:, None]
    products = columns @ columns.transpose(0, 2, 1)
    matrix, right = products[:, :9, :9], products[:, :9, 9]
    damping = 1e-6 * jnp.einsum("nii->ni", matrix) + 1e-6
    factor = jnp.linalg.cholesky(matrix + damping[:, :, None] * jnp.eye(9, dtype=jnp.float32))
    sides = jnp.broadcast_to(jnp.eye(9, 4, dtype=jnp.float32), (len(p), 9, 4))
    solved = jax.scipy.linalg.cho_solve(
        (factor, True), jnp.concatenate([right[..., None], sides], axis=2)
    )
    change = solved[..., 0]
    misfit = products[:, 9, 9] - (right * change).sum(axis=1)
    share = jnp.max(jnp.abs(change[:, :5]) / LONGEST, axis=1)
    p = p + change / jnp.maximum(share, 1.0)[:, None]
    p = p.at[:, 4].set(jnp.clip(p[:, 4], 0.3, 0.4 * radius))
    total = weight.sum(axis=1)
    variance = misfit / jnp.maximum(total - 9.0, 1.0)
    mean = value.sum(axis=1, keepdims=True) / total[:, None]
    spread = (((value - mean) * weight) ** 2).sum(axis=1)
    return (
        p,
        solved[:, :4, 1:] * variance[:, None, None],
        1.0 - misfit / jnp.maximum(spread, 1e-6),
        share,
    )
