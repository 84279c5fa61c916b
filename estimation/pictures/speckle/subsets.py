"""Subsets of a speckle picture, found again in other pictures by what is printed in them.

A subset is moved and deformed to first order, ξ → c + u + (I + G) ξ, until the other picture in it
is the reference's but for brightness and contrast. Inverse-compositional Gauss–Newton ([Baker2004]
S. Baker, I. Matthews, "Lucas-Kanade 20 Years On: A Unifying Framework"; [Pan2013] B. Pan, K. Li,
W. Tong, "Fast, Robust and Accurate Digital Image Correlation Calculation Without Redundant
Computations") linearises the reference, so that one matrix per subset, made once, takes grey levels
to steps. Brightness and contrast are two of its rows, so that no normalisation is needed.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

CLIPPED = (3.0, 250.0)
"""Grey levels, of 255, below and above which a pixel may be clipped."""
FINER, TAPS, KAISER = 3, 8, 5.0
"""How much finer pictures are made, and the length and the window of the filter that does it."""


class Subsets(NamedTuple):
    """Subsets of a reference picture.

    Attributes:
        centre: of each [px].
        offset: ξ, of its pixels from there [px].
        solve: takes the pixels' grey levels to the step of (u, G row by row), contrast and level.
        strength: root of the sum of squares of the grey levels about their mean.
        unit: covariance of (u, G row by row) at noise 1.
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
        """Some of the subsets."""
        return Subsets(
            self.centre[which],
            self.offset,
            self.solve[which],
            self.strength[which],
            self.unit[which],
        )


class Match(NamedTuple):
    """Subsets as they are in a picture.

    Attributes:
        position: of their centres [px].
        deformation: F = I + G.
        covariance: of position and F row by row, by the noise that the match leaves.
        correlation: zero-mean normalised cross-correlation with the reference [-].
        noise: standard deviation of what is left [grey levels of the reference].
        good: whether it has converged near its guess, inside the picture.
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
    """Square subsets about pixels of a reference picture, all inside it."""
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
    """Share of the pixels about each centre that are nearly black or white [-]."""
    clipped = ((grey < CLIPPED[0]) | (grey > CLIPPED[1])).astype(np.float32)
    size = 2 * round(radius) + 1
    share = cv2.blur(clipped, (size, size), borderType=cv2.BORDER_REPLICATE)
    last = np.array(grey.shape[::-1]) - 1
    x, y = np.clip(np.rint(np.nan_to_num(centre)).astype(int), 0, last).T
    return share[y, x].astype(float)


class Sampler:
    """A picture's grey levels between its pixels.

    The picture is made `FINER` times finer by a windowed sinc, and interpolated linearly there: as
    good as a cubic spline in the picture itself, for a fraction of the time.
    """

    def __init__(self, grey: Float32[np.ndarray, "h w"]) -> None:
        """Prepare a picture."""
        self.size = np.array(grey.shape[::-1])
        rows, columns = grey.shape
        kept, middle = np.ones(1, np.float32), TAPS // 2 - 1
        tall = np.empty((rows, FINER, columns), np.float32)
        tall[:, 0] = grey
        for part, taps in enumerate(BETWEEN, start=1):
            tall[:, part] = cv2.sepFilter2D(
                grey, -1, kept, taps, anchor=(0, middle), borderType=cv2.BORDER_REPLICATE
            )
        tall = tall.reshape(FINER * rows, columns)
        across = [
            cv2.sepFilter2D(
                tall, -1, taps, kept, anchor=(middle, 0), borderType=cv2.BORDER_REPLICATE
            )
            for taps in BETWEEN
        ]
        self.fine = cv2.merge([tall, *across]).reshape(FINER * rows, FINER * columns)

    def __call__(
        self,
        offset: Float32[np.ndarray, "p 2"],
        place: Float[np.ndarray, "n 2"],
        shape: Float[np.ndarray, "n 2 2"],
    ) -> Float32[np.ndarray, "n p"]:
        """Grey levels of squares that are moved and deformed to first order.

        Args:
            offset: of their points from the middle [px].
            place: of their middles in the picture [px].
            shape: F of each.
        """
        motion = (FINER * np.concatenate([shape, place[..., None]], axis=2)).astype(np.float32)
        ahead = np.concatenate([offset, np.ones_like(offset[:, :1])], axis=1).T
        x, y = motion[:, 0] @ ahead, motion[:, 1] @ ahead
        return cv2.remap(self.fine, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _between(share: float) -> Float32[np.ndarray, " taps"]:
    """Weights of the pixels around for the value a share of the way from one to the next."""
    distance = np.arange(TAPS) - (TAPS // 2 - 1) - share
    window = np.i0(KAISER * np.sqrt(np.clip(1.0 - (2.0 * distance / TAPS) ** 2, 0.0, 1.0)))
    weight = np.sinc(distance) * window
    return (weight / weight.sum()).astype(np.float32)


BETWEEN = [_between(part / FINER) for part in range(1, FINER)]


def match_subsets(
    subsets: Subsets,
    sampler: Sampler,
    position: Float[np.ndarray, "n 2"],
    deformation: Float[np.ndarray, "n 2 2"],
) -> Match:
    """Find subsets in a picture; not those whose guess shows nothing like them.

    Args:
        subsets: of the reference.
        sampler: of the picture.
        position: guessed, within about half a speckle [px]; NaN for what is not looked for.
        deformation: guessed F, its rotation within about 10°.
    """
    # step of the subset's rim below which it has converged [px]: each next one is twenty times as
    # small, and then a tenth of the noise
    least_step = 0.02
    steps = 15  # most steps from one guess
    hopeful = 0.3  # correlation at a guess from which it is followed [-]
    stray = 0.6  # farthest a subset may go from its guess [subset radii]
    place, shape = position.copy(), deformation.copy()
    count, radius = len(place), subsets.radius
    active = _inside(sampler, place, shape, radius)
    converged = np.zeros(count, dtype=bool)
    alpha, left = np.zeros(count), np.full(count, np.inf)
    for turn in range(steps):
        which = np.flatnonzero(active)
        if not len(which):
            break
        grey = sampler(subsets.offset, place[which], shape[which])
        solve = subsets.solve if len(which) == count else subsets.solve[which]
        step = np.matmul(solve, grey[..., None])[..., 0].astype(float)
        grey -= grey.mean(axis=1, keepdims=True)
        alpha[which] = step[:, 6]
        left[which] = np.einsum("np,np->n", grey, grey)
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
            wild |= alpha[which] * subsets.strength[which] < hopeful * np.sqrt(left[which])
        active[which] = ~converged[which] & ~wild
        active[which] &= _inside(sampler, place[which], shape[which], radius)
    return _gather(subsets, sampler, place, shape, converged, alpha, left)


def _gather(
    subsets: Subsets,
    sampler: Sampler,
    place: Float[np.ndarray, "n 2"],
    shape: Float[np.ndarray, "n 2 2"],
    converged: Bool[np.ndarray, " n"],
    contrast: Float[np.ndarray, " n"],
    total: Float[np.ndarray, " n"],
) -> Match:
    """What was found, with what it leaves unexplained."""
    rounding = 1.0 / 12.0  # least variance of a pixel, that of rounding to whole grey levels
    good = converged & _inside(sampler, place, shape, subsets.radius)
    contrast = np.where(good, contrast, np.nan)
    explained = contrast * subsets.strength
    correlation = explained / np.sqrt(np.maximum(total, 1e-12))
    rest = (total - explained**2) / (len(subsets.offset) - 8)
    noise = np.sqrt(np.maximum(rest, rounding)) / contrast
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
    """Whether whole subsets lie in the picture."""
    reach = radius * np.abs(shape).sum(axis=2)
    with np.errstate(invalid="ignore"):
        return ((place >= reach) & (place <= sampler.size - 1 - reach)).all(axis=1)


def _inverse(matrix: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    a, b, c, d = matrix.reshape(-1, 4).T
    determinant = a * d - b * c
    determinant = np.where(np.abs(determinant) > 1e-3, determinant, np.nan)
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    return adjugate / determinant[:, None, None]
