"""Detection of dots: seeds from a difference of Gaussians, then a sub-pixel fit of each dot."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int, Shaped

from estimation.pictures.dots.fit import fit_windows


class DotStyle(NamedTuple):
    """Appearance of a sensor's dots.

    Attributes:
        dark: whether the dots are darker than their surroundings.
        radius: typical radius [px].
        blur: typical standard deviation of the point spread [px].
    """

    dark: bool
    radius: float
    blur: float = 1.0


class Dots(NamedTuple):
    """Dots of a picture.

    Attributes:
        centre: positions [px], x right and y down, the first pixel's middle at 0.
        covariance: of the position, from the residual of the fit [px²].
        axes: symmetric matrices that map the unit circle to each dot's rim [px].
        contrast: difference of grey level between dot and background, positive for a dot of the
            style's polarity.
        blur: standard deviation of the point spread [px].
        explained: share of the picture's variance around the dot that the fit explains [-].
    """

    centre: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 2 2"]
    axes: Float[np.ndarray, "n 2 2"]
    contrast: Float[np.ndarray, " n"]
    blur: Float[np.ndarray, " n"]
    explained: Float[np.ndarray, " n"]

    def take(self, which: Shaped[np.ndarray, " m"]) -> "Dots":
        """Select dots by index or mask."""
        return Dots(*(value[which] for value in self))

    @property
    def radius(self) -> Float[np.ndarray, " n"]:
        """Radius of the circle with each dot's area [px]."""
        xx, xy, yx, yy = self.axes.reshape(-1, 4).T
        return np.sqrt(np.abs(xx * yy - xy * yx))

    @property
    def elongation(self) -> Float[np.ndarray, " n"]:
        """Ratio of the longer axis to the shorter one [-]."""
        xx, xy, _, yy = self.axes.reshape(-1, 4).T
        mean, apart = 0.5 * np.abs(xx + yy), np.hypot(0.5 * (xx - yy), xy)
        return (mean + apart) / np.maximum(np.abs(mean - apart), 1e-6)


def find_seeds(grey: Float[np.ndarray, "h w"], style: DotStyle) -> Int[np.ndarray, "n 2"]:
    """Find pixels (x, y) of possible dots: maxima of a difference of Gaussians.

    Large dots are searched in a picture of half the size.
    """
    coarse = 4.0  # radius from which dots are searched at half the resolution [px]
    faint = 0.3  # least strength of a seed, as a share of the typical seed's
    part = 2 if style.radius >= coarse else 1
    if part == 2:
        grey = cv2.resize(
            grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA
        )
    radius = style.radius / part
    narrow = cv2.GaussianBlur(grey, (0, 0), 0.6 * radius)
    wide = cv2.GaussianBlur(narrow, (0, 0), 0.8 * radius)
    response = wide - narrow if style.dark else narrow - wide
    side = 2 * round(radius) + 1
    highest = cv2.dilate(response, np.ones((side, side), np.uint8))
    tops = np.flatnonzero((response == highest) & (response > 1.0))  # faster than `nonzero`
    y, x = np.divmod(tops, response.shape[1])
    strength = response[y, x]
    if not len(x):
        return np.zeros((0, 2), dtype=int)
    ranked = np.sort(strength)
    strong = ranked[np.searchsorted(ranked, 0.5 * ranked[int(0.9 * (len(ranked) - 1))]) :]
    keep = strength > faint * strong[len(strong) // 2]
    x, y = x[keep], y[keep]
    off = np.stack(_find_tops(response, y, x), axis=1)
    limit = part * np.array(response.shape[::-1]) - 1
    place = part * (np.stack([x, y], axis=1) + off) + 0.5 * (part - 1)
    return np.clip(np.rint(place), 0, limit).astype(int)


def _find_tops(
    response: Float[np.ndarray, "h w"], y: Int[np.ndarray, " n"], x: Int[np.ndarray, " n"]
) -> list[Float[np.ndarray, " n"]]:
    """Offsets, in x and y, of the tops of parabolas through three pixels from the middle pixel."""
    height, width = response.shape
    value, at, offsets = response.ravel(), y * width + x, []
    for place, size, step in ((x, width, 1), (y, height, width)):
        ahead, behind = value[at + step * (place < size - 1)], value[at - step * (place > 0)]
        bend = np.maximum(2.0 * value[at] - ahead - behind, 1e-6)
        offsets.append(np.clip(0.5 * (ahead - behind) / bend, -0.5, 0.5))
    return offsets


def fit_dots(
    grey: Float[np.ndarray, "h w"], seeds: Int[np.ndarray, "n 2"], style: DotStyle
) -> Dots:
    """Fit centre, shape, blur, contrast and a sloping background at every seed.

    Args:
        grey: the picture from `to_grey`.
        seeds: initial pixels, each within a radius of a dot's centre.
        style: typical radius, and whether the dots are dark.
    """
    at_once = 16  # dots fitted at a time, so that their arrays stay in the processor's cache
    half = int(np.ceil(1.5 * style.radius + 2.0))
    x, y = seeds.T[..., None] + np.arange(-half, half + 1)
    near = [np.clip(place, 0, size - 1) for place, size in zip((y, x), grey.shape, strict=True)]
    windows = grey[near[0][:, :, None], near[1][:, None]]
    windows[(near[0] != y)[:, :, None] | (near[1] != x)[:, None]] = np.nan
    parts = [
        fit_windows(batch, style.radius)
        for batch in np.split(windows, range(at_once, len(seeds), at_once))
    ]
    offset, covariance, shape, contrast, blur, explained = (
        np.concatenate(values).astype(float) for values in zip(*parts, strict=True)
    )
    return Dots(
        centre=seeds + offset,
        covariance=covariance,
        axes=np.linalg.inv(shape),
        contrast=contrast if style.dark else -contrast,
        blur=blur,
        explained=explained,
    )
