"""Turns of an object's print between two pictures, by a method that shares no code with ours.

The dots are painted over. The strength of the edges that are left is compared at all rotations and
shifts by normalised cross-correlation of what both pictures show ([Padfield2012] D. Padfield,
"Masked Object Registration in the Fourier Domain"). A turn counts only where its peak stands out.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8


class Edges(NamedTuple):
    """Strength of a picture's edges, and where it is known: not on dots, and not at the border."""

    strength: Float[np.ndarray, "h w"]
    known: Float[np.ndarray, "h w"]


class Registration(NamedTuple):
    """The turn with the highest correlation.

    Attributes:
        turn: of the second picture's print against the first's [deg, clockwise on the screen].
        correlation: of edges after this turn [-].
        rival: highest correlation after a turn that differs by more than 8° [-].
        inner: whether the turn is a peak, and not at the end of the fine search.
    """

    turn: float
    correlation: float
    rival: float
    inner: bool

    @property
    def clear(self) -> bool:
        """Whether the peak stands out."""
        return self.inner and self.correlation > 0.6 and self.correlation - self.rival > 0.2


class _Search(NamedTuple):
    """Rotations that are compared, in degrees."""

    furthest: float = 64.0
    coarse: float = 2.0
    fine: float = 0.5
    apart: float = 8.0  # rotations closer to a peak belong to it


def find_edges(picture: UInt8[np.ndarray, "h w 3"]) -> Edges:
    """The edges of a picture with dark dots of 2 to 8 px radius painted over."""
    dots = _find_dots(picture)
    painted = cv2.inpaint(picture, dots.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    smooth = cv2.GaussianBlur(painted.astype(np.float32), (0, 0), 1.2)
    slopes = [cv2.Sobel(smooth, cv2.CV_32F, *axis) for axis in ((1, 0), (0, 1))]
    strength = np.sqrt(np.sqrt(sum((slope**2).sum(axis=2) for slope in slopes)))
    border = 6
    known = np.zeros_like(strength)
    inside = slice(border, -border), slice(border, -border)
    known[inside] = ~dots[inside]
    return Edges(strength, known)


def register(first: Edges, second: Edges) -> Registration:
    """The turn between two pictures, at a quarter of their size and then at half of it."""
    search = _Search()
    steps = np.arange(-search.furthest, search.furthest + 0.1, search.coarse)
    found = _correlate(_reduce(first, 4), _reduce(second, 4), steps)
    best = steps[found.argmax()]
    rival = found[np.abs(steps - best) > search.apart].max()
    near = best + np.arange(-search.coarse, search.coarse + 0.1, search.fine)
    finer = _correlate(_reduce(first, 2), _reduce(second, 2), near)
    k = int(finer.argmax())
    inner = 0 < k < len(near) - 1
    before, at, after = finer[k - 1 : k + 2] if inner else (0.0, 1.0, 0.0)
    peak = 0.5 * (before - after) / (before - 2.0 * at + after)  # of a parabola
    return Registration(
        float(near[k] + peak * search.fine), float(found.max()), float(rival), inner
    )


def _find_dots(picture: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
    """Dark spots up to 17 px wide, and what surrounds them by 3 px."""
    grey = picture.astype(np.float32).mean(axis=2)
    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (17, 17))
    depth = cv2.morphologyEx(grey, cv2.MORPH_BLACKHAT, window)
    dark = depth > max(18.0, 0.35 * float(np.percentile(depth, 99.5)))
    _, labels, found, _ = cv2.connectedComponentsWithStats(dark.astype(np.uint8))
    widest = found[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    compact = (found[:, cv2.CC_STAT_AREA] >= 12) & (widest <= 30)
    compact[0] = False  # the background
    return cv2.dilate(compact[labels].astype(np.uint8), np.ones((7, 7))) > 0


def _reduce(edges: Edges, factor: int) -> Edges:
    """A smaller copy, without slow changes of the strength."""
    height, width = edges.strength.shape
    size = width // factor, height // factor
    known = cv2.resize(edges.known, size, interpolation=cv2.INTER_AREA)
    strength = cv2.resize(edges.strength * edges.known, size, interpolation=cv2.INTER_AREA)
    strength /= np.maximum(known, 1e-3)
    known = (known > 0.5).astype(np.float32)
    reach = 32.0 / factor
    share = np.maximum(cv2.GaussianBlur(known, (0, 0), reach), 1e-3)
    slow = cv2.GaussianBlur(strength * known, (0, 0), reach) / share
    return Edges((strength - slow) * known, known)


def _correlate(
    first: Edges, second: Edges, turns: Float[np.ndarray, " k"], overlap: float = 0.3
) -> Float[np.ndarray, " k"]:
    """The highest correlation over all shifts, for each turn of the first picture [deg].

    Args:
        first: edges that are turned.
        second: edges of as large a picture.
        turns: rotations [deg].
        overlap: least share of the picture that is known in both.
    """
    height, width = first.strength.shape
    padded = 2 * height, 2 * width
    fixed = _transform(second, padded)
    highest = []
    for turn in turns:
        turning = cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), -turn, 1.0)
        strength, known = (cv2.warpAffine(field, turning, (width, height)) for field in first)
        known = (known > 0.5).astype(np.float32)
        moving = [part.conj() for part in _transform(Edges(strength, known), padded)]
        count, a, aa, b, bb, ab = (
            np.fft.irfft2(fixed[i] * moving[j], padded)
            for i, j in ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1))
        )
        known_count = np.maximum(count, 1e-3)
        spread = np.sqrt(
            np.maximum(aa - a * a / known_count, 0.0) * np.maximum(bb - b * b / known_count, 0.0)
        )
        valid = (count > overlap * height * width) & (spread > 1e-3 * spread.max())
        values = (ab - a * b / known_count) / np.maximum(spread, 1e-9)
        highest.append(np.where(valid, values, -1.0).max())
    return np.array(highest)


def _transform(edges: Edges, padded: tuple[int, int]) -> list[np.ndarray]:
    """Transforms of the mask, of the strength, and of its square."""
    known = edges.strength * edges.known
    return [np.fft.rfft2(field, padded) for field in (edges.known, known, edges.strength * known)]
