"""The contact region of object and pad, and its stick centre.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Section IV-B.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.fields.stencils import Stencils

CONTACT_SHARE = 0.5
"""Share of the largest indentation above which a marker is in contact [-]."""


def find_contact(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n 3"],
    indentation: Float[np.ndarray, " n"],
    has_rotation: Bool[np.ndarray, " n"],
    onset_mm: float,
    share: float,
) -> tuple[Bool[np.ndarray, " n"], int]:
    """Markers of the contact region, and the stick centre among them ([Li2024] IV-B).

    The region consists of the markers that are pressed in by at least a share of the largest normal
    displacement, and of pressed markers that they surround: a flat object as soft as the elastomer
    presses its rim in deepest and its middle hardly. A contact is reported once the stick centre
    has moved by the onset and its neighbours have followed, unlike in a peak of noise. A region
    with surrounded markers also counts once half of its rim is pressed in by the onset. A
    recording in two dimensions has no normal displacement: all markers belong to the contact once
    one of them has moved by the onset.

    Args:
        stencils: stencils of the layout.
        displacement: displacements [mm]; NaN for markers that are not visible.
        indentation: displacement into the elastomer [mm].
        has_rotation: markers whose rotation is known, among which the centre is chosen.
        onset_mm: displacement from which a contact is reported [mm].
        share: share of the largest normal displacement [-].

    Returns:
        The region, empty without contact, and the index of the centre, −1 without contact.
    """
    # share of the largest normal displacement from which surrounded markers count as touched
    surrounded_share = 0.05
    visible = np.isfinite(indentation)
    region = visible & has_rotation
    moved = np.sqrt(np.einsum("ni,ni->n", displacement, displacement))
    pressed_on = False
    if not stencils.flat:
        deepest = indentation[visible].max(initial=0.0)
        pressed = region & (indentation > surrounded_share * deepest)
        region &= (indentation >= share * deepest) & (deepest > 0.0)
        filled = _fill_hollow(stencils.reference[:, :2], region, pressed)
        hollow = bool((filled & ~region).any())
        pressed_on = hollow and float(np.median(indentation[region])) >= onset_mm
        region = filled
    if region.any():
        centre = find_stick_centre(stencils.reference, displacement, stencils.normals, region)
        moved_on = (moved[region].max() if stencils.flat else moved[centre]) >= onset_mm
        peak = not stencils.flat and _is_peak(stencils, displacement, centre)
        if (moved_on and not peak) or pressed_on:
            return region, centre
    return np.zeros_like(region), -1


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
    stencils: Stencils, displacement: Float[np.ndarray, "n 3"], region: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], int]:
    """A contact region given by the source, and its stick centre; −1 without contact."""
    if not region.any():
        return region, -1
    return region, find_stick_centre(stencils.reference, displacement, stencils.normals, region)


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
