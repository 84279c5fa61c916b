"""Where the object touches the pad: the contact region and the stick centre.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Section IV-B.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.fields.stencils import Stencils

SHARE = 0.5


def find_contact(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n 3"],
    indentation: Float[np.ndarray, " n"],
    has_rotation: Bool[np.ndarray, " n"],
    onset_mm: float,
    share: float,
) -> tuple[Bool[np.ndarray, " n"], int]:
    """Markers of the contact region, and the stick centre among them ([Li2024] IV-B).

    The region holds the markers that are pressed in by at least a share of the largest normal
    displacement, and those that they surround: a flat object as soft as the elastomer presses its
    rim in deepest, and its middle hardly. There is contact once the stick centre has moved by the
    onset and is no peak of noise, which its neighbours do not follow; or, where there are
    such, half of the rim is pressed in by it. A recording in two dimensions has no normal
    displacement: every marker counts, once one has moved by the onset.

    Args:
        stencils: of the layout.
        displacement: displacements [mm]; NaN where a marker was not seen.
        indentation: displacement into the elastomer [mm].
        has_rotation: markers whose rotation is known; the centre is one of them.
        onset_mm: displacement from which there is contact [mm].
        share: share of the largest normal displacement [-].

    Returns:
        The region, empty without contact, and the centre, −1 without contact.
    """
    # share of the largest normal displacement from which surrounded markers count as touched
    surrounded_share = 0.05
    seen = np.isfinite(indentation)
    region = seen & has_rotation
    moved = np.sqrt(np.einsum("ni,ni->n", displacement, displacement))
    pressed_on = False
    if not stencils.flat:
        deepest = indentation[seen].max(initial=0.0)
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
    """A region whose middle is not part of it, with what is pressed in between its markers."""
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
    """Whether a marker and those beside it have on average moved by less than half as far."""
    beside = stencils.neighbours[marker]
    moved = displacement[[marker, *beside[beside >= 0]]]
    mean = moved[np.isfinite(moved[:, 0])].mean(axis=0)
    return bool(np.linalg.norm(mean) < 0.5 * np.linalg.norm(displacement[marker]))


def known_contact(
    stencils: Stencils, displacement: Float[np.ndarray, "n 3"], region: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], int]:
    """A contact region that the source knows, and the stick centre in it; −1 without contact."""
    if not region.any():
        return region, -1
    return region, find_stick_centre(stencils.reference, displacement, stencils.normals, region)


def reaches_edge(neighbours: Int[np.ndarray, "n k"], contact: Bool[np.ndarray, " n"]) -> bool:
    """Whether much of the contact lies at the edge of the markers, so that part of it is unseen.

    Args:
        neighbours: of each marker, −1 where there is none; markers at the edge have fewer.
        contact: the contact region.
    """
    # share of the contact's markers at the edge of the view from which part of it counts as unseen
    edge_share = 0.25
    count = (neighbours >= 0).sum(axis=1)
    typical = np.sort(count)[len(count) // 2]
    return bool(contact.any() and np.mean(count[contact] < typical) >= edge_share)


def find_stick_centre(
    reference: Float[np.ndarray, "n 3"],
    displacement: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    contact: Bool[np.ndarray, " n"],
) -> int:
    """Marker near the contact region's centre whose tangential motion is near the mean.

    The paper names both conditions and no weights: here both distances are measured in their
    root mean square over the region, and the marker with the least sum of squares is taken.

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
