"""Recordings from pictures of markers."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Shaped

from estimation.contact import reaches_edge
from estimation.images.contact import (
    Arrival,
    find_unseen_flaw,
    region_of_dispersion,
    region_of_light,
)
from estimation.images.dots import DotStyle, to_grey
from estimation.images.imprint import LOST, ImprintFollower
from estimation.images.kinds import MARKER_KINDS
from estimation.images.lattice import (
    Reference,
    index_lattice,
    is_regular,
    lay_reference,
    make_reference,
)
from estimation.images.style import find_dots, find_style
from estimation.images.tracking import DotTracker
from estimation.recording import Recording
from estimation.sensor import Sensor
from estimation.sources.corners import CornerReader
from estimation.sources.markers import ImageSettings, MarkerReader, Row
from estimation.sources.names import name_recordings
from estimation.sources.pictures import Picture, describe_pictures, read_pictures
from estimation.sources.speckle import SpeckleReader
from estimation.sources.stereo import StereoReader, find_view_flaw

CONVENTION = (
    "x to the right and y down in the picture, z away from the camera, out of the elastomer: "
    "counter-clockwise about z is clockwise on the screen"
)


RESTING = 5
"""Frames in a row in which the dots must lie regularly, and still, to be at rest."""
RECOGNISED = 0.9
"""Share of a picture's dots that must be among them."""
LARGEST_RADIUS = 25.0
"""Radius of dots beyond which a picture is larger than it need be [px]."""
STILL = 0.02
"""Distance by which dots at rest may move from frame to frame [pitches]."""


class DotReader(MarkerReader):
    """Turns pictures of printed dots, one after the other, into marker positions.

    Where a clip starts loaded the reference is guessed; as soon as the gel is seen at rest, that is
    the reference of the whole clip.
    """

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Learn dots and reference from a picture.

        Raises:
            ValueError: there are no dots in rows in it.
        """
        assert first.image is not None
        self.sensor = settings.sensor
        self.style = _style(first.image, self.sensor)
        given = settings.unloaded is not None
        self.rest = first.image if given else None
        self.reference = self._make_reference(first.image, given)
        self.tracker = DotTracker(self.reference)
        self.imprint, self.arrival = ImprintFollower(), Arrival(self.reference)
        self.light = False
        self.lattice = index_lattice(self.reference.position)
        self.guessed = self.reference.doubt is not None
        self.resting, self.before = 0, self.reference.position
        self.scale, self.unit = settings.scale, settings.unit
        self.layout = self.reference.layout(self.scale)

    def read(self, picture: Picture) -> Row:
        """Marker positions, contact and imprint of the next picture."""
        count = len(self.reference.position)
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, (count, 2), picture.flaw or "no picture")
        dots = find_dots(to_grey(picture.image, self.style.dark), self.style)
        straight = self.sensor.straighten(dots.centre)
        match, flaw = self.tracker.update(straight)
        if flaw:
            return Row.of_none(picture, (count, 2), flaw)
        seen = (match >= 0)[:, None]
        position = np.where(seen, straight[match], np.nan)
        in_picture = np.where(seen, dots.centre[match], np.nan)
        if self.guessed:
            most = seen.sum() >= RECOGNISED * len(straight)
            self._look_for_rest(position if most else np.nan * position, picture.number)
        contact = self._contact(picture.image, position, in_picture)
        flaw = self.arrival.find_flaw(contact)
        if flaw or not contact.any():
            self.imprint, turned = ImprintFollower(), LOST
        else:
            turned = self.imprint.update(
                picture.image,
                dots.centre,
                self.style.radius,
                in_picture[contact],
                cut=reaches_edge(self.reference.neighbours, contact),
            )
        return Row(
            position=position,
            contact=contact,
            time=picture.time,
            number=picture.number,
            flaw=flaw or find_unseen_flaw(self.reference.position, contact, seen[:, 0]),
            imprint=turned.angle,
            imprint_error=turned.error,
        )

    def notes(self) -> tuple[str, ...]:
        """What the dots look like, what the reference is, and what tells the contact region."""
        by = "the change of light" if self.light else "the dispersion of the translation field"
        return (
            f"{len(self.reference.position)} {'dark' if self.style.dark else 'bright'} dots of "
            f"radius {self.style.radius:.1f} px, {self.reference.pitch:.1f} px apart.",
            self.reference.note,
            f"The contact region is found by {by}.",
        )

    def _make_reference(
        self, image: Shaped[np.ndarray, "h w *colour"], unloaded: bool
    ) -> Reference:
        """The sensor description's, unless an unloaded picture is at hand."""
        told = self.sensor.reference
        if told is not None and not unloaded:
            return lay_reference(
                told[:, :2] / self.sensor.scale, "The reference is the sensor description's."
            )
        dots = find_dots(to_grey(image, self.style.dark), self.style)
        size = (image.shape[1], image.shape[0])
        return make_reference(self.sensor.straighten(dots.centre), size, unloaded)

    def _look_for_rest(self, position: Float[np.ndarray, "m 2"], number: int) -> None:
        """Take the dots as the reference once they have been regular and still for long enough."""
        moved = np.linalg.norm(position - self.before, axis=1)
        still = np.nanmax(moved, initial=0.0) < STILL * self.reference.pitch
        rests = is_regular(self.lattice, position[self.lattice.dot])
        self.resting = self.resting + 1 if rests and (still or not self.resting) else 0
        self.before = position
        if self.resting < RESTING:
            return
        self.guessed, doubt = False, self.reference.doubt
        known = np.isfinite(position[:, 0])
        self.reference = self.reference._replace(
            position=np.where(known[:, None], position, self.reference.position),
            doubt=doubt if doubt is None else np.where(known, 0.0, doubt),
            note=f"The clip starts loaded: the reference is frame {number}, in which all dots lie "
            "on a regular lattice and have come to rest.",
        )
        self.tracker.reference = self.reference
        self.layout = self.reference.layout(self.scale)

    def _contact(
        self,
        image: Shaped[np.ndarray, "h w *colour"],
        position: Float[np.ndarray, "m 2"],
        in_picture: Float[np.ndarray, "m 2"],
    ) -> Bool[np.ndarray, " m"]:
        """The contact region: by light where an unloaded picture is known and it changes."""
        if self.rest is not None:
            region = region_of_light(self.reference, self.rest, image, in_picture)
            if region.sum() >= 3:
                self.light = True
                return region
        return region_of_dispersion(self.reference, position - self.reference.position)


READERS: dict[str, type[MarkerReader]] = dict(
    zip(MARKER_KINDS, (CornerReader, DotReader, SpeckleReader), strict=True)
)
"""What reads each kind of markers."""


def _style(image: Shaped[np.ndarray, "h w *colour"], sensor: Sensor) -> DotStyle:
    if sensor.radius is not None and sensor.radius > LARGEST_RADIUS:
        raise ValueError(
            f"dots of radius {sensor.radius:g} px are not read; {LARGEST_RADIUS:g} px at most: "
            "scale the pictures down"
        )
    if sensor.radius is not None and sensor.dark is not None:
        return DotStyle(sensor.dark, sensor.radius)
    found = find_style(image, sensor.dark)
    return found if sensor.radius is None else found._replace(radius=sensor.radius)


Watch = Callable[[MarkerReader, Row], None]
"""Is told every row as it comes, and the reader that it comes from."""


def read_images(
    path: Path, settings: ImageSettings | None = None, watch: Watch | None = None
) -> Recording:
    """Read a video, a folder of images or a camera as a recording of markers.

    Without a scale all lengths are in px. What has been read when a source breaks off, or when
    Ctrl-C ends a camera's recording, is kept.

    Args:
        path: as for `read_pictures`.
        settings: what is known of the sensor.
        watch: told what every picture has given before the next is taken.

    Raises:
        ValueError: no pictures, no markers in the first usable one, or a setting that does not fit.
        OSError: the source cannot be opened.
    """
    settings = ImageSettings() if settings is None else settings
    reader = None if settings.unloaded is None else _reader_at(path, settings)
    rows: list[Row] = []
    waiting: list[Picture] = []
    try:
        for picture in _read(path, settings):
            if reader is None and (picture.flaw or picture.image is None):
                waiting.append(picture)
                continue
            if reader is None:
                reader = _make_reader(picture, settings)
            for one in (*waiting, picture):
                rows.append(reader.read(one))
                if watch is not None:
                    watch(reader, rows[-1])
            waiting.clear()
    except KeyboardInterrupt:
        if not rows:
            raise
    if reader is None:
        raise ValueError(
            f"{path} has no usable picture: {waiting[0].flaw if waiting else 'it is empty'}"
        )
    return _to_recording(path, reader, rows, describe_pictures(path, settings.rate))


def _read(path: Path, settings: ImageSettings) -> Iterator[Picture]:
    """The pictures at a path, each view of them inspected where there are two."""
    for picture in read_pictures(path, settings.rate):
        if settings.rig is not None and picture.image is not None and not picture.flaw:
            picture = picture._replace(flaw=find_view_flaw(settings.rig, picture.image))
        yield picture


def _make_reader(first: Picture, settings: ImageSettings) -> MarkerReader:
    """The reader for the kind of markers that was given, or is found."""
    assert first.image is not None
    settings.sensor.expect_size(first.image.shape[1], first.image.shape[0])
    if settings.rig is not None:
        if settings.sensor.marker not in (None, "corners"):
            raise ValueError(f"{settings.sensor.marker} are not read in two views: use corners")
        return StereoReader(first, settings)
    sensor = settings.sensor
    kind = sensor.marker
    if kind is None and (sensor.radius is not None or sensor.dark is not None):
        kind = "dots"  # whose radius or polarity was given
    if kind is None:
        return _find_reader(first, settings)
    return READERS[kind](first, settings)


def _find_reader(first: Picture, settings: ImageSettings) -> MarkerReader:
    """The reader for the first kind of markers that a picture shows."""
    refusals = []
    for kind, reader in READERS.items():
        try:
            found = reader(first, settings)
        except ValueError as error:
            refusals.append(f"{kind}: {error}")
            continue
        found.chosen = f"Nobody said what the markers are; {kind} were found."
        if refusals:
            found.chosen += f" Not found: {'; '.join(refusals)}."
        return found
    raise ValueError(
        "no markers were found in the first usable frame, so that this sensor cannot be read by "
        f"them. {'; '.join(refusals)}. Say what the markers are if they are there (--marker)"
    )


def _reader_at(path: Path, settings: ImageSettings) -> MarkerReader:
    """A reader whose reference is the unloaded frame."""
    numbers = []
    for picture in _read(path, settings):
        numbers.append(picture.number)
        if picture.number == settings.unloaded:
            if picture.flaw:
                raise ValueError(f"the unloaded frame {picture.number}: {picture.flaw}")
            return _make_reader(picture, settings)
    known = f"{numbers[0]} to {numbers[-1]}" if numbers else "none"
    raise ValueError(
        f"{path} has no frame {settings.unloaded}, which should be the unloaded one: its frames "
        f"are {known}"
    )


def _to_recording(
    path: Path, reader: MarkerReader, rows: list[Row], warnings: tuple[str, ...]
) -> Recording:
    position = reader.scale * np.stack([row.position for row in rows])
    contact = [row.contact for row in rows if row.contact is not None]
    imprint = np.array([[row.imprint, row.imprint_error] for row in rows])
    unknown = np.full(position.shape[1], np.nan)
    rotation = [unknown if row.rotation is None else row.rotation for row in rows]
    lengths = ("Lengths are in px: no scale was given.",) if reader.unit == "px" else ()
    return Recording(
        layout=reader.layout,
        positions=position,
        valid=np.isfinite(position[..., 0]),
        time=np.array([row.time for row in rows]),
        source_index=np.array([row.number for row in rows]),
        contact=np.stack(contact) if len(contact) == len(rows) else None,
        imprint=imprint if np.isfinite(imprint).any() else None,
        rotation=np.stack(rotation) if np.isfinite(rotation).any() else None,
        flaws=tuple(row.flaw for row in rows),
        unit=reader.unit,
        name=name_recordings([path])[0],
        source=str(path),
        convention=CONVENTION,
        notes=(*((reader.chosen,) if reader.chosen else ()), *reader.notes(), *lengths),
        warnings=warnings,
    )
