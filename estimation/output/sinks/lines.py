"""Answers as lines of text, one for each frame, for terminals and controllers."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from estimation.output.table import read_cells, tabulate_answer
from estimation.tracking.stream import Answer


class AnswerLines(ABC):
    """A sink that writes each answer as a line, and only one line for each frame."""

    def __init__(self, say: Callable[[str], None], method: str) -> None:
        """Make a sink that passes each line of a method's answers to `say`."""
        self._say, self._method = say, method
        self._written = 0

    def put(self, answer: Answer) -> None:
        """Write an answer, unless its frame has a line."""
        if answer.row < self._written:
            return
        self._written = answer.row + 1
        self._say(self.show(answer))

    def restart(self) -> None:
        """Do nothing: lines that were written cannot be withdrawn."""
        return

    @abstractmethod
    def show(self, answer: Answer) -> str:
        """The line of an answer."""


class LineWriter(AnswerLines):
    """Writes answers as comma-separated values, after a header."""

    header = "time_s,source_index,state,angle_deg,angle_low_deg,angle_high_deg,alert,reason"

    def __init__(self, say: Callable[[str], None], method: str) -> None:
        """Make a sink and write the header; arguments as in `AnswerLines`."""
        super().__init__(say, method)
        say(self.header)

    def show(self, answer: Answer) -> str:
        """The line of an answer."""
        estimate = answer.estimates[self._method]
        degrees = np.degrees([estimate.angle, estimate.low, estimate.high])
        numbers = ",".join(f"{value:.4f}" for value in degrees)
        reason = estimate.reason.replace(",", ";")
        words = f"{answer.alert.level},{reason}"
        return f"{estimate.time:.4f},{estimate.source_index},{estimate.state},{numbers},{words}"


class JsonWriter(AnswerLines):
    """Writes answers as JSON objects with the columns of `angles.csv`; `null` where unknown."""

    def __init__(self, say: Callable[[str], None], method: str, unit: str = "mm") -> None:
        """Make a sink; arguments as in `AnswerLines`, and the unit of lengths, mm or px."""
        super().__init__(say, method)
        self._unit = unit

    def show(self, answer: Answer) -> str:
        """The line of an answer."""
        row = read_cells(tabulate_answer(answer, self._method, self._unit))
        content = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in row.items()
        }
        return json.dumps(content, ensure_ascii=False, allow_nan=False)
