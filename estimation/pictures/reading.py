"""Recordings from pictures of markers."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from estimation.frames.names import name_recordings
from estimation.frames.recording import Recording
from estimation.pictures.corners.reader import CornerReader
from estimation.pictures.dots.reader import DotReader
from estimation.pictures.kinds import MARKER_KINDS
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.speckle.reader import SpeckleReader
from estimation.pictures.stereo import StereoReader, find_view_flaw
from estimation.pictures.stream import Picture, describe_pictures, read_pictures

CONVENTION = (
    "x to the right and y down in the picture, z away from the camera, out of the elastomer: "
    "counter-clockwise about z is clockwise on the screen"
)


READERS: dict[str, type[MarkerReader]] = dict(
    zip(MARKER_KINDS, (CornerReader, DotReader, SpeckleReader), strict=True)
)
"""What reads each kind of markers."""


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
        found.chosen = f"The kind of markers was not given; {kind} were found."
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
