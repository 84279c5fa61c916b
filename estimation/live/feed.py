"""Between a source and its answers: a thread that reads, and a short queue."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from estimation.choices import LiveChoices
from estimation.tracking.stream import AHEAD_LIVE

Item = TypeVar("Item")
"""A frame, a picture or a message: whatever has a `time` [s]."""


class Feed:
    """Reads a source in a thread of its own, so that one that is slow to answer delays no reading.

    Who answers too slowly misses the oldest frames, unless all of them are waited for.

    Attributes:
        name: of the source.
        lost: frames that were left out.
        silences: how long the source gave nothing, each time that it was reported [s].
    """

    def __init__(
        self,
        name: str,
        choices: LiveChoices,
        say: Callable[[str], None],
        *,
        recorded: bool = False,
    ) -> None:
        """Make it; reading begins with the first item that is asked for.

        Args:
            name: of the source.
            choices: how it is followed.
            say: told when the source is silent, gives frames again, or ends by a flaw.
            recorded: whether it is a recording, which is played at its own pace or as fast as it
                is answered; else it has a pace of its own.
        """
        self.name, self.lost = name, 0
        self.silences: list[float] = []
        self._choices, self._say = choices, say
        self._paced = recorded and not choices.fast
        self._waits, self._given = recorded and choices.fast, 0
        self._queue: deque[Any] = deque()
        self._changed = threading.Condition()
        self._last: Any = None
        self._ended, self._stopped = False, threading.Event()
        self._error: Exception | None = None

    def __call__(self, items: Iterator[Item]) -> Iterator[Item]:
        """The items, as they come.

        Args:
            items: read in another thread; they can be fed once.

        Raises:
            ValueError: what reading them raises, and so an OSError or a RuntimeError.
        """
        thread = threading.Thread(target=self._read, args=(items,), daemon=True)
        del items  # the thread alone has it, and lets go of the camera when it ends
        thread.start()
        patience = 2.0  # time that the reader has to end [s]
        try:
            while (item := self._take()) is not None:
                yield item
        finally:
            self._stopped.set()
            with self._changed:
                self._changed.notify_all()
            thread.join(patience)
        if self._error is not None:
            raise self._error

    def notes(self) -> tuple[str, ...]:
        """What was lost, and how long the source was silent, in sentences."""
        notes = []
        if self.lost:
            notes.append(
                f"{self.lost} frames were lost between source and answer: they came faster than "
                f"they were answered, and {self._choices.queue} wait at most (--queue)."
            )
        if self.silences:
            notes.append(
                f"The source was silent {len(self.silences)} times, for {max(self.silences):.1f} s "
                "at the longest."
            )
        return tuple(notes)

    def _read(self, items: Iterator[Item]) -> None:
        try:
            for item in self._pace(items) if self._paced else items:
                if not self._put(item):
                    return
        except (ValueError, OSError, RuntimeError) as error:
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _put(self, item: Any) -> bool:
        """Add an item to the queue; whether more are wanted."""
        with self._changed:
            full = self._choices.queue
            while self._must_wait and len(self._queue) >= full and not self._stopped.is_set():
                self._changed.wait()
            if len(self._queue) >= full:
                self._queue.popleft()
                self.lost += 1
            self._queue.append(item)
            self._changed.notify_all()
        return not self._stopped.is_set()

    @property
    def _must_wait(self) -> bool:
        """Whether nothing is left out, as when a recording waits for its first answer."""
        return self._waits or (self._paced and self._given <= AHEAD_LIVE)

    def _pace(self, items: Iterator[Any]) -> Iterator[Any]:
        """Items at their times; clocks that run backwards or jump far ahead are not waited for.

        The first frames come as they are taken: the pace begins with the first answer.
        """
        longest = 10.0  # step of the time stamps that is waited for [s]
        start = last = math.nan  # clock at time 0 of the recording; last time stamp
        for item in items:
            step = item.time - last
            if math.isfinite(item.time) and (self._must_wait or not 0.0 <= step <= longest):
                start = time.monotonic() - item.time
            if math.isfinite(item.time):
                last = item.time
                self._stopped.wait(max(start + item.time - time.monotonic(), 0.0))
            yield item

    def _take(self) -> Any:
        """The next item, waited for; None at the end."""
        began, reported = time.monotonic(), False
        with self._changed:
            while not (self._queue or self._ended):
                if not self._changed.wait(self._choices.silent_s) and not reported:
                    self._say(f"{self.name}: no frame for {self._choices.silent_s:g} s; waiting")
                    reported = True
            item = self._queue.popleft() if self._queue else None
            self._given += 1
            self._changed.notify_all()
        if reported:
            self.silences.append(time.monotonic() - began)
            goes = "there are frames again" if item is not None else "it has ended"
            self._say(f"{self.name}: {goes}, after {self.silences[-1]:.1f} s")
        if item is None and (flaw := getattr(self._last, "flaw", "")):
            self._say(f"{self.name}: {flaw}")
        self._last = item
        return item
