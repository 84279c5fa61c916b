"""The two-ring circular detector of x-corners, and its seeds.

[Li2024] Fig. 5(a): the crossings of edges with two circles around a corner give four edge lines,
whose mean is the angle of the line features. [Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang,
"Incipient Slip-Based Rotation Measurement via Visuotactile Sensing During In-Hand Object Pivoting".

An x-corner has two edges. On the way around it from x to y, the rising edge is crossed from dark to
bright, the falling edge from bright to dark. In all arrays the rising edge comes first.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped


class Rings(NamedTuple):
    """Results of the two-ring detector at each seed.

    Attributes:
        position: intersection of the two edges [px].
        angles: of the rising and the falling edge [rad, from x to y, modulo π].
        contrast: grey level of bright minus dark.
        level: grey level half-way between bright and dark.
        good: whether both circles have four crossings, and the edges fit together.
    """

    position: Float[np.ndarray, "n 2"]
    angles: Float[np.ndarray, "n 2"]
    contrast: Float[np.ndarray, " n"]
    level: Float[np.ndarray, " n"]
    good: Bool[np.ndarray, " n"]

    @property
    def directions(self) -> Float[np.ndarray, "n 4"]:
        """Directions of the four half edges, rising and falling in turn, ascending [rad]."""
        return half_edges(self.angles)

    def take(self, which: Shaped[np.ndarray, " m"]) -> "Rings":
        """Select corners by index or mask."""
        return Rings(*(value[which] for value in self))


def half_edges(angles: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 4"]:
    """Directions of a corner's four half edges, rising and falling in turn, ascending [rad].

    The sector between the first and the second is bright, between the second and the third dark.
    """
    rising, falling = angles.T
    falling = rising + (falling - rising) % np.pi
    return np.stack([rising, falling, rising + np.pi, falling + np.pi], axis=1)


def find_saddles(grey: Float[np.ndarray, "h w"], radius: float) -> Int[np.ndarray, "n 2"]:
    """Find pixels (x, y) of possible x-corners: the strongest saddles of the blurred picture.

    Args:
        grey: the picture, 0 to 255.
        radius: of the window around a corner [px].
    """
    faint = 0.3  # least strength of a seed, as a share of the strong seeds' strength
    # larger windows are searched in a picture that is reduced to about this radius [px]
    coarse = 4.5
    scale = max(int(radius / coarse), 1)
    if scale > 1:
        size = (grey.shape[1] // scale, grey.shape[0] // scale)
        grey = cv2.resize(
            grey[: scale * size[1], : scale * size[0]], size, None, 0, 0, cv2.INTER_AREA
        )
        radius /= scale
    smooth = cv2.GaussianBlur(grey, (0, 0), radius / 5.0)
    xx, yy, xy = (
        cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3) for order in ((2, 0), (0, 2), (1, 1))
    )
    response = 4.0 * xy * xy - xx * yy  # the kernel of xy is half as strong
    side = 2 * round(0.5 * radius) + 1
    highest = cv2.dilate(response, np.ones((side, side), np.uint8))
    y, x = np.nonzero((response == highest) & (response > 1e-3))
    strength = response[y, x]
    if not len(x):
        return np.zeros((0, 2), dtype=int)
    keep = strength > faint * np.percentile(strength, 90)
    return scale * np.stack([x[keep], y[keep]], axis=1) + scale // 2


def read_rings(
    grey: Float[np.ndarray, "h w"], centre: Float[np.ndarray, "n 2"], radius: float
) -> Rings:
    """Detect edge crossings on two circles, and the edges through them.

    Args:
        grey: the picture, 0 to 255.
        centre: of the circles, within a tenth of the radius of a corner [px].
        radius: of the window around a corner [px].
    """
    inner, outer = 0.4, 0.85  # radii of the circles, as shares of the window's
    samples = 64  # number of points on each circle
    least_contrast = 8.0  # least difference of bright and dark [grey levels of 255]
    if not len(centre):
        none = np.zeros(0)
        return Rings(centre, np.zeros((0, 2)), none, none, none > 0)
    turn = 2.0 * np.pi / samples * np.arange(samples)
    radii = radius * np.array([inner, outer])
    x, y = (
        (middle[:, None] + np.outer(radii, part).ravel()).astype(np.float32)
        for middle, part in zip(centre.T, (np.cos(turn), np.sin(turn)), strict=True)
    )
    value = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    value = value.reshape(len(centre), 2, samples)
    ordered = np.sort(value, axis=-1)
    bright = ordered[..., -samples // 4 :].mean(axis=(1, 2))
    dark = ordered[..., : samples // 4].mean(axis=(1, 2))
    level = 0.5 * (bright + dark)
    inside = ((centre > radius - 0.5) & (centre < np.array(grey.shape[::-1]) - radius)).all(axis=1)
    crossing, good = _crossings(value - level[:, None, None])
    good &= inside & (bright - dark > least_contrast)
    points = radii[:, None] * np.exp(1j * crossing)
    points = points.transpose(0, 2, 1)  # corner, crossing, circle
    line = points[..., 1] - points[..., 0]
    # opposite crossings belong to one edge, whose line runs through both
    direction = line[:, :2] - line[:, 2:]
    direction /= np.maximum(np.abs(direction), 1e-9)
    angles = np.angle(direction) % np.pi
    middle = points.mean(axis=2)
    middle = 0.5 * (middle[:, :2] + middle[:, 2:])
    off = np.imag(np.conj(direction) * middle)  # distance of each line from the circles' centre
    sine = np.imag(np.conj(direction[:, 0]) * direction[:, 1])
    good &= np.abs(sine) > 0.4
    sine = np.where(good, sine, 1.0)
    meet = (off[:, 0] * direction[:, 1] - off[:, 1] * direction[:, 0]) / sine
    position = centre + np.stack([meet.real, meet.imag], axis=1)
    good &= np.abs(meet) < 0.35 * radius
    return Rings(position, angles, bright - dark, level, good)


def _crossings(
    value: Float[np.ndarray, "n 2 samples"],
) -> tuple[Float[np.ndarray, "n 2 4"], Bool[np.ndarray, " n"]]:
    """Angles of the four crossings of each circle: rising, falling, rising, falling.

    Returns:
        The angles [rad], 0 unless there are four; and whether both circles have four crossings that
        match.
    """
    samples = value.shape[-1]
    above = value > 0.0
    after = np.roll(above, -1, axis=-1)
    cross = above != after
    good = (cross.sum(axis=-1) == 4).all(axis=-1)
    share = value / np.where(cross, value - np.roll(value, -1, axis=-1), 1.0)
    angles = np.zeros((len(value), 2, 4))
    at = np.flatnonzero(cross & good[:, None, None]).reshape(-1, 2, 4) % samples
    exact = at + np.take_along_axis(share[good], at, axis=-1)
    falls = np.take_along_axis(above[good], at[..., :1], axis=-1)
    exact = np.where(falls, np.roll(exact, -1, axis=-1), exact)
    exact *= 2.0 * np.pi / samples
    # the outer circle's first rising crossing may be the inner one's second
    apart = np.angle(np.exp(1j * (exact[:, 1] - exact[:, 0])))
    swapped = np.angle(np.exp(1j * (np.roll(exact[:, 1], 2, axis=-1) - exact[:, 0])))
    swap = np.abs(swapped).sum(axis=-1) < np.abs(apart).sum(axis=-1)
    exact[:, 1] = np.where(swap[:, None], np.roll(exact[:, 1], 2, axis=-1), exact[:, 1])
    apart = np.where(swap[:, None], swapped, apart)
    angles[good] = exact
    good[good] = (np.abs(apart) < 0.5).all(axis=-1)
    return angles, good
