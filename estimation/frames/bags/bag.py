"""Reading bags: their topics, and the messages of a topic one after the other.

A bag is like a folder in which each topic is a recording: `grasp.mcap/left/frame` is the topic
`/left/frame` of `grasp.mcap`. MCAP files are read by `mcap`, which also reads files whose end is
missing. ROS 1 bags and ROS 2 folders are read by `rosbags`. No ROS is needed.
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


class Channel(NamedTuple):
    """The messages of one topic."""

    topic: str  # name of the topic
    type: str  # of the messages, in ROS 2's notation: `sensor_msgs/msg/Image`
    messages: int  # number of messages, as far as the bag lists it
    definition: str  # of the type; empty if the bag lacks it


class Message(NamedTuple):
    """A recorded message."""

    stamp: int  # time of its recording [ns]
    # the message, with its fields as attributes; None if the bag is damaged from here on
    content: Any
    damage: str = ""  # description of the damage; empty if there is none


class Contents(NamedTuple):
    """Contents of a bag: its channels, and the time of its first message [ns]."""

    channels: tuple[Channel, ...]
    start: int


def is_bag(path: Path) -> bool:
    """Whether there is a bag at the path."""
    # of bags that are files; a ROS 2 folder has a `metadata.yaml`
    suffixes = {".mcap", ".bag", ".db3"}
    if (path / "metadata.yaml").is_file():
        return any(suffixes & set(file.suffixes) for file in path.iterdir())
    return path.suffix in suffixes and path.is_file()


def split_place(path: Path) -> tuple[Path, str] | None:
    """Split a path into a bag and the name of a topic in it, perhaps empty; None without a bag."""
    if path.exists():
        return (path, "") if is_bag(path) else None
    place = next((above for above in path.parents if above.exists()), path)
    return (place, path.relative_to(place).as_posix()) if is_bag(place) else None


def describe_bag(path: Path) -> Contents:
    """List the contents of a bag.

    Raises:
        ImportError: the extra `bags` is not installed.
        ValueError: the path is not a bag, or the bag is damaged.
        OSError: the bag cannot be read.
    """
    require_extra("bags", f"reading the bag {path}")
    newest = max(file.stat().st_mtime_ns for file in (path, *_files(path)))
    return _describe(path, sum(file.stat().st_size for file in _files(path)), newest)


def read_messages(path: Path, channel: Channel) -> Generator[Message, None, None]:
    """Read the messages of a channel in the bag's order, with one message in memory at a time.

    If the bag is damaged, the messages end there, and the last one describes the damage.
    """
    messages = (_read_mcap if path.suffix == ".mcap" else _read_ros)(path, channel.topic)
    try:
        while True:
            try:
                yield next(messages)
            except StopIteration:
                return
            except _damage() as error:
                why = " ".join(str(error).split()) or type(error).__name__
                yield Message(0, None, f"the bag is damaged from here on ({why})")
                return
    finally:
        messages.close()


def _files(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


@lru_cache(maxsize=16)
def _describe(path: Path, size: int, newest: int) -> Contents:
    """Contents of a bag; size and time of its files make the cache notice changes."""
    try:
        contents = (_describe_mcap if path.suffix == ".mcap" else _describe_ros)(path)
    except PermissionError:
        raise
    except _damage() as error:
        why = " ".join(str(error).split()) or type(error).__name__
        advice = f"copy it again{_advise_repair(path)}"
        raise ValueError(f"{path} is not a bag, or is damaged ({why}): {advice}") from error
    if not contents.channels:
        raise ValueError(f"{path} holds no messages: it is empty, or damaged from its start")
    return contents


def _advise_repair(path: Path) -> str:
    """What else may help with a bag whose recording broke off."""
    if path.suffix == ".bag":
        return ", or repair it with `rosbag reindex` if its recording broke off"
    if parts := sorted(path.glob("*.mcap")):  # MCAP files are read up to their damage
        return f", or give its file {parts[0]}"
    if parts := sorted(path.glob("*.db3")):
        return f", or recover its file with `sqlite3 {parts[0]} .recover`"
    return ""


@lru_cache(maxsize=1)
def _damage() -> tuple[type[Exception], ...]:
    """Errors that the libraries, NumPy and Python raise on a damaged bag."""
    from mcap.exceptions import McapError
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    readers = (McapError, AnyReaderError, Error1, Error2, SerdeError, TypesysError)
    packed = (  # errors of their decompressors
        import_module("mcap.stream_reader").zstandard.ZstdError,
        import_module("rosbags.rosbag2.storage_mcap").zstd.ZstdError,
        import_module("rosbags.rosbag2.storage_sqlite3").apsw.Error,
        zlib.error,
        struct.error,
        EOFError,
    )
    nonsense = (ValueError, LookupError, TypeError, AttributeError, AssertionError)
    return (*readers, *packed, *nonsense, ArithmeticError, MemoryError, RuntimeError, OSError)


def _open_mcap(file: IO[bytes], size: int) -> tuple[Any, Any]:
    """A reader of an MCAP file, and its summary; None if the file's end is missing or damaged."""
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
    topics: dict[str, Channel] = {}
    for channel in channels:
        schema = schemas.get(channel.schema_id)
        count = counts.get(channel.id, 0)
        if earlier := topics.get(channel.topic):
            topics[channel.topic] = earlier._replace(messages=earlier.messages + count)
        elif schema is not None:
            text = schema.data.decode("utf-8", "replace")
            topics[channel.topic] = Channel(channel.topic, to_ros2_name(schema.name), count, text)
        else:
            topics[channel.topic] = Channel(channel.topic, "no schema", count, "")
    return Contents(tuple(topics.values()), start)


def _scan_mcap(reader: Any) -> tuple[dict[int, int], int, dict[int, Any], list[Any]]:
    """Contents of an MCAP file without a summary, up to the place where it is damaged."""
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
    """A function that decodes the messages of an MCAP channel."""
    if schema is None or (channel.message_encoding, schema.encoding) not in (
        ("cdr", "ros2msg"),
        ("cdr", "ros2idl"),
        ("ros1", "ros1msg"),
    ):
        kind = f"{channel.message_encoding}/{schema.encoding if schema else 'no schema'}"
        raise ValueError(f"{channel.topic} is encoded as {kind}: only ROS messages are read")
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
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        for connection, stamp, data in reader.messages(wanted):
            yield Message(stamp, reader.deserialize(data, connection.msgtype))
