"""Whether the gel still holds the object, from the object's print in the gel's own coordinates.

Where the object sticks, its print moves with the dots around it. Where the object slips, its print
moves over the gel. Each picture is therefore warped back to the gel at rest, by the displacement of
the dots, and correlated with earlier pictures around every dot. The correlation is 1 where the
print has stayed in place on the gel, and near 0 where another part of the object has taken its
place. The method assumes neither a rigid object nor an axis of rotation.
"""

from collections import deque
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.interpolate import RBFInterpolator

from estimation.pictures.imprint.painted import Painted
from estimation.pictures.lattice import Reference

COARSE = 8
"""Spacing of the points at which the displacement is interpolated [px of the scaled picture]."""


@dataclass(frozen=True)
class HoldSettings:
    """Settings for the comparison of prints.

    Attributes:
        window: side of the square that is compared around a dot [pitches].
        age: interval at which an earlier picture is stored. The picture compared with is between
            one and two intervals old [frames].
        lately: age of the recent picture that is also compared with, for partial slip [frames].
        shortly: age of a still more recent one, for the end of a slip [frames].
        alike: correlation with the former from which the latter is not needed [-].
        contrast: texture from which an object counts as printed, over the texture of the barest
            dots [-].
        bare: share of the dots that count as the barest [-].
        printed: share of the dots that is always compared: the dots with the most texture [-].
        seen: share of a window that must be visible, without dots, in both pictures [-].
    """

    window: float = 1.0
    age: int = 16
    lately: int = 6
    shortly: int = 4
    alike: float = 0.95
    contrast: float = 2.0
    bare: float = 0.15
    printed: float = 0.15
    seen: float = 0.2


class Hold(NamedTuple):
    """Correlation of the print on the gel with earlier prints.

    Attributes:
        since: median correlation with the print half a second to a second before [-]; NaN where
            unknown.
        lately: median correlation with the print some frames before [-].
        weakest: tenth percentile of the correlation with the print slightly earlier [-].
    """

    since: float
    lately: float
    weakest: float


UNKNOWN = Hold(np.nan, np.nan, np.nan)
WEAKEST = 0.1


class Print(NamedTuple):
    """A picture warped back to the gel at rest.

    Attributes:
        planes: its colours without dots and slow changes of light, grey levels of 255.
        power: sum of squares over the colours.
        clear: 1 where the gel is visible without a dot, else 0.
    """

    planes: list[Float32[np.ndarray, "h w"]]
    power: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]


class HoldFollower:
    """Compares the print on the gel with the prints of earlier frames."""

    def __init__(self, reference: Reference, settings: HoldSettings | None = None) -> None:
        """Start at the next frame.

        Args:
            reference: dots at rest.
            settings: for the comparison; defaults if None.
        """
        self._places, self._pitch = reference.position, reference.pitch
        self._settings = settings or HoldSettings()
        self._grid: Float[np.ndarray, "points 2"] | None = None
        self.restart()

    def restart(self) -> None:
        """Forget earlier frames: the comparison starts at the next one."""
        self._earlier: list[Print] = []
        self._recent: deque[Print] = deque(maxlen=self._settings.lately + 1)
        self._frames = 0

    def update(self, painted: Painted, position: Float[np.ndarray, "m 2"]) -> Hold:
        """Compare the print of the next frame with earlier prints.

        Args:
            painted: the picture without its dots.
            position: dots in the picture [px]; NaN where not visible.
        """
        seen = np.isfinite(position[:, 0])
        if seen.sum() < 3:
            return UNKNOWN
        if self._grid is None:
            self._lay_grid(painted)
        now = self._take_back(painted, position)
        if self._frames % self._settings.age == 0:
            self._earlier = [*self._earlier[-1:], now]
        self._frames += 1
        self._recent.append(now)
        (since,) = self._compare(self._earlier[0], now, seen, 0.5)
        lately, weakest = self._compare(self._recent[0], now, seen, 0.5, WEAKEST)
        if lately < self._settings.alike:
            shortly = self._recent[-1 - min(self._settings.shortly, len(self._recent) - 1)]
            (lately,) = self._compare(shortly, now, seen, 0.5)
        return Hold(since, lately, weakest)

    def _lay_grid(self, painted: Painted) -> None:
        """Lay a grid of points over pictures of this size, with their weights of the dots."""
        self._part = painted.part
        height, width = painted.clear.shape
        self._shape = (-(-height // COARSE) + 1, -(-width // COARSE) + 1)
        row, column = np.mgrid[: self._shape[0], : self._shape[1]]
        self._grid = np.stack([column, row], axis=-1).reshape(-1, 2) * float(COARSE * self._part)
        places = self._places / self._pitch
        self._spread = RBFInterpolator(places, np.eye(len(places)))(self._grid / self._pitch)
        place = np.rint(self._places / self._part).astype(int)
        self._columns, self._rows = np.clip(place, 0, [width - 1, height - 1]).T

    def _take_back(self, painted: Painted, position: Float[np.ndarray, "m 2"]) -> Print:
        """A picture warped so that its dots are at rest."""
        assert self._grid is not None
        moved = position - self._places
        lost = np.isnan(moved[:, 0])
        if lost.any():
            places = self._places / self._pitch
            moved[lost] = RBFInterpolator(places[~lost], moved[~lost])(places[lost])
        height, width = painted.clear.shape
        coarse = (self._grid + self._spread @ moved) / self._part
        step = np.array([[COARSE, 0.0, 0.0], [0.0, COARSE, 0.0]])
        where = cv2.warpAffine(
            coarse.reshape(*self._shape, 2).astype(np.float32),
            step,
            (width, height),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        column, row = where[..., 0].copy(), where[..., 1].copy()
        *planes, clear = (
            cv2.remap(plane, column, row, cv2.INTER_LINEAR)
            for plane in (*painted.planes, painted.clear)
        )
        return Print(planes, _multiply(planes, planes), (clear > 0.9).astype(np.float32))

    def _compare(
        self, before: Print, now: Print, seen: Bool[np.ndarray, " m"], *shares: float
    ) -> list[float]:
        """Quantiles of the correlation around dots, weighted by the texture of the print."""
        settings = self._settings
        width = (2 * int(0.5 * settings.window * self._pitch / self._part) + 1,) * 2
        clear, product = before.clear * now.clear, _multiply(before.planes, now.planes)
        values = (plane * clear for plane in (product, before.power, now.power))
        around = cv2.blur(cv2.merge([clear, *values]), width)[self._rows, self._columns]
        share = around[:, 0]
        cross, first, second = around[:, 1:].T / (share + np.float32(1e-3))
        power = np.maximum(first, second)
        seen = seen & (share > settings.seen)
        if not seen.any():
            return [np.nan] * len(shares)
        ranked = np.sort(power[seen])  # `np.quantile` of so few takes as long as all other steps
        share_of = np.linspace(0.0, 1.0, len(ranked))
        bare, printed = np.interp([settings.bare, 1.0 - settings.printed], share_of, ranked)
        least = min(settings.contrast**2 * bare + 1.0, printed)
        weight = np.sqrt(np.maximum(power - least, 0.0)) * seen
        agreement = cross / np.sqrt(first * second + 1e-6)
        if not weight.any():
            return [np.nan] * len(shares)
        order = np.argsort(agreement)
        sums = np.cumsum(weight[order])
        places = np.searchsorted(sums, np.multiply(shares, sums[-1]))
        return agreement[order[places]].tolist()


def _multiply(
    before: list[Float32[np.ndarray, "h w"]], now: list[Float32[np.ndarray, "h w"]]
) -> Float32[np.ndarray, "h w"]:
    """Product of two pictures, summed over the colours."""
    return reduce(np.add, (a * b for a, b in zip(before, now, strict=True)))
