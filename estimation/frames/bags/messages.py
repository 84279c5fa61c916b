"""Messages of markers, turned into frames.

A reader of each kind of topic is made from its first messages, in which it finds the markers at
rest, and then turns each message into a frame.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from estimation.frames.bags.topics import Stamped
from estimation.frames.flat import FRAME_FIELDS, LAYOUT_FIELDS, restore_frame, restore_layout
from estimation.frames.recording import Frame, MarkerLayout, layout_markers
from estimation.frames.tac3d import find_reference

UNKNOWN = float("nan")
Vectors = Float[np.ndarray, "n 3"]


class Seen(NamedTuple):
    """What a message says of the markers.

    Attributes:
        positions: of the markers [mm].
        time: time stamp [s].
        number: of the frame.
        displacements: of the markers, if it has them [mm].
        forces: at each marker, if it has them [N].
        wrench: as in `Frame`.
    """

    positions: Vectors
    time: float
    number: int
    displacements: Vectors | None = None
    forces: Vectors | None = None
    wrench: tuple[float, ...] = (UNKNOWN,) * 6


def stamp_message(content: Any, number: int = 0) -> Stamped:
    """A message that has just come, as from a subscription; its time is that of its header.

    Examples:
        >>> from types import SimpleNamespace as Message  # stands for ROS's own classes
        >>> from estimation import stamp_message
        >>> message = Message(header=Message(stamp=Message(sec=5, nanosec=40_000_000)))
        >>> print(f"{stamp_message(message).time} s")
        5.04 s
    """
    stamp = content.header.stamp
    return Stamped(content, stamp.sec + 1e-9 * stamp.nanosec, number)


def read_tac3d(message: Stamped) -> Seen:
    """What a `Frame` of the Tac3D nodes says; mm, N and N·mm, on the sensor's own clock.

    Raises:
        ValueError: its arrays do not fit each other.
    """
    content, found = message.content, dict[str, Vectors]()
    names = ("Positions", "Displacements", "Forces", "ResultantForce", "ResultantMoment")
    for name in names:
        values = np.asarray(getattr(content, name), dtype=float)
        wanted = 3 if name.startswith("Resultant") else found.get("Positions", values).size
        if values.size != wanted or wanted % 3 or not wanted:
            raise ValueError(
                f"{name} has {values.size} numbers, not {wanted - wanted % 3 or 'any'}"
            )
        found[name] = values.reshape(-1, 3)
    positions, displacements, forces, force, moment = (found[name] for name in names)
    time, number = float(content.sendTimestamp), int(content.index)
    wrench = (*force[0].tolist(), *moment[0].tolist())
    return Seen(positions, time, number, displacements, forces, wrench)


def read_points(message: Stamped) -> Seen:
    """The points of a `PointCloud2`, which keep their places in it; ROS gives them in m.

    Raises:
        ValueError: it has no x, y and z, or fewer bytes than it declares.

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
    fields = {one.name: one for one in cloud.fields if 1 <= one.datatype <= len(codes)}
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

    The reference comes from the displacements, as in Tac3D folders, but of the first loaded
    messages only; without displacements it is a message itself.

    Attributes:
        layout: the markers at rest.
        unit: of lengths.
        convention: how the axes lie.
        notes: remarks for readers, in sentences.
    """

    unit = "mm"
    convention = "z out of the elastomer towards the object, as the sensor gives it"

    def __init__(
        self,
        read: Callable[[Stamped], Seen],
        messages: Iterable[Stamped],
        unloaded: int | None = None,
    ) -> None:
        """Find the markers at rest; no more messages are read than that takes.

        Args:
            read: what a message says.
            messages: in order.
            unloaded: number of the message that is unloaded.

        Raises:
            ValueError: no message shows markers, or the unloaded one does not.
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
        most = 256  # messages with a load from which the sensor's zero is found
        kept, loaded = [first], 0
        for one in later:
            if len(one.positions) == self._count and one.displacements is not None:
                moved = bool(np.nan_to_num(one.displacements).any())
                loaded += moved
                if moved or len(kept) - loaded < most:
                    kept.append(one)
            if loaded == most:
                break
        moves = [one.displacements for one in kept if one.displacements is not None]
        return find_reference(np.stack([one.positions for one in kept]), np.stack(moves))

    def _find_rest(
        self, first: Seen, later: Iterator[Seen], unloaded: int | None
    ) -> tuple[Vectors, tuple[str, ...]]:
        if unloaded is None:
            note = "the markers' motion counts from the first message (--unloaded-frame)"
            return first.positions, (note,)
        for one in (first, *later):
            if one.number == unloaded:
                return one.positions, ()
        raise ValueError(
            f"no message {unloaded} with markers to take as unloaded (--unloaded-frame)"
        )

    def frame(self, message: Stamped) -> Frame:
        """The frame of a message.

        Raises:
            ValueError: the message is not of these markers, or inconsistent.
        """
        seen = self._read(message)
        if len(seen.positions) != self._count:
            raise ValueError(f"{len(seen.positions)} markers, not {self._count} as in the first")
        positions = seen.positions[self._known]
        return Frame(
            positions=positions,
            time=seen.time,
            source_index=seen.number,
            wrench=seen.wrench,
            forces=None if seen.forces is None else seen.forces[self._known],
        )


class WholeMessages:
    """Messages that hold all of a frame, as `run --sink mcap` writes them.

    The markers at rest come with the first message, and where they have changed. Attributes as of
    `PlainMessages`.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, messages: Iterable[Stamped]) -> None:
        """Find the markers at rest in the first message.

        Raises:
            ValueError: it does not have them.
        """
        first = next((message.content for message in messages), None)
        if first is None or not len(first.reference):
            raise ValueError("its first message does not give the markers at rest")
        self.layout = restore_layout(_attributes(first, LAYOUT_FIELDS), first.dimensions)
        self.unit, self.convention = first.unit, first.convention

    def frame(self, message: Stamped) -> Frame:
        """The frame of a message; as of `PlainMessages`."""
        content = message.content
        if len(content.reference):
            layout = restore_layout(_attributes(content, LAYOUT_FIELDS), content.dimensions)
            if not _is_same(layout, self.layout):
                self.layout = layout
        frame = restore_frame(_attributes(content, FRAME_FIELDS))
        if frame.positions.shape != self.layout.reference.shape:
            raise ValueError(f"{len(frame.valid)} markers, not {len(self.layout.reference)}")
        return frame


def _attributes(content: Any, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(content, name) for name in names}


def _is_same(one: MarkerLayout, other: MarkerLayout) -> bool:
    return one.grid_shape == other.grid_shape and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("reference", "neighbours")
    )


def _usable(read: Callable[[Stamped], Seen], messages: Iterable[Stamped]) -> Iterator[Seen]:
    """What the messages that can be read say.

    Raises:
        ValueError: none of them can be.
    """
    why, found = "there are none", False
    for message in messages:
        try:
            seen = read(message)
        except ValueError as error:
            why = str(error)
            continue
        if np.isfinite(seen.positions).all(axis=1).sum() >= 3:
            found = True
            yield seen
    if not found:
        raise ValueError(f"no message shows markers: {why}")
