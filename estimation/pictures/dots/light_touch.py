"""Touches that are too light to move the dots, from the change of each pixel."""

from dataclasses import replace
from functools import reduce

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from estimation.pictures.imprint.painted import Painted, add_squares


class LightTouch:
    """Detects light touches by the clip's own pictures of the bare gel.

    Once a contact has ended, neither dots nor print show one, and the gel is bare. Later pictures
    are compared with the mean of those pictures. An object adds the texture of its print or of its
    shading to the gel's own; lamps that change add none. If the present picture has less texture
    than the mean, an object still touched lightly when the mean was taken, and has gone.
    """

    def __init__(self) -> None:
        """Begin before the first contact."""
        self._bare: Painted | None = None
        self._free = 0  # frames since the last contact
        self._touched = False  # whether there has been a contact

    def find(
        self, painted: Painted, places: Float[np.ndarray, "m 2"], pitch: float, touched: bool
    ) -> Bool[np.ndarray, " m"]:
        """The dots beside pixels that a light touch has changed; none if there is no such touch.

        Args:
            painted: the picture without its dots.
            places: of the dots [px]; NaN where not visible.
            pitch: distance between neighbouring dots [px].
            touched: whether dots or print show a contact.
        """
        resting = 5  # frames after a contact in which the gel comes to rest
        slowly = 0.05  # share of a picture in the mean of the bare gel, which follows a drift
        least_area = 0.04  # of the changed pixels [pitches²]
        # texture that an object adds, over its change: 1 if the change is its print, −1 if it is
        # the lost print of an object that has gone [-]
        least_added = 0.5
        none, pitch = np.zeros(len(places), dtype=bool), pitch / painted.part
        self._touched |= touched
        self._free = 0 if touched else self._free + 1
        rests = self._touched and self._free >= resting
        if self._bare is None and rests:
            self._bare = painted
        if self._bare is None or touched:
            return none
        changed, added = _compare(self._bare, painted)
        if changed.sum() < least_area * pitch**2:
            self._bare = _average(self._bare, painted, slowly) if rests else self._bare
            return none
        if added < -least_added and rests:
            self._bare = painted
        if abs(added - 1.0) > least_added:
            return none
        seen = np.isfinite(places[:, 0])
        near = cv2.dilate(changed, np.ones((2 * int(0.5 * pitch) + 1,) * 2, np.uint8))
        limit = np.array(near.shape[::-1]) - 1
        column, row = np.clip(np.rint(places[seen] / painted.part).astype(int), 0, limit).T
        none[seen] = near[row, column] > 0
        return none


def _average(bare: Painted, now: Painted, share: float) -> Painted:
    """The mean picture of the bare gel with a share of another; all of it where it was hidden."""
    weight = np.where(bare.shown > 0.0, np.float32(share), np.float32(1.0)) * now.shown
    pairs = zip(bare.colours, now.colours, strict=True)
    colours = [before + weight * (after - before) for before, after in pairs]
    return replace(bare, colours=colours, shown=np.maximum(bare.shown, now.shown))


def _compare(bare: Painted, now: Painted) -> tuple[UInt8[np.ndarray, "h w"], float]:
    """The changed pixels, and the texture that they have gained over their change [-]."""
    # change of a pixel, in grey levels of 255, and over the median change, which is that of noise
    # and lamps [-]
    least, over_median = 8.0, 5.0
    shown, sample = bare.shown * now.shown, np.s_[::3, ::3]
    known = shown[sample] > 0.0
    if not known.any():
        return np.zeros(shown.shape, np.uint8), 0.0
    lit = [
        before * np.float32(np.median(after[sample][known] / (before[sample][known] + 1.0)))
        for before, after in zip(bare.colours, now.colours, strict=True)
    ]
    steps = [after - before for before, after in zip(lit, now.colours, strict=True)]
    smooth = [np.abs(cv2.GaussianBlur(step * shown, (0, 0), 1.0)) for step in steps]
    share = np.maximum(cv2.GaussianBlur(shown, (0, 0), 1.0), np.float32(0.3))
    change = shown * reduce(np.maximum, smooth) / share
    least = max(least, over_median * float(np.median(change[sample][known])))
    changed = (change > least).astype(np.uint8)
    changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    if not changed.any():
        return changed, 0.0
    around = cv2.dilate(changed, np.ones((7, 7), np.uint8)) * shown
    texture = [
        np.stack(replace(now, colours=colours, shown=shown).departing)
        for colours in (lit, now.colours)
    ]
    before, after, step = (
        float((add_squares([*planes]) * around).sum())
        for planes in (*texture, texture[1] - texture[0])
    )
    return changed, (after - before) / max(step, 1e-6)
