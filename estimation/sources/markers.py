"""What readers of markers have in common, whatever the markers look like.

A reader is made from the first usable picture and then turns each picture into a `Row`. Kinds of
markers are listed in `READERS` of `estimation.sources.images`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.recording import MarkerLayout
from estimation.sources.pictures import Picture


@dataclass(frozen=True)
class ImageSettings:
    """What is known of a sensor's pictures; what is not said is found out.

    Attributes:
        mm_per_px: scale [mm/px]; without it lengths stay in px.
        radius: of the dots [px].
        dark: whether they are darker than what is around them.
        unloaded: number of an unloaded frame, to be the reference.
        marker: kind of markers, one of `READERS`.

    Raises:
        ValueError: a length that is not above 0.
    """

    mm_per_px: float | None = None
    radius: float | None = None
    dark: bool | None = None
    unloaded: int | None = None
    marker: str | None = None

    def __post_init__(self) -> None:
        """Check the lengths."""
        for name, value in (("the scale", self.mm_per_px), ("the dots' radius", self.radius)):
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{name} is {value}; it must be a number above 0")

    @property
    def scale(self) -> float:
        """mm/px, or 1 where lengths stay in px."""
        return 1.0 if self.mm_per_px is None else self.mm_per_px

    @property
    def unit(self) -> str:
        """Of lengths."""
        return "px" if self.mm_per_px is None else "mm"


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
    """

    position: Float[np.ndarray, "m d"]
    contact: Bool[np.ndarray, " m"] | None
    time: float
    number: int
    flaw: str = ""
    imprint: float = float("nan")
    imprint_error: float = float("nan")

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
    """

    layout: MarkerLayout
    scale: float
    unit: str

    @abstractmethod
    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Learn markers and reference from a picture."""

    @abstractmethod
    def read(self, picture: Picture) -> Row:
        """What the next picture gives."""

    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What the report should say of markers and reference, in sentences."""
