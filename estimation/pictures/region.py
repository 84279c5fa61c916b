"""Where the object touches, from one view: how far dots have gone, or how light has changed.

[Li2024] Section IV-B names both for sensors with one camera and discrete markers.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from collections import deque

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from estimation.fields.contact import reaches_edge
from estimation.pictures.lattice import Reference

SHARE = 0.35
"""Share of the largest dispersion that bounds the region [-]."""
ONSET = 0.04
"""Displacement from which there is contact [pitches]; 0.1 mm would be a tenth on most pads."""
LIGHT_ONSET = 6.0
"""Change of grey level, of 255, from which there is contact."""
MIDDLE = 9
"""Markers that are a contact's middle; around it a jump of a pivot tears others out of sight."""
NOT_SETTLED = "a contact at the edge of the view has not settled"
"""Why the angle of a contact that comes into view is not judged."""
SETTLED, ALIKE = 8, 0.7
"""Frames over which a contact must have kept this share of its markers to be all in view."""


def region_of_dispersion(
    reference: Reference,
    displacement: Float[np.ndarray, "m 2"],
    whole: Bool[np.ndarray, " m"] | None = None,
) -> Bool[np.ndarray, " m"]:
    """The contact region by the dispersion of the translation field.

    A dot's dispersion is the root mean square displacement of it and its neighbours: gel that
    rests has none, gel that is pressed aside, dragged or twisted has much. The region is the convex
    hull of where it is large, so that the middle of a twist, which stays in place, belongs to it.

    Args:
        reference: the dots at rest.
        displacement: from there [px]; NaN where not seen. Of dots whose place at rest is in doubt
            only what goes beyond the doubt counts.
        whole: dots that the picture's side does not cut; those that it cuts jump, and do not count.
            All by default.
    """
    seen = np.isfinite(displacement[:, 0])
    counts = seen if whole is None else seen & whole
    far = np.linalg.norm(np.nan_to_num(displacement), axis=1)
    far = far if reference.doubt is None else np.maximum(far - reference.doubt, 0.0)
    squared = np.where(counts, far**2, 0.0)
    with_self = np.concatenate([np.arange(len(seen))[:, None], reference.neighbours], axis=1)
    known = (with_self >= 0) & counts[with_self]
    count = np.maximum(known.sum(axis=1), 1)
    dispersion = np.sqrt(np.where(known, squared[with_self], 0.0).sum(axis=1) / count)
    most = dispersion[counts].max(initial=0.0)
    if most < ONSET * reference.pitch:
        return np.zeros_like(seen)
    return seen & _hull(reference.position, seen & (dispersion >= SHARE * most))


def region_of_light(
    reference: Reference,
    before: Shaped[np.ndarray, "h w *colour"],
    now: Shaped[np.ndarray, "h w *colour"],
    position: Float[np.ndarray, "m 2"],
) -> Bool[np.ndarray, " m"]:
    """The contact region by the change of light since an unloaded picture.

    Args:
        reference: the dots at rest.
        before: the unloaded picture.
        now: the picture of the frame.
        position: dots of the frame [px]; NaN where not seen.
    """
    change = np.abs(_smooth(now, reference.pitch) - _smooth(before, reference.pitch))
    change = change.max(axis=-1) if change.ndim == 3 else change
    seen = np.isfinite(position[:, 0])
    pixel = np.clip(np.rint(np.nan_to_num(position)), 0, np.array(change.shape[::-1]) - 1)
    level = np.where(seen, change[pixel[:, 1].astype(int), pixel[:, 0].astype(int)], 0.0)
    if level.max(initial=0.0) < LIGHT_ONSET:
        return np.zeros_like(seen)
    return seen & (level >= max(0.5 * LIGHT_ONSET, SHARE * level.max()))


def region_of_print(
    reference: Reference, level: Float[np.ndarray, " m"], printed: bool
) -> Bool[np.ndarray, " m"]:
    """The contact region by what the object prints: its edges and texture.

    It tells a contact in a clip of which no unloaded frame is known, and that one has ended. A dot
    counts by the median of it and its neighbours: a scratch or a speck in the gel is no print.

    Args:
        reference: the dots at rest.
        level: texture around each dot; NaN where not seen.
        printed: whether an object was printed in the last frame.
    """
    # texture around a dot, over that of the pad where nothing touches it, from which an object is
    # printed there, and from which it still is if it was in the last frame [-]. Empty pads were at
    # 1.7 at most, objects that the eye sees at 2.9 and more
    begins, lasts = 2.2, 1.9
    # share of the dots, those with the least texture, that nothing is taken to touch [-]
    bare_share = 0.05
    least_print = 4.0  # grey levels, of 255 and over all colours, that a print must have at least
    # dots that an object's print must show: as many as a contact at the edge of the view
    least_printed = 12
    seen = np.isfinite(level)
    if seen.sum() < least_printed:
        return np.zeros_like(seen)
    around = np.concatenate([np.arange(len(level))[:, None], reference.neighbours], axis=1)
    levels = np.sort(np.where(around >= 0, level[around], np.nan), axis=1)  # NaN at the end
    count = np.maximum(np.isfinite(levels).sum(axis=1), 1)
    median = np.take_along_axis(levels, ((count - 1) // 2)[:, None], axis=1)[:, 0]
    bare = np.interp(bare_share, np.linspace(0.0, 1.0, int(seen.sum())), np.sort(level[seen]))
    least = max((lasts if printed else begins) * float(bare), least_print)
    region = seen & (median >= least)
    if region.sum() < least_printed:
        return np.zeros_like(seen)
    return seen & _hull(reference.position, region)


def find_unseen_flaw(
    rest: Float[np.ndarray, "m 2"],
    contact: Bool[np.ndarray, " m"],
    seen: Bool[np.ndarray, " m"],
) -> str:
    """Why a contact region cannot be judged: its middle is not seen; empty if it is.

    Motion blurs the middle of a contact, and a cover or a tear may lie over it.

    Args:
        rest: the markers at rest [px].
        contact: the contact region, of markers that are seen.
        seen: which are.
    """
    region = np.flatnonzero(_hull(rest, contact))
    if not len(region):
        return ""
    place = rest[region]
    far = np.linalg.norm(place - place.mean(axis=0), axis=1)
    middle = region[np.argsort(far)[:MIDDLE]]
    if seen[middle].any():
        return ""
    return f"none of the {len(middle)} markers in the contact's centre is visible"


def find_tear_flaw(
    neighbours: Int[np.ndarray, "m 4"],
    rest: Float[np.ndarray, "m d"],
    now: Float[np.ndarray, "m d"],
) -> str:
    """Why a pattern is no longer one piece, empty if it is.

    Along a line of four markers the displacement of gel goes on from the second to the third as it
    does before, after, or in between the two; where the gel is torn it jumps. One marker that is
    not seen may lie in the tear. Either side is recognised by itself, so that only this tells that
    what has moved is not what turns.

    Args:
        neighbours: of each marker, those before and after it along each of two lines; −1 for none.
        rest: positions at rest.
        now: positions now; NaN where not seen.
    """
    # jump of the displacement between neighbours beyond which the pattern is torn [pitches], and
    # the fewest such places; around slipping contacts 0.42 was found, at μp₀/2G* = 0.5 and 20°
    torn_off, torn_most = 0.5, 4
    moved = np.append(now - rest, np.full((1, rest.shape[1]), np.nan), axis=0)
    place = np.append(rest, np.full((1, rest.shape[1]), np.nan), axis=0)
    beside = np.append(neighbours, np.full((1, 4), -1), axis=0)
    pitch = float(np.nanmedian(np.linalg.norm(place[beside[:, 0]] - place, axis=1)))
    jumps = []
    for before, after in ((0, 1), (2, 3)):
        second = np.arange(len(rest))
        third = beside[second, after]
        for far in (1, 2):
            if far == 2:  # the one between is not seen
                third = np.where(np.isnan(moved[third, 0]), beside[third, after], -1)
            earlier = moved[second] - moved[beside[second, before]]
            later = moved[beside[third, after]] - moved[third]
            step = moved[third] - moved[second]
            goings = earlier, later, 0.5 * (earlier + later)
            beyond = [np.linalg.norm(step - far * going, axis=1) for going in goings]
            jumps.append(np.min(beyond, axis=0))
    torn = np.concatenate(jumps) / pitch
    torn = torn[torn > torn_off]
    if len(torn) < torn_most:
        return ""
    return (
        f"the pattern is torn: in {len(torn)} places neighbouring markers have moved apart, by "
        f"{np.median(torn):.1f} of the distance between them"
    )


class Arrival:
    """Tells a contact that comes into view over its edge from one that is all there.

    Of an object that is pushed in from the side ever new parts come into view: neither what its
    markers did before is known, nor is what is seen of it the same from frame to frame.
    """

    def __init__(self, reference: Reference) -> None:
        """Start at the first frame of a clip: a contact that is there then has arrived."""
        self.reference = reference
        self._arriving = False
        self._before: deque[np.ndarray] | None = None

    def find_flaw(self, contact: Bool[np.ndarray, " m"]) -> str:
        """Why the contact in the next frame cannot be judged yet, empty if it can."""
        if not contact.any():
            self._arriving, self._before = False, deque(maxlen=SETTLED)
            return ""
        if self._before is None:
            return ""
        if len(self._before) < SETTLED:
            self._arriving |= reaches_edge(self.reference.neighbours, contact)
        self._before.append(contact)
        if len(self._before) == SETTLED:
            kept = min((c & contact).sum() / (c | contact).sum() for c in self._before)
            self._arriving &= bool(kept < ALIKE)
        return NOT_SETTLED if self._arriving else ""


def _smooth(image: Shaped[np.ndarray, "h w *colour"], pitch: float) -> np.ndarray:
    scale = 1.0 / 257.0 if image.dtype == np.uint16 else 1.0
    return cv2.GaussianBlur(image.astype(np.float32) * np.float32(scale), (0, 0), 0.5 * pitch)


def _hull(points: Float[np.ndarray, "m 2"], some: Bool[np.ndarray, " m"]) -> np.ndarray:
    """The points in the convex hull of some of them."""
    if some.sum() < 3:
        return some
    corner = cv2.convexHull(points[some].astype(np.float32))[:, 0].astype(float)
    side = np.roll(corner, -1, axis=0) - corner
    across = np.stack([-side[:, 1], side[:, 0]], axis=1)
    if abs(np.sum(across * corner)) < 1.0:  # twice the area [px²]: all on one line
        return some
    beyond = points @ across.T - np.sum(across * corner, axis=1)
    return some | (beyond >= 0.0).all(axis=1) | (beyond <= 0.0).all(axis=1)
