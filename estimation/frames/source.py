"""Sources of frames: objects that yield frames one after the other."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from estimation.frames.recording import Frame, MarkerLayout, Recording

MOST_HELD_FRAMES = 2000
"""Largest number of frames that a better reference, found after them, can answer again."""


@runtime_checkable
class Source(Protocol):
    """An object that yields frames one after the other, such as a `Recording`.

    Examples:
        >>> from estimation import Source, simulate_pivot
        >>> class EverySecond:  # of another source's frames
        ...     def __init__(self, source):
        ...         self.all = source
        ...     def __getattr__(self, name):  # layout, name, unit and the others
        ...         return getattr(self.all, name)
        ...     def __iter__(self):
        ...         return (frame for row, frame in enumerate(self.all) if row % 2 == 0)
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> source: Source = EverySecond(recording)
        >>> print(f"{len(list(source))} of {len(recording)} frames, lengths in {source.unit}")
        22 of 43 frames, lengths in mm
    """

    @property
    def live(self) -> bool:
        """Whether frames arrive as they are taken.

        If so, the first answer waits for fewer frames, Ctrl-C ends the run like the end of a
        recording, and a resumed run continues with the next frame that arrives.
        """
        ...

    @property
    def provisional(self) -> bool:
        """Whether a better reference may still be found, which then replaces `layout`."""
        ...

    @property
    def layout(self) -> MarkerLayout:
        """Markers and reference of the last frame; they may change between frames."""
        ...

    @property
    def name(self) -> str:
        """Short name."""
        ...

    @property
    def source(self) -> str:
        """Origin of the frames, such as a path."""
        ...

    @property
    def convention(self) -> str:
        """Directions of the axes."""
        ...

    @property
    def unit(self) -> str:
        """Unit of lengths, mm or px."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers, in sentences, up to the last frame."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Assumptions and doubts, in sentences."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order of time."""
        ...


@dataclass
class FrameStream:
    """A source made from any frames, such as those from a socket or a simulator.

    Attributes:
        layout: markers and reference; it may be replaced while frames arrive.
        frames: in order of time.
        name: short name.
        source: origin of the frames, such as a path.
        convention: directions of the axes.
        unit: of lengths, mm or px.
        notes: remarks for readers, in sentences.
        warnings: assumptions and doubts, in sentences.
        live: whether frames arrive as they are taken, as from a socket; see `Source`.
        provisional: whether a better reference may still be found.

    Examples:
        >>> from estimation import FrameStream, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> def receive():  # frames, as from a socket
        ...     yield from recording
        >>> source = FrameStream(recording.layout, receive(), name="left finger")
        >>> for answer in Stream(source, Settings()).answers():
        ...     if answer.row % 20 == 0:
        ...         print(answer.row, answer.estimates["tracked"].state)
        0 no_contact
        20 stick
        40 incipient
    """

    layout: MarkerLayout
    frames: Iterable[Frame]
    name: str = "stream"
    source: str = ""
    convention: str = "z out of the elastomer towards the object"
    unit: str = "mm"
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    live: bool = False
    provisional: bool = False

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order of time."""
        return iter(self.frames)


def describe_source(source: Source) -> dict[str, Any]:
    """The attributes that describe a source, beside its frames, by name."""
    facts = ("name", "source", "convention", "unit", "notes", "warnings")
    return {name: getattr(source, name) for name in facts}


def record_frames(layout: MarkerLayout, frames: Sequence[Frame], **about: Any) -> Recording:
    """Make a recording of one frame or more; `about` are its `unit`, `name`, `source` …"""
    contact = [frame.contact for frame in frames if frame.contact is not None]
    none = np.zeros(len(layout.reference), dtype=bool)
    others = np.stack([none if frame.others is None else frame.others for frame in frames])
    required = ("positions", "valid", "time", "source_index", "wrench")
    all_of = {name: np.array([getattr(frame, name) for frame in frames]) for name in required}
    force, moment = np.split(all_of.pop("wrench"), 2, axis=1)

    def if_known(name: str, shape: tuple[int, ...] = ()) -> np.ndarray | None:
        unknown, fields = np.full(shape, np.nan), (getattr(frame, name) for frame in frames)
        values = np.array([unknown if value is None else value for value in fields])
        return values if np.isfinite(values).any() else None

    return Recording(
        layout=layout,
        force=force if np.isfinite(force).any() else None,
        moment=moment if np.isfinite(moment).any() else None,
        forces=if_known("forces", layout.reference.shape),
        flaws=tuple(frame.flaw for frame in frames),
        contact=np.stack(contact) if len(contact) == len(frames) else None,
        rotation=if_known("rotation", layout.reference.shape[:1]),
        others=others if others.any() else None,
        pictured=all(frame.pictured for frame in frames),
        **{name: if_known(name) for name in ("imprint", "print_point", "hold")},
        **all_of,
        **about,
    )


def record_source(source: Source, frames: Sequence[Frame]) -> Recording:
    """Make a recording of a source's frames.

    Args:
        source: the source of the frames.
        frames: at least one frame, in order.

    Examples:
        >>> from estimation import FrameStream, record_source, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> source = FrameStream(recording.layout, recording, name="left finger")
        >>> kept = record_source(source, list(source)[:20])
        >>> print(kept.name, kept.positions.shape)
        left finger (20, 400, 3)
    """
    return record_frames(source.layout, frames, **describe_source(source))
