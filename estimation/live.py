"""Angles while a camera runs: each picture is answered before the next is taken."""

from collections.abc import Callable
from typing import Any

import numpy as np

from estimation.estimators.result import Estimate
from estimation.frames.recording import MarkerLayout
from estimation.pictures.reader import MarkerReader, Row
from estimation.tracker import Tracker

HEADER = "time_s,source_index,state,angle_deg,angle_low_deg,angle_high_deg,reason"


class LiveAngles:
    """Answers each row of a reader as it comes, for `read_recording`'s `watch`."""

    def __init__(self, say: Callable[[str], None], method: str, **settings: Any) -> None:
        """Make it.

        Args:
            say: told a line of comma-separated values for every picture, a header first.
            method: of the tracker.
            **settings: of the tracker; without `noise` intervals come from each frame's misfit.
        """
        self.say, self.method, self.settings = say, method, settings
        self.layout: MarkerLayout | None = None
        self.tracker: Tracker | None = None

    def __call__(self, reader: MarkerReader, row: Row) -> None:
        """Answer a row; a reader that finds a better reference starts the count anew."""
        if self.tracker is None:
            self.say(HEADER)
        if self.tracker is None or self.layout is not reader.layout:
            self.layout = reader.layout
            self.tracker = Tracker(reader.layout, self.method, **self.settings)
        self.say(_line(self.tracker.update(reader.frame(row))))


def _line(estimate: Estimate) -> str:
    degrees = np.degrees([estimate.angle, estimate.low, estimate.high])
    numbers = ",".join(f"{value:.4f}" for value in degrees)
    reason = estimate.reason.replace(",", ";")
    return f"{estimate.time:.4f},{estimate.source_index},{estimate.state},{numbers},{reason}"
