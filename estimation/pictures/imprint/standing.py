"""Structure that stands still in the pictures: a frame around the pad, mirrors, text, dust.

Its edges and texture look like the print of an object that does not turn. Two signs distinguish
it. It was there before the object touched. And it stands still while gel turns away from rest as
one body, which only gel does that sticks to an object that turns. Gel that an object at rest
shears or presses away turns by another angle at each dot. Gel under load also turns as it relaxes:
without a reference at rest, the second sign does not count.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Complex, Float, Float32

from estimation.fields.plane import fit_motion
from estimation.pictures.imprint.follower import Imprint
from estimation.pictures.imprint.painted import Painted, add_squares
from estimation.pictures.imprint.witness import find_bodies
from estimation.pictures.lattice import Reference


class _Start(NamedTuple):
    """The first frame with the print that is watched.

    Attributes:
        number: of the frame.
        planes: deviation of each colour from its surroundings [grey levels of 255].
        position: of the dots [px]; NaN where not visible.
        turn: largest turn of the print since then [rad].
        shift: largest shift of the print since then [px].
        ahead: how much further gel has turned than the print since then, in each of the last two
            frames [rad].
    """

    number: int
    planes: list[Float32[np.ndarray, "h w"]]
    position: Float[np.ndarray, "m 2"]
    turn: float = 0.0
    shift: float = 0.0
    ahead: tuple[float, float] = (0.0, 0.0)

    def update(self, imprint: Imprint, gel: float, pitch: float) -> "_Start":
        """Take the next frame with the print.

        An object drags the gel along by friction, which turns no part of it further than the
        object. Where the object shifts, gel beside it is sheared, and turns by up to a quarter of
        the shift over a pitch.

        Args:
            imprint: motion of the print.
            gel: largest turn of the gel away from rest since the start [rad].
            pitch: distance between neighbouring dots [px].
        """
        errors, sheared = 2.0, 0.25  # of the print's turn; turn of the gel by a shift [rad/pitch]
        point = np.reshape(imprint.point[:4], (2, 2))
        shift = max(self.shift, float(np.nan_to_num(np.linalg.norm(point[1] - point[0]))))
        turn = max(self.turn, abs(imprint.angle))
        ahead = gel - turn - errors * imprint.error - sheared * shift / pitch
        return self._replace(turn=turn, shift=shift, ahead=(self.ahead[1], ahead))

    def stood_still(self, turned: Float[np.ndarray, " n"], pitch: float) -> Bool[np.ndarray, " n"]:
        """Whether the print has stood still while the gel turned away from rest.

        Args:
            turned: turns of the gel [rad]; NaN if unknown.
            pitch: distance between neighbouring dots [px].
        """
        # turn of the gel that shows this [rad]; and the print's largest turn and shift, over the
        # gel's turn [-, pitches/rad]
        least, most_turn, most_shift = np.radians(2.0), 0.2, 1.4
        still = (self.turn < most_turn * turned) & (self.shift < most_shift * turned * pitch)
        return (turned >= least) & still


class Standing:
    """Finds structure that stands still in the pictures, from the print of the frames so far."""

    least_texture = 4.0  # of its pixels [grey levels of 255]

    def __init__(self) -> None:
        """Begin before the first picture."""
        self.hidden: Bool[np.ndarray, "h w"] | None = None
        """Pixels of the scaled picture with such structure; None if there is none."""
        self.found = False
        """Whether a print turned out to be such structure: others may do so too."""
        self.flaw = ""
        """Why the print of the last frame is doubted; empty if it is not."""
        self._start: _Start | None = None
        self._free: Float32[np.ndarray, "h w"] | None = None
        self._count = 0
        self._touched = False

    def take_over(self, other: "Standing") -> None:
        """Hide what was found when the same pictures were read before, and learn no more.

        Without a print that was rejected, the first frames of a contact may seem to have none.
        """
        self.hidden, self.found, self._touched = other.hidden, other.found, True

    def learn(self, painted: Painted, touched: bool) -> None:
        """Hide edges and texture of the pictures before the first contact: they are no print.

        Later, a print that is just too faint to be a contact would be hidden.

        Args:
            painted: the picture without its dots.
            touched: whether there is a contact.
        """
        self._touched |= touched
        if self._touched:
            return
        frames, more = 5, 4.0  # frames that must show such pixels; texture over that of most [-]
        texture = np.sqrt(add_squares(painted.departing)) * painted.clear
        self._free = texture if self._free is None else np.minimum(self._free, texture)
        self._count += 1
        if self._count == frames:
            shown = self._free[self._free > 0.0]
            typical = float(np.median(shown)) if len(shown) else 0.0
            self._hide(self._free > max(self.least_texture, more * typical))
            self._free, self._count = None, 0

    @property
    def notes(self) -> tuple[str, ...]:
        """A remark on this structure for the report, if there is any."""
        if self.hidden is None:
            return ()
        return (
            f"{self.hidden.mean():.1%} of the picture's area shows marks that were there before "
            "the contact, or stood still while the gel turned. They do not count as a print.",
        )

    def take_off(self, painted: Painted) -> Painted:
        """The picture without this structure."""
        return painted if self.hidden is None else painted.without(self.hidden)

    def widen(self, imprint: Imprint) -> Imprint:
        """The motion of the last frame's print, whose interval reaches beyond gel that is ahead.

        Marks then hold the print, and gel between the dots may have turned further: the interval
        reaches beyond the gel by as much again.
        """
        likely = 1.96  # standard errors of a 95 % interval
        ahead = 0.0 if self._start is None else max(self._start.ahead[-1], 0.0)
        return imprint._replace(error=float(np.hypot(imprint.error, 2.0 * ahead / likely)))

    def find(
        self,
        painted: Painted,
        reference: Reference,
        position: Float[np.ndarray, "m 2"],
        contact: Bool[np.ndarray, " m"],
        number: int,
        imprint: Imprint,
    ) -> range:
        """The frames up to this one whose print was such structure, which is hidden from now on.

        Args:
            painted: the picture without its dots.
            reference: the dots at rest.
            position: of the dots, without the lens's distortion [px]; NaN where not visible.
            contact: dots in contact.
            number: of the frame.
            imprint: motion of the print.
        """
        doubtful = np.radians(1.0)  # turn of the gel beyond the print's that shows a mark [rad]
        self.flaw = ""
        if not np.isfinite([imprint.angle, *imprint.point[:4]]).all():
            return range(0)  # a print that has just been found again may be another one
        if imprint.angle == 0.0 or self._start is None:
            self._start = _Start(number, painted.departing, position)
            return range(0)
        # both by the present reference, which may be new, and by dots that both frames show
        before = np.where(np.isnan(position), np.nan, self._start.position)
        after = np.where(np.isnan(before), np.nan, position)
        points = reference.position, before, after
        gel = measure_patches(reference, before, after, contact)
        self._start = self._start.update(imprint, gel, reference.pitch)
        if min(self._start.ahead) > doubtful:
            self.flaw = (
                "the gel turns further than the print: marks in the picture count as the print, "
                "or hold it (--mask, --crop)"
            )
        if reference.strained:
            return range(0)
        turns = [measure_turns(reference, p) for p in (after, before)]
        turned = self._start.stood_still(np.subtract(*np.abs(turns)), reference.pitch)
        away = measure_bodies(points, contact, turned, reference.pitch)
        if not self._start.stood_still(away, reference.pitch).any():
            return range(0)
        first = self._start.number
        self._hide(self._find_unchanged(painted))
        self._start, self.found, self.flaw = None, True, ""
        return range(first, number + 1)

    def _find_unchanged(self, painted: Painted) -> Bool[np.ndarray, "h w"]:
        """Pixels with texture that has not changed since the start, and those beside them."""
        assert self._start is not None
        changed = 0.5  # largest change of the texture, as a share of itself [-]
        before, now = np.stack(self._start.planes), np.stack(painted.departing)
        texture = np.linalg.norm(before, axis=0)
        stays = np.linalg.norm(now - before, axis=0) < changed * texture
        hidden = (stays & (texture > self.least_texture)).astype(np.uint8)
        beside = np.ones((2 * round(painted.radius) + 1,) * 2, np.uint8)  # dots cut by a mirror
        return cv2.dilate(hidden, beside) > 0

    def _hide(self, pixels: Bool[np.ndarray, "h w"]) -> None:
        if pixels.any():
            self.hidden = pixels if self.hidden is None else self.hidden | pixels


def measure_bodies(
    points: Sequence[Float[np.ndarray, "m 2"]],
    contact: Bool[np.ndarray, " m"],
    turned: Bool[np.ndarray, " m"],
    pitch: float,
) -> Float[np.ndarray, " n"]:
    """Turns away from rest of dots that move as one body [rad].

    Such a body may reach beyond the print: marks hide dots, and need not cover the object.

    Args:
        points: dots at rest, at the start and now [px]; NaN where not visible.
        contact: dots in contact, of which a body has one at least.
        turned: dots around which bodies are sought.
        pitch: distance between neighbouring dots [px].
    """
    misfit = 0.02  # of a dot of the body, as much as dots at rest move [pitches]
    seen = np.isfinite(points[-1][:, 0])
    rest, start, now = (place[seen] @ np.array([1.0, 1.0j]) for place in points)
    bodies = find_bodies(start, now, pitch, misfit, turned[seen])
    bodies = np.unique(bodies[bodies[:, contact[seen]].any(axis=1)], axis=0)
    turns = [[fit_motion(rest[b], place[b]).angle for b in bodies] for place in (now, start)]
    return np.subtract(*np.abs(turns))


def measure_patches(
    reference: Reference,
    before: Float[np.ndarray, "m 2"],
    after: Float[np.ndarray, "m 2"],
    contact: Bool[np.ndarray, " m"],
) -> float:
    """Largest turn away from rest of a dot and those around it, in contact or beside it [rad].

    Args:
        reference: the dots at rest.
        before: of the dots at the start [px]; NaN where not visible.
        after: the same now.
        contact: dots in contact.
    """
    fewest, reach = 6, 1.6  # dots of nine that are visible, and their distance [pitches]
    beside = reference.neighbours[contact]
    middle = contact.copy()
    middle[beside[beside >= 0]] = True
    seen = np.isfinite(after[:, 0])
    place = [points @ np.array([1.0, 1.0j]) for points in (reference.position, before, after)]
    patch = np.abs(place[0][middle, None] - place[0][seen]) < reach * reference.pitch
    patch = patch[patch.sum(axis=1) >= fewest]
    share = patch / patch.sum(axis=1, keepdims=True)
    rest, *moved = (points[seen] for points in place)
    turns = [
        np.angle(share @ (np.conj(rest) * points) - np.conj(share @ rest) * (share @ points))
        for points in moved
    ]
    return float(np.subtract(*np.abs(turns[::-1])).max(initial=0.0))


def measure_turns(
    reference: Reference, position: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, " m"]:
    """Rotation of the gel around each dot since rest [rad]; NaN with fewer than three neighbours.

    Args:
        reference: the dots at rest.
        position: of the dots [px]; NaN where not visible.
    """
    rest, now = (_arms(points, reference) for points in (reference.position, position))
    product = np.where(reference.neighbours >= 0, np.conj(rest) * now, np.nan)
    known = np.isfinite(product)
    turn = np.angle(np.where(known, product, 0.0).sum(axis=1))
    return np.where(known.sum(axis=1) >= 3, turn, np.nan)


def _arms(points: Float[np.ndarray, "m 2"], reference: Reference) -> Complex[np.ndarray, "m k"]:
    """From each dot to its neighbours, as complex numbers [px]."""
    place = points @ np.array([1.0, 1.0j])
    return place[reference.neighbours] - place[:, None]
