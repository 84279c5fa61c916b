"""Recordings from pictures of printed dots."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Shaped

from estimation.frames.recording import Flaw, Frame
from estimation.frames.source import MOST_HELD_FRAMES
from estimation.pictures.dots.departure import Departure
from estimation.pictures.dots.find import Dots
from estimation.pictures.dots.light_touch import LightTouch
from estimation.pictures.dots.rest import RestSearch
from estimation.pictures.dots.stirred import StirredGel
from estimation.pictures.dots.strokes import find_strokes
from estimation.pictures.dots.style import choose_style, find_dots
from estimation.pictures.dots.surroundings import leave_out_surroundings
from estimation.pictures.dots.tracking import DotTracker
from estimation.pictures.hold import NO_HOLD, Hold, HoldFollower
from estimation.pictures.imprint.follower import NO_IMPRINT, Imprint, ImprintFollower
from estimation.pictures.imprint.painted import Painted, paint_out
from estimation.pictures.imprint.standing import Standing
from estimation.pictures.imprint.witness import GelWitness
from estimation.pictures.lattice import (
    Reference,
    continue_rows,
    find_rows,
    lay_reference,
    make_reference,
)
from estimation.pictures.light import find_gain, is_grey, to_grey
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import (
    Arrival,
    Bare,
    OneContact,
    fill_hull,
    find_unseen_flaw,
    region_of_dispersion,
    region_of_light,
    region_of_print,
    region_of_shade,
)
from estimation.pictures.stream import Picture


class DotReader(MarkerReader):
    """Turns pictures of printed dots into marker positions, one picture after the other.

    If a clip starts loaded, the reference is estimated. As soon as the gel rests in a later frame,
    that frame becomes the reference of the whole clip.
    """

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Detect the dots in a picture and make the reference.

        Raises:
            ValueError: the picture shows no dots in rows.
        """
        assert first.image is not None
        self.sensor, self.part, self.origin = settings.shown, settings.part, settings.part.origin
        self.style = choose_style(first.image, self.sensor)
        self.part, self.left_out = leave_out_surroundings(first.image, self.style, self.part)
        self.gain, self.grey = find_gain(first.image, self.part.seen), is_grey(first.image)
        unloaded = settings.unloaded is not None
        self.rest = first.image if unloaded else None
        self.reference = self._make_reference(first.image, unloaded)
        self.tracker, self.rows = DotTracker(self.reference), find_rows(self.reference)
        self.imprint, self.arrival = ImprintFollower(), Arrival(self.reference)
        self.hold, self.gel = HoldFollower(self.reference), GelWitness(self.reference)
        self.standing, self.unprinted = Standing(), set[int]()
        self.light = self.printed = self.prints = self.shaded = self.shades = False
        self.one, self.light_touch = OneContact(self.reference), LightTouch()
        self.stirred, self.departure = StirredGel(), Departure()
        self.bare: Bare | None = None
        self.provisional = not unloaded and self.sensor.reference is None
        self.search = RestSearch(self.reference)
        self.by_dots: deque[int] = deque(maxlen=MOST_HELD_FRAMES)
        self.size, self.scale, self.unit = first.size, settings.scale, settings.unit
        self.layout = self.reference.layout(self.scale, self.origin)

    def read(self, picture: Picture) -> Row:
        """Measure marker positions, contact and imprint in the next picture."""
        count = len(self.reference.position)
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, (count, 2), picture.flaw or "no picture")
        grey = to_grey(picture.image, self.style.dark)
        dots = self._find(grey)
        straight = self.sensor.undistort(dots.centre)
        match, flaw = self.tracker.update(straight)
        seen = match >= 0
        position, in_picture = np.full((2, count, 2), np.nan)
        position[seen], in_picture[seen] = straight[match[seen]], dots.centre[match[seen]]
        searched = self.provisional and not (self.printed or self.shaded)
        if searched and self.search.finds(position, len(straight)):
            self._take_rest(position, picture.number)
        missed, seen_pixels = continue_rows(in_picture, self.rows), self.part.seen
        image = np.atleast_3d(picture.image)[..., :1] if self.grey else picture.image
        painted = paint_out(image, dots.centre, self.style.radius, seen_pixels, missed, self.gain)
        strokes = None if flaw else find_strokes(grey, dots, self.style)
        painted = self.standing.take_off(painted.without_overlays(strokes))
        if flaw:  # the print shows a contact without knowing which dot is which
            level = painted.level(self.reference.position, self.reference.pitch)
            return Row.of_none(picture, (count, 2), flaw)._replace(contact=self._find_print(level))
        measured = self._measure(picture, painted, position, in_picture)
        if self._finds_standing(painted, position, picture.number, *measured[:2]):
            painted = self.standing.take_off(painted)
            measured = self._measure(picture, painted, position, in_picture)
        contact, turned, hold, flaw = measured
        turned, flaw = self.standing.widen(turned), flaw or self.standing.flaw
        self.one.last, touched = contact, bool(contact.any())
        self.standing.learn(painted, touched)
        lit = self.light_touch.find(painted, in_picture, self.reference.pitch, touched)
        stirred = self.stirred.find(in_picture, self.reference, touched or bool(lit.any()))
        if lit.any() or stirred.any():
            contact, flaw, self.shades = lit | stirred, Flaw.TOO_LIGHT, self.shades or lit.any()
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
            others=self.one.others if self.one.others.any() else None,
        )

    def _measure(
        self,
        picture: Picture,
        painted: Painted,
        position: Float[np.ndarray, "m 2"],
        in_picture: Float[np.ndarray, "m 2"],
    ) -> tuple[Bool[np.ndarray, " m"], Imprint, Hold, str]:
        """Contact, imprint and hold of the print, and why the contact cannot be judged."""
        contact = self._contact(picture, painted, position, in_picture)
        position[self.one.others] = in_picture[self.one.others] = np.nan
        flaw = self.arrival.find_flaw(contact)
        where = in_picture, self.reference.pitch, contact
        shows = self.printed or self.shaded
        if self.provisional and self.departure.find(painted, *where, shows):
            flaw, contact = Flaw.DEPARTED, np.zeros_like(contact)
        turned, hold = NO_IMPRINT, NO_HOLD
        shown = contact.any() and not self.shaded
        moved = position - self.reference.position
        if flaw or not shown:
            self.imprint.restart()
        else:
            read = in_picture[contact], picture.quantizer, moved[contact]
            turned = self.imprint.update(painted, *read)
        if shown:
            hold = self.hold.update(painted, in_picture, moved, turned.located, picture.time)
            turned = self.gel.check(turned, position, contact)
        else:
            self.hold.restart()
        return contact, turned, hold, flaw

    def _finds_standing(
        self,
        painted: Painted,
        position: Float[np.ndarray, "m 2"],
        number: int,
        contact: Bool[np.ndarray, " m"],
        imprint: Imprint,
    ) -> bool:
        """Whether the print turns out to stand still in the pictures, and is hidden from now on.

        Earlier frames are answered again without it, if they are still there.
        """
        frames = self.standing.find(painted, self.reference, position, contact, number, imprint)
        if not frames:
            return False
        self.outdated = self.provisional and number < MOST_HELD_FRAMES
        self.unprinted |= set(frames)
        self.by_dots.extend(frames)
        self.imprint.restart()
        self.printed = self.prints = False
        self.hold.restart()
        if self.provisional:
            self.layout = self.reference.layout(self.scale, self.origin)
        return True

    def _in_plane(self, point: tuple[float, ...]) -> tuple[float, ...]:
        """A point of the object's print, without the lens's distortion [px]."""
        places = self.sensor.undistort(np.reshape(point[:4], (2, 2)))
        return (*places.ravel().tolist(), *point[4:])

    def notes(self) -> tuple[str, ...]:
        """Remarks on the dots, the reference and the estimate of the contact region."""
        ways = ["how far neighbouring dots have moved"]
        if self.shades:
            ways.insert(0, "a change of light in part of the picture")
        if self.prints:
            ways.insert(0, "the object's print where there is one")
        source = "the change of light" if self.light else ", else from ".join(ways)
        return (
            f"{len(self.reference.position)} {'dark' if self.style.dark else 'bright'} dots of "
            f"radius {self.style.radius:.1f} px, {self.reference.pitch:.1f} px apart.",
            *self.left_out,
            self.reference.note,
            *self.standing.notes,
            f"The contact region is estimated from {source}.",
        )

    def _find(self, grey: Float[np.ndarray, "h w"]) -> Dots:
        """Find the dots of a picture that the mask does not cut."""
        dots = find_dots(grey, self.style)
        return dots.take(self.part.shows(dots.centre, self.style.radius))

    def _make_reference(
        self, image: Shaped[np.ndarray, "h w *colour"], unloaded: bool
    ) -> Reference:
        """The reference: from an unloaded picture, the sensor description or the first picture."""
        described = self.sensor.reference
        if described is not None and not unloaded:
            return lay_reference(
                described[:, :2] / self.sensor.scale,
                "The reference is from the sensor description.",
            )
        centre = self.sensor.undistort(self._find(to_grey(image, self.style.dark)).centre)
        return make_reference(centre, (image.shape[1], image.shape[0]), unloaded)

    def _take_rest(self, position: Float[np.ndarray, "m 2"], number: int) -> None:
        """Take dots at rest as the reference."""
        # a first frame that looked unloaded stays the reference if they lie where it has them
        if self.search.first is not None and not self._touched(position).any():
            return
        self.provisional, seen, doubt = False, np.isfinite(position), self.reference.doubt
        self.reference = self.reference._replace(
            position=np.where(seen, position, self.reference.position),
            doubt=doubt if doubt is None else np.where(seen[:, 0], 0.0, doubt),
            strained=False,
            note=f"The clip starts loaded: the reference is frame {number}, in which all dots lie "
            "on a regular lattice and have come to rest.",
        )
        self.tracker, self.bare = DotTracker(self.reference), None
        self.layout = self.reference.layout(self.scale, self.origin)

    def take_over(self, other: MarkerReader) -> None:
        """Hide what the other reader has found to stand still in the pictures."""
        super().take_over(other)
        if isinstance(other, DotReader):
            self.standing.take_over(other.standing)

    def reevaluate(self, frames: Sequence[Frame]) -> list[Frame]:
        """Correct the contact of frames that were read before the reference was found.

        Contacts detected by the object's print do not depend on the reference, and stay.

        Args:
            frames: in order of time.

        Returns:
            The frames, measured from the present reference.
        """
        arrival, judged, by_dots = Arrival(self.reference), list[Frame](), set(self.by_dots)
        touched = False
        for frame in frames:
            if frame.contact is None or frame.flaw not in ("", *Flaw):
                judged.append(frame)
                continue
            contact = frame.contact
            if frame.source_index in by_dots:
                contact = self._touched(frame.positions / self.scale - self.origin, touched)
            touched = bool(contact.any())
            if frame.flaw == Flaw.TOO_LIGHT and not touched:
                judged.append(frame)
                continue
            if not touched or frame.source_index in self.unprinted:
                frame = frame.without_print()
            judged.append(replace(frame, contact=contact, flaw=arrival.find_flaw(contact)))
        return judged

    def _contact(
        self,
        picture: Picture,
        painted: Painted,
        position: Float[np.ndarray, "m 2"],
        in_picture: Float[np.ndarray, "m 2"],
    ) -> Bool[np.ndarray, " m"]:
        """The contact region: by the change of light, the object's print or the dots.

        The change of light is used if an unloaded picture is known and the light has changed since.
        Otherwise the object's print is used. Without a print, it is the change of light since a
        first picture that seemed unloaded, else the dots. When a print disappears without such a
        change, the object has gone, and the dots will come to rest at their true places.
        """
        level = painted.level(in_picture, self.reference.pitch)
        region = self.one.follow(self._find_print(level))
        if self.rest is not None:
            assert picture.image is not None
            pictures = self.rest, picture.image
            lit = region_of_light(self.reference, *pictures, in_picture, self.gain)
            lit &= ~self.one.others
            if lit.sum() >= 3:
                self.light = True
                return lit
        region = np.isfinite(level) & fill_hull(self.reference.position, region)
        if self.one.others.any():
            self.printed, self.prints, self.shaded = True, True, False
            return region & ~self.one.others
        first, shade = not (self.by_dots or self.prints), np.zeros_like(region)
        if (first or self.bare is not None) and not region.any():
            now = Bare(painted.light(in_picture, 0.5 * self.reference.pitch), level)
            if first and self.provisional and self.reference.doubt is None:
                self.bare = now
            if self.bare is not None:
                shade = region_of_shade(self.reference, self.bare, now)
        self.shaded = bool(shade.any())
        self.shades |= self.shaded
        if self.printed and not (region.any() or self.shaded) and self.rest is None:
            self.provisional, self.bare = True, None
            self.search.restart()
        self.printed = bool(region.any())
        if self.printed:
            self.prints = True
            return region
        self.by_dots.append(picture.number)
        return shade if self.shaded else self._touched(position, bool(self.one.last.any()))

    def _find_print(self, level: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """The dots with a print; none once marks have been found, which are left in places."""
        return region_of_print(self.reference, level, self.printed) & (not self.standing.found)

    def _touched(
        self, position: Float[np.ndarray, "m 2"], touched: bool = False
    ) -> Bool[np.ndarray, " m"]:
        """The contact region by the dots, without the jumping dots at the picture's edge.

        Args:
            position: of the dots [px].
            touched: whether there was a contact in the frame before.
        """
        place = self.reference.position
        room = np.minimum(place, np.array(self.size) - 1 - place).min(axis=1)
        whole = room >= self.style.radius
        return region_of_dispersion(self.reference, position - place, whole, touched)
