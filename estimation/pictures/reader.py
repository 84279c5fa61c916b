"""What readers of markers have in common, whatever the markers look like.

A reader is made from the first usable picture and then turns each picture into a `Row`. Kinds of
markers are listed in `READERS` of `estimation.pictures.reading`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.frames.recording import Frame, MarkerLayout
from estimation.pictures.part import WHOLE, Part
from estimation.pictures.rig import Rig
from estimation.pictures.sensor import Sensor
from estimation.pictures.still import Still
from estimation.pictures.stream import Picture


@dataclass(frozen=True)
class ImageSettings:
    """Properties of a recording's pictures; those not given are detected.

    Attributes:
        sensor: what took them.
        unloaded: the reference: the number of an unloaded frame, as `Recording.source_index` has
            it, by the name of the picture or counted from 0; or a picture of the same sensor that
            nothing touches.
        rig: calibration of both views, where mirrors split the picture.
        rate: pictures per second of a folder without a table of times [1/s].
        part: of each picture that is read; positions are those in the whole picture.

    Raises:
        ValueError: the rate is not above 0, or a part is given of pictures that mirrors split.

    Examples:
        >>> from pathlib import Path
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import ImageSettings, PictureSource, Scene, Sensor, VirtualClip
        >>> from estimation import write_pictures
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0)], steps=[2, 2])
        >>> write_pictures(VirtualClip(Scene(contact=contact, path=path)), Path("clip"))
        >>> settings = ImageSettings(Sensor(mm_per_px=0.06, marker="dots"), unloaded=1)
        >>> source = PictureSource(Path("clip"), settings)
        >>> print(f"{len(source.layout.reference)} markers, lengths in {source.unit}")
        80 markers, lengths in mm
    """

    sensor: Sensor = field(default_factory=Sensor)
    unloaded: int | Still | None = None
    rig: Rig | None = None
    rate: float | None = None
    part: Part = WHOLE

    def __post_init__(self) -> None:
        """Check rate and part."""
        if self.rate is not None and not 0.0 < self.rate < float("inf"):
            raise ValueError(
                f"{self.rate:g} pictures per second (--fps): it must be a number above 0"
            )
        if self.rig is not None and self.part != WHOLE:
            raise ValueError(
                "the calibration of two views (--stereo) applies to whole pictures: leave out "
                "--crop and --mask"
            )

    @property
    def shown(self) -> Sensor:
        """The sensor as the part of the pictures shows it."""
        return self.sensor.of_part(self.part)

    def locate(self, positions: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "views n 2"]:
        """Where markers are in the whole picture, in each view of it [px].

        Args:
            positions: of the markers.

        Raises:
            ValueError: positions in space, and no calibration of the views.
        """
        if self.rig is not None:
            return self.rig.locate(positions)
        if positions.shape[1] == 3:
            raise ValueError(
                "positions in space are drawn only with the views' calibration (--stereo)"
            )
        return self.sensor.to_pixels(positions)[None]

    def content(self) -> dict[str, Any]:
        """Reference and part of the pictures that is read, for a summary."""
        part, unloaded = self.part, self.unloaded
        given = {
            "unloaded": str(unloaded.path) if isinstance(unloaded, Still) else unloaded,
            "crop_px": None if part.crop is None else list(part.crop),
            "mask": None if part.mask is None else str(part.mask.path),
        }
        return {name: value for name, value in given.items() if value is not None}

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
        print_point: as in `Frame`, in the reader's own lengths.
        rotation: of the line features at each marker [rad], None where only positions are known.
        hold: as in `Frame` [-].
    """

    position: Float[np.ndarray, "m d"]
    contact: Bool[np.ndarray, " m"] | None
    time: float
    number: int
    flaw: str = ""
    imprint: float = float("nan")
    imprint_error: float = float("nan")
    print_point: tuple[float, ...] = (float("nan"),) * 7
    rotation: Float[np.ndarray, " m"] | None = None
    hold: tuple[float, float, float] = (float("nan"), float("nan"), float("nan"))

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
        origin: what is added to them before, where a part of the pictures is read.
        unit: of the recording's lengths, mm or px.
        chosen: why this kind of markers is read, where nobody has said so.
        provisional: whether a better reference may still be found; `layout` is another one then.
    """

    layout: MarkerLayout
    scale: float
    unit: str
    origin: Float[np.ndarray, " 2"] = WHOLE.origin
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
        position = row.position.copy()
        position[:, :2] += self.origin
        position *= self.scale
        first, now, spread = np.split(np.array(row.print_point), [2, 4])
        places = self.scale * (np.concatenate([first, now]) + np.tile(self.origin, 2))
        return Frame(
            positions=position,
            time=row.time,
            source_index=row.number,
            flaw=row.flaw,
            contact=row.contact,
            imprint=(row.imprint, row.imprint_error),
            print_point=(*places.tolist(), *(self.scale**2 * spread).tolist()),
            rotation=row.rotation,
            hold=row.hold,
        )

    def judge_again(self, frames: Sequence[Frame]) -> list[Frame]:
        """Frames that were read before the reference was found, judged by it.

        Args:
            frames: in order of time.
        """
        return list(frames)

    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What the report should say of markers and reference, in sentences."""
