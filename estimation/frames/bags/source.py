"""Frames from a topic of markers in a bag, one after the other."""

from collections.abc import Iterator
from contextlib import closing
from itertools import takewhile
from pathlib import Path

import numpy as np

from contactmodel.common.inputs import naming
from estimation.frames.bags.messages import (
    PlainMessages,
    WholeMessages,
    read_points,
    read_tac3d_frame,
)
from estimation.frames.bags.topics import Stamped, find_topic, read_topic
from estimation.frames.inspection import LiveInspector
from estimation.frames.names import name_recordings
from estimation.frames.recording import Frame, MarkerLayout


def _open_messages(
    kind: str, messages: Iterator[Stamped], unloaded: int | None
) -> PlainMessages | WholeMessages:
    """Make the reader that converts messages of a kind to frames."""
    if kind == "frames":
        return WholeMessages(messages)
    read = {"Tac3D frames": read_tac3d_frame, "points": read_points}[kind]
    return PlainMessages(read, messages, unloaded)


class BagSource:
    """The frames of a topic of markers, with one message in memory at a time.

    A message that cannot be used becomes a frame whose flaw gives the reason. If the bag is
    damaged, the flaw of the last frame describes the damage.

    Attributes:
        name: short name.
        source: path of the topic, as text.
        warnings: assumptions about the messages, in sentences.
        live: false: a bag is complete.
        provisional: false: the reference is final.

    Examples:
        >>> from contextlib import closing
        >>> from pathlib import Path
        >>> from estimation import BagSource, Settings, Stream, simulate_pivot
        >>> from estimation.output.sinks.bag import BagWriter  # the sink of `run --sink mcap`
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> with closing(BagWriter(Path("lift.mcap"), recording, "tracked")) as bag:
        ...     _ = list(Stream(recording, Settings()).answers(bag))
        >>> source = BagSource(Path("lift.mcap"))
        >>> print(source.name, sum(1 for frame in source), "frames")
        lift 43 frames
    """

    live, provisional = False, False

    def __init__(
        self, place: str | Path, *, name: str = "", unloaded: int | None = None, skip: int = 0
    ) -> None:
        """Find the markers at rest.

        Args:
            place: a bag with one topic of markers, or the topic in a bag.
            name: short name; taken from the place by default.
            unloaded: number of the unloaded message, if the messages have no displacements.
            skip: number of frames that are skipped at the start.

        Raises:
            ValueError: there is no such topic, the bag is damaged, or its messages show no markers.
            OSError: the bag cannot be read.
        """
        place = Path(place)
        self.name = name or name_recordings([place])[0]
        self.source, self.warnings = str(place), ()
        self._place, self._skip = place, skip
        bag, self._topic = find_topic(place)
        with naming(bag), closing(read_topic(place)) as messages:
            sound = takewhile(lambda message: not message.damage, messages)
            self._markers = _open_messages(self._topic.kind, sound, unloaded)
        self._inspector = LiveInspector()

    @property
    def layout(self) -> MarkerLayout:
        """The markers at rest."""
        return self._markers.layout

    @property
    def unit(self) -> str:
        """Unit of lengths, mm or px."""
        return self._markers.unit

    @property
    def convention(self) -> str:
        """Directions of the axes."""
        return self._markers.convention

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers, in sentences, up to the last frame."""
        return (*self._markers.notes, *self._inspector.notes())

    def __len__(self) -> int:
        """Number of messages, as far as the bag lists it."""
        return self._topic.channel.messages

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order."""
        self._inspector = LiveInspector()
        with closing(read_topic(self._place)) as messages:
            for message in messages:
                frame = self._inspector.inspect(self._frame(message), self.layout.reference)
                if message.number >= self._skip:
                    yield frame

    def _frame(self, message: Stamped) -> Frame:
        flaw = message.damage
        if not flaw:
            try:
                return self._markers.frame(message)
            except ValueError as error:
                flaw = f"the message cannot be used: {error}"
        none = np.full(self.layout.reference.shape, np.nan)
        return Frame(none, message.time, message.number, flaw=flaw)
