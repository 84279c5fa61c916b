"""Conversion of messages of markers to frames.

The reader of a topic is made from its first messages, in which it finds the markers at rest. It
then converts each message to a frame.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from estimation.frames.bags.topics import Stamped
from estimation.frames.flat import FRAME_FIELDS, LAYOUT_FIELDS, restore_frame, restore_layout
from estimation.frames.recording import Frame, MarkerLayout, layout_markers
from estimation.frames.tac3d import find_reference

Vectors = Float[np.ndarray, "n 3"]


class Seen(NamedTuple):
    """The markers in a message."""

    positions: Vectors  # of the markers [mm]
    time: float  # time stamp [s]
    number: int  # of the frame
    displacements: Vectors | None = None  # of the markers, if the message has them [mm]
    forces: Vectors | None = None  # at each marker, if the message has them [N]
    wrench: tuple[float, ...] = (np.nan,) * 6  # as in `Frame`


def stamp_message(content: Any, number: int = 0) -> Stamped:
    """Stamp a message that has just arrived, as from a subscription, with its header's time.

    Args:
        content: the message.
        number: of the message.

    Examples:
        >>> from types import SimpleNamespace as Message  # stands for ROS's own classes
        >>> from estimation import stamp_message
        >>> message = Message(header=Message(stamp=Message(sec=5, nanosec=40_000_000)))
        >>> print(f"{stamp_message(message).time} s")
        5.04 s
    """
    stamp = content.header.stamp
    return Stamped(content, stamp.sec + 1e-9 * stamp.nanosec, number)


def read_tac3d_frame(message: Stamped) -> Seen:
    """Read a `Frame` message of the Tac3D nodes: mm, N and N·mm, on the sensor's own clock.

    Raises:
        ValueError: its arrays do not fit each other.
    """
    content, vectors = message.content, dict[str, Vectors]()
    names = ("Positions", "Displacements", "Forces", "ResultantForce", "ResultantMoment")
    for name in names:
        values = np.asarray(getattr(content, name), dtype=float)
        wanted = 3 if name.startswith("Resultant") else vectors.get("Positions", values).size
        if values.size != wanted or wanted % 3 or not wanted:
            raise ValueError(
                f"{name} has {values.size} numbers, not {wanted - wanted % 3 or 'any'}"
            )
        vectors[name] = values.reshape(-1, 3)
    positions, displacements, forces, force, moment = (vectors[name] for name in names)
    time, number = float(content.sendTimestamp), int(content.index)
    wrench = (*force[0].tolist(), *moment[0].tolist())
    return Seen(positions, time, number, displacements, forces, wrench)


def read_points(message: Stamped) -> Seen:
    """Read the points of a `PointCloud2`, in the cloud's order; ROS's m are converted to mm.

    Raises:
        ValueError: the cloud lacks x, y or z, or has fewer bytes than it declares.

    Examples:
        >>> from types import SimpleNamespace as Message  # stands for ROS's own classes
        >>> import numpy as np
        >>> from estimation import read_points, stamp_message
        >>> points = np.array([[0.001, 0.0, 0.0], [0.002, 0.0, 0.0]], "f4")  # m
        >>> cloud = Message(
        ...     header=Message(stamp=Message(sec=5, nanosec=0)),
        ...     fields=[Message(name=n, datatype=7, offset=4 * i) for i, n in enumerate("xyz")],
        ...     height=1,
        ...     width=2,
        ...     point_step=12,
        ...     row_step=24,
        ...     is_bigendian=False,
        ...     data=points.view("u1").ravel(),
        ... )
        >>> print(read_points(stamp_message(cloud)).positions.round(3))  # mm
        [[1. 0. 0.]
         [2. 0. 0.]]
    """
    cloud, mm = message.content, 1e3
    codes = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
    fields = {field.name: field for field in cloud.fields if 1 <= field.datatype <= len(codes)}
    if missing := [axis for axis in "xyz" if axis not in fields]:
        raise ValueError(f"the cloud lacks the fields {', '.join(missing)}")
    order = ">" if cloud.is_bigendian else "<"
    kinds = [order + codes[fields[axis].datatype - 1] for axis in "xyz"]
    offsets = [fields[axis].offset for axis in "xyz"]
    point = np.dtype(
        {"names": list("xyz"), "formats": kinds, "offsets": offsets, "itemsize": cloud.point_step}
    )
    data: Shaped[np.ndarray, " bytes"] = np.ascontiguousarray(cloud.data)
    needed = (cloud.height - 1) * cloud.row_step + cloud.width * cloud.point_step
    if not 0 < needed <= data.nbytes:
        raise ValueError(f"the cloud declares {needed} bytes and has {data.nbytes}")
    shape, strides = (cloud.height, cloud.width), (cloud.row_step, cloud.point_step)
    points = np.ndarray(shape, point, data, strides=strides).ravel()
    positions = mm * np.stack([points[axis].astype(float) for axis in "xyz"], axis=1)
    return Seen(positions, message.time, message.number)


class PlainMessages:
    """Messages with the positions of all markers, and perhaps their displacements.

    The reference follows from the displacements of the first loaded messages, as in Tac3D folders.
    Without displacements, one message is the reference.
    """

    unit = "mm"
    convention = "z out of the elastomer towards the object, as in the sensor's data"

    def __init__(
        self,
        read: Callable[[Stamped], Seen],
        messages: Iterable[Stamped],
        unloaded: int | None = None,
    ) -> None:
        """Find the markers at rest, from as few messages as possible.

        Raises:
            ValueError: no message shows markers, or the unloaded message does not.
        """
        self._read = read
        seen = _usable(read, messages)
        first = next(seen)
        self._count = len(first.positions)
        if first.displacements is not None:
            reference, self.notes = self._find_zero(first, seen)
        else:
            reference, self.notes = self._find_rest(first, seen, unloaded)
        self._known = np.isfinite(reference).all(axis=1)
        if not self._known.all():
            self.notes += (f"{(~self._known).sum()} markers were never seen and are left out",)
        self.layout = layout_markers(reference[self._known])

    def _find_zero(self, first: Seen, later: Iterator[Seen]) -> tuple[Vectors, tuple[str, ...]]:
        most = 256  # largest number of loaded messages that determine the sensor's zero
        used, loaded = [first], 0
        for seen in later:
            if len(seen.positions) == self._count and seen.displacements is not None:
                moved = bool(np.nan_to_num(seen.displacements).any())
                loaded += moved
                if moved or len(used) - loaded < most:
                    used.append(seen)
            if loaded == most:
                break
        moves = [seen.displacements for seen in used if seen.displacements is not None]
        return find_reference(np.stack([seen.positions for seen in used]), np.stack(moves))

    def _find_rest(
        self, first: Seen, later: Iterator[Seen], unloaded: int | None
    ) -> tuple[Vectors, tuple[str, ...]]:
        if unloaded is None:
            note = "the markers' motion is measured from the first message (--unloaded-frame)"
            return first.positions, (note,)
        for seen in (first, *later):
            if seen.number == unloaded:
                return seen.positions, ()
        raise ValueError(
            f"no message {unloaded} with markers to take as unloaded (--unloaded-frame)"
        )

    def frame(self, message: Stamped) -> Frame:
        """Convert a message to a frame.

        Raises:
            ValueError: the message has other markers, or is inconsistent.
        """
        seen = self._read(message)
        if len(seen.positions) != self._count:
            raise ValueError(
                f"it has {len(seen.positions)} markers, the first message {self._count}"
            )
        positions = seen.positions[self._known]
        return Frame(
            positions=positions,
            time=seen.time,
            source_index=seen.number,
            wrench=seen.wrench,
            forces=None if seen.forces is None else seen.forces[self._known],
        )


class WholeMessages:
    """Messages that hold complete frames, as written by `run --sink mcap`.

    The first message contains the markers at rest, and so does every message in which they change.
    The attributes are those of `PlainMessages`.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, messages: Iterable[Stamped]) -> None:
        """Read the markers at rest from the first message.

        Raises:
            ValueError: the first message lacks them.
        """
        first = next((message.content for message in messages), None)
        if first is None or not len(first.reference):
            raise ValueError("its first message lacks the markers at rest")
        self.layout = restore_layout(_attributes(first, LAYOUT_FIELDS), first.dimensions)
        self.unit, self.convention = first.unit, first.convention

    def frame(self, message: Stamped) -> Frame:
        """Convert a message to a frame, as in `PlainMessages`."""
        content = message.content
        if len(content.reference):
            layout = restore_layout(_attributes(content, LAYOUT_FIELDS), content.dimensions)
            if not _is_same(layout, self.layout):
                self.layout = layout
        return restore_frame(_attributes(content, FRAME_FIELDS), self.layout)


def _attributes(content: Any, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(content, name) for name in names}


def _is_same(one: MarkerLayout, other: MarkerLayout) -> bool:
    return one.grid_shape == other.grid_shape and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("reference", "neighbours")
    )


def _usable(read: Callable[[Stamped], Seen], messages: Iterable[Stamped]) -> Iterator[Seen]:
    """The markers of the readable messages that show at least three.

    Raises:
        ValueError: there is no such message.
    """
    why, usable = "there are none", False
    for message in messages:
        try:
            seen = read(message)
        except ValueError as error:
            why = str(error)
            continue
        if np.isfinite(seen.positions).all(axis=1).sum() >= 3:
            usable = True
            yield seen
    if not usable:
        raise ValueError(f"no message shows markers: {why}")
