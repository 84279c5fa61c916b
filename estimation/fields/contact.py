"""The contact region of object and pad, and its stick centre.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Section IV-B.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.fields.edge import Edge, find_edge, outline_edge
from estimation.fields.separate import separate
from estimation.fields.stencils import Stencils, mean_around

CONTACT_SHARE = 0.5
"""Share of the largest indentation above which a marker is in contact, if no edge fits [-]."""


class Region(NamedTuple):
    """The contact region of a frame.

    Attributes:
        markers: the markers of the region, none without contact.
        centre: index of the stick centre; −1 without contact.
        edge: the fitted edge of the contact; None if none fits.
        others: markers under and around other contacts; None if there are none.
    """

    markers: Bool[np.ndarray, " n"]
    centre: int
    edge: Edge | None = None
    others: Bool[np.ndarray, " n"] | None = None


def find_contact(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n 3"],
    indentation: Float[np.ndarray, " n"],
    has_rotation: Bool[np.ndarray, " n"],
    onset_mm: float,
    share: float | None,
    last: Region | None = None,
) -> Region:
    """Markers of the contact region, and the stick centre among them ([Li2024] IV-B).

    The region consists of the markers within the contact's edge, which is fitted to the indentation
    (`estimation.fields.edge`). If no edge fits, or with a share, it consists of the markers that
    are pressed in by at least a share of the largest normal displacement, and of pressed markers
    that they surround: a flat object as soft as the elastomer presses its rim in deepest and its
    middle hardly. The stick centre is one of the pressed-in markers, since slip begins at the edge.
    A contact is reported once the stick centre has moved by the onset and its
    neighbours have followed, unlike in a peak of noise. A region with surrounded markers also
    counts once half of its rim is pressed in by the onset. A recording in two dimensions has no
    normal displacement: all markers belong to the contact once one of them has moved by the onset.

    Of several separate contacts, the first is followed, or the deepest of those that begin
    together. When it ends, one frame has no contact, and then the deepest of the others is
    followed.

    Args:
        stencils: stencils of the layout.
        displacement: displacements [mm]; NaN for markers that are not visible.
        indentation: displacement into the elastomer [mm].
        has_rotation: markers whose rotation is known, among which the centre is chosen.
        onset_mm: displacement from which a contact is reported [mm].
        share: share of the largest normal displacement; None to fit the edge [-].
        last: the region in the frame before.
    """
    apart = None if stencils.flat else separate(stencils, indentation, onset_mm)
    last = last or Region(np.zeros_like(has_rotation), -1)
    others = None
    if apart is not None:  # the markers nearest to another contact count as not visible
        followed = last.centre if last.centre >= 0 else int(np.nanargmax(indentation))
        others = apart != apart[followed]
        indentation = np.where(others, np.nan, indentation)
    region = _find_alone(stencils, displacement, indentation, has_rotation, onset_mm, share, last)
    ended = last.markers.any() and not (last.markers & region.markers).any()
    if ended and (others is not None or last.others is not None):
        return Region(np.zeros_like(has_rotation), -1)
    return region._replace(others=others)


def _find_alone(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n 3"],
    indentation: Float[np.ndarray, " n"],
    has_rotation: Bool[np.ndarray, " n"],
    onset_mm: float,
    share: float | None,
    last: Region,
) -> Region:
    """The region of the only contact; indentations near others are NaN."""
    # share of the largest normal displacement from which surrounded markers count as touched
    surrounded_share = 0.05
    visible = np.isfinite(indentation)
    region = known = visible & has_rotation
    moved = np.sqrt(np.einsum("ni,ni->n", displacement, displacement))
    pressed_on, edge, points = False, None, stencils.reference[:, :2]
    core = np.zeros_like(region)  # markers among which the stick centre lies; none: the region's
    if not stencils.flat:
        deepest = indentation[visible].max(initial=0.0)
        pressed = known & (indentation > surrounded_share * deepest)
        bound = CONTACT_SHARE if share is None else share
        region = known & (indentation >= bound * deepest) & (deepest > 0.0)
        filled = _fill_hollow(points, region, pressed)
        hollow = bool((filled & ~region).any())
        pressed_on = hollow and float(np.median(indentation[region])) >= onset_mm
        if share is None and not hollow and deepest >= onset_mm:
            edge = find_clear_edge(points, indentation, last.edge)
        deep, region = region, filled
        if edge is not None:
            region = known & (edge.distance <= 1.0)
            core = region & deep
    if region.any():
        core = core if core.any() else region
        centre = find_stick_centre(stencils.reference, displacement, stencils.normals, core)
        moved_on = (moved[region].max() if stencils.flat else moved[centre]) >= onset_mm
        if stencils.flat and last.markers.any():
            moved_on = moved_on or _is_strained(stencils, displacement, onset_mm)
        peak = not stencils.flat and _is_peak(stencils, displacement, centre)
        if (moved_on and not peak) or pressed_on:
            return Region(region, centre, edge)
    return Region(np.zeros_like(region), -1)


def _is_strained(
    stencils: Stencils, displacement: Float[np.ndarray, "n 3"], onset_mm: float
) -> bool:
    """Whether gel in the plane is still strained: neighbours have moved alike.

    An object that turns back moves the gel through nearly its unloaded shape.
    """
    least, alike = 0.3, 0.5  # share of the onset, and of the motion that neighbours share
    moved = np.nan_to_num(displacement[:, :2])
    shared = np.column_stack([mean_around(stencils, one) for one in moved.T])
    furthest = np.sqrt(np.sum(shared**2, axis=1).max())
    return bool(furthest >= least * onset_mm and np.sum(moved * shared) >= alike * np.sum(moved**2))


def find_clear_edge(
    points: Float[np.ndarray, "n 2"], indentation: Float[np.ndarray, " n"], last: Edge | None
) -> Edge | None:
    """The fitted edge of the contact; None if the fit is poor or the radius too uncertain."""
    largest_error, largest_misfit = 0.1, 0.25
    edge = find_edge(points, indentation, CONTACT_SHARE, last)
    if edge is None or edge.error > largest_error or edge.misfit > largest_misfit:
        return None
    return edge


def _fill_hollow(
    points: Float[np.ndarray, "n 2"],
    region: Bool[np.ndarray, " n"],
    pressed: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """The region; if its middle is missing, with the pressed markers that the region surrounds."""
    if not region.any():
        return region
    middle = np.argmin(np.sum((points - points[region].mean(axis=0)) ** 2, axis=1))
    if region[middle]:
        return region
    open_ = np.nonzero(pressed & ~region)[0]
    away = points[region] - points[open_, None]
    angle = np.sort(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    gap = np.diff(angle, axis=1, append=angle[:, :1] + 2.0 * np.pi).max(axis=1, initial=0.0)
    filled = region.copy()
    filled[open_[gap < np.pi]] = True
    return filled


def _is_peak(stencils: Stencils, displacement: Float[np.ndarray, "n 3"], marker: int) -> bool:
    """Whether a marker and its neighbours have on average moved less than half as far as it."""
    neighbours = stencils.neighbours[marker]
    moved = displacement[[marker, *neighbours[neighbours >= 0]]]
    mean = moved[np.isfinite(moved[:, 0])].mean(axis=0)
    return bool(np.linalg.norm(mean) < 0.5 * np.linalg.norm(displacement[marker]))


def known_contact(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n 3"],
    region: Bool[np.ndarray, " n"],
    exact: bool,
) -> Region:
    """A contact region given by the source, and its stick centre; −1 without contact.

    Without z, the edge of an exact region follows from its markers, unless the view cuts it.
    """
    if not region.any():
        return Region(region, -1)
    centre = find_stick_centre(stencils.reference, displacement, stencils.normals, region)
    whole = exact and stencils.flat and not reaches_edge(stencils.neighbours, region)
    return Region(region, centre, outline_edge(stencils.reference, region) if whole else None)


def reaches_edge(neighbours: Int[np.ndarray, "n k"], contact: Bool[np.ndarray, " n"]) -> bool:
    """Whether the edge of the view cuts the contact, since many of its markers lie at the edge.

    Args:
        neighbours: indices of each marker's neighbours, filled up with −1; markers at the edge have
            fewer.
        contact: the contact region.
    """
    edge_share = 0.25  # share of the contact's markers at the edge from which it is cut
    count = (neighbours >= 0).sum(axis=1)
    typical = np.sort(count)[len(count) // 2]
    return bool(contact.any() and np.mean(count[contact] < typical) >= edge_share)


def find_stick_centre(
    reference: Float[np.ndarray, "n 3"],
    displacement: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    contact: Bool[np.ndarray, " n"],
) -> int:
    """Index of a marker near the contact region's centre whose tangential motion is near the mean.

    The paper gives both conditions without weights. Here both distances are measured in units of
    their root mean square over the region, and the marker with the least sum of squares is chosen.

    Args:
        reference: unloaded positions [mm].
        displacement: displacements [mm].
        normals: unit normals of the unloaded surface.
        contact: the contact region, at least one marker.
    """
    markers = np.nonzero(contact)[0]
    motion = displacement[markers]
    across = normals[markers]
    motion = motion - np.sum(motion * across, axis=1, keepdims=True) * across
    return int(markers[np.argmin(_spread(reference[markers]) + _spread(motion))])


def _spread(vectors: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Squared distance of each vector from the mean, over the mean of the squared distances."""
    squared = np.sum((vectors - vectors.mean(axis=0)) ** 2, axis=1)
    mean = squared.mean()
    return squared / mean if mean > 0.0 else squared
