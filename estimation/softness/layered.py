"""Softness of an object on an elastomer of finite thickness, its markers below the surface.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (2) and (13).

Every wave q that turns the elastomer turns the object's surface against it by
k̂(q) = k coth(qh) (`contactmodel.layer_gain`, the object a half-space), and markers at the
depth z turn by D(q) = sinh(q(h − z))/sinh(qh) of the surface. Where the object sticks to it the
elastomer therefore does not move as one body, and no one rotation φ is there to be multiplied by
1 + k. But the displacement u of the markers, lifted to

    ũ = u + (1/D − 1) u + k/(1 + k) · (coth qh − 1)/D · u

by its waves that turn (transverse ones), is (1 + k)⁻¹ of the object's own motion there, whatever
slips beside: what a thick elastomer's surface would show. Frames are lifted before anything is
sought in them, and Eq. (13) with the number k holds for what is found.

Longitudinal waves have no curl, but a rigid fit of a long contact takes in the shear that they
bring across it. Between incompressible bodies they count with
k̂_L(q) = k (sinh²x + x² + 1)/(sinh x cosh x + x), x = qh. Frames are not lifted by them: most of
what they carry is the squeeze of a thin elastomer, which would make the contact larger than it is.
What they add to the rotation of what sticks is a load term L of Eq. (13) instead, of which the
squeeze, by its symmetry, is no part.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from contactmodel.common.settings import check_limits, to_table, unit
from estimation.softness.bar import check_edge
from estimation.softness.contact import (
    RATIO_METADATA,
    Contact,
    Lifting,
    Validity,
    check_covariance,
)
from estimation.softness.lifting import Seen, Sizes, lifting_kernels, marker_pitch
from estimation.softness.scalar import ScalarSoftness

Matrix = tuple[tuple[float, ...], ...]

LARGEST_SHARE = 0.45
"""Radius of the contact over a ball's up to which contacts are covered: finite elements reach 0.4,
and the radius of a contact is read from markers [-]."""


@dataclass(frozen=True)
class LayeredSoftness:
    """Stiffness ratio of an object, and the elastomer that it is held against.

    The object is a half-space, or a ball, whose surface yields more (`contactmodel.ball_gain`), or
    a plate or cylinder that is gripped at its back. The interval takes the part of a ball and of a
    plate as known to 8 %, since it depends on the shape beside the contact. Of a cylinder it takes
    the whole turn against the gel as known to 1.5 %, or to 3 % if the markers have no z, which
    shows how far the cylinder is compressed. It takes the parts of a round tip and of the grip as
    known to 30 %. A plate must be higher than the markers' pitch. A square bar turns like a
    cylinder with 0.547 of its width as `object_side`; `object_edge` is for round ones. Under a ball
    or round tip, contacts wider than 0.45 R are not covered (`Track.covered`).

    Attributes:
        stiffness_ratio: k = G_S/G_B, elastomer over object [-]; 0 for a rigid object.
        thickness: h of the elastomer, bonded to its base; infinite for a half-space [mm].
        depth: z of the markers below the surface [mm].
        object_radius: R of a ball or round tip; infinite for a flat surface [mm].
        object_height: H from the contact to the grip; infinite if far [mm].
        object_side: radius of a cylinder's side, requires its height; infinite for a plate [mm].
        object_edge: radius of the edge between a cylinder's flat face and its side, at most half of
            `object_side`; it counts for low cylinders [mm].
        covariance: of (k, h, z), row by row.
        validity: the contacts that it was fitted to.
        provenance: where it came from, for readers.

    Raises:
        ValueError: a value out of range, or a covariance that is none.

    Examples:
        >>> import numpy as np
        >>> from estimation import LayeredSoftness, PivotModel, estimate_angles, simulate_pivot
        >>> few = PivotModel(stiffness_ratio=0.5, grid_shape=(10, 10), pitch=2.0)
        >>> recording, _ = simulate_pivot(few, angles_deg=(0.0, 10.0), frames=(20,))
        >>> for thickness in (np.inf, 4.0):  # mm
        ...     result = estimate_angles(recording, softness=LayeredSoftness(0.5, thickness))
        ...     print(f"{thickness} mm: {np.degrees(result.angle[-1]):.1f}°")
        inf mm: 10.0°
        4.0 mm: 10.2°
    """

    stiffness_ratio: float = field(metadata=RATIO_METADATA)
    thickness: float = field(metadata=unit("mm", above=0.0, most=np.inf))
    depth: float = field(default=0.0, metadata=unit("mm", least=0.0))
    covariance: Matrix = ((0.0, 0.0, 0.0),) * 3
    validity: Validity = field(default_factory=Validity)
    object_radius: float = field(default=np.inf, metadata=unit("mm", above=0.0, most=np.inf))
    object_height: float = field(default=np.inf, metadata=unit("mm", above=0.0, most=np.inf))
    object_side: float = field(default=np.inf, metadata=unit("mm", above=0.0, most=np.inf))
    object_edge: float = field(default=0.0, metadata=unit("mm", least=0.0))
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values."""
        check_limits(self)
        if not 0.0 <= self.depth < self.thickness:
            raise ValueError(
                f"depth is {self.depth} mm; it must lie between 0 and the thickness, "
                f"{self.thickness} mm"
            )
        if np.isinf(self.object_height) and np.isfinite(self.object_side):
            raise ValueError(
                "object_height_mm is missing: give the height of the cylinder from the contact to "
                "the grip"
            )
        check_edge(self.object_edge, self.object_side, self.object_radius)
        check_covariance(self.covariance, ("k", "h", "z"))

    @property
    def sizes(self) -> Sizes:
        """Lengths and k for the lifting."""
        layer = self.thickness, self.depth
        body = self.object_radius, self.object_height, self.object_side, self.object_edge
        return Sizes(*layer, *body, self.stiffness_ratio)

    @property
    def in_mm(self) -> bool:
        """Whether the correction depends on lengths, which must then be in mm."""
        return bool(np.isfinite([self.thickness, *self.sizes[2:5]]).any() or self.depth > 0.0)

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> Lifting | None:
        """Displacements to add to those of the markers.

        Args:
            points: the markers in the unloaded elastomer [mm].

        Raises:
            ValueError: the object is lower than the markers' pitch.
        """
        if not self.in_mm:
            return None
        if self.object_height < (pitch := marker_pitch(points)):
            raise ValueError(
                f"object_height_mm is {self.object_height:g}, lower than the markers' pitch of "
                f"{pitch:.2g} mm, which cannot show how such an object turns: use denser markers, "
                "or leave out its height"
            )
        share = self.stiffness_ratio / (1.0 + self.stiffness_ratio)
        kernels = lifting_kernels(points, points, self.sizes)
        parts = zip(kernels.below, kernels.thin, strict=True)
        return Lifting(*(below + share * thin for below, thin in parts))

    def at(self, contact: Contact) -> ScalarSoftness:
        """k and L for a frame that has been lifted; in L's covariance that of h and z.

        L's variance has the error of the shape's parts as well: the rms over bodies of other shapes
        beside the contact (`papers.finite_strain`, "Soft balls"), for plates the same share. Beside
        a side the moment, of which the object's whole turn is made, and the strain are off. There
        what a near grip takes away and what a round tip adds are off by more, as under low discs
        and domes of finite elements.
        """
        seen = _seen(contact)
        if seen is None:
            spread = self.covariance[0][0]
            return ScalarSoftness(
                self.stiffness_ratio, 0.0, ((spread, 0.0), (0.0, 0.0)), validity=self._covered
            )
        # standard deviations over the whole turn, or a part
        whole_error = 0.015 if seen.pressed.any() else 0.03
        part_error = 0.08 if np.isinf(self.object_side) else 0.3
        k = self.stiffness_ratio
        turns = seen.turns(self.sizes)
        # θ = (1 + k)(φ + below) + k (thin + along), and (1 + k) times the lifted φ lacks `along`
        slopes = [turns.thin / (1.0 + k) + turns.along, *self._slopes(seen)]
        to = np.array([[1.0, 0.0, 0.0], [-2.0 * slope for slope in slopes]])
        (kk, kl), (_, ll) = (to @ np.asarray(self.covariance) @ to.T).tolist()
        if np.isfinite(self.object_side):  # of k times the lifted rotation, and of L
            share, load = whole_error * k, -2.0 * whole_error * k * turns.along
            kk, kl, ll = kk + share**2, kl + share * load, ll + load**2
        ll += (2.0 * k * part_error) ** 2 * (turns.ball**2 + turns.plate**2)
        return ScalarSoftness(
            k, -2.0 * k * turns.along, ((kk, kl), (kl, ll)), validity=self._covered
        )

    @property
    def _covered(self) -> Validity:
        """The contacts that it was fitted to, less those too wide for a ball."""
        if np.isinf(self.object_radius):
            return self.validity
        low, high = self.validity.contact_radius or (0.0, np.inf)
        most = LARGEST_SHARE * self.object_radius
        return replace(self.validity, contact_radius=(min(low, most), min(high, most)))

    def _slopes(self, seen: Seen) -> list[float]:
        """Derivatives of the object's angle by thickness and depth, where these are uncertain."""
        rise = 1e-3  # of thickness, for derivatives
        k, found = self.stiffness_ratio, []
        for place, name in ((1, "thickness"), (2, "depth")):
            if self.covariance[place][place] == 0.0:
                found.append(0.0)
                continue
            step = rise * self.thickness
            least = 0.0 if name == "depth" else 0.5 * self.thickness
            start = max(getattr(self, name) - step, least)
            values = start, start + 2.0 * step
            ends = [seen.turns(self.sizes._replace(**{name: value})) for value in values]
            below, thin, along, *_ = np.subtract(ends[1], ends[0]) / (2.0 * step)
            found.append(float((1.0 + k) * below + k * (thin + along)))
        return found

    def content(self) -> dict[str, Any]:
        """The content of its file."""
        return {"kind": "layered", **to_table(self)}


def _seen(contact: Contact) -> Seen | None:
    """What a frame's markers showed; None where nothing has been lifted or nothing sticks."""
    fewest = 3  # markers that have a rotation
    fields, moved = contact.fields, contact.as_seen
    if moved is None:
        return None
    region = fields.contact if contact.stick is None else contact.stick
    points = (fields.positions - fields.displacement)[:, :2]
    seen = Seen.of(points, moved, fields.displacement[:, 2], region, fields.contact)
    return seen if len(seen.at) >= fewest else None
