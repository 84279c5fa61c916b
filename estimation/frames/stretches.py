"""Stretches of a recording: frames in a row for which something holds."""

from collections import deque
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool


def find_stretches(flags: Bool[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """The first row of each stretch of True, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.pad(flags, 1).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


class Span:
    """Converts numbers of frames of usual cameras to those of slower ones.

    A number of frames stands for a time. With fewer than 20 pictures per second, as many frames as
    fit into that time are used, at least one.
    """

    _slow = 0.05  # interval between frames above which a camera is slow [s]

    def __init__(self) -> None:
        """Begin without a frame."""
        self._times = deque[float](maxlen=9)

    def update(self, time: float) -> Callable[[int], int]:
        """Take the time stamp of the next frame [s]; return the conversion."""
        self._times.append(time)
        steps = np.diff(self._times)
        step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        share = min(1.0, self._slow / step) if step else 1.0
        return lambda frames: max(int(frames * share), 1)
