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
        moves: whether the print has moved since then, beyond its errors.
        gel: largest turn of the gel one way since then, beyond its turn the other way, that two
            frames in a row show [rad].
        last: this turn in the last frame [rad].
    """

    number: int
    planes: list[Float32[np.ndarray, "h w"]]
    position: Float[np.ndarray, "m 2"]
    turn: float = 0.0
    shift: float = 0.0
    moves: bool = False
    gel: float = 0.0
    last: float = 0.0

    def update(self, imprint: Imprint, turned: Float[np.ndarray, " k"], pitch: float) -> "_Start":
        """Take the next frame with the print.

        Args:
            imprint: motion of the print.
            turned: turn of the gel since the start around each dot in contact [rad].
            pitch: distance between neighbouring dots [px].
        """
        # standard errors and turn beyond them [rad], or shift [pitches], that show a motion
        errors, least_turn, least_shift = 4.0, np.radians(0.3), 0.1
        point = np.reshape(imprint.point[:4], (2, 2))
        shift = float(np.nan_to_num(np.linalg.norm(point[1] - point[0])))
        moves = abs(imprint.angle) > errors * imprint.error + least_turn
        turned = np.sort(turned[np.isfinite(turned)])[2:-2]  # single dots may jump
        # gel that is pressed away on all sides turns both ways
        gel = abs(float(turned[0] + turned[-1])) if len(turned) else 0.0
        return self._replace(
            turn=max(self.turn, abs(imprint.angle)),
            shift=max(self.shift, shift),
            moves=self.moves or moves or shift > least_shift * pitch,
            gel=max(self.gel, min(gel, self.last)),
            last=gel,
        )

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
        doubtful = np.radians(1.0)  # turn of the gel from which a print must have moved, too [rad]
        self.flaw = ""
        if not np.isfinite([imprint.angle, *imprint.point[:4]]).all():
            return range(0)  # a print that has just been found again may be another one
        if imprint.angle == 0.0 or self._start is None:
            self._start = _Start(number, painted.departing, position)
            return range(0)
        # both by the present reference, which may be new, and by dots that both frames show
        before = np.where(np.isnan(position), np.nan, self._start.position)
        after = np.where(np.isnan(before), np.nan, position)
        turns = [measure_turns(reference, p) for p in (after, before)]
        self._start = self._start.update(imprint, np.subtract(*turns)[contact], reference.pitch)
        if self._start.gel > doubtful and not self._start.moves:
            self.flaw = (
                "the gel turns while the print stands still: the object slips, or the print is a "
                "mark in the picture (--mask, --crop)"
            )
        if reference.strained:
            return range(0)
        turned = self._start.stood_still(np.subtract(*np.abs(turns)), reference.pitch)
        points = reference.position, before, after
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
