"""A thread that reads a live source, and a short queue between it and the answers."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from estimation.choices import LiveChoices
from estimation.frames.names import counted
from estimation.tracking.stream import AHEAD_LIVE_FRAMES

Item = TypeVar("Item")
"""A frame, a picture or a message: any object with a `time` [s]."""


class Feed:
    """Reads a source in a separate thread, so that slow answers do not delay reading.

    If answers are too slow, the oldest frames in the queue are dropped, except from a recording
    that is played as fast as possible.

    Attributes:
        name: name of the source.
        lost: number of dropped frames.
        silences: duration of each reported time without a frame [s].
    """

    def __init__(
        self,
        name: str,
        choices: LiveChoices,
        say: Callable[[str], None],
        *,
        recorded: bool = False,
        arrived: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        """Make a feed; reading begins when the first item is requested.

        Args:
            name: name of the source.
            choices: how the source is followed.
            say: receives a message when the source is silent, gives frames again, or ends with a
                flaw.
            recorded: whether the source is a recording, which is played at its own pace or as fast
                as it is answered; other sources set the pace themselves.
            arrived: sentences on what else has arrived, for the message that the source is silent.
        """
        self.name, self.lost = name, 0
        self.silences: list[float] = []
        self._choices, self._say, self._arrived = choices, say, arrived
        self._paced = recorded and not choices.fast
        self._waits, self._taken = recorded and choices.fast, 0
        self._queue: deque[Any] = deque()
        self._changed = threading.Condition()
        self._last: Any = None
        self._ended, self._stopped = False, threading.Event()
        self._error: Exception | None = None

    def __call__(self, items: Iterator[Item]) -> Iterator[Item]:
        """The items as they arrive.

        Args:
            items: items to read in the other thread; they can be fed once.

        Raises:
            ValueError: an item cannot be read; an OSError or RuntimeError of the reader is raised
                too.
        """
        thread = threading.Thread(target=self._read, args=(items,), daemon=True)
        del items  # only the thread refers to them, so the camera is released when it ends
        thread.start()
        patience = 2.0  # time for the reader to end [s]
        try:
            while (item := self._take()) is not None:
                yield item
        finally:
            self._stopped.set()
            with self._changed:
                self._changed.notify_all()
            if thread is not threading.current_thread():  # garbage is collected in any thread
                thread.join(patience)
        if self._error is not None:
            raise self._error

    def notes(self) -> tuple[str, ...]:
        """Sentences on dropped frames and on times without a frame, if any."""
        notes = []
        if self.lost:
            notes.append(
                f"{counted(self.lost, 'frame was', 'frames were')} lost between source and answer: "
                "frames came faster than they were answered, and at most "
                f"{self._choices.queue} can wait (--queue)"
                + (": play the recording with --fast to answer all." if self._paced else ".")
            )
        if self.silences:
            notes.append(
                f"The source was silent {counted(len(self.silences), 'time', 'times')}, for up to "
                f"{max(self.silences):.1f} s."
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
        """Add an item to the queue; return whether to go on reading."""
        with self._changed:
            full = self._choices.queue
            while self._must_wait and len(self._queue) >= full and not self._stopped.is_set():
                self._changed.wait()
            if len(self._queue) >= full + self._more:
                self._queue.popleft()
                self.lost += 1
            self._queue.append(item)
            self._changed.notify_all()
        return not self._stopped.is_set()

    @property
    def _must_wait(self) -> bool:
        """Whether no frame may be dropped, as while a recording waits for its first answer."""
        return self._waits or (self._paced and self._taken <= AHEAD_LIVE_FRAMES)

    @property
    def _more(self) -> int:
        """Number of frames that may wait beyond the queue at the start.

        The frames before the first answer are answered in one batch, while others arrive. The
        number falls by one with each frame that is taken after them.
        """
        return max(min(2 * AHEAD_LIVE_FRAMES - self._taken, AHEAD_LIVE_FRAMES), 0)

    def _pace(self, items: Iterator[Any]) -> Iterator[Any]:
        """Items at the pace of their times; steps backwards or far ahead are passed at once.

        The first frames come as fast as they are taken: the pace begins with the first answer.
        """
        longest = 10.0  # largest step of the time stamps to wait for [s]
        start = last = math.nan  # clock at time 0 of the recording; last time stamp
        for item in items:
            first, step = self._must_wait, item.time - last
            if math.isfinite(item.time) and (first or not 0.0 <= step <= longest):
                start = time.monotonic() - item.time
            if math.isfinite(item.time):
                last = item.time
                self._stopped.wait(max(start + item.time - time.monotonic(), 0.0))
            yield item
            if first and math.isfinite(item.time):  # it may have waited for a place in the queue
                start = time.monotonic() - item.time

    def _take(self) -> Any:
        """Wait for the next item; None at the end."""
        began, reported = time.monotonic(), False
        with self._changed:
            while not (self._queue or self._ended):
                if not self._changed.wait(self._choices.silent_s) and not reported:
                    silent = f"{self.name}: no frame for {self._choices.silent_s:g} s; waiting"
                    self._say(". ".join([silent, *self._arrived()]))
                    reported = True
            item = self._queue.popleft() if self._queue else None
            self._taken += 1
            self._changed.notify_all()
        if reported:
            self.silences.append(time.monotonic() - began)
            event = "frames arrive again" if item is not None else "the source has ended"
            self._say(f"{self.name}: {event}, after {self.silences[-1]:.1f} s")
        if item is None and (flaw := getattr(self._last, "flaw", "")):
            self._say(f"{self.name}: {flaw}")
        self._last = item
        return item
