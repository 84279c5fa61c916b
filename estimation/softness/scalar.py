"""Softness of the object: what Eq. (13) adds to the rotation of the elastomer.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (2), (12) and (13).

L is the paper's L_xy − L_yx everywhere in this project, so that counter-clockwise the object has
turned by (1 + k) φ − L/2.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from contactmodel.common.settings import check_limits, to_table, unit
from contactmodel.equations import object_rotation
from estimation.estimators.measurement import Z95, Measurement
from estimation.softness.contact import RATIO_METADATA, Contact, Validity, check_covariance

Covariance = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class ScalarSoftness:
    """Stiffness ratio and load term of an object on a sensor.

    Attributes:
        stiffness_ratio: k = G_S/G_B, elastomer over object [-]; 0 for a rigid object.
        load_term: L = L_xy − L_yx [rad], in the paper's sign; per newton of the normal force
            [rad/N] where `load_by_force`.
        covariance: of (k, L), row by row.
        load_by_force: whether L grows in proportion to the normal force.
        validity: the contacts that it was fitted to.
        provenance: where it came from, for readers: recordings, reference, sensor, versions.

    Raises:
        ValueError: k below 0, or a covariance that is none.

    Examples:
        >>> import numpy as np
        >>> from estimation import PivotModel, ScalarSoftness, estimate_angles, simulate_pivot
        >>> soft = PivotModel(stiffness_ratio=0.5)
        >>> recording, _ = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(20,))
        >>> for k in (0.0, 0.5):
        ...     result = estimate_angles(recording, softness=ScalarSoftness(k))
        ...     print(f"k = {k}: {np.degrees(result.angle[-1]):.1f}°")
        k = 0.0: 6.7°
        k = 0.5: 10.0°
    """

    stiffness_ratio: float = field(default=0.0, metadata=RATIO_METADATA)
    load_term: float = field(default=0.0, metadata=unit("rad"))
    covariance: Covariance = ((0.0, 0.0), (0.0, 0.0))
    load_by_force: bool = False
    validity: Validity = field(default_factory=Validity)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values."""
        check_limits(self)
        check_covariance(self.covariance, ("k", "L"))

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> None:
        """Nothing: what moves as one body is multiplied as a whole."""

    def at(self, contact: Contact) -> "ScalarSoftness":
        """Itself, or with L for the contact's normal force where it grows with that.

        Raises:
            ValueError: L grows with a force that is not known.
        """
        if not self.load_by_force:
            return self
        force = contact.normal_force
        if not np.isfinite(force):
            raise ValueError("the load term needs the normal force, which this frame does not have")
        (kk, kl), (_, ll) = self.covariance
        return ScalarSoftness(
            self.stiffness_ratio,
            self.load_term * force,
            ((kk, kl * force), (kl * force, ll * force**2)),
            validity=self.validity,
        )

    def correct(self, gel: Measurement) -> tuple[float, float, float]:
        """The object's angle and the ends of its 95 % interval [rad, counter-clockwise].

        [Li2024] Eq. (13) with the sign turned; the interval takes in the covariance of (k, L).
        """
        angle = float(object_rotation(gel.angle, self.stiffness_ratio, self.load_term))
        gradient = np.array([gel.angle, -0.5])
        spread = Z95 * np.sqrt(gradient @ np.asarray(self.covariance) @ gradient)
        gain = 1.0 + self.stiffness_ratio
        below = np.hypot(gain * (gel.angle - gel.low), spread)
        above = np.hypot(gain * (gel.high - gel.angle), spread)
        return angle, float(angle - below), float(angle + above)

    def content(self) -> dict[str, Any]:
        """The content of its file."""
        return {"kind": "scalar", **to_table(self)}


RIGID_OBJECT = ScalarSoftness()
"""Nothing is added to the turn of the gel."""
