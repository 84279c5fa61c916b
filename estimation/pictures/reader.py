"""What readers of markers have in common, whatever the markers look like.

A reader is made from the first usable picture and then turns each picture into a `Row`. Kinds of
markers are listed in `READERS` of `estimation.pictures.reading`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.frames.recording import Frame, MarkerLayout
from estimation.pictures.rig import Rig
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture


@dataclass(frozen=True)
class ImageSettings:
    """What is known of a recording's pictures; what is not said is found out.

    Attributes:
        sensor: what took them.
        unloaded: number of an unloaded frame, to be the reference: as `Recording.source_index`
            has it, by the name of the picture or counted from 0.
        rig: calibration of both views, where mirrors split the picture.
        rate: pictures per second of a folder without a table of times [1/s].

    Raises:
        ValueError: the rate is not above 0.
    """

    sensor: Sensor = field(default_factory=Sensor)
    unloaded: int | None = None
    rig: Rig | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        """Check the rate."""
        if self.rate is not None and not 0.0 < self.rate < float("inf"):
            raise ValueError(
                f"{self.rate:g} pictures per second (--fps): it must be a number above 0"
            )

    @property
    def scale(self) -> float:
        """mm/px, or 1 where lengths stay in px."""
        return self.sensor.scale

    @property
    def unit(self) -> str:
        """Of lengths."""
        return self.sensor.unit


class Row(NamedTuple):
    """What one picture has given.

    Attributes:
        position: of the markers, in the reader's own lengths; NaN where not seen.
        contact: the contact region, None where the displacements are to tell.
        time: time stamp [s].
        number: the source's.
        flaw: why the picture cannot be used, empty where it can.
        imprint: rotation of what the object prints [rad], NaN where unknown.
        imprint_error: its standard error [rad].
        rotation: of the line features at each marker [rad], None where only positions are known.
    """

    position: Float[np.ndarray, "m d"]
    contact: Bool[np.ndarray, " m"] | None
    time: float
    number: int
    flaw: str = ""
    imprint: float = float("nan")
    imprint_error: float = float("nan")
    rotation: Float[np.ndarray, " m"] | None = None

    @classmethod
    def of_none(cls, picture: Picture, shape: tuple[int, int], flaw: str) -> "Row":
        """Of a picture that cannot be used."""
        none = np.zeros(shape[0], dtype=bool)
        return cls(np.full(shape, np.nan), none, picture.time, picture.number, flaw)


class MarkerReader(ABC):
    """Turns pictures of one kind of markers, one after the other, into marker positions.

    It is made from the first usable picture and the settings, and raises a `ValueError` where that
    shows no markers of its kind.

    Attributes:
        layout: the markers at rest.
        scale: what its rows' positions are multiplied by to be in the recording's unit.
        unit: of the recording's lengths, mm or px.
        chosen: why this kind of markers is read, where nobody has said so.
        provisional: whether a better reference may still be found; `layout` is another one then.
    """

    layout: MarkerLayout
    scale: float
    unit: str
    chosen: str = ""
    provisional: bool = False

    @abstractmethod
    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Learn markers and reference from a picture."""

    @abstractmethod
    def read(self, picture: Picture) -> Row:
        """What the next picture gives."""

    def frame(self, row: Row) -> Frame:
        """A row of this reader's as `Tracker.update` takes it."""
        position = self.scale * row.position
        return Frame(
            positions=position,
            valid=np.isfinite(position[:, 0]),
            time=row.time,
            source_index=row.number,
            flaw=row.flaw,
            contact=row.contact,
            imprint=(row.imprint, row.imprint_error),
            rotation=row.rotation,
        )

    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What the report should say of markers and reference, in sentences."""
