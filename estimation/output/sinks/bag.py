"""Answers and frames as an MCAP file that includes the types of its messages."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from estimation.estimators.measurement import Z95
from estimation.frames.bags.bag import describe_bag, read_messages
from estimation.frames.bags.types import MessageType, add_type, ros_types
from estimation.frames.extras import require_extra
from estimation.frames.files import growing
from estimation.frames.flat import LAYOUT_FIELDS, flatten_frame, flatten_layout
from estimation.frames.recording import MarkerLayout
from estimation.frames.source import Source
from estimation.output.scene import keep_pictures
from estimation.output.table import read_cells, tabulate_answer
from estimation.tracking.stream import Answer


class BagWriter:
    """The sink that writes an MCAP file of ROS messages, including their types.

    Topics:

    - `/contactmodel/frame`: the complete frame, from which a run can be repeated.
    - `/contactmodel/answer`: the row of `angles.csv` in numbers, with the variance of the angle.
    - `/contactmodel/markers`: the markers as points [m], with their state.
    - `/contactmodel/wrench`: force and moment [N, N·m], if known.
    - `/contactmodel/picture`: the picture, if any, as a JPEG of up to 960 px.
    """

    def __init__(self, path: Path, source: Source, method: str, rows: int = 0) -> None:
        """Make a file, or continue an existing one after so many rows.

        Raises:
            ImportError: the extra `bags` is not installed.
            OSError: the file cannot be written.
        """
        require_extra("bags", f"writing {path}")
        self._path, self._method, self._source = path, method, source
        self._find_picture, self._types = keep_pictures(source), ros_types()
        self._definitions: dict[str, str] = {}
        earlier = path.with_name(f".{path.name}")
        if rows and not earlier.is_file():
            path.rename(earlier)
        self._begin()
        if rows:
            for sent in _read_sent(earlier, rows):
                self._send(sent)
        earlier.unlink(missing_ok=True)

    def restart(self) -> None:
        """Clear the file."""
        self._file.close()
        self._begin()

    def _begin(self) -> None:
        self._file = self._path.open("wb")
        self._writer: Any = None
        self._channels: dict[str, int] = {}
        self._layout: MarkerLayout | None = None
        self._stamp = 0

    def put(self, answer: Answer) -> None:
        """Write the messages of an answer; they are on the disc when this returns."""
        time = answer.frame.time
        if math.isfinite(time) and 0.0 <= time < 2.0**31:
            self._stamp = round(1e9 * time)
        with growing(self._path):
            for topic, kind, values in self._messages(answer):
                if kind not in self._definitions:
                    self._definitions[kind], _ = self._types.generate_msgdef(kind, ros_version=2)
                data = bytes(self._types.serialize_cdr(self._types.types[kind](**values), kind))
                at = (self._stamp, answer.row)
                name, definition = f"/contactmodel/{topic}", self._definitions[kind]
                self._send(_Sent(name, kind, definition, *at, data))
            self._file.flush()

    def close(self) -> None:
        """Write the index at the end of the file, and close it."""
        with growing(self._path):
            if self._writer is not None:
                self._writer.finish()
            self._file.close()

    def _send(self, sent: "_Sent") -> None:
        if self._writer is None:
            self._writer = _start_writer(self._file)
        if sent.topic not in self._channels:
            schema = self._writer.register_schema(sent.kind, "ros2msg", sent.definition.encode())
            self._channels[sent.topic] = self._writer.register_channel(sent.topic, "cdr", schema)
        channel = self._channels[sent.topic]
        self._writer.add_message(channel, sent.stamp, sent.data, sent.stamp, sent.row)

    def _messages(self, answer: Answer) -> Iterator[tuple[str, str, dict[str, Any]]]:
        """Topic, type and fields of the messages of an answer."""
        layout = {name: np.empty(0, kind) for name, kind in LAYOUT_FIELDS.items()}
        if answer.layout is not self._layout:
            self._layout = answer.layout
            arrays = flatten_layout(self._layout)
            layout = {name: values.ravel() for name, values in arrays.items()}
        frame = flatten_frame(answer.frame)
        for name, value in frame.items():
            if isinstance(value, np.ndarray):
                unknown = name in ("forces", "rotation") and not np.isfinite(value).any()
                frame[name] = value.ravel()[: 0 if unknown else None]
        yield (
            "frame",
            MessageType.FRAME,
            frame
            | {
                "dimensions": answer.frame.positions.shape[1],
                "unit": self._source.unit,
                "convention": self._source.convention,
                **layout,
            },
        )
        stamp = self._types.types["builtin_interfaces/msg/Time"](*divmod(self._stamp, 10**9))
        header = self._types.types["std_msgs/msg/Header"](stamp, "pad")
        yield "answer", MessageType.ANSWER, {"header": header} | self._row(answer)
        yield "markers", MessageType.POINTS, {"header": header} | self._points(answer)
        wrench = np.array(answer.frame.wrench)
        if np.isfinite(wrench).any():
            vectors = (wrench[:3], 1e-3 * wrench[3:])  # ROS uses N·m
            make = self._types.types["geometry_msgs/msg/Vector3"]
            force, moment = (make(*vector.tolist()) for vector in vectors)
            message = self._types.types["geometry_msgs/msg/Wrench"](force, moment)
            yield "wrench", MessageType.WRENCH, {"header": header, "wrench": message}
        if (shown := self._find_picture(answer.frame)) is not None:
            jpeg = np.frombuffer(shown.copy.jpeg, np.uint8)
            yield "picture", MessageType.PICTURE, {"header": header, "format": "jpeg", "data": jpeg}

    def _row(self, answer: Answer) -> dict[str, Any]:
        """The fields of an answer, which define the message's type."""
        row = read_cells(tabulate_answer(answer, self._method, self._source.unit))
        row = {name.lower(): value for name, value in row.items()}
        spread = (float(row["angle_high_deg"]) - float(row["angle_low_deg"])) / (2.0 * Z95)
        row["angle_variance_deg2"] = spread**2  # of a normal distribution with this 95 % interval
        if MessageType.ANSWER not in self._types.types:
            kinds = {str: "string", int: "int64", float: "float64"}
            lines = [f"{kinds[type(value)]} {name}" for name, value in row.items()]
            add_type(self._types, MessageType.ANSWER, "\n".join(["std_msgs/Header header", *lines]))
        return row

    def _points(self, answer: Answer) -> dict[str, Any]:
        """The markers as a cloud of points."""
        estimate, positions = answer.estimates[self._method], answer.frame.positions
        kinds = {"x": "<f4", "y": "<f4", "z": "<f4", "turned_rad": "<f4"}
        kinds |= dict.fromkeys(("valid", "contact", "stick"), "u1")
        points = np.zeros(len(positions), np.dtype(list(kinds.items())))
        for axis, values in zip("xyz", positions.T, strict=False):
            points[axis] = (1e-3 if self._source.unit == "mm" else 1.0) * values
        points["turned_rad"], points["valid"] = answer.turned, answer.frame.valid
        points["contact"], points["stick"] = estimate.contact, estimate.stick
        make, codes = self._types.types["sensor_msgs/msg/PointField"], {"<f4": 7, "u1": 2}
        sizes = [np.dtype(kind).itemsize for kind in kinds.values()]
        fields = zip(kinds.items(), np.cumsum([0, *sizes]).tolist(), strict=False)
        return {
            "height": 1,
            "width": len(points),
            "fields": [make(name, at, codes[kind], 1) for (name, kind), at in fields],
            "is_bigendian": False,
            "point_step": points.itemsize,
            "row_step": points.nbytes,
            "data": np.frombuffer(points.tobytes(), np.uint8),
            "is_dense": bool(answer.frame.valid.all()),
        }


def read_answers(path: Path) -> Iterator[dict[str, Any]]:
    """The answers in a file by `BagWriter`, each as values by field."""
    (channel,) = (
        channel for channel in describe_bag(path).channels if channel.type == MessageType.ANSWER
    )
    for message in read_messages(path, channel):
        if message.content is not None:
            others = ("header", "__msgtype__")  # of the message, not of the answer
            row = vars(message.content)
            yield {name: value for name, value in row.items() if name not in others}


class _Sent(NamedTuple):
    topic: str
    kind: str
    definition: str
    stamp: int
    row: int
    data: bytes


def _start_writer(file: IO[bytes]) -> Any:
    """A writer without chunks, so that each message is complete on the disc before the next."""
    from mcap.writer import Writer

    writer = Writer(file, use_chunking=False)
    writer.start("ros2", "contactmodel")
    return writer


def _read_sent(path: Path, rows: int) -> Iterator["_Sent"]:
    """The messages of the first rows of a file by `BagWriter`, which may be incomplete."""
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    with path.open("rb") as file:
        try:
            messages = NonSeekingReader(file).iter_messages(log_time_order=False)
            for schema, channel, message in messages:
                if schema is not None and message.sequence < rows:
                    text = schema.data.decode()
                    at = (message.log_time, message.sequence, message.data)
                    yield _Sent(channel.topic, schema.name, text, *at)
        except EndOfFile:
            return
