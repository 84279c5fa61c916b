"""A way out for lines that never keeps anyone waiting: who reads too slowly misses the oldest."""

import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable


class Outlet:
    """Passes lines on in a thread of its own.

    Attributes:
        sent: lines that were passed on.
        dropped: lines that were not, because the reader was slow or gone.
    """

    def __init__(
        self, write: Callable[[bytes], None], end: Callable[[], object] = int, most: int = 256
    ) -> None:
        """Open it.

        Args:
            write: passes one line on; it may take as long as it likes, and raise an OSError.
            end: called once no more is written.
            most: lines that wait at a time; then the oldest is dropped.
        """
        self.sent = self.dropped = 0
        self._write, self._end, self._most = write, end, most
        self._waiting = deque[bytes]()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    def send(self, line: str) -> None:
        """Pass a line on; returns at once."""
        with self._changed:
            if len(self._waiting) == self._most:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(f"{line}\n".encode())
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
        lines = self.sent + self.dropped
        return f"{name}: {self.dropped} of {lines} lines dropped: their reader was slow or gone"

    def _pass_on(self) -> None:
        while True:
            with self._changed:
                while not (self._waiting or self._closed):
                    self._changed.wait()
                line = self._waiting.popleft() if self._waiting else None
            if line is None:
                self._end()
                return
            try:
                self._write(line)
            except OSError:
                passed = 0
            else:
                passed = 1
            with self._changed:
                self.sent += passed
                self.dropped += 1 - passed


def open_stdout() -> Outlet:
    """A way to standard output, beside Python's own buffer."""
    handle = os.dup(sys.stdout.fileno())

    def write(line: bytes) -> None:
        while line:
            line = line[os.write(handle, line) :]

    return Outlet(write, lambda: os.close(handle))


def open_udp(host: str, port: int) -> Outlet:
    """A way to a UDP port, one packet a line.

    Raises:
        OSError: there is no such host.
    """
    family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    sender = socket.socket(family, kind)

    def write(line: bytes) -> None:
        sender.sendto(line, address)

    return Outlet(write, sender.close)


def close_outlet(outlet: Outlet, name: str, tell: Callable[[str], None]) -> None:
    """Close a way out.

    Args:
        outlet: passes on what waits, for a while.
        name: of its reader.
        tell: told what was dropped, in a sentence.
    """
    outlet.close()
    if note := outlet.describe(name):
        tell(note)
