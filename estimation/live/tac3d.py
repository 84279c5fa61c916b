"""The frames that the Tac3D desktop program sends by UDP, without its maker's SDK.

A frame comes in packets of a serial number (4 bytes), the number of the last packet and that of
this one (2 bytes each, as the machine orders them), and a piece. The first piece is a head in YAML,
the others are its arrays. This is what the decoder of the maker's SDK reads (`pytac3d` 3.3.0.9,
`Sensor.py`); the SDK itself asks for packages that replace the OpenCV of this one.
"""

import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np

from estimation.frames.bags.messages import PlainMessages, read_tac3d
from estimation.frames.bags.topics import Stamped
from estimation.frames.extras import require_extra
from estimation.frames.inspection import LiveInspector
from estimation.frames.recording import Frame, MarkerLayout

PREFIX = "tac3d:"
"""What a name of such a source begins with."""
_ARRAYS = {
    "Positions": "3D_Positions",
    "Displacements": "3D_Displacements",
    "Forces": "3D_Forces",
    "ResultantForce": "3D_ResultantForce",
    "ResultantMoment": "3D_ResultantMoment",
}


class Tac3DReceiver:
    """Puts the packets of a port together.

    Attributes:
        sensor: serial number of the one that is listened to; empty before its first frame.
        others: serial numbers of other sensors on the port.
        foreign: packets and frames that could not be read.
    """

    def __init__(self, name: str) -> None:
        """Listen.

        Args:
            name: `tac3d:PORT`, or `tac3d:PORT/SENSOR` where several sensors send to a port.

        Raises:
            ImportError: the extra `tac3d` is not installed.
            ValueError: there is no port.
            OSError: another program listens there.
        """
        require_extra("tac3d", f"following {name}")
        port, _, self.sensor = name.removeprefix(PREFIX).partition("/")
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
                f"{name}: the port cannot be listened to ({error.strerror}): does another program, "
                "or the SDK, listen to it?"
            ) from error

    def messages(self) -> Iterator[Stamped]:
        """The sensor's frames as they come; it has no end."""
        largest = 65535  # of a packet [bytes]
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
        """What else came to the port, in sentences."""
        notes = []
        if self.others:
            others = ", ".join(sorted(self.others))
            notes.append(
                f"Only {self.sensor} is followed; to the same port send {others} "
                f"({PREFIX}PORT/SENSOR chooses)."
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
        begun, most = 8, 256  # frames at a time; packets of a frame
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
            while len(self._pieces) > begun:  # packets of the oldest were lost
                del self._pieces[next(iter(self._pieces))]
            return None
        del self._pieces[sender, serial]
        return pieces[0], b"".join(pieces[i] for i in range(1, last + 1))


class Tac3DSource:
    """The frames of a Tac3D sensor as the desktop program sends them.

    The reference comes from the first frame with a load, or from the first two seconds without one.

    Attributes:
        name: short name.
        source: where they come from.
        warnings: none.
        live: yes.
        provisional: no.
    """

    live, provisional, unit = True, False, PlainMessages.unit
    convention, warnings = PlainMessages.convention, ()

    def __init__(self, name: str, feed: Callable[[Iterator[Stamped]], Iterator[Stamped]]) -> None:
        """Wait for the first frames.

        Args:
            name: as for `Tac3DReceiver`.
            feed: passes the frames on as they come.

        Raises:
            ImportError: the extra `tac3d` is not installed.
            ValueError: there is no port.
            OSError: another program listens there.
        """
        most = 64  # frames that are waited for
        self.name = self.source = name
        self._receiver, self._ahead = Tac3DReceiver(name), list[Stamped]()
        self._messages = feed(self._receiver.messages())
        for message in self._messages:
            self._ahead.append(message)
            if message.content.Displacements.any() or len(self._ahead) == most:
                break
        self._markers, self._inspector = PlainMessages(read_tac3d, self._ahead), LiveInspector()

    @property
    def layout(self) -> MarkerLayout:
        """The markers at rest."""
        return self._markers.layout

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know, in sentences, as known by now."""
        received = self._receiver.notes()
        return (*self._markers.notes, *received, *self._inspector.notes())

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order; it can be done once."""
        shape = self.layout.reference.shape
        for message in chain(self._ahead, self._messages):
            try:
                frame = self._markers.frame(message)
            except ValueError as error:
                none, flaw = np.full(shape, np.nan), f"the frame cannot be used: {error}"
                frame = Frame(none, message.time, message.number, flaw=flaw)
            yield self._inspector.inspect(frame, self.layout.reference)


def _decode(head: bytes, data: bytes) -> Any:
    """A frame with the fields of a `Frame` of the Tac3D nodes; None while the sensor begins.

    Raises:
        ValueError: that is no head, or arrays that it declares are not there; and so KeyError,
            TypeError, struct.error.
    """
    from ruamel.yaml import YAML, YAMLError

    largest = 65536  # of a head [bytes]
    if len(head) > largest:
        raise ValueError("the head is too long")
    try:
        told = YAML(typ="safe").load(head.decode("ascii"))
    except YAMLError as error:
        raise ValueError("the head is no YAML") from error
    frame = SimpleNamespace(SN=str(told["SN"]), index=int(told["index"]))
    frame.sendTimestamp = float(told["timestamp"])
    parts = {item["name"]: item for item in told["data"]}
    begun = parts.get("InitializeProgress")
    if begun is not None and struct.unpack_from("=i", data, int(begun["offset"]))[0] != 100:
        return None
    for name, sent in _ARRAYS.items():
        part = parts[sent]
        shape = (int(part["height"]), int(part["width"]))
        if min(shape) < 1 or int(part["offset"]) < 0:
            raise ValueError(f"{sent} has no size")
        values = np.frombuffer(data, np.float64, shape[0] * shape[1], int(part["offset"]))
        setattr(frame, name, values.reshape(shape))
    return frame
