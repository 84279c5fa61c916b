"""Answers as lines of text, one for each frame: for people on the terminal, for controllers."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from estimation.output.table import read_cells, tabulate_answer
from estimation.tracking.stream import Answer

HEADER = "time_s,source_index,state,angle_deg,angle_low_deg,angle_high_deg,reason"


class AnswerLines(ABC):
    """A sink that says every answer as a line; what has been said is not said again."""

    def __init__(self, say: Callable[[str], None], method: str) -> None:
        """Make it.

        Args:
            say: told each line.
            method: whose answers are said.
        """
        self._say, self._method = say, method
        self._said = 0

    def put(self, answer: Answer) -> None:
        """Say an answer, unless there was one to the same frame."""
        if answer.row < self._said:
            return
        self._said = answer.row + 1
        self._say(self.show(answer))

    def restart(self) -> None:
        """Go on: what has been said cannot be taken back."""
        return

    @abstractmethod
    def show(self, answer: Answer) -> str:
        """The line of an answer."""


class LineWriter(AnswerLines):
    """Says answers as comma-separated values, a header first."""

    def __init__(self, say: Callable[[str], None], method: str) -> None:
        """Make it; arguments as for `AnswerLines`."""
        super().__init__(say, method)
        say(HEADER)

    def show(self, answer: Answer) -> str:
        """The line of an answer."""
        estimate = answer.estimates[self._method]
        degrees = np.degrees([estimate.angle, estimate.low, estimate.high])
        numbers = ",".join(f"{value:.4f}" for value in degrees)
        reason = estimate.reason.replace(",", ";")
        return f"{estimate.time:.4f},{estimate.source_index},{estimate.state},{numbers},{reason}"


class JsonWriter(AnswerLines):
    """Says answers as JSON objects with the columns of `angles.csv`; `null` where unknown."""

    def __init__(self, say: Callable[[str], None], method: str, unit: str = "mm") -> None:
        """Make it.

        Args:
            say: as for `AnswerLines`.
            method: as for `AnswerLines`.
            unit: of lengths, mm or px.
        """
        super().__init__(say, method)
        self._unit = unit

    def show(self, answer: Answer) -> str:
        """The line of an answer."""
        row = read_cells(tabulate_answer(answer, self._method, self._unit))
        known = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in row.items()
        }
        return json.dumps(known, ensure_ascii=False, allow_nan=False)
