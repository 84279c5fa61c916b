"""Recordings from pictures of printed dots."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped

from estimation.images.contact import region_of_dispersion, region_of_light
from estimation.images.dots import Dots, DotStyle, to_grey
from estimation.images.imprint import ImprintFollower
from estimation.images.lattice import Reference, make_reference
from estimation.images.style import find_dots, find_style
from estimation.images.tracking import DotTracker
from estimation.recording import Recording
from estimation.sources.pictures import Picture, read_pictures

CONVENTION = (
    "x to the right and y down in the picture, z away from the camera, out of the elastomer: "
    "counter-clockwise about z is clockwise on the screen"
)


@dataclass(frozen=True)
class ImageSettings:
    """What is known of a sensor's pictures; what is not said is found out.

    Attributes:
        mm_per_px: scale [mm/px]; without it lengths stay in px.
        radius: of the dots [px].
        dark: whether they are darker than what is around them.
        unloaded: number of an unloaded frame, to be the reference.

    Raises:
        ValueError: a length that is not above 0.
    """

    mm_per_px: float | None = None
    radius: float | None = None
    dark: bool | None = None
    unloaded: int | None = None

    def __post_init__(self) -> None:
        """Check the lengths."""
        for name, value in (("the scale", self.mm_per_px), ("the dots' radius", self.radius)):
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{name} is {value}; it must be a number above 0")

    @property
    def scale(self) -> float:
        """mm/px, or 1 where lengths stay in px."""
        return 1.0 if self.mm_per_px is None else self.mm_per_px


class _Row(NamedTuple):
    """What one picture has given; lengths in px."""

    position: Float[np.ndarray, "m 2"]
    contact: Bool[np.ndarray, " m"]
    time: float
    number: int
    imprint: float
    imprint_error: float
    flaw: str


class DotReader:
    """Turns pictures of dots, one after the other, into marker positions."""

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Learn dots and reference from a picture.

        Raises:
            ValueError: there are no dots in rows in it.
        """
        assert first.image is not None
        self.style = _style(first.image, settings)
        dots = find_dots(to_grey(first.image, self.style.dark), self.style)
        given = settings.unloaded is not None
        height, width = first.image.shape[:2]
        self.reference: Reference = make_reference(dots.centre, (width, height), unloaded=given)
        self.rest = first.image if given else None
        self.tracker = DotTracker(self.reference)
        self.imprint = ImprintFollower()
        self.light = False

    def read(self, picture: Picture) -> tuple[_Row, Dots | None]:
        """Marker positions, contact and imprint of the next picture, and the dots found in it."""
        count = len(self.reference.position)
        nothing = _Row(
            np.full((count, 2), np.nan),
            np.zeros(count, dtype=bool),
            picture.time,
            picture.number,
            np.nan,
            np.nan,
            picture.flaw,
        )
        if picture.flaw or picture.image is None:
            return nothing._replace(flaw=picture.flaw or "no picture"), None
        dots = find_dots(to_grey(picture.image, self.style.dark), self.style)
        match, flaw = self.tracker.update(dots.centre)
        if flaw:
            return nothing._replace(flaw=flaw), dots
        position = np.where((match >= 0)[:, None], dots.centre[match], np.nan)
        contact = self._contact(picture.image, position)
        turned = self.imprint.update(
            picture.image, dots.centre, self.style.radius, position[contact]
        )
        row = nothing._replace(
            position=position, contact=contact, imprint=turned.angle, imprint_error=turned.error
        )
        return row, dots

    def _contact(
        self, image: Shaped[np.ndarray, "h w *colour"], position: Float[np.ndarray, "m 2"]
    ) -> Bool[np.ndarray, " m"]:
        """The contact region: by light where an unloaded picture is known and it changes."""
        if self.rest is not None:
            region = region_of_light(self.reference, self.rest, image, position)
            if region.sum() >= 3:
                self.light = True
                return region
        return region_of_dispersion(self.reference, position - self.reference.position)


def _style(image: Shaped[np.ndarray, "h w *colour"], settings: ImageSettings) -> DotStyle:
    if settings.radius is not None and settings.dark is not None:
        return DotStyle(settings.dark, settings.radius)
    found = find_style(image, settings.dark)
    return found if settings.radius is None else found._replace(radius=settings.radius)


def read_images(path: Path, settings: ImageSettings | None = None) -> Recording:
    """Read a video, a folder of images or a camera as a recording of dots.

    Without a scale all lengths are in px. What has been read when a source breaks off, or when
    Ctrl-C ends a camera's recording, is kept.

    Args:
        path: as for `read_pictures`.
        settings: what is known of the sensor.

    Raises:
        ValueError: no pictures, no dots in rows in the first usable one, or a setting that does
            not fit.
        OSError: the source cannot be opened.
    """
    settings = ImageSettings() if settings is None else settings
    reader = None if settings.unloaded is None else _reader_at(path, settings)
    rows: list[_Row] = []
    waiting: list[Picture] = []
    try:
        for picture in read_pictures(path):
            if reader is None and (picture.flaw or picture.image is None):
                waiting.append(picture)
                continue
            if reader is None:
                reader = DotReader(picture, settings)
                rows += [reader.read(one)[0] for one in waiting]
            rows.append(reader.read(picture)[0])
    except KeyboardInterrupt:
        if not rows:
            raise
    if reader is None:
        raise ValueError(
            f"{path} has no usable picture: {waiting[0].flaw if waiting else 'it is empty'}"
        )
    return _to_recording(path, settings, reader, rows)


def _reader_at(path: Path, settings: ImageSettings) -> DotReader:
    """A reader whose reference is the unloaded frame."""
    for picture in read_pictures(path):
        if picture.number == settings.unloaded:
            if picture.flaw:
                raise ValueError(f"the unloaded frame {picture.number}: {picture.flaw}")
            return DotReader(picture, settings)
    raise ValueError(f"{path} has no frame {settings.unloaded}, which should be the unloaded one")


def _to_recording(
    path: Path, settings: ImageSettings, reader: DotReader, rows: list[_Row]
) -> Recording:
    scale, reference = settings.scale, reader.reference
    position = scale * np.stack([row.position for row in rows])
    style, unit = reader.style, "px" if settings.mm_per_px is None else "mm"
    lengths = "Lengths are in px: no scale was given." if unit == "px" else ""
    by = "the change of light" if reader.light else "the dispersion of the translation field"
    notes = (
        f"{len(reference.position)} {'dark' if style.dark else 'bright'} dots of radius "
        f"{style.radius:.1f} px, {reference.pitch:.1f} px apart.",
        reference.note,
        f"The contact region is found by {by}.",
        *([lengths] if lengths else []),
    )
    return Recording(
        layout=reference.layout(scale),
        positions=position,
        valid=np.isfinite(position[..., 0]),
        time=np.array([row.time for row in rows]),
        source_index=np.array([row.number for row in rows]),
        contact=np.stack([row.contact for row in rows]),
        imprint=np.array([[row.imprint, row.imprint_error] for row in rows]),
        flaws=tuple(row.flaw for row in rows),
        unit=unit,
        name=path.stem if path.parent.name == "" else f"{path.parent.name}-{path.stem}",
        source=str(path),
        convention=CONVENTION,
        notes=notes,
    )
