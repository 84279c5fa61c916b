"""An outlet that never blocks its sender: a slow reader misses the oldest items."""

import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
"""The item for a frame: a line, or the arguments of a drawing function."""


class Outlet(Generic[Item]):
    """Passes items on in a separate thread."""

    def __init__(
        self, write: Callable[[Item], None], end: Callable[[], object] = int, most: int = 256
    ) -> None:
        """Open an outlet.

        Args:
            write: passes one item on; it may block, and may raise an OSError.
            end: called after the last item.
            most: largest number of waiting items; when there are more, the oldest is dropped.
        """
        self.sent = self.dropped = 0
        self._write, self._end, self._most = write, end, most
        self._waiting = deque[Item]()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    def send(self, item: Item) -> None:
        """Queue an item and return at once."""
        with self._changed:
            if len(self._waiting) == self._most:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(item)
            self._changed.notify()

    def close(self, patience: float = 1.0) -> None:
        """Pass on the waiting items, and drop those left after `patience` [s]."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(patience)
        with self._changed:
            self.dropped += len(self._waiting)
            self._waiting.clear()

    def describe(self, name: str) -> str:
        """A sentence on dropped items; empty if there are none."""
        if not self.dropped:
            return ""
        total = self.sent + self.dropped
        return f"{name}: {self.dropped} of {total} frames dropped: the reader was slow or gone"

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
    """An outlet for lines to standard output, without Python's buffer."""
    handle = os.dup(sys.stdout.fileno())

    def write(line: str) -> None:
        data = f"{line}\n".encode()
        while data:
            data = data[os.write(handle, data) :]

    return Outlet(write, lambda: os.close(handle))


def open_udp(host: str, port: int) -> Outlet[str]:
    """An outlet for lines to a UDP port, one packet for each line.

    Raises:
        OSError: the host is unknown.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise OSError(
            f"the host {host!r} of the sink udp:{host}:{port} (--sink) cannot be found "
            f"({error.strerror}): check its name, or give its IP address"
        ) from error
    sender = socket.socket(family, kind)

    def write(line: str) -> None:
        sender.sendto(f"{line}\n".encode(), address)

    return Outlet(write, sender.close)


def close_outlet(outlet: Outlet[Any], name: str, say: Callable[[str], None]) -> None:
    """Close an outlet, which first passes on items; `say` receives a line on dropped ones."""
    outlet.close()
    if note := outlet.describe(name):
        say(note)
