"""Pictures warped back to the gel at rest, by the displacement of its dots, and their structure."""

from dataclasses import dataclass
from functools import cached_property, reduce
from math import isqrt

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import minimum_filter
from scipy.spatial.distance import cdist
from scipy.special import xlogy

from estimation.frames.state import WithoutCaches
from estimation.pictures.imprint.painted import Painted, add_squares
from estimation.pictures.lattice import Reference


@dataclass(frozen=True, eq=False)
class Print(WithoutCaches):
    """A picture warped back to the gel at rest, in a window around every dot.

    Attributes:
        planes: its colours without dots and slow changes of light, grey levels of 255; 0 where
            hidden.
        shown: where the gel is visible without a dot.
    """

    planes: list[Float32[np.ndarray, "m pixels"]]
    shown: Bool[np.ndarray, "m pixels"]

    @cached_property
    def power(self) -> Float32[np.ndarray, "m pixels"]:
        """Sum of squares over the colours."""
        return add_squares(self.planes)

    @cached_property
    def clear(self) -> Float32[np.ndarray, "m pixels"]:
        """1 where the gel is visible without a dot, else 0."""
        return self.shown.astype(np.float32)


class Warp:
    """Warps pictures of one size so that their dots are at rest, by a thin plate through them."""

    def __init__(self, reference: Reference, painted: Painted, window: float, spacing: int) -> None:
        """Lay a grid of points over pictures of this size, with their weights of the dots.

        The windows around the dots are mirrored at the picture's edge. `HoldSettings` describes the
        side of a window [pitches] and the spacing of the grid [px of the scaled picture].
        """
        places, pitch = reference.position, reference.pitch
        self._places, self._spacing, self._part = places, spacing, painted.part
        height, width = painted.clear.shape
        self._shape = (-(-height // spacing) + 2, -(-width // spacing) + 2)
        row, column = np.mgrid[: self._shape[0], : self._shape[1]]
        points = spacing * (np.stack([column, row], axis=-1).reshape(-1, 2) - 0.5) - 0.5
        self._grid = points * self._part
        scaled = places / pitch
        self._spread = RBFInterpolator(scaled, np.eye(len(scaled)))(self._grid / pitch)
        apart, plane = cdist(scaled, scaled), np.insert(scaled, 0, 1.0, axis=1)
        plate = np.block([[apart * xlogy(apart, apart), plane], [plane.T, np.zeros((3, 3))]])
        self._bending = np.linalg.inv(plate)[: len(scaled), : len(scaled)]
        half = int(0.5 * window * pitch / self._part)
        last = np.array([[width - 1], [height - 1]])
        place = np.clip(np.rint(places.T / self._part), 0, last)
        column, row = last[..., None] - np.abs(
            last[..., None] - np.abs(place[..., None] + np.arange(-half, half + 1))
        )
        index = (row[:, :, None] + spacing) * spacing * self._shape[1] + column[:, None] + spacing
        self._windows = index.reshape(len(row), -1).astype(int)

    def take_back(self, painted: Painted, position: Float[np.ndarray, "m 2"]) -> Print:
        """A picture warped so that its dots are at rest."""
        moved = position - self._places
        lost = np.isnan(moved[:, 0])
        if lost.any():  # they leave the thin plate through the other dots as it is
            pull = self._bending[lost]
            moved[lost] = np.linalg.solve(pull[:, lost], -pull[:, ~lost] @ moved[~lost])
        coarse = (self._grid + self._spread @ moved) / self._part
        coarse = coarse.reshape(*self._shape, 2).astype(np.float32)
        spacing = self._spacing
        fine = cv2.resize(coarse, None, fx=spacing, fy=spacing, interpolation=cv2.INTER_LINEAR)
        where = np.take(fine.view(np.complex64), self._windows)
        column, row = where.real.copy(), where.imag.copy()
        together = cv2.merge([*painted.planes, painted.inner])  # faster than plane by plane
        warped = cv2.remap(together, column, row, cv2.INTER_LINEAR)
        shown = warped[..., -1] > 0.9
        return Print([warped[..., k] * shown for k in range(len(painted.planes))], shown)


def find_structure(shown: Print) -> Float32[np.ndarray, "m 2 2"]:
    """Mean products of the print's slopes along x and y around each dot, over all colours [1/px²].

    Pixels beside the dots are left out, because they keep some of the dots' light. Where the dots
    are too close together to leave any, it is NaN.
    """
    beside = 2  # reach of hidden pixels: the width of the smoothing, and a slope [px]
    side = isqrt(shown.clear.shape[1])
    clear = shown.clear.reshape(-1, side, side)
    inner = minimum_filter(clear, (1, 2 * beside + 1, 2 * beside + 1))[:, 1:-1, 1:-1]
    slopes = []
    for plane in shown.planes:
        level = plane.reshape(-1, side, side)
        right = 0.5 * (level[:, 1:-1, 2:] - level[:, 1:-1, :-2])
        down = 0.5 * (level[:, 2:, 1:-1] - level[:, :-2, 1:-1])
        slopes.append(np.stack([right * inner, down * inner], axis=1))
    product = reduce(np.add, (np.einsum("mikl,mjkl->mij", slope, slope) for slope in slopes))
    pixels = inner.sum(axis=(1, 2))
    return product / np.where(pixels > 0.0, pixels, np.nan)[:, None, None]
