"""Markers that have moved unlike all markers around them, as misread markers do."""

import numpy as np
import scipy
from jaxtyping import Bool, Float


class OutlierFinder:
    """Compares markers in space with the median of those around them.

    The median of markers on all sides takes no part of an even deformation. The curvature of the
    surface remains, but not in one marker alone.
    """

    nearest = 8  # number of markers around: a ring of a square grid
    beside = 2  # outliers among the markers around that may hide no other
    local = 4.0  # deviation over the next largest of the markers around, of an outlier
    common = 6.0  # the same over the median of all markers
    least = 0.1  # the same over the distance between markers
    rounds = 4  # in which outliers hidden by others are found

    def __init__(self, reference: Float[np.ndarray, "n d"]) -> None:
        """Find the markers around each marker of a layout."""
        points = reference[:, :2]
        count = min(self.nearest + 1, len(points))
        distance, around = scipy.spatial.KDTree(points).query(points, range(1, count + 1))
        self._pitch = float(np.median(distance[:, 1])) if count > 1 else 0.0
        self.around = np.asarray(around)[:, 1:]
        """Indices of the markers around each marker, the nearest first."""

    def find(self, displacement: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Outliers among the markers of a frame, whose displacements are NaN if not visible."""
        outliers = np.zeros(len(displacement), dtype=bool)
        if self.around.shape[1] < self.nearest:
            return outliers
        for _ in range(self.rounds):
            more = self._stand_out(np.where(outliers[:, None], np.nan, displacement))
            if not more.any():
                break
            outliers |= more
        return outliers

    def _stand_out(self, displacement: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        seen = np.isfinite(displacement[:, 0])
        outliers = np.zeros_like(seen)
        if not seen.any():
            return outliers
        off = displacement - _median(displacement[self.around])
        for size in (np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])):
            known = np.nan_to_num(size)
            beside = np.sort(known[self.around], axis=1)[:, -1 - self.beside]
            floor = max(self.common * float(np.median(known[seen])), self.least * self._pitch)
            outliers |= known > np.maximum(self.local * beside, floor)
        return outliers


def _median(values: Float[np.ndarray, "n k d"]) -> Float[np.ndarray, "n d"]:
    """Medians along the second axis of the values that are known; NaN without any."""
    ordered = np.sort(values, axis=1)  # NaN last
    last = np.maximum(np.isfinite(values).sum(axis=1, keepdims=True) - 1, 0)
    low, high = (np.take_along_axis(ordered, at, 1) for at in (last // 2, (last + 1) // 2))
    return 0.5 * (low + high)[:, 0]
