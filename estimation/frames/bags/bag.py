"""Bags opened: the topics of one, and the messages of a topic, one after the other.

A bag is like a folder, in which each topic is a recording: `grasp.mcap/left/frame` is the topic
`/left/frame` of `grasp.mcap`. MCAP files are read by `mcap`, which reads them without their end,
too; ROS 1 bags and ROS 2 folders are read by `rosbags`. No ROS is needed.
"""

import struct
import zlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple

from estimation.frames.bags.types import ros_types, to_ros2_name
from estimation.frames.extras import require_extra

SUFFIXES = {".mcap", ".bag", ".db3"}
"""Of bags that are files; a ROS 2 folder has a `metadata.yaml`."""


class Channel(NamedTuple):
    """The messages of one topic.

    Attributes:
        topic: its name.
        type: of the messages, as ROS 2 names it: `sensor_msgs/msg/Image`.
        messages: how many there are, as far as it is known.
        definition: of the type; empty where the bag does not have it.
    """

    topic: str
    type: str
    messages: int
    definition: str


class Message(NamedTuple):
    """A message as it was recorded.

    Attributes:
        stamp: when it was recorded [ns].
        content: its fields are attributes; None where the bag is damaged from here on.
        damage: what is wrong then.
    """

    stamp: int
    content: Any
    damage: str = ""


class Contents(NamedTuple):
    """What a bag holds: its channels, and when its first message was recorded [ns]."""

    channels: tuple[Channel, ...]
    start: int


def is_bag(path: Path) -> bool:
    """Whether there is a bag at the path."""
    if (path / "metadata.yaml").is_file():
        return any(SUFFIXES & set(one.suffixes) for one in path.iterdir())
    return path.suffix in SUFFIXES and path.is_file()


def split_place(path: Path) -> tuple[Path, str] | None:
    """The bag that a path is of or in, and the topic's name there; None where there is no bag."""
    if path.exists():
        return (path, "") if is_bag(path) else None
    place = next((above for above in path.parents if above.exists()), path)
    return (place, path.relative_to(place).as_posix()) if is_bag(place) else None


def describe_bag(path: Path) -> Contents:
    """What a bag holds.

    Raises:
        ImportError: the extra `bags` is not installed.
        ValueError: it is not a bag, or is damaged.
        OSError: it cannot be read.
    """
    require_extra("bags", f"reading the bag {path}")
    newest = max(one.stat().st_mtime_ns for one in (path, *_files(path)))
    return _describe(path, sum(one.stat().st_size for one in _files(path)), newest)


def read_messages(path: Path, channel: Channel) -> Generator[Message, None, None]:
    """The messages of a channel, as they come in the bag, one at a time in memory.

    Where the bag is damaged they end, and the last one says so.
    """
    found = (_read_mcap if path.suffix == ".mcap" else _read_ros)(path, channel.topic)
    try:
        while True:
            try:
                yield next(found)
            except StopIteration:
                return
            except _damage() as error:
                why = " ".join(str(error).split()) or type(error).__name__
                yield Message(0, None, f"the bag is damaged from here on ({why})")
                return
    finally:
        found.close()


def _files(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


@lru_cache(maxsize=16)
def _describe(path: Path, size: int, newest: int) -> Contents:
    """What a bag of that size and time holds."""
    try:
        contents = (_describe_mcap if path.suffix == ".mcap" else _describe_ros)(path)
    except PermissionError:
        raise
    except _damage() as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is not a bag, or is damaged ({why}): copy it again") from error
    if not contents.channels:
        raise ValueError(f"{path} holds no messages: it is empty, or damaged from its start")
    return contents


@lru_cache(maxsize=1)
def _damage() -> tuple[type[Exception], ...]:
    """What the libraries raise where a bag is damaged; NumPy's and Python's own errors with it."""
    from mcap.exceptions import McapError
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    theirs = (McapError, AnyReaderError, Error1, Error2, SerdeError, TypesysError)
    packed = (  # of what these libraries unpack with
        import_module("mcap.stream_reader").zstandard.ZstdError,
        import_module("rosbags.rosbag2.storage_mcap").zstd.ZstdError,
        import_module("rosbags.rosbag2.storage_sqlite3").apsw.Error,
        zlib.error,
        struct.error,
        EOFError,
    )
    nonsense = (ValueError, LookupError, TypeError, AttributeError, AssertionError)
    return (*theirs, *packed, *nonsense, ArithmeticError, MemoryError, RuntimeError, OSError)


def _open_mcap(file: IO[bytes], size: int) -> tuple[Any, Any]:
    """A reader of an MCAP file, and its summary; None where its end is missing or damaged."""
    from mcap.reader import NonSeekingReader, SeekingReader

    reader = SeekingReader(file, validate_crcs=True, record_size_limit=size)
    try:
        summary = reader.get_summary()
    except _damage():
        summary = None
    if summary is not None and summary.statistics is None:
        summary = None
    if summary is not None and summary.chunk_indexes:
        return reader, summary
    file.seek(0)
    return NonSeekingReader(file, validate_crcs=True, record_size_limit=size), summary


def _describe_mcap(path: Path) -> Contents:
    size = path.stat().st_size
    with path.open("rb") as file:
        reader, summary = _open_mcap(file, size)
        if summary is not None:
            counts = summary.statistics.channel_message_counts
            schemas, channels = summary.schemas, summary.channels.values()
            start = summary.statistics.message_start_time
        else:
            counts, start, schemas, channels = _scan_mcap(reader)
    found: dict[str, Channel] = {}
    for channel in channels:
        schema = schemas.get(channel.schema_id)
        count = counts.get(channel.id, 0)
        if earlier := found.get(channel.topic):
            found[channel.topic] = earlier._replace(messages=earlier.messages + count)
        elif schema is not None:
            text = schema.data.decode("utf-8", "replace")
            found[channel.topic] = Channel(channel.topic, to_ros2_name(schema.name), count, text)
        else:
            found[channel.topic] = Channel(channel.topic, "no schema", count, "")
    return Contents(tuple(found.values()), start)


def _scan_mcap(reader: Any) -> tuple[dict[int, int], int, dict[int, Any], list[Any]]:
    """What an MCAP file holds that is not listed at its end, up to where it is damaged."""
    counts: dict[int, int] = {}
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    start = 2**63
    try:
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            channels[channel.id] = channel
            if schema is not None:
                schemas[schema.id] = schema
            counts[channel.id] = counts.get(channel.id, 0) + 1
            start = min(start, message.log_time)
    except _damage():
        if not channels:
            raise
    return counts, start, schemas, list(channels.values())


def _read_mcap(path: Path, topic: str) -> Generator[Message, None, None]:
    size, decoders = path.stat().st_size, dict[int, Callable[[bytes], Any]]()
    with path.open("rb") as file:
        reader, _ = _open_mcap(file, size)
        for schema, channel, message in reader.iter_messages([topic], log_time_order=False):
            if channel.id not in decoders:
                decoders[channel.id] = _make_decoder(channel, schema)
            yield Message(message.log_time, decoders[channel.id](message.data))


def _make_decoder(channel: Any, schema: Any) -> Callable[[bytes], Any]:
    """What turns the bytes of an MCAP channel's messages into objects."""
    if schema is None or (channel.message_encoding, schema.encoding) not in (
        ("cdr", "ros2msg"),
        ("cdr", "ros2idl"),
        ("ros1", "ros1msg"),
    ):
        kind = f"{channel.message_encoding}/{schema.encoding if schema else 'no schema'}"
        raise ValueError(f"{channel.topic} is encoded as {kind}: only messages of ROS are read")
    store = ros_types(schema.name, schema.data.decode(), idl=schema.encoding == "ros2idl")
    name = to_ros2_name(schema.name)
    decode = store.deserialize_cdr if schema.encoding != "ros1msg" else store.deserialize_ros1
    return lambda data: decode(data, name)


@contextmanager
def _open_ros(path: Path) -> Generator[Any, None, None]:
    from rosbags.highlevel import AnyReader

    with AnyReader([path], default_typestore=ros_types()) as reader:
        yield reader


def _describe_ros(path: Path) -> Contents:
    with _open_ros(path) as reader:
        channels = tuple(
            Channel(topic, info.msgtype or "several types", info.msgcount, info.msgdef.data)
            for topic, info in reader.topics.items()
        )
        return Contents(channels, reader.start_time)


def _read_ros(path: Path, topic: str) -> Generator[Message, None, None]:
    with _open_ros(path) as reader:
        connections = [one for one in reader.connections if one.topic == topic]
        for connection, stamp, data in reader.messages(connections):
            yield Message(stamp, reader.deserialize(data, connection.msgtype))
