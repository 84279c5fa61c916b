"""Recordings from pictures of a speckle pattern."""

import numpy as np
from jaxtyping import Float

from estimation.frames.recording import MarkerLayout
from estimation.pictures.lattice import Reference, lattice_neighbours
from estimation.pictures.light import to_light
from estimation.pictures.lines import Rotation, fuse_rotations, rotation_of_lines
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import find_tear_flaw, find_unseen_flaw, region_of_dispersion
from estimation.pictures.sensor import Sensor
from estimation.pictures.speckle.subsets import Match, polar_angle, polar_variance
from estimation.pictures.speckle.tracking import SpeckleTracker
from estimation.pictures.stream import Picture


class SpeckleReader(MarkerReader):
    """Turns pictures of a speckle pattern into positions of its points, one after the other."""

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Choose points of interest in a picture and make the reference.

        Raises:
            ValueError: the picture shows no speckle pattern.
        """
        assert first.image is not None
        self.sensor, self.part, self.origin = settings.shown, settings.part, settings.part.origin
        self.tracker = SpeckleTracker(to_light(first.image), settings.part)
        lattice, style = self.tracker.lattice, self.tracker.style
        rest = lattice.centre
        self.stretch = lens_stretch(self.sensor, rest)
        self.scale, self.unit = settings.scale, settings.unit
        self.neighbours = lattice_neighbours(lattice.number)
        self.given = settings.unloaded is not None
        note = (
            "The reference is the frame that was given."
            if self.given
            else "Speckle does not show whether the gel is at rest, so the first usable frame is "
            "the reference, and angles count from it; give an unloaded frame if there is one "
            "(--unloaded-frame or --unloaded)."
        )
        around = np.full((len(rest), 0), -1)
        position = self.sensor.undistort(rest)
        self.reference = Reference(position, self.neighbours, around, float(style.pitch), note)
        full = lattice.number.shape if (lattice.number >= 0).all() else None
        self.layout = MarkerLayout(self.scale * (position + self.origin), self.neighbours, full)

    def read(self, picture: Picture) -> Row:
        """Measure positions, contact and rotation of the points in the next picture."""
        shape = self.reference.position.shape
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, shape, picture.flaw or "no picture")
        match, flaw = self.tracker.find(to_light(picture.image))
        if flaw:
            return Row.of_none(picture, shape, flaw)
        match = self._undistort(match)
        displacement = match.position - self.reference.position
        contact = region_of_dispersion(self.reference, displacement)
        rest = self.reference.position
        return Row(
            position=match.position,
            contact=contact,
            time=picture.time,
            number=picture.number,
            flaw=find_tear_flaw(self.neighbours, rest, match.position)
            or find_unseen_flaw(rest, contact, match.good),
            rotation=measure_rotation(self.reference, match).angle,
        )

    def notes(self) -> tuple[str, ...]:
        """Remarks on the speckle, the unusable points and the reference."""
        style, lattice = self.tracker.style, self.tracker.lattice
        unusable = [f"{count} {why}" for why, count in lattice.left_out.items() if count]
        masked = f" Points not used: {', '.join(unusable)}." if unusable else ""
        seeds = (
            f" Features were needed in {self.tracker.searched} pictures."
            if self.tracker.searched
            else ""
        )
        return (
            f"{len(lattice.centre)} points on a speckle pattern with a grain of "
            f"{2 * style.size:.1f} px. The points are {style.pitch} px apart, each tracked by the "
            f"{2 * style.radius + 1} px square around it.{masked}{seeds}",
            self.reference.note,
            "The contact region is estimated from how far neighbouring markers have moved.",
        )

    def _undistort(self, match: Match) -> Match:
        """Remove the lens's distortion from a match."""
        if self.sensor.lens is None:
            return match
        shape = lens_stretch(self.sensor, match.position) @ match.deformation
        return match._replace(
            position=self.sensor.undistort(match.position),
            deformation=shape @ np.linalg.inv(self.stretch),
        )


def lens_stretch(sensor: Sensor, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2 2"]:
    """Derivative of undistorted positions by positions in the picture."""
    step = 1.0  # step of the central difference [px]
    if sensor.lens is None:
        return np.tile(np.eye(2), (len(points), 1, 1))
    columns = [
        (sensor.undistort(points + step * axis) - sensor.undistort(points - step * axis))
        / (2.0 * step)
        for axis in np.eye(2)
    ]
    return np.stack(columns, axis=-1)


def measure_rotation(reference: Reference, match: Match) -> Rotation:
    """Rotation of each subset and of the lattice's lines through it, averaged by variance."""
    own = Rotation(
        polar_angle(match.deformation), np.where(match.good, polar_variance(match), np.inf)
    )
    variance = 0.5 * np.einsum("nii->n", match.covariance[:, :2, :2])
    lines = rotation_of_lines(
        reference.neighbours, reference.position, match.position, np.nan_to_num(variance)
    )
    return fuse_rotations(own, lines)
