"""Fields of one frame: displacement, indentation, and each marker's rotation in its tangent plane.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (7), (8) and Fig. 5(b).

Pads are domed, so every marker has its own tangent plane. The deformation gradient of the surface
at a marker maps its reference tangent plane to its present one. Without the tilt of the plane it is
a 2×2 gradient, whose rotation is the marker's φ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.equations import mean_line_rotation, polar_rotation
from estimation.fields.contact import Region, find_contact, known_contact
from estimation.fields.edge import Edge
from estimation.fields.stencils import Stencils, cross, in_space, unit
from estimation.frames.recording import ONSET_MM, Frame


class Fields(NamedTuple):
    """Quantities of each marker in one frame; NaN where unknown.

    Attributes:
        positions: marker positions [mm]; two-dimensional recordings have z = 0.
        displacement: positions minus reference [mm].
        indentation: displacement into the elastomer, along the reference normal [mm].
        normals: unit normals of the deformed surface.
        rotation: φ, the mean rotation of two orthogonal lines, the pair nearest the grid lines
            [rad]. Without a grid, φ is the mean over all pairs of lines, the polar rotation. If the
            source measures rotations, φ is the source's.
        contact: markers of the contact region; empty without contact.
        centre: index of the stick centre, a marker of the contact region; −1 without contact.
        imprint: rotation of the object's imprint and its standard error [rad]; NaN if unknown.
        print_kept: smallest correlation over the parts of the object's print on the gel with that
            of a few frames before [-]; 0 where a picture does not show it, NaN without pictures.
        closed: whether the disc of sticking markers has closed, by their motion over some frames;
            None if unknown.
        grips: whether the inner half of the contact has just turned as one body.
        edge: the fitted edge of the contact; None if unknown.
        others: markers under and around other contacts, which count as not visible; None if there
            are none.
        lifted: whether the positions are lifted to the surface of a soft object, so that their
            noise is not that of the markers.
        bounded: whether the contact region is known. Otherwise all markers count as in contact.
    """

    positions: Float[np.ndarray, "n 3"]
    displacement: Float[np.ndarray, "n 3"]
    indentation: Float[np.ndarray, " n"]
    normals: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    centre: int
    imprint: tuple[float, float] = (float("nan"), float("nan"))
    print_kept: float = float("nan")
    closed: bool | None = None
    grips: bool = False
    edge: Edge | None = None
    others: Bool[np.ndarray, " n"] | None = None
    lifted: bool = False
    bounded: bool = True

    @property
    def region(self) -> Region:
        """The contact region."""
        return Region(self.contact, self.centre, self.edge, self.others)


def measure_fields(
    stencils: Stencils,
    frame: Frame,
    *,
    onset_mm: float = ONSET_MM,
    share: float | None = None,
    last: Region | None = None,
) -> Fields:
    """Displacement, rotation and contact region of a frame.

    Args:
        stencils: stencils of the frame's layout.
        frame: the frame.
        onset_mm: displacement of the stick centre from which a contact is reported [mm].
        share: share of the largest normal displacement that bounds the contact region; by default
            the region's edge is fitted [-].
        last: the contact region in the frame before.
    """
    positions = np.where(frame.valid[:, None], in_space(frame.positions), np.nan)
    displacement = positions - stencils.reference
    indentation = -np.einsum("ni,ni->n", displacement, stencils.normals)
    normals, gradient = _surface_gradient(stencils, positions)
    rotation = np.asarray((mean_line_rotation if stencils.gridded else polar_rotation)(gradient))
    if frame.rotation is not None:
        rotation = np.where(frame.valid & np.isfinite(frame.rotation), frame.rotation, rotation)
    usable = np.isfinite(rotation)
    if frame.contact is None:
        region = find_contact(stencils, displacement, indentation, usable, onset_mm, share, last)
    else:
        others = frame.others if frame.others is not None and frame.others.any() else None
        usable = usable if others is None else usable & ~others
        exact = not frame.pictured
        region = known_contact(stencils, displacement, frame.contact & usable, exact)
        region = region._replace(others=others)
    if region.others is not None:
        hidden = region.others[:, None]
        positions, displacement = (
            np.where(hidden, np.nan, one) for one in (positions, displacement)
        )
        indentation = np.where(region.others, np.nan, indentation)
    return Fields(
        positions=positions,
        displacement=displacement,
        indentation=indentation,
        normals=normals,
        rotation=rotation,
        contact=region.markers,
        centre=region.centre,
        imprint=frame.imprint,
        print_kept=float(np.nan_to_num(frame.hold[2])) if frame.pictured else frame.hold[2],
        edge=region.edge,
        others=region.others,
        bounded=frame.contact is not None or not stencils.flat,
    )


def rotation_sensitivity(
    stencils: Stencils, markers: Bool[np.ndarray, " n"], valid: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3"]:
    """Derivative of the mean φ over `markers` by every marker's position [rad/mm].

    It is of first order in the deformation. With it, the variance of the mean follows from the
    marker noise, including the effect of shared neighbours.
    """
    weights, inverse = stencils.fit_planes(valid)
    per_edge = np.einsum("nk,nkj,nji->nki", weights, stencils.offsets, inverse)[markers]
    e1, e2 = stencils.tangents[markers][..., 0], stencils.tangents[markers][..., 1]
    share = 0.5 * (per_edge[..., :1] * e2[:, None] - per_edge[..., 1:] * e1[:, None])
    share = np.where(weights[markers][..., None] > 0, share, 0.0) / markers.sum()
    sensitivity = np.zeros_like(stencils.reference)
    np.add.at(sensitivity, stencils.neighbours[markers], share)
    np.add.at(sensitivity, np.nonzero(markers)[0], -share.sum(axis=1))
    return sensitivity


def tilt(
    vectors: Float[np.ndarray, "*batch 3"],
    before: Float[np.ndarray, "*#batch 3"],
    after: Float[np.ndarray, "*#batch 3"],
) -> Float[np.ndarray, "*batch 3"]:
    """Rotate vectors by the smallest rotation that maps the unit vector `before` to `after`."""
    axis = cross(before, after)
    cosine = np.sum(before * after, axis=-1, keepdims=True)
    once = cross(axis, vectors)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN where a plane is turned over
        return vectors + once + cross(axis, once) / (1.0 + cosine)


def _surface_gradient(
    stencils: Stencils, positions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2 2"]]:
    """Present normals, and the deformation gradient without the tilt of the tangent planes."""
    weights, inverse = stencils.fit_planes(np.isfinite(positions[:, 0]))
    edges = positions[stencils.neighbours] - positions[:, None]
    edges = np.where(weights[..., None] > 0, edges, 0.0)
    images = edges.transpose(0, 2, 1) @ stencils.offsets @ inverse
    normals = unit(cross(images[..., 0], images[..., 1]))
    tangents = tilt(
        stencils.tangents.transpose(0, 2, 1), stencils.normals[:, None], normals[:, None]
    )
    return normals, tangents @ images
