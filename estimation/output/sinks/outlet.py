"""A way out that never keeps anyone waiting: who reads too slowly misses the oldest."""

import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
"""What is passed on for a frame: a line, or what is drawn of it."""


class Outlet(Generic[Item]):
    """Passes items on in a thread of its own.

    Attributes:
        sent: items that were passed on.
        dropped: items that were not, because the reader was slow or gone.
    """

    def __init__(
        self, write: Callable[[Item], None], end: Callable[[], object] = int, most: int = 256
    ) -> None:
        """Open it.

        Args:
            write: passes one item on; it may take as long as it likes, and raise an OSError.
            end: called once no more is written.
            most: items that wait at a time; then the oldest is dropped.
        """
        self.sent = self.dropped = 0
        self._write, self._end, self._most = write, end, most
        self._waiting = deque[Item]()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    def send(self, item: Item) -> None:
        """Pass an item on; returns at once."""
        with self._changed:
            if len(self._waiting) == self._most:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(item)
            self._changed.notify()

    def close(self, patience: float = 1.0) -> None:
        """Pass on what waits, unless that takes longer than `patience` [s]."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(patience)
        with self._changed:
            self.dropped += len(self._waiting)
            self._waiting.clear()

    def describe(self, name: str) -> str:
        """What was dropped, in a sentence; empty where nothing was."""
        if not self.dropped:
            return ""
        every = self.sent + self.dropped
        return f"{name}: {self.dropped} of {every} frames dropped: the reader was slow or gone"

    def _pass_on(self) -> None:
        while True:
            with self._changed:
                while not (self._waiting or self._closed):
                    self._changed.wait()
                if not self._waiting:
                    break
                item = self._waiting.popleft()
            try:
                self._write(item)
            except OSError:
                passed = 0
            else:
                passed = 1
            with self._changed:
                self.sent += passed
                self.dropped += 1 - passed
        self._end()


def open_stdout() -> Outlet[str]:
    """A way for lines to standard output, beside Python's own buffer."""
    handle = os.dup(sys.stdout.fileno())

    def write(line: str) -> None:
        data = f"{line}\n".encode()
        while data:
            data = data[os.write(handle, data) :]

    return Outlet(write, lambda: os.close(handle))


def open_udp(host: str, port: int) -> Outlet[str]:
    """A way for lines to a UDP port, a packet each.

    Raises:
        OSError: there is no such host.
    """
    family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    sender = socket.socket(family, kind)

    def write(line: str) -> None:
        sender.sendto(f"{line}\n".encode(), address)

    return Outlet(write, sender.close)


def close_outlet(outlet: Outlet[Any], name: str, tell: Callable[[str], None]) -> None:
    """Close a way out.

    Args:
        outlet: passes on what waits, for a while.
        name: of its reader.
        tell: told what was dropped, in a sentence.
    """
    outlet.close()
    if note := outlet.describe(name):
        tell(note)
