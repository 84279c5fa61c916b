"""Recordings from pictures of a continuous marker pattern: the x-corners of a checkerboard."""

import numpy as np
from jaxtyping import Int

from estimation.frames.recording import MarkerLayout
from estimation.pictures.corners.tracking import CornerTracker, Seen
from estimation.pictures.lattice import Reference
from estimation.pictures.lines import Rotation, fuse_rotations, rotation_of_edges, rotation_of_lines
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import find_tear_flaw, find_unseen_flaw, region_of_dispersion
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture


class CornerReader(MarkerReader):
    """Turns pictures of a checkerboard into marker positions, one picture after the other."""

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Detect the corners in a picture and make the reference.

        Raises:
            ValueError: the picture shows no checkerboard.
        """
        assert first.image is not None
        self.sensor, self.part, self.origin = settings.shown, settings.part, settings.part.origin
        unloaded = settings.unloaded is not None
        self.tracker = CornerTracker.learn(first.image, unloaded=unloaded, part=settings.part)
        plan = self.tracker.plan
        self.rest = undistort(self.sensor, self.tracker.rest)
        self.scale, self.unit = settings.scale, settings.unit
        self.layout = lay_out(self.tracker, settings.scale * (self.rest.position + self.origin))
        around = np.full((len(plan.position), 0), -1)
        self.reference = Reference(
            self.rest.position, self.layout.neighbours, around, plan.pitch, self.tracker.note
        )

    def read(self, picture: Picture) -> Row:
        """Measure positions, contact and rotation of the line features in the next picture."""
        shape = self.reference.position.shape
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, shape, picture.flaw or "no picture")
        seen = undistort(self.sensor, self.tracker.find(picture.image))
        if seen.flaw:
            return Row.of_none(picture, shape, seen.flaw)
        displacement = seen.position - self.reference.position
        contact = region_of_dispersion(self.reference, displacement)
        rest, visible = self.reference.position, np.isfinite(displacement[:, 0])
        return Row(
            position=seen.position,
            contact=contact,
            time=picture.time,
            number=picture.number,
            flaw=find_tear_flaw(self.tracker.neighbours, rest, seen.position)
            or find_unseen_flaw(rest, contact, visible),
            rotation=measure_rotation(self.tracker.neighbours, self.rest, seen).angle,
        )

    def notes(self) -> tuple[str, ...]:
        """Remarks on the pattern, its identification, the reference and the contact region."""
        return (
            self.tracker.describe(),
            self.reference.note,
            "The contact region is estimated from how far neighbouring markers have moved.",
        )


def undistort(sensor: Sensor, seen: Seen) -> Seen:
    """Remove the lens's distortion from corners and their edges."""
    if sensor.lens is None:
        return seen
    position = sensor.undistort(seen.position)
    edges = [
        sensor.undistort(seen.position + np.stack([np.cos(angle), np.sin(angle)], axis=1))
        - position
        for angle in seen.heading.T
    ]
    heading = np.stack([np.arctan2(edge[:, 1], edge[:, 0]) for edge in edges], axis=1)
    return seen._replace(position=position, heading=heading)


def lay_out(tracker: CornerTracker, reference: np.ndarray) -> MarkerLayout:
    """The corners at rest, as a recording's layout."""
    corner = tracker.plan.cells.corner
    shape = (int(corner.shape[0]), int(corner.shape[1])) if (corner >= 0).all() else None
    return MarkerLayout(reference, tracker.neighbours, shape)


def measure_rotation(neighbours: Int[np.ndarray, "m 4"], rest: Seen, now: Seen) -> Rotation:
    """Rotation of edges and of lines to the neighbours, averaged by their variances."""
    edges = rotation_of_edges(
        rest.heading, now.heading, rest.heading_variance + now.heading_variance
    )
    lines = rotation_of_lines(neighbours, rest.position, now.position, rest.variance + now.variance)
    return fuse_rotations(edges, lines)
