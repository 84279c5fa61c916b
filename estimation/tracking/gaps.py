"""Markers that are misread or not visible for some frames, as the markers around them show them."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from estimation.frames.outliers import OutlierFinder, median
from estimation.frames.recording import Frame, MarkerLayout


class GapFiller:
    """Takes misread markers out of each frame, and fills short gaps.

    A marker that lies off its place in the first frames, while all others rest, is left out for
    good: nothing touches the gel then, so it is no corner of a face.

    A hidden marker has gone on as the markers around it have since the last frame: their motion is
    continued evenly to its place. So one frame without it does not change the contact, its plane or
    the rotation of its neighbours.
    """

    longest = 4  # frames for which a marker is filled or counts as misread
    swapped = 0.5  # deviation in the plane over the pitch, which no gel reaches in one marker alone
    fewest = 5  # visible markers around it
    rest = 3, 16  # fewest and most frames at rest that show lasting errors

    def __init__(self, layout: MarkerLayout) -> None:
        """Begin without any frame."""
        self._reference = layout.reference
        self._outliers = OutlierFinder(layout.reference)
        self._last = np.full_like(layout.reference, np.nan)  # displacements in the last frame
        self._before = self._last  # in the one before
        self._at_rest: list[np.ndarray] = []  # displacements in the first frames, while all rest
        self._rests = True
        self._off = np.zeros(len(layout.reference), dtype=bool)  # markers left out for good
        # frames in a row; in the first one only in space, since coarse markers in the plane seem
        # misread if the pad is loaded
        self._misread = np.full(len(layout.reference), int(layout.reference.shape[1] == 3))
        self._hidden = np.zeros(len(layout.reference), dtype=int)  # frames in a row

    def fill(self, frame: Frame) -> Frame:
        """The next frame without misread markers, and with hidden markers filled.

        Frames from pictures stay as they are: their readers have left out what they misread.
        """
        if frame.pictured:
            return frame
        read = np.where(frame.valid[:, None], frame.positions - self._reference, np.nan)
        self._find_off(read)
        wrong = self._are_misread(read) | self._off
        moved = np.where(wrong[:, None], np.nan, read)
        seen = np.isfinite(moved[:, 0])
        self._hidden = np.where(seen, 0, self._hidden + 1)
        gaps = ~seen & np.isfinite(self._last[:, 0]) & (self._hidden <= self.longest)
        if gaps.any():
            moved[gaps] = self._last[gaps] + self._follow(moved - self._last, gaps)
        self._before, self._last = self._last, moved
        if seen.all():
            return frame
        positions = np.where(seen[:, None], frame.positions, self._reference + moved)
        return replace(frame, positions=positions, valid=np.isfinite(positions[:, 0]))

    def _find_off(self, read: Float[np.ndarray, "n d"]) -> None:
        """Find the markers that lie off their place, until the gel does not rest any more."""
        fewest, most = self.rest
        finder = self._outliers
        if self._rests:
            others = np.where(finder.find(read, finder.resting)[:, None], np.nan, read)
            self._rests = len(self._at_rest) < most and finder.rests(others)
        if not self._rests:
            return
        self._at_rest.append(read)
        if len(self._at_rest) >= fewest:
            off = finder.find(median(np.stack(self._at_rest, axis=1)), finder.resting)
            if len(self._at_rest) > fewest:
                off &= self._off
            self._off = off & bool(off.mean() <= finder.few)

    def _are_misread(self, read: Float[np.ndarray, "n d"]) -> Bool[np.ndarray, " n"]:
        """Markers that have suddenly moved unlike all around them.

        They count for `longest` frames at most, since at a face's corner the gel itself moves
        unlike that around, but step by step, or for long. Where markers are swapped, they count as
        long as they are. A marker that was misread unnoticed in the last frame jumps back, but has
        not moved since the one before.
        """
        jumps = self._outliers.find(read - self._last)
        misread = jumps | (self._misread > 0) & np.isnan(self._last[:, 0])
        if misread.any():
            misread &= self._outliers.find(read)
        if jumps.any():
            misread |= jumps & self._outliers.find(read - self._before)
        self._misread = np.where(misread, self._misread + 1, 0)
        lasting = misread & (self._misread > self.longest)
        if lasting.any():
            misread &= ~lasting | self._outliers.find(read[:, :2], self.swapped)
        return misread

    def _follow(
        self, step: Float[np.ndarray, "n d"], gaps: Bool[np.ndarray, " n"]
    ) -> Float[np.ndarray, "m d"]:
        """Steps of the hidden markers by an even motion of those around; NaN with too few."""
        around = self._outliers.around[gaps]
        offset = self._reference[around, :2] - self._reference[gaps, None, :2]
        terms = np.concatenate([np.ones_like(offset[..., :1]), offset], axis=-1)
        steps, known = step[around], np.isfinite(step[around, :1])
        terms, steps = np.where(known, terms, 0.0), np.where(known, steps, 0.0)
        fit = np.linalg.pinv(terms, rcond=1e-3) @ steps
        enough = known[..., 0].sum(axis=1) >= self.fewest
        return np.where(enough[:, None], fit[:, 0], np.nan)
