"""Bags written for tests: the messages of a sensor as MCAP files, ROS 1 bags and ROS 2 folders."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from estimation.frames.bags.types import MESSAGE_DEFINITIONS, MessageType

NOW = 1_700_000_000 * 10**9
"""When the bags start [ns]."""


class Sent(NamedTuple):
    """A message, and when it was sent after the start [ns]."""

    topic: str
    message: Any
    after: int


def types(ros1: bool = False):
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    for name, text in MESSAGE_DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def header(after: int, ros1: bool = False):
    store = types(ros1)
    time = store.types["builtin_interfaces/msg/Time"](*divmod(NOW + after, 10**9))
    made = store.types["std_msgs/msg/Header"]
    return made(0, time, "pad") if ros1 else made(time, "pad")


def tac3d(positions, displacements, number=0, time=0.0, **changes):
    """A `Frame` of the Tac3D nodes."""
    values = {
        "SN": "AD2-0001",
        "index": number,
        "sendTimestamp": time,
        "recvTimestamp": time,
        "Positions": np.ravel(positions),
        "Displacements": np.ravel(displacements),
        "Forces": np.zeros(np.size(positions)),
        "ResultantForce": np.array([0.0, 0.0, -2.0]),
        "ResultantMoment": np.array([0.0, 0.0, float(number)]),
    }
    return types().types[MessageType.TAC3D](**(values | changes))


def pair(left, right, after=0):
    """A message of the node for two fingers."""
    return types().types[MessageType.TAC3D_PAIR](header(after), left, right)


def cloud(positions, after=0, ros1=False):
    """A `PointCloud2` of positions in mm."""
    store = types(ros1)
    field = store.types["sensor_msgs/msg/PointField"]
    fields = [field(axis, 4 * i, 7, 1) for i, axis in enumerate("xyz")]
    points = np.ascontiguousarray(1e-3 * positions, "<f4")
    made = store.types["sensor_msgs/msg/PointCloud2"]
    data, row = np.frombuffer(points.tobytes(), np.uint8), points.nbytes
    return made(header(after, ros1), 1, len(points), fields, False, 12, row, data, False)


def image(pixels, encoding, after=0, ros1=False):
    """An `Image`."""
    made = types(ros1).types["sensor_msgs/msg/Image"]
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    height, width = pixels.shape[:2]
    step = pixels.strides[0]
    return made(header(after, ros1), height, width, encoding, 0, step, data)


def compressed(data, after=0, kind="png"):
    """A `CompressedImage`."""
    made = types().types["sensor_msgs/msg/CompressedImage"]
    return made(header(after), kind, np.frombuffer(data, np.uint8))


def write_mcap(path: Path, sent: Sequence[Sent], end: bool = True, ros1: bool = False) -> Path:
    """An MCAP file; without its end, it is as a recorder leaves it that is killed."""
    store = types(ros1)
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=20_000, compression=CompressionType.ZSTD)
        writer.start("ros1" if ros1 else "ros2")
        channels = {}
        for number, (topic, message, after) in enumerate(sent):
            kind = message.__msgtype__
            if topic not in channels:
                text = store.generate_msgdef(kind, ros_version=1 if ros1 else 2)[0]
                name = kind.replace("/msg/", "/") if ros1 else kind
                kinds = ("ros1msg", "ros1") if ros1 else ("ros2msg", "cdr")
                schema = writer.register_schema(name, kinds[0], text.encode())
                channels[topic] = writer.register_channel(topic, kinds[1], schema)
            pack = store.serialize_ros1 if ros1 else store.serialize_cdr
            stamp = NOW + after
            writer.add_message(channels[topic], stamp, bytes(pack(message, kind)), stamp, number)
        if end:
            writer.finish()
    return path


def write_ros1(path: Path, sent: Sequence[Sent]) -> Path:
    """A ROS 1 bag."""
    store, channels = types(ros1=True), {}
    with Bag1Writer(path) as writer:
        for topic, message, after in sent:
            kind = message.__msgtype__
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(channels[topic], NOW + after, store.serialize_ros1(message, kind))
    return path


def write_ros2(path: Path, sent: Sequence[Sent], mcap: bool = False) -> Path:
    """A ROS 2 folder."""
    store, channels = types(), {}
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Bag2Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic, message, after in sent:
            kind = message.__msgtype__
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(channels[topic], NOW + after, store.serialize_cdr(message, kind))
    return path
