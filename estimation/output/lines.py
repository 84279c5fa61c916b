"""Answers as lines of text, while a camera runs."""

from collections.abc import Callable

import numpy as np

from estimation.stream import Answer

HEADER = "time_s,source_index,state,angle_deg,angle_low_deg,angle_high_deg,reason"


class LineWriter:
    """The sink that says every answer as a line of comma-separated values, a header first."""

    def __init__(self, say: Callable[[str], None], method: str) -> None:
        """Make it.

        Args:
            say: told each line.
            method: whose answers are said.
        """
        self._say, self._method = say, method
        self._said = 0
        say(HEADER)

    def put(self, answer: Answer) -> None:
        """Say an answer, unless there was one to the same frame."""
        if answer.row < self._said:
            return
        self._said = answer.row + 1
        estimate = answer.estimates[self._method]
        degrees = np.degrees([estimate.angle, estimate.low, estimate.high])
        numbers = ",".join(f"{value:.4f}" for value in degrees)
        reason = estimate.reason.replace(",", ";")
        self._say(
            f"{estimate.time:.4f},{estimate.source_index},{estimate.state},{numbers},{reason}"
        )

    def restart(self) -> None:
        """Go on: what has been said cannot be taken back."""
