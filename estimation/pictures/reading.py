"""Recordings of markers from pictures."""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.common.inputs import naming
from estimation.frames.inspection import LiveInspector
from estimation.frames.names import name_recordings
from estimation.frames.recording import Frame, MarkerLayout, Recording
from estimation.frames.source import record_source
from estimation.pictures.reader import ImageSettings, MarkerReader, doubt_reference, doubt_shape
from estimation.pictures.sensor import MARKER_KINDS
from estimation.pictures.still import Album, Shown, Still, kind_of
from estimation.pictures.stream import (
    Picture,
    count_pictures,
    describe_pictures,
    is_camera,
    read_pictures,
    take_part,
)


@cache
def marker_readers() -> dict[str, type[MarkerReader]]:
    """The reader of each marker type; runs without pictures do not import them."""
    from estimation.pictures.corners.reader import CornerReader
    from estimation.pictures.dots.reader import DotReader
    from estimation.pictures.speckle.reader import SpeckleReader

    return dict(zip(MARKER_KINDS, (CornerReader, DotReader, SpeckleReader), strict=True))


class PictureState(NamedTuple):
    """State of a picture source: the reader of its markers, and the inspector of its frames."""

    reader: MarkerReader
    inspector: LiveInspector


class PictureSource:
    """The frames of a video, a folder of images, a bag or a camera, one after the other.

    Without a scale, all lengths are in px. A source that breaks off ends without an error.

    Attributes:
        path: of the pictures.
        reader: of the markers; it holds the state of the tracking.
        name: short name.
        source: path of the pictures, as text.
        convention: directions of the axes.
        warnings: assumptions and doubts about the pictures, in sentences.
        live: whether pictures arrive as they are taken.

    Examples:
        >>> from pathlib import Path
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import PictureSource, Scene, VirtualClip, write_pictures
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0)], steps=[2, 2])
        >>> write_pictures(VirtualClip(Scene(contact=contact, path=path)), Path("clip"))
        >>> source = PictureSource(Path("clip"))
        >>> for frame in source:
        ...     pass  # its markers are found and followed
        >>> print(f"{frame.valid.sum()} of {len(frame.valid)} markers followed, in {source.unit}")
        80 of 80 markers followed, in px
    """

    convention = (
        "x to the right and y down in the picture, z away from the camera, out of the elastomer: "
        "counter-clockwise about z is clockwise on the screen"
    )

    def __init__(
        self,
        path: str | Path,
        settings: ImageSettings | None = None,
        *,
        name: str = "",
        state: PictureState | None = None,
        skip: int = 0,
        after: tuple[float, int] = (0.0, 0),
        feed: Callable[[Iterator[Picture]], Iterator[Picture]] | None = None,
    ) -> None:
        """Open a source, and detect markers and reference in the first usable picture.

        Args:
            path: as for `read_pictures`.
            settings: known properties of the pictures.
            name: short name; taken from the path by default.
            state: of an earlier source of the same pictures, to resume from.
            skip: number of pictures that the earlier source has read.
            after: time stamp [s] and number of the first picture, if a camera's recording resumes.
            feed: passes pictures on as they arrive, for example from another thread; the source is
                then live.

        Raises:
            ValueError: there are no pictures, the first usable one shows no markers, or a setting
                does not fit the pictures.
            OSError: the source cannot be opened.
        """
        path, settings = Path(path), ImageSettings() if settings is None else settings
        self.path, self.live = path, feed is not None or is_camera(path)
        self.name = name or name_recordings([path])[0]
        self.source = str(path)
        self.warnings = describe_pictures(path, settings.rate)
        reader = None if state is None else state.reader
        self._settings, self._skip = settings, skip
        self._album = Album()
        self._again: list[Frame] = []  # frames that were read again
        self._shown: dict[int, Shown] | None = None
        self._taken: Iterator[Picture] | None = None
        if self.live:
            pictures = _count_on(_read(path, settings), *after)
            self._taken = pictures if feed is None else feed(pictures)
        self._waiting: list[Picture] = []
        if settings.unloaded_picture is not None and reader is None:
            reader = self._reader_of(settings.unloaded_picture, settings)
        elif settings.unloaded is not None and reader is None:
            reader = _reader_at(path, settings)
        self.reader = reader or self._find_reader(settings)
        self.warnings += doubt_shape(self.reader)
        if self._taken is None:
            self._waiting = []  # these pictures are read again
        self._inspector = LiveInspector() if state is None else state.inspector
        self._count = count_pictures(path)

    def _find_reader(self, settings: ImageSettings) -> MarkerReader:
        """The reader for the markers in the first usable picture."""
        for picture in self._taken or _read(self.path, settings):
            self._waiting.append(picture)
            if picture.image is not None and not picture.flaw:
                return make_reader(picture, settings)
        raise self._unusable()

    def _unusable(self) -> ValueError:
        flaw = self._waiting[0].flaw if self._waiting else "it is empty"
        return ValueError(f"{self.path} has no usable picture: {flaw}")

    def _reader_of(self, still: Still, settings: ImageSettings) -> MarkerReader:
        """The reader whose reference is a separate unloaded picture of the same sensor."""
        # number of a camera's pictures in which the unloaded picture's markers are searched
        live_tries = 25
        reader, flaws, size = None, [], (still.image.shape[1], still.image.shape[0])
        for picture in self._taken or _read(self.path, settings):
            self._waiting.append(picture)
            if picture.image is None or picture.flaw:
                continue
            if picture.size != size or picture.image.ndim != still.image.ndim:
                raise ValueError(
                    f"the unloaded picture {still.path} is {size[0]}×{size[1]}, "
                    f"{kind_of(still.image)}; those of {self.path} are {picture.size[0]}×"
                    f"{picture.size[1]}, {kind_of(picture.image)}: give one like them (--unloaded)"
                )
            if reader is None:
                rest = take_part(Picture(still.image, np.nan, -1), settings.part)
                if rest.flaw:
                    raise ValueError(f"the unloaded picture {still.path}: {rest.flaw}")
                with naming(still.path):
                    reader = make_reader(rest, settings)
            row = deepcopy(reader).read(picture)
            if np.isfinite(row.position).any():
                self.warnings += doubt_reference(reader, row, still)
                return reader
            flaws.append(row.flaw)
            if self.live and len(flaws) == live_tries:
                break
        if reader is None:
            raise self._unusable()
        raise ValueError(
            f"the markers of the unloaded picture {still.path} are not those of {self.path}: "
            f"{flaws[0]} in its first usable frame, and none of its {len(flaws)} frames matches; "
            "give a picture of the same sensor with nothing on it (--unloaded)"
        )

    @property
    def layout(self) -> MarkerLayout:
        """The markers at rest, by the present reference."""
        return self.reader.layout

    @property
    def provisional(self) -> bool:
        """Whether a better reference may still be found."""
        return self.reader.provisional

    @property
    def unit(self) -> str:
        """Unit of lengths, mm or px."""
        return self.reader.unit

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the markers for the report, up to the last frame."""
        chosen = (self.reader.chosen,) if self.reader.chosen else ()
        lengths = ("Lengths are in px: no scale was given.",) if self.unit == "px" else ()
        part = (self._settings.part.note,) if self._settings.part.note else ()
        return (*part, *chosen, *self.reader.notes(), *lengths, *self._inspector.notes())

    @property
    def state(self) -> PictureState:
        """The state after the last frame, from which another source can resume."""
        return PictureState(self.reader, self._inspector)

    def reevaluate(self, frames: Sequence[Frame]) -> list[Frame]:
        """Correct frames that were read before the reference was found.

        Args:
            frames: in order of time.

        Returns:
            The frames, measured from the present reference.
        """
        return self.reader.reevaluate([*self._again, *frames[len(self._again) :]][: len(frames)])

    def find_copy(
        self, frame: Frame
    ) -> tuple[bytes, Float[np.ndarray, "views n 2"]] | tuple[None, None]:
        """A small JPEG copy of a frame's picture and its markers' positions in the copy [px].

        At most 256 copies are stored, evenly spread over the frames. Without a copy, both are None.
        """
        copy = self._album.find(frame.source_index)
        if copy is None:
            return None, None
        return copy.jpeg, copy.place(self.locate(frame.positions))

    def locate(self, positions: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "views n 2"]:
        """Positions of markers in the part of the pictures that is read, for each view [px].

        Args:
            positions: of the markers, in the recording's unit.
        """
        return self._settings.locate(positions) - self._settings.part.origin

    def keep_pictures(self) -> None:
        """Store every picture for `find_picture` until its frame has been answered."""
        self._shown = {}

    def find_picture(self, frame: Frame) -> Shown | None:
        """The picture of a frame; None if it is not stored.

        Pictures of earlier frames are deleted.
        """
        shown = self._shown or {}
        for number in [number for number in shown if number < frame.source_index]:
            del shown[number]
        return shown.get(frame.source_index)

    def __len__(self) -> int:
        """Number of pictures; 0 if it is unknown before they are read, as for a camera."""
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order. A source can be iterated only once, as its reader has a state."""
        if self._taken is not None:
            pictures = chain(self._waiting, self._taken)
        else:
            pictures = islice(_read(self.path, self._settings), self._skip, None)
        self._waiting = []
        for row, picture in enumerate(pictures, self._skip):
            if picture.image is not None:
                self._album.take(row, picture.number, picture.image)
                if self._shown is not None:
                    self._shown[picture.number] = Shown(picture.image)
            frame = self._inspect(picture)
            if self.reader.outdated and not self.live:
                *self._again, frame = self._read_again(row + 1)
            yield frame

    def _inspect(self, picture: Picture) -> Frame:
        """The frame of the next picture."""
        frame = self.reader.take(picture)
        return self._inspector.inspect(frame, self.layout.reference)

    def _read_again(self, count: int) -> list[Frame]:
        """Read the first pictures again, with what their reader has learnt about them."""
        outdated, self._inspector = self.reader, LiveInspector()
        self.reader = self._find_reader(self._settings)
        self._waiting = []
        self.reader.take_over(outdated)
        return [
            self._inspect(picture) for picture in islice(_read(self.path, self._settings), count)
        ]


def read_images(path: str | Path, settings: ImageSettings | None = None) -> Recording:
    """Read a video, a folder of images, a bag or a camera as a recording of markers.

    Ctrl-C ends a camera's recording; the frames read so far are returned.

    Args:
        path: as for `read_pictures`.
        settings: known properties of the pictures.

    Raises:
        ValueError: there are no pictures, the first usable one shows no markers, or a setting does
            not fit the pictures.
        OSError: the source cannot be opened.
    """
    source, frames = PictureSource(path, settings), list[Frame]()
    layout = source.layout
    try:
        for frame in source:
            frames.append(frame)
    except KeyboardInterrupt:
        if not (frames and source.live):
            raise
    if source.layout is not layout:
        frames = source.reevaluate(frames)
    return record_source(source, frames)


def _read(path: Path, settings: ImageSettings) -> Iterator[Picture]:
    """The pictures at a path; with two views, each view is inspected."""
    for picture in read_pictures(path, settings.rate, settings.part):
        if settings.rig is not None and picture.image is not None and not picture.flaw:
            from estimation.pictures.stereo import find_view_flaw

            picture = picture._replace(flaw=find_view_flaw(settings.rig, picture.image))
        yield picture


def _count_on(pictures: Iterator[Picture], time: float, number: int) -> Iterator[Picture]:
    """Pictures whose times and numbers are shifted by a time stamp [s] and a number."""
    for picture in pictures:
        yield picture._replace(time=picture.time + time, number=picture.number + number)


def make_reader(first: Picture, settings: ImageSettings) -> MarkerReader:
    """Make the reader for the marker type that is set, or else detected.

    Args:
        first: a usable picture.
        settings: known properties of the pictures.

    Raises:
        ValueError: the picture shows no such markers, or a setting does not fit the picture.
    """
    assert first.image is not None
    sensor, kind = settings.sensor, settings.sensor.marker
    sensor.expect_size(*first.size)
    if settings.rig is not None:
        if kind not in (None, "corners"):
            raise ValueError(
                f"with two views (--stereo) only corners are read, not {kind}: set --marker corners"
            )
        from estimation.pictures.stereo import StereoReader

        return StereoReader(first, settings)
    if kind is None and (sensor.radius is not None or sensor.dark is not None):
        kind = "dots"  # only dots have a radius and a polarity
    return marker_readers()[kind](first, settings) if kind else _find_reader(first, settings)


def _find_reader(first: Picture, settings: ImageSettings) -> MarkerReader:
    """The reader for the first marker type that is detected in a picture."""
    refusals = []
    for kind, reader in marker_readers().items():
        try:
            made = reader(first, settings)
        except ValueError as error:
            refusals.append(f"{kind}: {error}")
            continue
        made.chosen = f"Marker type detected: {kind} (set --marker to choose)."
        if refusals:
            made.chosen += f" Not detected: {'; '.join(refusals)}."
        return made
    raise ValueError(
        "no markers were detected in the first usable frame. "
        f"{'; '.join(refusals)}. If there are markers, set their type (--marker). If the gel comes "
        "into view later, cut the clip there, or name a frame of the empty gel (--unloaded-frame)"
    )


def _reader_at(path: Path, settings: ImageSettings) -> MarkerReader:
    """A reader whose reference is the unloaded frame."""
    numbers = []
    for picture in _read(path, settings):
        numbers.append(picture.number)
        if picture.number == settings.unloaded:
            if picture.flaw:
                raise ValueError(f"the unloaded frame {picture.number}: {picture.flaw}")
            return make_reader(picture, settings)
    frames = f"its frames are {numbers[0]} to {numbers[-1]}" if numbers else "it has no frames"
    raise ValueError(
        f"{path} has no frame {settings.unloaded} to take as unloaded (--unloaded-frame): {frames}"
    )
