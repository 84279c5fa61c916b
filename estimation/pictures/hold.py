"""Whether the gel still holds what it touches: the object's print in the gel's own coordinates.

Where the object sticks, what it prints moves with the dots around it; where it slips, its print
goes over the gel, whichever way it slips and whatever the gel does meanwhile. Each picture is
therefore taken back to where the gel lay at rest, along the displacement that the dots show, and
compared around every dot with earlier ones: 1 where the print has stayed on the gel, near 0 where
another part of the object is there now. That needs no rigid object and no axis of rotation.
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
"""Pixels, of the scaled picture, between points that the displacement is interpolated to."""


@dataclass(frozen=True)
class HoldSettings:
    """How prints are compared.

    Attributes:
        window: side of the square around a dot that is compared [pitches].
        age: frames between the earlier pictures that are kept; the one compared with is once to
            twice as old [frames].
        lately: age of the other one [frames].
        contrast: texture over that of the barest dots from which an object is printed [-].
        bare: share of the dots that are the barest [-].
        printed: share of the dots, those with the most texture, that are compared in any case [-].
        seen: share of a window that must be seen in both pictures, without dots [-].
    """

    window: float = 1.0
    age: int = 16
    lately: int = 4
    contrast: float = 2.0
    bare: float = 0.15
    printed: float = 0.15
    seen: float = 0.2


class Hold(NamedTuple):
    """How well the print on the gel agrees with an earlier one.

    Attributes:
        since: correlation with that of half a second or a second before [-]; NaN where unknown.
        lately: with that of some frames before [-].
        weakest: the same where it agrees least: a tenth of the print agrees less [-].
    """

    since: float
    lately: float
    weakest: float


UNKNOWN = Hold(np.nan, np.nan, np.nan)
WEAKEST = 0.1


class Print(NamedTuple):
    """What a picture shows, taken back to where the gel lay at rest.

    Attributes:
        planes: its colours without dots and slow changes of light, grey levels of 255.
        power: their sum of squares.
        clear: 1 where the gel is seen and no dot is, else 0.
    """

    planes: list[Float32[np.ndarray, "h w"]]
    power: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]


class HoldFollower:
    """Compares the print on the gel with that of some frames before."""

    def __init__(self, reference: Reference, settings: HoldSettings | None = None) -> None:
        """Begin with the next frame.

        Args:
            reference: dots at rest.
            settings: how prints are compared.
        """
        self._places, self._pitch = reference.position, reference.pitch
        self._settings = settings or HoldSettings()
        self._grid: Float[np.ndarray, "points 2"] | None = None
        self.restart()

    def restart(self) -> None:
        """Compare with the next frame and not with those before."""
        self._earlier: list[Print] = []
        self._recent: deque[Print] = deque(maxlen=self._settings.lately + 1)
        self._frames = 0

    def update(self, painted: Painted, position: Float[np.ndarray, "m 2"]) -> Hold:
        """How well the print of the next frame agrees with earlier ones.

        Args:
            painted: the picture without its dots.
            position: dots in it [px]; NaN where not seen.
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
        return Hold(since, *self._compare(self._recent[0], now, seen, 0.5, WEAKEST))

    def _lay_grid(self, painted: Painted) -> None:
        """Lay points over pictures of this size, and learn what moves them as the dots move."""
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
        """A picture as it would be if its dots were where they rest."""
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
        """Quantiles of the correlation around dots, weighted by what is printed there."""
        settings = self._settings
        width = (2 * int(0.5 * settings.window * self._pitch / self._part) + 1,) * 2
        both, product = before.clear * now.clear, _multiply(before.planes, now.planes)
        values = (one * both for one in (product, before.power, now.power))
        around = cv2.blur(cv2.merge([both, *values]), width)[self._rows, self._columns]
        share = around[:, 0]
        cross, first, second = around[:, 1:].T / (share + np.float32(1e-3))
        power = np.maximum(first, second)
        seen = seen & (share > settings.seen)
        if not seen.any():
            return [np.nan] * len(shares)
        ranked = np.sort(power[seen])  # for so few `np.quantile` takes as long as the rest
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
    """Sum over the colours of the products of two pictures."""
    return reduce(np.add, (a * b for a, b in zip(before, now, strict=True)))
