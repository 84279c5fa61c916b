"""Topics of tactile sensors in a bag: listing them, and choosing one."""

from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from estimation.frames.bags.bag import Channel, describe_bag, read_messages, split_place
from estimation.frames.bags.types import MessageType


class Stamped(NamedTuple):
    """A message of a topic."""

    # the message, with its fields as attributes; None if the bag is damaged from here on
    content: Any
    time: float  # of the message, from the start of the bag [s]
    number: int  # of the message, counted from 0
    damage: str = ""  # why there are no more messages; empty if there is no damage


class Topic(NamedTuple):
    """The messages of a topic, or one field of these messages."""

    name: str  # of the topic; with the name of the field if each message is of two fingers
    kind: str  # frames, Tac3D frames, points or pictures; empty if the sensor is not tactile
    channel: Channel  # of the messages
    field: str = ""  # name of the field that is read; empty for the whole message

    def describe(self) -> str:
        """Name, type and number of the messages, in one line."""
        kind = self.kind or "not tactile"
        return f"{self.name}: {kind} ({self.channel.type}, {self.channel.messages} messages)"


def list_topics(bag: Path) -> list[Topic]:
    """List the topics of a bag, sorted by name.

    Raises:
        ImportError: the extra `bags` is not installed.
        ValueError: the path is not a bag, or the bag is damaged.
        OSError: the bag cannot be read.
    """
    topics = []
    for channel in sorted(describe_bag(bag).channels):
        name = channel.topic.rstrip("/")
        if channel.type.endswith("/TactileMsg") and _has_tac3d(channel):
            topics += [
                Topic(f"{name}/{side}", "Tac3D frames", channel, side) for side in ("left", "right")
            ]
        else:
            topics.append(Topic(name, _kind_of(channel), channel))
    return topics


def find_topic(place: Path) -> tuple[Path, Topic]:
    """Find the bag and the topic of a place: a bag with one topic of its kind, or a bag's topic.

    Raises:
        ValueError: the bag is damaged, has no such topic, or has no or several topics of a tactile
            sensor.
        OSError: there is no bag, or it cannot be read.
    """
    # if no topic is named, the first kind of topics that the bag has is read
    read_kinds = ("frames", "Tac3D frames", "points", "pictures")
    readable = "Tac3D frames, PointCloud2 of markers, Image, CompressedImage"
    readable += " or what `run --sink mcap` writes"
    split = split_place(place)
    if split is None:
        raise FileNotFoundError(f"{place} does not exist, and is not a topic in a bag")
    bag, name = split
    topics = list_topics(bag)
    held = "; ".join(topic.describe() for topic in topics)
    if name:
        for topic in topics:
            if topic.name.strip("/") == name:
                if topic.kind:
                    return bag, topic
                raise ValueError(
                    f"{bag}: {topic.describe()}: a topic of {readable} is expected; it holds {held}"
                    + _explain(topics)
                )
        raise ValueError(f"{bag} has no topic {name}; it holds {held}")
    kinds = [topic.kind for topic in topics]
    first = next((kind for kind in read_kinds if kind in kinds), None)
    if first is None:
        raise ValueError(f"{bag} has no topic of {readable}; it holds {held}{_explain(topics)}")
    candidates = [topic for topic in topics if topic.kind == first]
    if len(candidates) > 1:
        names = ", ".join(topic.name for topic in candidates)
        raise ValueError(
            f"{bag} has {len(candidates)} topics of {first}: name one (--topic): {names}"
        )
    return bag, candidates[0]


def holds_pictures(place: Path) -> bool:
    """Whether the topic at a place in a bag holds pictures; arguments as for `find_topic`."""
    return split_place(place) is not None and find_topic(place)[1].kind == "pictures"


def read_topic(place: Path) -> Generator[Stamped, None, None]:
    """Read the messages of a topic in order; arguments as for `find_topic`.

    Their times are from their headers. If a header has no time, or one that is a minute or more
    from the recording's and so of another clock, the time of recording is used.
    """
    bag, topic = find_topic(place)
    start, longest = describe_bag(bag).start, 60 * 10**9
    with closing(read_messages(bag, topic.channel)) as messages:
        for number, (recorded, content, damage) in enumerate(messages):
            if content is None:
                yield Stamped(None, float("nan"), number, damage)
                continue
            stamp = getattr(getattr(content, "header", None), "stamp", None)
            taken = recorded if stamp is None else stamp.sec * 10**9 + stamp.nanosec
            time = (taken if abs(taken - recorded) < longest else recorded) - start
            if topic.field:
                content = getattr(content, topic.field)
            yield Stamped(content, 1e-9 * time, number)


def _explain(topics: list[Topic]) -> str:
    """Why messages of a known sensor are not read; empty for other topics."""
    if any("papillarray" in topic.channel.type.lower() for topic in topics):
        return (
            ". The nine pillars of a PapillArray are too few: rotation is read from a field of dots"
        )
    return ""


def _kind_of(channel: Channel) -> str:
    kinds = {
        MessageType.FRAME: "frames",
        MessageType.POINTS: "points",
        "sensor_msgs/msg/Image": "pictures",
        MessageType.PICTURE: "pictures",
    }
    if channel.type.endswith("/Frame") and _has_tac3d(channel):
        return "Tac3D frames"
    return kinds.get(channel.type, "")


def _has_tac3d(channel: Channel) -> bool:
    """Whether messages are of the Tac3D nodes, by their definition; true without one."""
    return "Displacements" in (channel.definition or "Displacements")
