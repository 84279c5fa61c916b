"""The moments of a recording whose markers the report draws."""

from collections.abc import Callable, Iterable

import numpy as np

from estimation.estimators.result import Track
from estimation.output.record import KeptMarkers


def choose_frames(
    track: Track, markers: Callable[[], Iterable[KeptMarkers]], size: int, count: int = 5
) -> list[KeptMarkers]:
    """Markers of the frames to draw maps of.

    They are the first and the last frame of macro slip and the frame of the largest angle, as far
    as their markers are stored. The others are evenly spread over the contact, or over all frames.

    Args:
        track: track of the method to draw.
        markers: returns the stored markers, frame by frame.
        size: final number of markers; earlier frames of a resumed camera may have another.
        count: largest number of frames, at least 4.
    """
    rows = np.array([frame.row for frame in markers() if len(frame.turned) == size])
    touching = rows[track.contact_markers[rows] > 0]
    rows = touching if len(touching) else rows
    slips = np.flatnonzero(track.slipping)
    chosen: set[int] = set()
    if len(slips):
        stored = np.intersect1d(rows, slips)
        ends = stored[[0, -1]] if len(stored) else rows[[np.abs(rows - slips[0]).argmin()]]
        chosen |= set(ends.tolist())
    angles = np.abs(track.angle[rows])
    if np.isfinite(angles).any():
        chosen.add(int(rows[np.nanargmax(angles)]))
    spread = np.linspace(0, len(rows) - 1, count - len(chosen)).astype(int)
    chosen |= set(rows[spread].tolist())
    return [frame for frame in markers() if frame.row in chosen]
