"""Matching of subsets of a speckle picture (digital image correlation).

A subset is moved and deformed to first order, ξ → c + u + (I + G) ξ, until the picture in it equals
the reference except for brightness and contrast. The method is inverse-compositional Gauss–Newton
([Baker2004] S. Baker, I. Matthews, "Lucas-Kanade 20 Years On: A Unifying Framework"; [Pan2013] B.
Pan, K. Li, W. Tong, "Fast, Robust and Accurate Digital Image Correlation Calculation Without
Redundant Computations"). It linearises the reference, so that one matrix per subset, computed once,
maps grey levels to steps. Brightness and contrast are two of the matrix's rows, so that no
normalisation is needed.
"""

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int


class Subsets(NamedTuple):
    """Subsets of a reference picture.

    Attributes:
        centre: of each subset [px].
        offset: ξ, of the pixels from the centre [px].
        solve: maps the pixels' grey levels to the step of (u, G row by row), contrast and level.
        strength: norm of the grey levels minus their mean.
        unit: covariance of (u, G row by row) for noise of 1 grey level.
    """

    centre: Float[np.ndarray, "n 2"]
    offset: Float32[np.ndarray, "p 2"]
    solve: Float32[np.ndarray, "n 8 p"]
    strength: Float[np.ndarray, " n"]
    unit: Float[np.ndarray, "n 6 6"]

    @property
    def radius(self) -> float:
        """Half the side of a subset [px]."""
        return float(self.offset.max())

    def take(self, which: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Subsets":
        """Select subsets by index or mask."""
        return Subsets(
            self.centre[which],
            self.offset,
            self.solve[which],
            self.strength[which],
            self.unit[which],
        )


class Match(NamedTuple):
    """Subsets matched to a picture.

    Attributes:
        position: of their centres [px].
        deformation: F = I + G.
        covariance: of position and F row by row, from the residual of the match.
        correlation: zero-mean normalised cross-correlation with the reference [-].
        noise: standard deviation of the residual [grey levels of the reference].
        good: whether the match has converged near its guess, inside the picture.
    """

    position: Float[np.ndarray, "n 2"]
    deformation: Float[np.ndarray, "n 2 2"]
    covariance: Float[np.ndarray, "n 6 6"]
    correlation: Float[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    good: Bool[np.ndarray, " n"]


def make_subsets(
    grey: Float32[np.ndarray, "h w"], centre: Int[np.ndarray, "n 2"], radius: int
) -> Subsets:
    """Make square subsets around pixels of a reference picture.

    Args:
        grey: the reference picture, 0 to 255.
        centre: x and y of the pixels; all subsets must lie inside the picture.
        radius: half the side of a subset [px].
    """
    side = np.arange(-radius, radius + 1)
    offset = np.stack(np.meshgrid(side, side, indexing="xy"), axis=-1).reshape(-1, 2)
    at = centre[:, None] + offset
    slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    one = np.ones(1)
    across, down = (
        cv2.sepFilter2D(grey, cv2.CV_32F, *kernels)[at[..., 1], at[..., 0]].astype(float)
        for kernels in ((slope, one), (one, slope))
    )
    value = grey[at[..., 1], at[..., 0]].astype(float)
    value -= value.mean(axis=1, keepdims=True)
    x, y = offset.T
    columns = [across, down, across * x, across * y, down * x, down * y]
    jacobian = np.stack([*columns, value, np.ones_like(value)], axis=1)
    scale = np.maximum(np.linalg.norm(jacobian, axis=2), 1e-6)
    unit = jacobian / scale[..., None]
    normal = unit @ unit.transpose(0, 2, 1) + 1e-9 * np.eye(8)
    inverse = np.linalg.inv(normal) / (scale[:, :, None] * scale[:, None, :])
    return Subsets(
        centre=centre.astype(float),
        offset=offset.astype(np.float32),
        solve=(inverse @ jacobian).astype(np.float32),
        strength=np.linalg.norm(value, axis=1),
        unit=inverse[:, :6, :6],
    )


def count_clipped(
    grey: Float32[np.ndarray, "h w"], centre: Float[np.ndarray, "n 2"], radius: float
) -> Float[np.ndarray, " n"]:
    """Share of nearly black or white pixels around each centre [-]."""
    black, white = 3.0, 250.0  # grey levels of 255 beyond which a pixel may be clipped
    clipped = ((grey < black) | (grey > white)).astype(np.float32)
    size = 2 * round(radius) + 1
    share = cv2.blur(clipped, (size, size), borderType=cv2.BORDER_REPLICATE)
    last = np.array(grey.shape[::-1]) - 1
    x, y = np.clip(np.rint(np.nan_to_num(centre)).astype(int), 0, last).T
    return share[y, x].astype(float)


class Sampler:
    """Interpolates a picture's grey levels between pixels.

    The picture is upsampled `finer` times by a windowed sinc, and then interpolated linearly. This
    is as accurate as a cubic spline in the original picture, for a fraction of the time.
    """

    finer = 3

    def __init__(self, grey: Float32[np.ndarray, "h w"]) -> None:
        """Prepare a picture."""
        self.size = np.array(grey.shape[::-1])
        rows, columns = grey.shape
        finer, between = self.finer, _make_filters(self.finer)
        single, middle = np.ones(1, np.float32), len(between[0]) // 2 - 1
        tall = np.empty((rows, finer, columns), np.float32)
        tall[:, 0] = grey
        for part, taps in enumerate(between, start=1):
            tall[:, part] = cv2.sepFilter2D(
                grey, -1, single, taps, anchor=(0, middle), borderType=cv2.BORDER_REPLICATE
            )
        tall = tall.reshape(finer * rows, columns)
        across = [
            cv2.sepFilter2D(
                tall, -1, taps, single, anchor=(middle, 0), borderType=cv2.BORDER_REPLICATE
            )
            for taps in between
        ]
        self.fine = cv2.merge([tall, *across]).reshape(finer * rows, finer * columns)

    def __call__(
        self,
        offset: Float32[np.ndarray, "p 2"],
        place: Float[np.ndarray, "n 2"],
        shape: Float[np.ndarray, "n 2 2"],
    ) -> Float32[np.ndarray, "n p"]:
        """Grey levels of squares that are moved and deformed to first order.

        Args:
            offset: of a square's points from its middle [px].
            place: of the squares' middles in the picture [px].
            shape: deformation gradient F of each square.
        """
        motion = (self.finer * np.concatenate([shape, place[..., None]], axis=2)).astype(np.float32)
        ahead = np.concatenate([offset, np.ones_like(offset[:, :1])], axis=1).T
        x, y = motion[:, 0] @ ahead, motion[:, 1] @ ahead
        return cv2.remap(self.fine, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


@cache
def _make_filters(finer: int) -> tuple[Float32[np.ndarray, " taps"], ...]:
    """Weights of the pixels around for the values at each `finer`-th part between two pixels."""
    taps, kaiser = 8, 5.0  # length and Kaiser parameter of the filters
    filters = []
    for part in range(1, finer):
        distance = np.arange(taps) - (taps // 2 - 1) - part / finer
        window = np.i0(kaiser * np.sqrt(np.clip(1.0 - (2.0 * distance / taps) ** 2, 0.0, 1.0)))
        weight = np.sinc(distance) * window
        filters.append((weight / weight.sum()).astype(np.float32))
    return tuple(filters)


def match_subsets(
    subsets: Subsets,
    sampler: Sampler,
    position: Float[np.ndarray, "n 2"],
    deformation: Float[np.ndarray, "n 2 2"],
) -> Match:
    """Match subsets to a picture; subsets whose guess correlates too little are not matched.

    Args:
        subsets: of the reference.
        sampler: of the picture.
        position: guessed position, within about half a speckle [px]; NaN to skip a subset.
        deformation: guessed F, with a rotation within about 10°.
    """
    # step of the subset's rim below which the match has converged [px]: the next step would be
    # twenty times smaller, a tenth of the noise
    least_step = 0.02
    steps = 15  # largest number of steps from one guess
    hopeful = 0.3  # least correlation at a guess [-]
    stray = 0.6  # largest distance of a subset from its guess [subset radii]
    place, shape = position.copy(), deformation.copy()
    count, radius = len(place), subsets.radius
    active = _inside(sampler, place, shape, radius)
    converged = np.zeros(count, dtype=bool)
    alpha, power = np.zeros(count), np.full(count, np.inf)
    for turn in range(steps):
        which = np.flatnonzero(active)
        if not len(which):
            break
        grey = sampler(subsets.offset, place[which], shape[which])
        solve = subsets.solve if len(which) == count else subsets.solve[which]
        step = np.matmul(solve, grey[..., None])[..., 0].astype(float)
        grey -= grey.mean(axis=1, keepdims=True)
        alpha[which] = step[:, 6]
        power[which] = np.einsum("np,np->n", grey, grey)
        contrast = np.where(step[:, 6] > 0.0, step[:, 6], np.nan)
        shift, gradient = step[:, :2] / contrast[:, None], step[:, 2:6] / contrast[:, None]
        inverse = _inverse(np.eye(2) + gradient.reshape(-1, 2, 2))
        shape[which] = shape[which] @ inverse
        place[which] -= np.einsum("nij,nj->ni", shape[which], shift)
        moved = np.hypot(*shift.T) + radius * np.sqrt(np.sum(gradient**2, axis=1))
        converged[which] = moved < least_step
        strayed = np.linalg.norm(place[which] - position[which], axis=1) > stray * radius
        wild = ~np.isfinite(moved) | strayed | (moved > 2.0 * radius)
        if not turn:
            wild |= alpha[which] * subsets.strength[which] < hopeful * np.sqrt(power[which])
        active[which] = ~converged[which] & ~wild
        active[which] &= _inside(sampler, place[which], shape[which], radius)
    return _gather(subsets, sampler, place, shape, converged, alpha, power)


def _gather(
    subsets: Subsets,
    sampler: Sampler,
    place: Float[np.ndarray, "n 2"],
    shape: Float[np.ndarray, "n 2 2"],
    converged: Bool[np.ndarray, " n"],
    contrast: Float[np.ndarray, " n"],
    total: Float[np.ndarray, " n"],
) -> Match:
    """Make the match, with correlation, noise and covariance from its residual."""
    rounding = 1.0 / 12.0  # least variance of a pixel, from rounding to whole grey levels
    good = converged & _inside(sampler, place, shape, subsets.radius)
    contrast = np.where(good, contrast, np.nan)
    explained = contrast * subsets.strength
    correlation = explained / np.sqrt(np.maximum(total, 1e-12))
    variance = (total - explained**2) / (len(subsets.offset) - 8)
    noise = np.sqrt(np.maximum(variance, rounding)) / contrast
    turn = np.zeros((len(place), 6, 6))
    turn[:, :2, :2] = turn[:, 2:4, 2::2] = shape
    turn[:, 2:, 2:] = np.einsum("nij,kl->nikjl", shape, np.eye(2)).reshape(-1, 4, 4)
    covariance = noise[:, None, None] ** 2 * (turn @ subsets.unit @ turn.transpose(0, 2, 1))
    return Match(
        position=np.where(good[:, None], place, np.nan),
        deformation=np.where(good[:, None, None], shape, np.nan),
        covariance=covariance,
        correlation=np.where(good, correlation, 0.0),
        noise=noise,
        good=good,
    )


def polar_angle(deformation: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, " n"]:
    """Rotation of the polar decomposition of F [rad, from x to y]."""
    across = deformation[:, 1, 0] - deformation[:, 0, 1]
    return np.arctan2(across, deformation[:, 0, 0] + deformation[:, 1, 1])


def polar_variance(match: Match) -> Float[np.ndarray, " n"]:
    """Variance of the polar rotation [rad²]."""
    f = match.deformation
    across, along = f[:, 1, 0] - f[:, 0, 1], f[:, 0, 0] + f[:, 1, 1]
    slope = np.stack([-across, -along, along, -across], axis=1)
    slope /= (across**2 + along**2)[:, None]
    return np.einsum("ni,nij,nj->n", slope, match.covariance[:, 2:, 2:], slope)


def _inside(
    sampler: Sampler,
    place: Float[np.ndarray, "n 2"],
    shape: Float[np.ndarray, "n 2 2"],
    radius: float,
) -> Bool[np.ndarray, " n"]:
    """Whether each subset lies completely inside the picture."""
    reach = radius * np.abs(shape).sum(axis=2)
    with np.errstate(invalid="ignore"):
        return ((place >= reach) & (place <= sampler.size - 1 - reach)).all(axis=1)


def _inverse(matrix: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    a, b, c, d = matrix.reshape(-1, 4).T
    determinant = a * d - b * c
    determinant = np.where(np.abs(determinant) > 1e-3, determinant, np.nan)
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    return adjugate / determinant[:, None, None]
