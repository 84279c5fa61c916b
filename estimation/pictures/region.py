"""The contact region from one view: by the displacement of dots, or by the change of light.

[Li2024] Section IV-B names both methods for sensors with one camera and discrete markers.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from estimation.fields.contact import reaches_edge
from estimation.frames.recording import Flaw, Hidden
from estimation.pictures.lattice import Reference


def region_of_dispersion(
    reference: Reference,
    displacement: Float[np.ndarray, "m 2"],
    whole: Bool[np.ndarray, " m"] | None = None,
    touched: bool = False,
) -> Bool[np.ndarray, " m"]:
    """The contact region by the dispersion of the translation field.

    A dot's dispersion is the root mean square displacement of the dot and its neighbours. It is
    zero at rest, and large where the gel is pressed aside, dragged or twisted. The region is the
    convex hull of the dots with large dispersion, so that it includes the centre of a twist, which
    stays in place.

    Args:
        reference: the dots at rest.
        displacement: from rest [px]; NaN where not visible. Where the position at rest is
            uncertain, only the displacement beyond that uncertainty counts.
        whole: dots that the picture's edge does not cut; cut dots jump and do not count. All by
            default.
        touched: whether there was a contact in the last frame.
    """
    # displacement from which a contact begins, and down to which it lasts [pitches]; 0.1 mm is a
    # tenth on most pads
    begins, lasts = 0.04, 0.035
    share = 0.35  # dispersion at the region's boundary, over the largest [-]
    seen = np.isfinite(displacement[:, 0])
    counts = seen if whole is None else seen & whole
    far = np.linalg.norm(np.nan_to_num(displacement), axis=1)
    far = far if reference.doubt is None else np.maximum(far - reference.doubt, 0.0)
    squared = np.where(counts, far**2, 0.0)
    with_self = np.concatenate([np.arange(len(seen))[:, None], reference.neighbours], axis=1)
    counted = (with_self >= 0) & counts[with_self]
    count = np.maximum(counted.sum(axis=1), 1)
    dispersion = np.sqrt(np.where(counted, squared[with_self], 0.0).sum(axis=1) / count)
    largest = dispersion[counts].max(initial=0.0)
    if largest < (lasts if touched else begins) * reference.pitch:
        return np.zeros_like(seen)
    return seen & fill_hull(reference.position, seen & (dispersion >= share * largest))


def region_of_light(
    reference: Reference,
    before: Shaped[np.ndarray, "h w *colour"],
    now: Shaped[np.ndarray, "h w *colour"],
    position: Float[np.ndarray, "m 2"],
    gain: float = 1.0,
) -> Bool[np.ndarray, " m"]:
    """The contact region by the change of light since an unloaded picture.

    Args:
        reference: the dots at rest.
        before: the unloaded picture.
        now: the picture of the frame.
        position: dots of the frame [px]; NaN where not visible.
        gain: factor by which the pictures are brightened [-].
    """
    onset = 6.0  # change from which contact is detected [grey levels of 255]
    share = 0.35  # change at the region's boundary, over the largest [-]
    change = gain * np.abs(_smooth(now, reference.pitch) - _smooth(before, reference.pitch))
    change = change.max(axis=-1) if change.ndim == 3 else change
    seen = np.isfinite(position[:, 0])
    pixel = np.clip(np.rint(np.nan_to_num(position)), 0, np.array(change.shape[::-1]) - 1)
    level = np.where(seen, change[pixel[:, 1].astype(int), pixel[:, 0].astype(int)], 0.0)
    if level.max(initial=0.0) < onset:
        return np.zeros_like(seen)
    return seen & (level >= max(0.5 * onset, share * level.max()))


def region_of_print(
    reference: Reference, level: Float[np.ndarray, " m"], printed: bool
) -> Bool[np.ndarray, " m"]:
    """The contact region by the object's print: its edges and texture.

    It detects the start and the end of a contact in clips without a known unloaded frame. Each dot
    takes the median texture of itself and its neighbours, so that scratches and specks in the gel
    do not count as a print.

    Args:
        reference: the dots at rest.
        level: texture around each dot; NaN where not visible.
        printed: whether an object was printed in the last frame.

    Returns:
        The dots with a print; `OneContact` fills the gaps between them.
    """
    # texture around a dot over the texture of the untouched pad, from which a print begins, and
    # down to which it lasts if there was one in the last frame [-]. Empty pads reached 1.7 at most;
    # objects visible to the eye 2.9 and more
    begins, lasts = 2.2, 1.9
    # share of the dots with the least texture, which count as untouched [-]
    bare_share = 0.05
    least_print = 4.0  # least texture of a print [grey levels of 255, over all colours]
    # least number of dots in a print: as many as in a contact at the edge of the view
    least_printed = 12
    seen = np.isfinite(level)
    if seen.sum() < least_printed:
        return np.zeros_like(seen)
    around = np.concatenate([np.arange(len(level))[:, None], reference.neighbours], axis=1)
    levels = np.sort(np.where(around >= 0, level[around], np.nan), axis=1)  # NaN at the end
    count = np.maximum(np.isfinite(levels).sum(axis=1), 1)
    median = levels[np.arange(len(levels)), (count - 1) // 2]
    bare = np.interp(bare_share, np.linspace(0.0, 1.0, int(seen.sum())), np.sort(level[seen]))
    least = max((lasts if printed else begins) * float(bare), least_print)
    region = seen & (median >= least)
    return region if region.sum() >= least_printed else np.zeros_like(seen)


class OneContact:
    """Follows one of several contacts whose prints lie apart.

    The first is followed, or the largest of those that begin together. When it ends, one frame has
    no contact, and then the largest of the others is followed. One object may print in parts, but
    in 48 published clips no such parts had bare gel two dots wide between them. The change of light
    and the displacement do not show contacts apart: both may fall to 0 in the middle of one.
    """

    def __init__(self, reference: Reference) -> None:
        """Begin without contact.

        Args:
            reference: the dots at rest.
        """
        reach = 2.3  # distance up to which dots belong to the same contact [pitches]
        self._place = reference.position
        away = np.linalg.norm(self._place[:, None] - self._place, axis=2)
        self._linked = away < reach * reference.pitch
        self.others = np.zeros(len(self._place), dtype=bool)
        """Dots under and around other contacts in the last frame."""
        self.last = self.others
        """The contact in the last frame."""

    def follow(self, region: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """The part of a print that is the followed contact; all of it if no part lies apart.

        Args:
            region: the dots with a print.
        """
        least = 5  # dots of another contact
        last, before, self.others = self.last, self.others, np.zeros_like(region)
        if not region.any():
            return region
        dots = np.flatnonzero(region)
        part = _label_parts(self._linked[np.ix_(dots, dots)])
        size = np.bincount(part)
        kept = np.bincount(part, weights=last[dots])
        ended = bool(last.any() and before.any() and not kept.any())
        followed = -1 if ended else int((kept if kept.any() else size).argmax())
        away = size >= least
        away[followed] &= ended
        if not away.any():
            return region
        mine, theirs = dots[part == followed], dots[away[part]]
        gap = [
            np.linalg.norm(self._place[:, None] - self._place[of], axis=2) for of in (theirs, mine)
        ]
        self.others = gap[0].min(axis=1) < gap[1].min(axis=1, initial=np.inf)
        return np.isin(np.arange(len(region)), mine)


def _label_parts(linked: Bool[np.ndarray, "n n"]) -> Int[np.ndarray, " n"]:
    """Label connected dots by the lowest number among them; faster than SciPy for so few."""
    label = np.arange(len(linked))
    while True:
        lower = np.where(linked, label, len(label)).min(axis=1)
        lower = lower[lower]  # jump to the label's own label, since parts are long
        if (lower == label).all():
            return label
        label = lower


def find_unseen_flaw(
    rest: Float[np.ndarray, "m 2"],
    contact: Bool[np.ndarray, " m"],
    seen: Bool[np.ndarray, " m"],
) -> str:
    """Why a contact cannot be judged: its centre is not visible; empty if it is.

    Motion blur, a cover or a tear may hide the centre of a contact.

    Args:
        rest: the markers at rest [px].
        contact: the visible markers in contact.
        seen: which markers are visible.
    """
    central = 9  # markers that form the centre; a jump in a pivot may hide markers further out
    if np.count_nonzero(~seen) < min(central, np.count_nonzero(contact)):
        return ""  # too few are hidden to hide a centre
    region = np.flatnonzero(fill_hull(rest, contact))
    if not len(region):
        return ""
    place = rest[region]
    far = np.linalg.norm(place - place.mean(axis=0), axis=1)
    middle = region[np.argsort(far)[:central]]
    return "" if seen[middle].any() else Hidden.CENTRE


def find_tear_flaw(
    neighbours: Int[np.ndarray, "m 4"],
    rest: Float[np.ndarray, "m d"],
    now: Float[np.ndarray, "m d"],
) -> str:
    """Why a pattern is no longer one piece; empty if it is.

    Along a line of four markers, the displacement of whole gel changes from the second to the third
    as it does before them, after them, or as the mean of the two. A tear shows as a jump. One
    marker in the tear may be hidden. Each side of a tear is recognised on its own, so that only
    this check distinguishes a tear from a rotation.

    Args:
        neighbours: of each marker, the ones before and after it along each of two lines; −1 for
            none.
        rest: positions at rest.
        now: current positions; NaN where not visible.
    """
    # jump of the displacement between neighbours from which the pattern is torn [pitches], and
    # the fewest such places; around slipping contacts it reached 0.42, at μp₀/2G* = 0.5 and 20°
    torn_off, torn_most = 0.5, 4
    moved = np.append(now - rest, np.full((1, rest.shape[1]), np.nan), axis=0)
    place = np.append(rest, np.full((1, rest.shape[1]), np.nan), axis=0)
    linked = np.append(neighbours, np.full((1, 4), -1), axis=0)
    pitch = float(np.nanmedian(np.linalg.norm(place[linked[:, 0]] - place, axis=1)))
    jumps = []
    for before, after in ((0, 1), (2, 3)):
        second = np.arange(len(rest))
        third = linked[second, after]
        for far in (1, 2):
            if far == 2:  # the marker between them is hidden
                third = np.where(np.isnan(moved[third, 0]), linked[third, after], -1)
            earlier = moved[second] - moved[linked[second, before]]
            later = moved[linked[third, after]] - moved[third]
            step = moved[third] - moved[second]
            expected = earlier, later, 0.5 * (earlier + later)
            beyond = [np.linalg.norm(step - far * change, axis=1) for change in expected]
            jumps.append(np.min(beyond, axis=0))
    torn = np.concatenate(jumps) / pitch
    torn = torn[torn > torn_off]
    if len(torn) < torn_most:
        return ""
    return (
        f"the pattern is torn: neighbouring markers have moved apart in {len(torn)} places, by "
        f"{np.median(torn):.1f} of their distance at rest"
    )


class Bare(NamedTuple):
    """A picture that seems unloaded, around each dot.

    Attributes:
        light: mean of each colour [grey levels of 255]; NaN where not visible.
        level: texture [grey levels of 255, over all colours]; NaN where not visible.
    """

    light: Float[np.ndarray, "m k"]
    level: Float[np.ndarray, " m"]


def region_of_shade(reference: Reference, bare: Bare, now: Bare) -> Bool[np.ndarray, " m"]:
    """The contact region by a change of light in one part of the picture.

    It detects smooth objects, which neither print nor move the dots. A change of most of the
    picture comes from lamps or exposure. The picture with less texture is that of the bare gel: if
    it is the present one, an object has gone.

    Args:
        reference: the dots at rest.
        bare: the picture that seems unloaded.
        now: the picture of the frame.
    """
    onset = 8.0  # change against the other dots from which contact is detected [grey levels]
    share = 0.35  # change at the region's boundary, over the largest [-]
    largest_part = 0.5  # of the dots that the region may hold [-]
    more = 1.3  # texture over that of the bare gel [-]
    change = now.light - bare.light
    seen = np.isfinite(change[:, 0])
    if seen.sum() < 3:
        return np.zeros_like(seen)
    change = np.abs(change - np.median(change[seen], axis=0)).max(axis=1)
    change[~seen] = 0.0
    most = np.sort(change)[-3]  # one dot may be wrong
    region = seen & (change >= share * most)
    textured = np.median(now.level[region]) > more * np.median(bare.level[region])
    if most < onset or region.sum() > largest_part * seen.sum() or not textured:
        return np.zeros_like(seen)
    return seen & fill_hull(reference.position, region)


class Arrival:
    """Detects contacts that are still entering the view across its edge.

    New parts of an object that is pushed in from the side keep coming into view: the earlier motion
    of their markers is unknown, and the visible part changes from frame to frame.
    """

    def __init__(self, reference: Reference) -> None:
        """Start at the first frame of a clip; a contact in that frame counts as arrived."""
        self.reference = reference
        self._arriving = False
        self._before: deque[np.ndarray] | None = None

    def find_flaw(self, contact: Bool[np.ndarray, " m"]) -> str:
        """Why the contact in the next frame cannot be judged yet; empty if it can."""
        # a contact counts as fully in view once this share of its markers was in it for 8 frames
        settled, alike = 8, 0.7
        if not contact.any():
            self._arriving, self._before = False, deque(maxlen=settled)
            return ""
        if self._before is None:
            return ""
        if len(self._before) < settled:
            self._arriving |= reaches_edge(self.reference.neighbours, contact)
        self._before.append(contact)
        if len(self._before) == settled:
            known = min((c & contact).sum() for c in self._before) / contact.sum()
            self._arriving &= bool(known < alike)
        return Flaw.NOT_SETTLED if self._arriving else ""


def _smooth(image: Shaped[np.ndarray, "h w *colour"], pitch: float) -> np.ndarray:
    scale = 1.0 / 257.0 if image.dtype == np.uint16 else 1.0
    return cv2.GaussianBlur(image.astype(np.float32) * np.float32(scale), (0, 0), 0.5 * pitch)


def fill_hull(
    points: Float[np.ndarray, "m 2"], chosen: Bool[np.ndarray, " m"]
) -> Bool[np.ndarray, " m"]:
    """The points in the convex hull of the chosen ones."""
    if chosen.sum() < 3:
        return chosen
    corner = cv2.convexHull(points[chosen].astype(np.float32))[:, 0].astype(float)
    side = np.roll(corner, -1, axis=0) - corner
    across = np.stack([-side[:, 1], side[:, 0]], axis=1)
    if abs(np.sum(across * corner)) < 1.0:  # twice the area [px²]: all on one line
        return chosen
    beyond = points @ across.T - np.sum(across * corner, axis=1)
    return chosen | (beyond >= 0.0).all(axis=1) | (beyond <= 0.0).all(axis=1)
