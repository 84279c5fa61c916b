"""Recordings from pictures of printed dots."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.spatial import KDTree

from estimation.frames.recording import Frame
from estimation.pictures.dots.find import Dots, DotStyle
from estimation.pictures.dots.style import find_dots, find_style
from estimation.pictures.dots.tracking import DotTracker
from estimation.pictures.hold import UNKNOWN, HoldFollower
from estimation.pictures.imprint.follower import LOST, ImprintFollower
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.lattice import (
    Reference,
    find_irregularity,
    index_lattice,
    lay_reference,
    make_reference,
    nearest,
)
from estimation.pictures.light import to_grey
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import (
    NOT_SETTLED,
    Arrival,
    find_unseen_flaw,
    region_of_dispersion,
    region_of_light,
    region_of_print,
)
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture

RESTING = 5
"""Frames in a row in which the dots must lie regularly, and still, to be at rest."""
MOST_JUDGED = 2000
"""Frames whose contact is judged again once they have been seen at rest."""


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
        self.sensor, self.part, self.origin = settings.shown, settings.part, settings.part.origin
        self.style = _style(first.image, self.sensor)
        given = settings.unloaded is not None
        self.rest = first.image if given else None
        self.reference = self._make_reference(first.image, given)
        self.tracker = DotTracker(self.reference)
        self.imprint, self.arrival = ImprintFollower(), Arrival(self.reference)
        self.hold = HoldFollower(self.reference)
        self.light = self.printed = self.prints = False
        self.lattice = index_lattice(self.reference.position)
        self.provisional = not given and self.sensor.reference is None
        self.assumed = find_irregularity(self.lattice, self.reference.position[self.lattice.dot])
        self.size = first.size
        self.by_dots: deque[int] = deque(maxlen=MOST_JUDGED)
        self.resting, self.before = 0, self.reference.position
        self.uneven = np.zeros((0, 2))  # dots that did not rest when they were last counted
        self.reach = 0.0  # motion of those up to which they cannot rest [px]
        self.scale, self.unit = settings.scale, settings.unit
        self.layout = self.reference.layout(self.scale, self.origin)

    def read(self, picture: Picture) -> Row:
        """Marker positions, contact and imprint of the next picture."""
        count = len(self.reference.position)
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, (count, 2), picture.flaw or "no picture")
        dots = self._find(picture.image)
        straight = self.sensor.straighten(dots.centre)
        match, flaw = self.tracker.update(straight)
        seen = match >= 0
        position = np.full((count, 2), np.nan)
        position[seen] = straight[match[seen]]
        if self.provisional and not self.printed:
            self._look_for_rest(position, straight, picture.number)
        if flaw:
            return Row.of_none(picture, (count, 2), flaw)
        in_picture = np.where(seen[:, None], dots.centre[match], np.nan)
        painted = paint_out(picture.image, dots.centre, self.style.radius, self.part.seen)
        level = painted.level(in_picture, self.reference.pitch)
        contact = self._contact(picture, level, position, in_picture)
        flaw = self.arrival.find_flaw(contact)
        turned, hold = LOST, UNKNOWN
        if contact.any():
            hold = self.hold.update(painted, in_picture)
        else:
            self.hold.restart()
        if flaw or not contact.any():
            self.imprint = ImprintFollower()
        else:
            turned = self.imprint.update(painted, in_picture[contact])
        return Row(
            position=position,
            contact=contact,
            time=picture.time,
            number=picture.number,
            flaw=flaw or find_unseen_flaw(self.reference.position, contact, seen),
            imprint=turned.angle,
            imprint_error=turned.error,
            print_point=self._in_plane(turned.point),
            hold=hold,
        )

    def _in_plane(self, point: tuple[float, ...]) -> tuple[float, ...]:
        """A point of what the object prints, where a straight lens would show it [px]."""
        places = self.sensor.straighten(np.reshape(point[:4], (2, 2)))
        return (*places.ravel().tolist(), *point[4:])

    def notes(self) -> tuple[str, ...]:
        """What the dots look like, what the reference is, and what tells the contact region."""
        by = "the dispersion of the translation field"
        if self.prints:
            by = f"the object's print where there is one, else from {by}"
        by = "the change of light" if self.light else by
        return (
            f"{len(self.reference.position)} {'dark' if self.style.dark else 'bright'} dots of "
            f"radius {self.style.radius:.1f} px, {self.reference.pitch:.1f} px apart.",
            self.reference.note,
            f"The contact region is estimated from {by}.",
        )

    def _find(self, image: Shaped[np.ndarray, "h w *colour"]) -> Dots:
        """The dots of a picture that are read whole."""
        dots = find_dots(to_grey(image, self.style.dark), self.style)
        return dots.take(self.part.shows(dots.centre, self.style.radius))

    def _make_reference(
        self, image: Shaped[np.ndarray, "h w *colour"], unloaded: bool
    ) -> Reference:
        """The sensor description's, unless an unloaded picture is at hand."""
        told = self.sensor.reference
        if told is not None and not unloaded:
            return lay_reference(
                told[:, :2] / self.sensor.scale, "The reference is the sensor description's."
            )
        dots = self._find(image)
        size = (image.shape[1], image.shape[0])
        return make_reference(self.sensor.straighten(dots.centre), size, unloaded)

    def _look_for_rest(
        self, position: Float[np.ndarray, "m 2"], dots: Float[np.ndarray, "k 2"], number: int
    ) -> None:
        """Take the dots as the reference once they have been regular and still for long enough."""
        # share of a picture's dots, or of the reference's where those are fewer, to be among them
        recognised = 0.9
        most_motion = 0.02  # distance by which dots at rest may move from frame to frame [pitches]
        needed = recognised * min(len(dots), len(self.lattice.dot))
        found = find_irregularity(self.lattice, position[self.lattice.dot])
        rests = found.rests and np.isfinite(position[:, 0]).sum() >= needed
        if not rests:  # a lattice guessed beside a contact may have mistaken dots for others
            position = self._recognise(dots)
            rests = np.isfinite(position[:, 0]).sum() >= needed
        moved = np.linalg.norm(position - self.before, axis=1)
        still = np.nanmax(moved, initial=0.0) < most_motion * self.reference.pitch
        self.resting = self.resting + 1 if rests and (still or not self.resting) else 0
        self.before = position
        if self.resting < RESTING or not self._is_better(position):
            return
        self.provisional, doubt = False, self.reference.doubt
        known = np.isfinite(position[:, 0])
        self.reference = self.reference._replace(
            position=np.where(known[:, None], position, self.reference.position),
            doubt=doubt if doubt is None else np.where(known, 0.0, doubt),
            note=f"The clip starts loaded: the reference is frame {number}, in which all dots lie "
            "on a regular lattice and have come to rest.",
        )
        self.tracker = DotTracker(self.reference)
        self.layout = self.reference.layout(self.scale, self.origin)

    def _is_better(self, position: Float[np.ndarray, "m 2"]) -> bool:
        """Whether dots that rest are a better reference than the one there is.

        They are where that is guessed beside a contact, or an object has gone since. A first frame
        that looked unloaded is given up where dots lie elsewhere, and more regularly.
        """
        more_regular = 0.9  # share of the first frame's irregularity that they may have [-]
        if self.reference.doubt is not None or self.assumed is None:
            return True
        if not self._touched(position).any():
            return False
        found = find_irregularity(self.lattice, position[self.lattice.dot])
        return found.mean < more_regular * self.assumed.mean

    def judge_again(self, frames: Sequence[Frame]) -> list[Frame]:
        """Frames that were read before the reference was found, their contact judged by it.

        Where an object is printed it touches, whatever the reference is.

        Args:
            frames: in order of time.
        """
        arrival, judged, by_dots = Arrival(self.reference), list[Frame](), set(self.by_dots)
        for frame in frames:
            unusable = frame.flaw and frame.flaw != NOT_SETTLED
            if frame.contact is None or unusable:
                judged.append(frame)
                continue
            contact, imprint, hold = frame.contact, frame.imprint, frame.hold
            if frame.source_index in by_dots:
                contact = self._touched(frame.positions / self.scale - self.origin)
            if not contact.any():
                imprint, hold = (np.nan, np.nan), UNKNOWN
            flaw = arrival.find_flaw(contact)
            judged.append(replace(frame, contact=contact, flaw=flaw, imprint=imprint, hold=hold))
        return judged

    def _recognise(self, dots: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
        """The places of the reference's dots among dots that lie regularly, by their rows.

        Rows and columns are counted alike in both, but for where the count begins: most dots of the
        reference lie nearest to themselves.

        Returns:
            NaN for dots that are not there, and for all where the dots do not lie regularly.
        """
        nowhere = np.full_like(self.reference.position, np.nan)
        if self.reach and nearest(KDTree(self.uneven), dots)[0].max(initial=0.0) < self.reach:
            return nowhere
        found = index_lattice(dots)
        irregularity = find_irregularity(found, dots[found.dot])
        if not irregularity.rests:
            self.uneven, self.reach = dots, irregularity.reach * found.pitch
            return nowhere
        near = nearest(KDTree(dots[found.dot]), self.reference.position[self.lattice.dot])[1]
        begins = found.coordinates[near] - self.lattice.coordinates
        begin, votes = np.unique(begins, axis=0, return_counts=True)
        index = self.lattice.coordinates + begin[votes.argmax()]
        same = (index[:, None] == found.coordinates).all(axis=2)
        known = same.any(axis=1)
        nowhere[self.lattice.dot[known]] = dots[found.dot[same[known].argmax(axis=1)]]
        return nowhere

    def _contact(
        self,
        picture: Picture,
        level: Float[np.ndarray, " m"],
        position: Float[np.ndarray, "m 2"],
        in_picture: Float[np.ndarray, "m 2"],
    ) -> Bool[np.ndarray, " m"]:
        """The contact region: by light where an unloaded picture is known and it changes.

        Elsewhere by what the object prints, and by the dots where it prints nothing. Where a print
        goes the object has gone: the dots will come to rest where they belong.
        """
        if self.rest is not None:
            assert picture.image is not None
            region = region_of_light(self.reference, self.rest, picture.image, in_picture)
            if region.sum() >= 3:
                self.light = True
                return region
        region = region_of_print(self.reference, level, self.printed)
        if self.printed and not region.any() and self.rest is None:
            self.provisional, self.resting, self.assumed = True, 0, None
        self.printed = bool(region.any())
        self.prints |= self.printed
        if self.printed:
            return region
        self.by_dots.append(picture.number)
        return self._touched(position)

    def _touched(self, position: Float[np.ndarray, "m 2"]) -> Bool[np.ndarray, " m"]:
        """The contact region by the dots; those that the picture's side cuts jump."""
        place = self.reference.position
        room = np.minimum(place, np.array(self.size) - 1 - place).min(axis=1)
        return region_of_dispersion(self.reference, position - place, room >= self.style.radius)


def _style(image: Shaped[np.ndarray, "h w *colour"], sensor: Sensor) -> DotStyle:
    largest_radius = 25.0  # radius of dots beyond which a picture is larger than it need be [px]
    if sensor.radius is not None and sensor.radius > largest_radius:
        raise ValueError(
            f"dots of radius {sensor.radius:g} px are not read; {largest_radius:g} px at most: "
            "scale the pictures down"
        )
    if sensor.radius is not None and sensor.dark is not None:
        return DotStyle(sensor.dark, sensor.radius)
    found = find_style(image, sensor.dark)
    return found if sensor.radius is None else found._replace(radius=sensor.radius)
