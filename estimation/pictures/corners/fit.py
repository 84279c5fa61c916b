"""Fit of x-corners: position and both edge angles of a blurred saddle, many at once.

The model is the product of two straight edges under a Gaussian blur. With t₁, t₂ the distances
from the edges over the blur and ρ the cosine between their normals, the mean of sgn·sgn under the
blur is 4 Φ₂(t₁, t₂; ρ) − 2 Φ(t₁) − 2 Φ(t₂) + 1. Mehler's expansion in ρ is used to first order:
erf(t₁/√2) erf(t₂/√2) + 4 ρ φ(t₁) φ(t₂). The neglected terms are symmetric about the corner, and
bias neither its position nor the mean of its angles.

[Abramowitz1964] M. Abramowitz, I. A. Stegun (eds.), "Handbook of Mathematical Functions".
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from estimation.pictures.corners.rings import Rings, find_saddles, half_edges, read_rings


class CornerStyle(NamedTuple):
    """Appearance of a sensor's corners.

    Attributes:
        pitch: typical distance between corners [px].
        blur: typical standard deviation of the point spread [px].
    """

    pitch: float
    blur: float = 1.0

    @property
    def radius(self) -> float:
        """Half the side of the window around a corner [px], in steps of half a pixel."""
        largest_window, window = 9.5, 0.41  # half sides: at most [px], and in pitches
        return min(largest_window, float(np.floor(2.0 * window * self.pitch)) / 2.0)


class Corners(NamedTuple):
    """X-corners of a picture.

    Attributes:
        position: of each corner [px], x right and y down, the first pixel's middle at 0.
        angles: of the rising and the falling edge [rad, from x to y, modulo π].
        covariance: of x, y and both angles, from the residual of the fit [px, rad].
        blur: standard deviation of the point spread, including the pixel's width [px].
        contrast: grey level of bright minus dark cells.
        level: grey level half-way between bright and dark.
        explained: share of the picture's variance around the corner that the fit explains [-]; 0
            if the fit has not converged.
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
        """Directions of the four half edges, rising and falling in turn, ascending [rad]."""
        return half_edges(self.angles)

    @property
    def is_explained(self) -> Bool[np.ndarray, " n"]:
        """Whether the fit explains enough of the variance around each corner."""
        least = 0.8  # share that must be explained [-]
        return self.explained > least

    def take(self, which: Shaped[np.ndarray, " m"]) -> "Corners":
        """Select corners by index or mask."""
        return Corners(*(value[which] for value in self))


def find_corners(grey: Float[np.ndarray, "h w"], style: CornerStyle) -> Corners:
    """Find the corners of a picture: saddles confirmed by both rings and explained by the fit.

    Args:
        grey: the picture, 0 to 255.
        style: appearance of the corners.
    """
    # largest unexplained share of a fit, over that of the typical corner: the rim of an object that
    # covers the pattern makes false corners
    odd = 15.0
    rings = find_rings(grey, style)
    corners = fit_corners(grey, rings, style)
    good = corners.is_explained & (corners.contrast > 0.0)
    good &= np.linalg.norm(corners.position - rings.position, axis=1) < 0.2 * style.radius
    good &= np.isfinite(corners.covariance).all(axis=(1, 2))
    if good.any():
        good &= corners.contrast > 0.3 * np.median(corners.contrast[good])
        residual = 1.0 - corners.explained
        good &= residual < odd * np.median(residual[good])
    return corners.take(good)


def find_rings(grey: Float[np.ndarray, "h w"], style: CornerStyle) -> Rings:
    """Find the saddles of a picture that both rings confirm."""
    rings = read_rings(grey, find_saddles(grey, style.radius).astype(float), style.radius)
    return rings.take(rings.good)


def fit_corners(
    grey: Float[np.ndarray, "h w"], start: Rings | Corners, style: CornerStyle
) -> Corners:
    """Fit position, both angles, blur, contrast and a sloping background.

    Args:
        grey: the picture, 0 to 255.
        start: initial corners, each within a tenth of the window.
        style: appearance of the corners.
    """
    most_steps = 5  # largest number of steps of a fit
    # pixels of the windows fitted at a time, so that their arrays stay in the processor's cache
    pixels_at_once = 20000
    # a fit has converged if its step is below this share of the longest: the next is below noise
    settled = 0.12
    window = _Window.of_radius(style.radius)
    middle = np.rint(start.position).astype(int)
    rising, falling = start.angles.T
    falling = rising + (falling - rising) % np.pi  # bright from the rising to the falling edge
    p = np.zeros((len(middle), 9), dtype=np.float32)
    p[:, :2] = start.position - middle
    p[:, 2:5] = np.column_stack([rising, falling, np.full_like(rising, style.blur)])
    p[:, 5:7] = np.column_stack([0.5 * start.contrast, start.level])
    covariance, explained = np.zeros((len(p), 4, 4)), np.zeros(len(p))
    value = window.cut(grey, middle)
    active = np.arange(len(p))
    batch = max(pixels_at_once // len(window.dx), 1)
    for _ in range(most_steps):
        if not len(active):
            break
        stepped = [
            _step(window, value[rows], p[rows])
            for rows in np.split(active, range(batch, len(active), batch))
        ]
        parts = [np.concatenate(part) for part in zip(*stepped, strict=True)]
        p[active], covariance[active], explained[active], share = parts
        active = active[share > settled]
    explained[active] = 0.0
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


def reach_of_window(radius: float) -> float:
    """Distance from the corner up to which a window, a square without its corners, extends [px].

    Args:
        radius: half its side [px].
    """
    return 1.2 * radius


class _Window(NamedTuple):
    """The pixels around a corner that are fitted.

    Attributes:
        dx: of each pixel, from the middle pixel [px].
        dy: the same along y.
        radius: half the side [px].
    """

    dx: Float32[np.ndarray, " p"]
    dy: Float32[np.ndarray, " p"]
    radius: float

    @classmethod
    def of_radius(cls, radius: float) -> "_Window":
        half = int(radius)
        dy, dx = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1).astype(np.float32)
        inside = dx**2 + dy**2 <= reach_of_window(radius) ** 2
        return cls(dx[inside], dy[inside], radius)

    def cut(
        self, grey: Float[np.ndarray, "h w"], middle: Int[np.ndarray, "n 2"]
    ) -> Float32[np.ndarray, "n p"]:
        """Grey levels of the window's pixels around each middle; NaN outside the picture."""
        half = int(self.radius)
        padded = cv2.copyMakeBorder(grey, half, half, half, half, cv2.BORDER_CONSTANT, value=np.nan)
        wide = padded.shape[1]
        start = (middle[:, 1] + half) * wide + middle[:, 0] + half
        offset = self.dy.astype(int) * wide + self.dx.astype(int)
        return padded.ravel()[start[:, None] + offset].astype(np.float32)


def _step(
    window: _Window, value: Float32[np.ndarray, "n p"], p: Float32[np.ndarray, "n 9"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One Gauss–Newton step of several corners: x, y, angles, blur, half contrast, light.

    Returns:
        The parameters, the covariance of the first four, the explained share of the variance, and
        the step over the longest one allowed.
    """
    # longest step in x and y [px], both angles [rad] and the blur [px]
    longest_step = np.array([1.0, 1.0, 0.3, 0.3, 0.4], dtype=np.float32)
    inside = np.isfinite(value)
    value = np.where(inside, value, np.float32(0.0))
    columns = _linearise(window, p)
    light = columns[:, 6:9].transpose(0, 2, 1) @ p[:, 6:9, None]
    columns[:, 9] = value - light[..., 0] - p[:, 5:6] * columns[:, 5]
    if not inside.all():
        columns *= inside[:, None]
    products = (columns[:, :9] @ columns.transpose(0, 2, 1)).astype(float)
    matrix, right = products[..., :9], products[..., 9]
    damping = 1e-6 * np.einsum("nii->ni", matrix) + 1e-6
    inverse = np.linalg.inv(matrix + damping[:, :, None] * np.eye(9))
    change = np.einsum("nij,nj->ni", inverse, right)
    off = columns[:, 9]
    misfit = np.einsum("np,np->n", off, off) - np.einsum("ni,ni->n", right, change)
    share = np.max(np.abs(change[:, :5]) / longest_step, axis=1)
    p = p + (change / np.maximum(share, 1.0)[:, None]).astype(np.float32)
    p[:, 4] = np.clip(p[:, 4], 0.3, 0.4 * window.radius)
    total = inside.sum(axis=1)
    variance = misfit / np.maximum(total - 9.0, 1.0)
    mean = value.sum(axis=1) / total
    spread = np.einsum("np,np->n", value, value) - total * mean**2
    return (
        p,
        inverse[:, :4, :4] * variance[:, None, None],
        1.0 - misfit / np.maximum(spread, 1e-6),
        share,
    )


def _linearise(window: _Window, p: Float32[np.ndarray, "n 9"]) -> Float32[np.ndarray, "n 10 p"]:
    """Derivatives of the model by its nine parameters, and an empty column for the residual.

    The derivative by half the contrast is the negative of the model without its light.
    """
    dx, dy = window.dx, window.dy
    x, y = dx - p[:, :1], dy - p[:, 1:2]
    c1, s1, c2, s2 = (f(p[:, i : i + 1]) for i in (2, 3) for f in (np.cos, np.sin))
    blur, half_contrast = p[:, 4:5], p[:, 5:6]
    t1, t2 = (c1 * y - s1 * x) / blur, (c2 * y - s2 * x) / blur
    (e1, f1), (e2, f2) = _edge(t1), _edge(t2)
    rho = c1 * c2 + s1 * s2
    bells = 4.0 * f1 * f2
    saddle = e1 * e2 + rho * bells
    scale = -half_contrast / blur
    by_t1 = scale * (2.0 * f1 * e2 - rho * t1 * bells)
    by_t2 = scale * (2.0 * f2 * e1 - rho * t2 * bells)
    by_rho = half_contrast * (s1 * c2 - c1 * s2) * bells  # times dρ/dα₁ = −sin(α₁ − α₂)
    columns = np.empty((len(p), 10, len(dx)), dtype=np.float32)
    columns[:, 0] = s1 * by_t1 + s2 * by_t2
    columns[:, 1] = -c1 * by_t1 - c2 * by_t2
    columns[:, 2] = by_rho - (c1 * x + s1 * y) * by_t1
    columns[:, 3] = -by_rho - (c2 * x + s2 * y) * by_t2
    columns[:, 4] = -t1 * by_t1 - t2 * by_t2
    columns[:, 5] = -saddle
    columns[:, 6], columns[:, 7], columns[:, 8] = 1.0, dx, dy
    return columns


def _edge(t: Float32[np.ndarray, "n p"]) -> tuple[np.ndarray, np.ndarray]:
    """erf(t/√2) and the normal density, from one exponential ([Abramowitz1964] 7.1.26)."""
    # smallest exponent of a density: products of densities stay normal numbers, fast in float32
    faintest = np.float32(-20.0)
    # coefficients of [Abramowitz1964] 7.1.26, accurate to 1.5e-7, the precision of float32
    erf = (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429)
    bell = np.exp(np.maximum(-0.5 * t * t, faintest))
    k = 1.0 / (1.0 + np.float32(0.3275911 * np.sqrt(0.5)) * np.abs(t))
    tail = k * np.float32(erf[-1])
    for coefficient in erf[-2::-1]:
        tail = (tail + np.float32(coefficient)) * k
    return np.copysign(1.0 - tail * bell, t), np.float32(1.0 / np.sqrt(2.0 * np.pi)) * bell
