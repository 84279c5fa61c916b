"""Published rivals, as their authors give them, and corrected beside that where they are wrong.

[Kolamuri2021] R. Kolamuri, Z. Si, Y. Zhang, A. Agarwal, W. Yuan, "Improving Grasp Stability with
Rotation Measurement from Tactile Sensing".
[Dong2019] S. Dong, D. Ma, E. Donlon, A. Rodriguez, "Maintaining Grasps within Slipping Bounds by
Monitoring Incipient Slip".
[Castano2023] J. Castaño-Amorós, P. Gil, "Measuring Object Rotation via Visuo-Tactile Segmentation
of Grasping Region".
[Kabsch1976] W. Kabsch, "A solution for the best rotation to relate two sets of vectors".

Their markers lie in an image; here they lie in the contact's tangent plane. None of them gives an
interval, so `low` and `high` are NaN. All but [Dong2019] take the whole contact to stick and name
all of it as sticking.
"""

from collections import deque

import numpy as np
from jaxtyping import Bool, Float

from estimation.estimators.measurement import Measurement
from estimation.estimators.plane import fit_motion, in_contact_plane
from estimation.fields import Fields
from estimation.noise import Noise
from estimation.stencils import Stencils
from estimation.stick import MIN_STICK_MARKERS, check_positive


class Kabsch:
    """Plain rigid fit of the whole contact region ([Kabsch1976])."""

    def __init__(self, stencils: Stencils, noise: Noise | None) -> None:
        """Make the estimator; the noise plays no part."""
        self.stencils = stencils

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact region, from the fields of the next frame."""
        if fields.contact.sum() < MIN_STICK_MARKERS:
            return Measurement.none(np.zeros_like(fields.contact))
        before, after = (
            z[fields.contact] for z in in_contact_plane(self.stencils, fields, fields.contact)
        )
        motion = fit_motion(before, after, np.ones(len(before)))
        return _without_interval(float(np.angle(motion.turn)), fields.contact)


class Kolamuri:
    """Mean angle about the centre of rotation ([Kolamuri2021]).

    The centre is where the perpendicular bisectors of the displacements meet, in least squares:
    c = (Σ d dᵀ)⁻¹ Σ d dᵀ m with mid-points m and unit displacements d. For a rigid motion that is
    exact at any angle, so there is nothing to correct: what it lacks is the slip.
    """

    def __init__(self, stencils: Stencils, noise: Noise | None) -> None:
        """Make the estimator; the noise plays no part."""
        self.stencils = stencils

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact region, from the fields of the next frame.

        None where all displacements are parallel: there is then no centre.
        """
        moved = fields.contact & fields.displacement.any(axis=1)
        if moved.sum() < MIN_STICK_MARKERS:
            return Measurement.none(np.zeros_like(fields.contact))
        before, after = (z[moved] for z in in_contact_plane(self.stencils, fields, fields.contact))
        middle = 0.5 * (before + after)
        direction = (after - before) / np.abs(after - before)
        along = np.stack([direction.real, direction.imag], axis=1)
        normal_matrix = along.T @ along
        smallest, largest = np.linalg.eigvalsh(normal_matrix)
        if smallest <= 1e-9 * largest:
            return Measurement.none(np.zeros_like(fields.contact))
        reach = np.real(np.conj(direction) * middle)  # dᵀm
        x, y = np.linalg.solve(normal_matrix, along.T @ reach)
        centre = complex(x, y)
        angle = np.angle((after - centre) * np.conj(before - centre)).mean()
        return _without_interval(float(angle), fields.contact)


class Dong:
    """Rigid fit of the eroded contact region, and who deviates from it ([Dong2019]).

    As published the fit is linear in the angle, u = t + θ ẑ×r. A marker of a body turned by 20°
    is then 6 % of its lever arm away from where the fit has it, and the angle comes out as the
    sine; with `exact` the motion is a finite rotation.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        *,
        exact: bool = False,
        deviation_mm: float = 0.1,
    ) -> None:
        """Make the estimator; the noise plays no part.

        Args:
            stencils: of the marker layout.
            noise: of the markers.
            exact: whether the motion is a finite rotation instead of a small one.
            deviation_mm: deviation from the fit from which a marker counts as slipping [mm]; the
                authors' is in pixels of their camera. 0.1 is ours, not checked against the paper,
                and so is the erosion by one ring of markers.
        """
        self.stencils = stencils
        self.exact = exact
        self.deviation_mm = check_positive("deviation_mm", deviation_mm)

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact's core, from the fields of the next frame.

        None where the contact is too small to have a core, or where all of it deviates.
        """
        core = erode(fields.contact, self.stencils)
        if core.sum() < MIN_STICK_MARKERS:
            return Measurement.none(np.zeros_like(core))
        before, after = in_contact_plane(self.stencils, fields, fields.contact)
        motion = fit_motion(before[core], after[core], np.ones(core.sum()))
        arm = before - motion.origin
        if self.exact:
            angle = float(np.angle(motion.turn))
            image = np.exp(1j * angle) * arm
        else:
            angle = float(motion.turn.imag)  # Σ r×u / Σ r²
            image = arm + 1j * angle * arm
        with np.errstate(invalid="ignore"):
            stick = fields.contact & (np.abs(after - motion.image - image) < self.deviation_mm)
        if stick.sum() < MIN_STICK_MARKERS:
            return Measurement.none(stick)
        return _without_interval(angle, stick)


class Castano:
    """Long axis of the contact mask, since the first frame with contact ([Castano2023]).

    The mask holds the contact's markers where they are now, all alike. The axis is followed by half
    turns and averaged over a trailing window. A round contact has no axis and the authors refuse
    none: there the angle says nothing. It is the object's own, whatever sticks, and wants no
    correction for softness.
    """

    def __init__(self, stencils: Stencils, noise: Noise | None, *, window: int = 5) -> None:
        """Make the estimator; the noise plays no part.

        Args:
            stencils: of the marker layout.
            noise: of the markers.
            window: frames of the trailing mean [-]; 5 is ours, not checked against the paper.
        """
        if window < 1:
            raise ValueError(f"window is {window}; it must be at least one frame")
        self._recent: deque[float] = deque(maxlen=window)
        self._first = np.nan

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact's mask, from the fields of the next frame."""
        if fields.contact.sum() < MIN_STICK_MARKERS:
            self._recent.clear()
            self._first = np.nan
            return Measurement.none(np.zeros_like(fields.contact))
        axis = _long_axis(fields.positions[fields.contact, :2])
        if not self._recent:
            self._first = axis
        last = self._recent[-1] if self._recent else axis
        self._recent.append(float(axis + np.pi * np.round((last - axis) / np.pi)))
        return _without_interval(float(np.mean(self._recent) - self._first), fields.contact)


def erode(markers: Bool[np.ndarray, " n"], stencils: Stencils) -> Bool[np.ndarray, " n"]:
    """The markers of a region all of whose neighbours belong to it."""
    return markers & (markers[stencils.neighbours] | (stencils.neighbours < 0)).all(axis=1)


def _long_axis(points: Float[np.ndarray, "m 2"]) -> float:
    """Direction in which points spread most [rad]."""
    spread = np.cov(points.T)
    return float(0.5 * np.arctan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1]))


def _without_interval(angle: float, stick: Bool[np.ndarray, " n"]) -> Measurement:
    return Measurement(angle, np.nan, np.nan, stick)
