"""Frames that the Tac3D desktop program sends by UDP, read without the maker's SDK.

A frame comes in packets. Each consists of a serial number (4 bytes), the number of the last packet
and that of this one (2 bytes each, in the machine's byte order), and a piece. The first piece is a
head in YAML, the others hold its arrays. The decoder of the maker's SDK reads the same (`pytac3d`
3.3.0.9, `Sensor.py`); the SDK is not used since its requirements replace this project's OpenCV.
"""

import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np

from estimation.frames.bags.messages import PlainMessages, read_tac3d_frame
from estimation.frames.bags.topics import Stamped
from estimation.frames.extras import require_extra
from estimation.frames.inspection import LiveInspector
from estimation.frames.recording import Frame, MarkerLayout


def is_tac3d_port(name: str) -> bool:
    """Whether a source's name is that of a Tac3D sensor that sends to a port: `tac3d:PORT`."""
    return name.startswith("tac3d:")


class Tac3DReceiver:
    """Joins the packets that arrive at a port.

    Attributes:
        sensor: serial number of the followed sensor; empty before its first frame.
        others: serial numbers of other sensors that send to the port.
        foreign: number of packets and frames that could not be read.
    """

    def __init__(self, name: str) -> None:
        """Listen to a port.

        Args:
            name: `tac3d:PORT`, or `tac3d:PORT/SENSOR` if several sensors send to the port.

        Raises:
            ImportError: the extra `tac3d` is not installed.
            ValueError: the name has no valid port.
            OSError: the port is not available.
        """
        require_extra("tac3d", f"following {name}")
        port, _, self.sensor = name.removeprefix("tac3d:").partition("/")
        if not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
            raise ValueError(f"{name!r} has no port: give tac3d:PORT, as set in the Tac3D program")
        self.others: set[str] = set()
        self.foreign = 0
        self._pieces: dict[tuple[object, int], dict[int, bytes]] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("", int(port)))
        except OSError as error:
            self._socket.close()
            raise OSError(
                f"{name}: the port is not available ({error.strerror}): close the other program "
                "or SDK that listens to it"
            ) from error

    def messages(self) -> Iterator[Stamped]:
        """The sensor's frames as they arrive, without end."""
        largest = 65535  # size of a packet [bytes]
        with closing(self._socket):
            while True:
                packet, sender = self._socket.recvfrom(largest)
                whole = self._join(packet, sender)
                if whole is None:
                    continue
                try:
                    content = _decode(*whole)
                except (ValueError, KeyError, TypeError, struct.error):
                    self.foreign += 1
                    continue
                if content is not None and self._is_ours(content.SN):
                    yield Stamped(content, content.sendTimestamp, content.index)

    def notes(self) -> tuple[str, ...]:
        """Sentences on other data that came to the port, if any."""
        notes = []
        if self.others:
            others = ", ".join(sorted(self.others))
            notes.append(
                f"Only {self.sensor} is followed; other sensors send to the same port: {others} "
                f"(tac3d:PORT/SENSOR chooses)."
            )
        if self.foreign:
            notes.append(f"{self.foreign} packets were not of a Tac3D sensor, or damaged.")
        return tuple(notes)

    def _is_ours(self, sensor: str) -> bool:
        self.sensor = self.sensor or sensor
        if sensor != self.sensor:
            self.others.add(sensor)
        return sensor == self.sensor

    def _join(self, packet: bytes, sender: object) -> tuple[bytes, bytes] | None:
        """Head and arrays of the frame that a packet completes."""
        incomplete, most = 8, 256  # largest number of incomplete frames; of packets of a frame
        try:
            serial, last, this = struct.unpack_from("=IHH", packet)
        except struct.error:
            serial, last, this = 0, 0, 1
        if this > last or last >= most:
            self.foreign += 1
            return None
        pieces = self._pieces.setdefault((sender, serial), {})
        pieces[this] = packet[8:]
        if len(pieces) <= last:
            while len(self._pieces) > incomplete:  # the oldest frame has lost packets
                del self._pieces[next(iter(self._pieces))]
            return None
        del self._pieces[sender, serial]
        return pieces[0], b"".join(pieces[i] for i in range(1, last + 1))


class Tac3DSource:
    """Frames of a Tac3D sensor as the desktop program sends them.

    The reference comes from the first frame with a load, or from the first two seconds without one.
    """

    live, provisional, unit = True, False, PlainMessages.unit
    convention, warnings = PlainMessages.convention, ()

    def __init__(
        self,
        name: str,
        receiver: Tac3DReceiver,
        feed: Callable[[Iterator[Stamped]], Iterator[Stamped]],
    ) -> None:
        """Wait for the first frames of a receiver; the feed passes them on as they arrive.

        Raises:
            ValueError: no message shows markers.
        """
        most = 64  # largest number of frames to wait for
        self.name = self.source = name
        self._receiver, self._ahead = receiver, list[Stamped]()
        self._messages = feed(self._receiver.messages())
        for message in self._messages:
            self._ahead.append(message)
            if message.content.Displacements.any() or len(self._ahead) == most:
                break
        self._markers, self._inspector = (
            PlainMessages(read_tac3d_frame, self._ahead),
            LiveInspector(),
        )

    @property
    def layout(self) -> MarkerLayout:
        """The markers at rest."""
        return self._markers.layout

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes up to now, in sentences."""
        received = self._receiver.notes()
        return (*self._markers.notes, *received, *self._inspector.notes())

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order; they can be iterated once."""
        shape = self.layout.reference.shape
        for message in chain(self._ahead, self._messages):
            try:
                frame = self._markers.frame(message)
            except ValueError as error:
                none, flaw = np.full(shape, np.nan), f"the frame cannot be used: {error}"
                frame = Frame(none, message.time, message.number, flaw=flaw)
            yield self._inspector.inspect(frame, self.layout.reference)


def _decode(head: bytes, data: bytes) -> Any:
    """A frame with the fields of a Tac3D node's `Frame`; None while the sensor initializes.

    Raises:
        ValueError: the head is malformed, or an array that it declares is missing; this may also
            raise KeyError, TypeError or struct.error.
    """
    from ruamel.yaml import YAML, YAMLError

    largest = 65536  # size of a head [bytes]
    arrays = ("Positions", "Displacements", "Forces", "ResultantForce", "ResultantMoment")
    if len(head) > largest:
        raise ValueError("the head is too long")
    try:
        content = YAML(typ="safe").load(head.decode("ascii"))
    except YAMLError as error:
        raise ValueError("the head is not YAML") from error
    frame = SimpleNamespace(SN=str(content["SN"]), index=int(content["index"]))
    frame.sendTimestamp = float(content["timestamp"])
    parts = {item["name"]: item for item in content["data"]}
    progress = parts.get("InitializeProgress")
    if progress is not None and struct.unpack_from("=i", data, int(progress["offset"]))[0] != 100:
        return None
    for name in arrays:
        sent = f"3D_{name}"
        part = parts[sent]
        shape = (int(part["height"]), int(part["width"]))
        if min(shape) < 1 or int(part["offset"]) < 0:
            raise ValueError(f"{sent} has no size")
        values = np.frombuffer(data, np.float64, shape[0] * shape[1], int(part["offset"]))
        setattr(frame, name, values.reshape(shape))
    return frame
