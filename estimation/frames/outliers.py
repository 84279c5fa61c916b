"""Markers that have moved unlike all markers around them, as misread markers do."""

import numpy as np
import scipy
from jaxtyping import Bool, Float


class OutlierFinder:
    """Compares markers with the median of those around them.

    The median of markers on all sides takes no part of an even deformation. The curvature of the
    surface remains, but not in one marker alone.
    """

    nearest = 8  # number of markers around: a ring of a square grid
    beside = 2  # outliers among the markers around that may hide no other
    local = 2.5  # deviation over the next largest of the markers around, of an outlier in a step
    bent = 3.0  # the same of an outlier in a displacement, which bends at the rim of a contact
    clear = 5.0  # the same over the noise
    least = 0.075  # the same over the distance between markers
    resting = 1e-3  # the same while nothing touches the gel
    few = 0.02  # share of the markers that may seem to move then
    rounds = 4  # in which outliers hidden by others are found

    def __init__(self, reference: Float[np.ndarray, "n d"]) -> None:
        """Find the markers around each marker of a layout."""
        points = reference[:, :2]
        count = min(self.nearest + 1, len(points))
        distance, around = scipy.spatial.KDTree(points).query(points, range(1, count + 1))
        self._pitch = float(np.median(distance[:, 1])) if count > 1 else 0.0
        self.around = np.asarray(around)[:, 1:]
        """Indices of the markers around each marker, the nearest first."""

    def find(
        self,
        displacement: Float[np.ndarray, "n d"],
        least: float = least,
        local: float = local,
    ) -> Bool[np.ndarray, " n"]:
        """Outliers among the markers of a frame.

        Args:
            displacement: displacement of each marker, NaN if it is not visible.
            least: least deviation of an outlier, over the distance between markers.
            local: the same over the next largest of the markers around.
        """
        outliers = np.zeros(len(displacement), dtype=bool)
        if self.around.shape[1] < self.nearest:
            return outliers
        for _ in range(self.rounds):
            left = np.where(outliers[:, None], np.nan, displacement)
            more = self._stand_out(left, least, local)
            if not more.any():
                break
            outliers |= more
        return outliers

    def rests(self, displacement: Float[np.ndarray, "n d"]) -> bool:
        """Whether nothing touches the gel, as nearly all markers only scatter."""
        seen = displacement[np.isfinite(displacement[:, 0])]
        if not len(seen):
            return False
        size = self._over_noise(seen - np.median(seen, axis=0), self.resting)
        return bool((size > self.clear).mean() <= self.few)

    def _stand_out(
        self, displacement: Float[np.ndarray, "n d"], least: float, local: float
    ) -> Bool[np.ndarray, " n"]:
        off = displacement - median(displacement[self.around])
        known, size = np.isfinite(off[:, 0]), np.zeros(len(off))
        if known.any():
            size[known] = self._over_noise(off[known], least)
        beside = np.sort(size[self.around], axis=1)[:, -1 - self.beside]
        return size > np.maximum(local * beside, self.clear)

    def _over_noise(self, off: Float[np.ndarray, "n d"], least: float) -> Float[np.ndarray, " n"]:
        """Sizes of deviations over their noise, which differs between the plane and z.

        The noise per coordinate follows from the median size, of one normal number along z and of
        two in the plane. It counts as so large that no outlier deviates by less than the least.
        """
        sizes = np.stack([np.hypot(off[:, 0], off[:, 1]), *np.abs(off[:, 2:].T)])
        noise = np.median(sizes, axis=1) / (1.177, 0.674)[: len(sizes)]
        floor = max(least * self._pitch / self.clear, 1e-12)
        return np.linalg.norm(sizes / np.maximum(noise, floor)[:, None], axis=0)


def median(values: Float[np.ndarray, "n k d"]) -> Float[np.ndarray, "n d"]:
    """Medians along the second axis of the values that are known; NaN without any."""
    ordered = np.sort(values, axis=1)  # NaN last
    last = np.maximum(np.isfinite(values).sum(axis=1, keepdims=True) - 1, 0)
    low, high = (np.take_along_axis(ordered, at, 1) for at in (last // 2, (last + 1) // 2))
    return 0.5 * (low + high)[:, 0]
