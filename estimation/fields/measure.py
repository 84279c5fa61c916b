"""Fields of one frame: displacement, indentation, and each marker's rotation in its tangent plane.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (7), (8) and Fig. 5(b).

Pads are domed, so every marker has a tangent plane of its own. The deformation gradient of the
surface at a marker maps its reference tangent plane to the plane it has now; what is left after
the plane's own tilt has been taken back is a 2×2 gradient, and its rotation is the marker's φ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.equations import mean_line_rotation, polar_rotation
from estimation.fields.contact import SHARE, find_contact, known_contact
from estimation.fields.stencils import Stencils, cross, in_space, unit
from estimation.frames.recording import ONSET_MM, Frame


class Fields(NamedTuple):
    """What one frame says at each marker; NaN where it says nothing.

    Attributes:
        positions: marker positions [mm]; two-dimensional recordings have z = 0.
        displacement: positions minus reference [mm].
        indentation: displacement into the elastomer, along the reference normal [mm].
        normals: unit normals of the surface as it is now.
        rotation: φ, the mean rotation of two orthogonal lines, those nearest the grid's [rad].
            Without a grid no pair of lines is singled out; φ is then the mean over all pairs, the
            polar rotation. Where the source has measured the lines itself, φ is theirs.
        polar_rotation: rotation of the polar decomposition [rad].
        contact: markers of the contact region; none where there is no contact.
        centre: the stick centre, a marker of the contact region; −1 where there is no contact.
        imprint: rotation of what the object prints, and its standard error [rad]; NaN if unknown.
    """

    positions: Float[np.ndarray, "n 3"]
    displacement: Float[np.ndarray, "n 3"]
    indentation: Float[np.ndarray, " n"]
    normals: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, " n"]
    polar_rotation: Float[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    centre: int
    imprint: tuple[float, float] = (float("nan"), float("nan"))


def measure_fields(
    stencils: Stencils,
    frame: Frame,
    *,
    onset_mm: float = ONSET_MM,
    share: float = SHARE,
) -> Fields:
    """Displacement, rotation and contact region of a frame.

    Args:
        stencils: of the layout that the frame's markers belong to.
        frame: the frame.
        onset_mm: displacement of the stick centre from which there is contact [mm].
        share: share of the largest normal displacement that bounds the contact region [-].
    """
    positions = np.where(frame.valid[:, None], in_space(frame.positions), np.nan)
    displacement = positions - stencils.reference
    indentation = -np.einsum("ni,ni->n", displacement, stencils.normals)
    normals, gradient = _surface_gradient(stencils, positions)
    polar = np.asarray(polar_rotation(gradient))
    rotation = np.asarray(mean_line_rotation(gradient)) if stencils.gridded else polar
    if frame.rotation is not None:
        rotation = np.where(frame.valid & np.isfinite(frame.rotation), frame.rotation, rotation)
    usable = np.isfinite(rotation)
    if frame.contact is None:
        contact, centre = find_contact(stencils, displacement, indentation, usable, onset_mm, share)
    else:
        contact, centre = known_contact(stencils, displacement, frame.contact & usable)
    return Fields(
        positions=positions,
        displacement=displacement,
        indentation=indentation,
        normals=normals,
        rotation=rotation,
        polar_rotation=polar,
        contact=contact,
        centre=centre,
        imprint=frame.imprint,
    )


def rotation_sensitivity(
    stencils: Stencils, markers: Bool[np.ndarray, " n"], valid: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3"]:
    """Derivative of the mean φ over `markers` by every marker's position [rad/mm].

    To first order in the deformation; with it the variance of the mean follows from the marker
    noise, shared neighbours included.
    """
    weights, inverse = _stencil_weights(stencils, valid)
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
    """Turn vectors by the smallest rotation that takes the unit vector `before` to `after`."""
    axis = cross(before, after)
    cosine = np.sum(before * after, axis=-1, keepdims=True)
    once = cross(axis, vectors)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN where a plane is turned over
        return vectors + once + cross(axis, once) / (1.0 + cosine)


def _surface_gradient(
    stencils: Stencils, positions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2 2"]]:
    """Current normals, and the deformation gradient with the tangent planes' tilt taken back."""
    weights, inverse = _stencil_weights(stencils, np.isfinite(positions[:, 0]))
    edges = positions[stencils.neighbours] - positions[:, None]
    edges = np.where(weights[..., None] > 0, edges, 0.0)
    images = edges.transpose(0, 2, 1) @ stencils.offsets @ inverse
    normals = unit(cross(images[..., 0], images[..., 1]))
    tangents = tilt(
        stencils.tangents.transpose(0, 2, 1), stencils.normals[:, None], normals[:, None]
    )
    return normals, tangents @ images


def _stencil_weights(
    stencils: Stencils, valid: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n 2 2"]]:
    """Which neighbours count, and the inverse normal matrix of each marker's plane fit."""
    weights = ((stencils.neighbours >= 0) & valid[stencils.neighbours] & valid[:, None]) * 1.0
    weighted = stencils.offsets * weights[..., None]
    normal_matrix = weighted.transpose(0, 2, 1) @ stencils.offsets
    a, b, d = normal_matrix[:, 0, 0], normal_matrix[:, 0, 1], normal_matrix[:, 1, 1]
    determinant = a * d - b * b
    enough = determinant > 1e-3 * (a + d) ** 2
    determinant = np.where(enough, determinant, np.nan)
    adjugate = np.stack([np.stack([d, -b], -1), np.stack([-b, a], -1)], -2)
    return weights, adjugate / determinant[:, None, None]
