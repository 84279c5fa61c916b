"""The interface of marker readers, common to all marker types.

A reader is made from the first usable picture and turns each picture into a `Row`.
`marker_readers` of `estimation.pictures.reading` lists the marker types.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.spatial import KDTree

from estimation.frames.recording import Frame, Hidden, MarkerLayout
from estimation.pictures.lattice import fit_lattice, index_lattice
from estimation.pictures.part import Part
from estimation.pictures.rig import Rig
from estimation.pictures.sensor import Sensor
from estimation.pictures.still import Still, read_still
from estimation.pictures.stream import Picture, ignored_rate


@dataclass(frozen=True)
class ImageSettings:
    """Properties of a recording's pictures; properties that are not given are detected.

    Attributes:
        sensor: the sensor that took the pictures.
        unloaded: the reference: either the number of an unloaded frame (as in
            `Recording.source_index`: from the picture's name, or counted from 0), or a picture of
            the same sensor with nothing on it, as an array or a file.
        rig: calibration of both views, if mirrors split the picture.
        rate: pictures per second of a folder without a table of times [1/s].
        part: the part of each picture that is read; positions refer to the whole picture.

    Raises:
        ValueError: the rate is not above 0, or both `rig` and `part` are given.

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
    unloaded: int | Still | Path | str | Shaped[np.ndarray, "h w *colour"] | None = None
    rig: Rig | None = None
    rate: float | None = None
    part: Part = Part()

    def __post_init__(self) -> None:
        """Check rate and part, and read the unloaded picture."""
        if isinstance(self.unloaded, np.ndarray):
            object.__setattr__(self, "unloaded", Still(Path("array"), self.unloaded))
        elif isinstance(self.unloaded, (str, Path)):
            still = read_still(Path(self.unloaded), "the unloaded picture")
            object.__setattr__(self, "unloaded", still)
        if self.rate is not None and not 0.0 < self.rate < float("inf"):
            raise ValueError(
                f"got {self.rate:g} pictures per second (--fps): it must be a number above 0"
            )
        if self.rig is not None and self.part != Part():
            raise ValueError(
                "the calibration of two views (--stereo) applies to whole pictures: leave out "
                "--crop and --mask"
            )

    @property
    def unloaded_picture(self) -> Still | None:
        """The picture with nothing on the sensor, if one is given."""
        return self.unloaded if isinstance(self.unloaded, Still) else None

    @property
    def shown(self) -> Sensor:
        """The sensor, with positions counted from the part that is read."""
        return self.sensor.of_part(self.part)

    def locate(self, positions: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "views n 2"]:
        """Positions of markers in the whole picture, for each of its views [px].

        Args:
            positions: of the markers, in the recording's unit.

        Raises:
            ValueError: the positions are in space, and the calibration of the views is missing.
        """
        if self.rig is not None:
            return self.rig.locate(positions)
        if positions.shape[1] == 3:
            raise ValueError(
                "markers in space cannot be drawn: give the calibration of the views (--stereo)"
            )
        return self.sensor.to_pixels(positions)[None]

    def content(self) -> dict[str, Any]:
        """The reference and the part of the pictures that is read, for a summary."""
        part, rest = self.part, self.unloaded_picture
        content = {
            "unloaded": self.unloaded if rest is None else str(rest.path),
            "crop_px": None if part.crop is None else list(part.crop),
            "mask": None if part.mask is None else str(part.mask.path),
        }
        return {name: value for name, value in content.items() if value is not None}

    def describe_unused(self) -> tuple[str, ...]:
        """Remarks on what a recording of marker positions does not use."""
        remarks = () if self.rate is None else (ignored_rate(self.rate, "the recording"),)
        if unused := ", ".join(self.content()):
            remarks += (f"Not used, since the recording is not of pictures: {unused}.",)
        return remarks

    @property
    def scale(self) -> float:
        """Scale of the markers [mm/px], or 1 if lengths stay in px."""
        return self.sensor.scale

    @property
    def unit(self) -> str:
        """Unit of lengths: mm, or px without a scale."""
        return self.sensor.unit


class Row(NamedTuple):
    """Measurements in one picture.

    Attributes:
        position: of the markers, in the reader's own lengths; NaN where not visible.
        contact: the contact region; None if displacements must determine it.
        time: time stamp [s].
        number: the source's frame number.
        flaw: why the picture cannot be used; empty if it can.
        imprint: rotation of the object's print [rad]; NaN where unknown.
        imprint_error: standard error of that rotation [rad].
        print_point: as in `Frame`, in the reader's own lengths.
        rotation: of the line features at each marker [rad]; None if only positions are measured.
        hold: as in `Frame` [-].
        others: as in `Frame`.
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
    others: Bool[np.ndarray, " m"] | None = None

    @classmethod
    def of_none(cls, picture: Picture, shape: tuple[int, int], flaw: str) -> "Row":
        """The row of a picture that cannot be used.

        Args:
            picture: the picture.
            shape: number of markers and of their coordinates.
            flaw: why it cannot be used.
        """
        none = np.zeros(shape[0], dtype=bool)
        return cls(np.full(shape, np.nan), none, picture.time, picture.number, flaw)


class MarkerReader(ABC):
    """Turns pictures of one marker type into marker positions, one picture after the other.

    A reader is made from the first usable picture and the settings. It raises a `ValueError` if
    that picture shows no markers of its type.

    Attributes:
        layout: the markers at rest.
        scale: factor from the rows' lengths to the recording's unit.
        part: of the pictures that is read.
        origin: position of the part in the whole picture, added before scaling [px].
        unit: of the recording's lengths, mm or px.
        chosen: note on the detected marker type; empty if the type was set.
        provisional: whether a better reference may still be found, which then replaces `layout`.
        outdated: whether earlier pictures should be read again (`take_over`).
    """

    layout: MarkerLayout
    scale: float
    unit: str
    part: Part = Part()
    origin: Float[np.ndarray, " 2"] = Part().origin
    chosen: str = ""
    provisional: bool = False
    outdated: bool = False
    _last: tuple[Shaped[np.ndarray, "h w *colour"] | None, Row | None] = None, None

    @abstractmethod
    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Detect the markers in a picture and make the reference."""

    @abstractmethod
    def read(self, picture: Picture) -> Row:
        """Measure the markers in the next picture."""

    def take(self, picture: Picture) -> Frame:
        """The frame of the next picture.

        A source that is polled faster than it takes pictures gives them several times. Such a
        repeat is not measured, as it would count as an object at rest.
        """
        image, row = self._last
        if row is None or picture.flaw or not _equal(picture.image, image):
            row = self.read(picture)
            # copied, since a loop of one's own may take each picture into the same array
            self._last = None if picture.image is None else picture.image.copy(), row
        return self.frame(row._replace(time=picture.time, number=picture.number))

    def frame(self, row: Row) -> Frame:
        """Convert a row of this reader to a `Frame`, as `Tracker.update` takes it."""
        position, flaw = row.position.copy(), row.flaw
        if not flaw and row.contact is not None and self.part.hides(position[row.contact, :2]):
            flaw = Hidden.MASKED
        position[:, :2] += self.origin
        position *= self.scale
        first, now, spread = np.split(np.array(row.print_point), [2, 4])
        places = self.scale * (np.concatenate([first, now]) + np.tile(self.origin, 2))
        return Frame(
            positions=position,
            time=row.time,
            source_index=row.number,
            flaw=flaw,
            contact=row.contact,
            imprint=(row.imprint, row.imprint_error),
            print_point=(*places.tolist(), *(self.scale**2 * spread).tolist()),
            rotation=row.rotation,
            hold=row.hold,
            others=row.others,
            pictured=row.contact is not None,
        )

    def take_over(self, other: "MarkerReader") -> None:
        """Take over what an outdated reader of the same pictures has learnt about them."""
        self.chosen = other.chosen

    def reevaluate(self, frames: Sequence[Frame]) -> list[Frame]:
        """Correct frames that were read before the reference was found.

        Args:
            frames: in order of time.

        Returns:
            The frames, measured from the present reference.
        """
        return list(frames)

    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Remarks on markers and reference for the report, in sentences."""


def _equal(one: Shaped[np.ndarray, "..."] | None, other: Shaped[np.ndarray, "..."] | None) -> bool:
    """Whether two pictures exist and are the same to the last digit."""
    return one is not None and other is not None and np.array_equal(one, other)


def doubt_reference(reader: MarkerReader, row: Row, still: Still) -> tuple[str, ...]:
    """A warning if nearly all markers have moved from their place in the unloaded picture."""
    # share of the markers that should rest (the least moved), and their distance from the unloaded
    # picture's markers above which the picture is doubted [pitches]
    resting, doubtful = 0.1, 0.1
    rest = reader.layout.reference
    moved = np.linalg.norm(reader.frame(row).positions - rest, axis=1)
    moved, pitch = moved[np.isfinite(moved)], float(np.median(KDTree(rest).query(rest, 2)[0][:, 1]))
    least = float(np.quantile(moved, resting)) if len(moved) else 0.0
    if least < doubtful * pitch:
        return ()
    return (
        f"{1.0 - resting:.0%} of the markers in the first frame lie {least:.3g} {reader.unit} or "
        f"more from their place in the unloaded picture {still.path}: is it of the same sensor, "
        "with the camera at the same place?",
    )


def doubt_shape(reader: MarkerReader) -> tuple[str, ...]:
    """A warning if the markers at rest form rectangles: the pictures may be stretched.

    A picture of 4:3 that is stored as 16:9 is one, as is one that the camera takes at an angle.
    """
    # ratio of the sides from which the pictures are doubted [-]: published gels have 1.00 to 1.06,
    # and up to 1.10 under load; and share of the markers that must lie on a lattice
    doubtful, regular = 1.12, 0.5
    rest = reader.layout.reference[:, :2]
    lattice = index_lattice(rest)
    on = fit_lattice(lattice, rest).on if len(lattice.dot) else np.zeros(0, dtype=bool)
    index = lattice.coordinates[on]
    if len(index) < regular * len(rest) or np.ptp(index, axis=0).min() < 2:
        return ()
    terms = np.column_stack([np.ones(len(index)), index])
    steps = np.linalg.lstsq(terms, rest[lattice.dot[on]], rcond=None)[0][1:]
    short, long = np.sort(np.linalg.norm(steps, axis=1)).tolist()
    if long < doubtful * short:
        return ()
    return (
        f"The markers are {long:.3g} {reader.unit} apart along one direction, and {short:.3g} "
        f"{reader.unit} along the other. If they form squares on the gel, the pictures are "
        f"stretched, and turns are up to {long / short - 1.0:.0%} wrong, which the intervals do "
        "not cover. Give pictures with square pixels.",
    )
