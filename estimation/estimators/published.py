"""Published methods of other groups, as published, and in corrected form where they are wrong.

[Kolamuri2021] R. Kolamuri, Z. Si, Y. Zhang, A. Agarwal, W. Yuan, "Improving Grasp Stability with
Rotation Measurement from Tactile Sensing".
[Dong2019] S. Dong, D. Ma, E. Donlon, A. Rodriguez, "Maintaining Grasps within Slipping Bounds by
Monitoring Incipient Slip".
[Castano2023] J. Castaño-Amorós, P. Gil, "Measuring Object Rotation via Visuo-Tactile Segmentation
of Grasping Region".
[Kabsch1976] W. Kabsch, "A solution for the best rotation to relate two sets of vectors".
[Ye2026] P. Ye, Y. Ma, Y. Zhou, W. Chen, W. Dong, M. Duan, "InvariantCloud: A Globally Invariant,
Uniquely Indexed Point Cloud Framework for Robust 6-DoF Tactile Pose Tracking", arXiv 2605.25216.

The authors' markers lie in an image; here they lie in the contact's tangent plane. No method gives
an interval, so `low` and `high` are NaN. All but [Dong2019] assume that the whole contact sticks,
and report all of its markers as sticking.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float

from contactmodel.common.ranges import check_positive
from estimation.estimators.measurement import Measurement
from estimation.fields.measure import Fields
from estimation.fields.plane import fit_motion, in_contact_plane
from estimation.fields.stencils import Stencils, erode
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.noise import Noise


class Kabsch:
    """Plain rigid fit of the whole contact region ([Kabsch1976])."""

    def __init__(self, stencils: Stencils, noise: Noise | None) -> None:
        """Make the estimator; it does not use the noise."""
        self.stencils = stencils

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact region, from the fields of the next frame."""
        if fields.contact.sum() < MIN_STICK_MARKERS:
            return Measurement.none(np.zeros_like(fields.contact))
        before, after = (
            z[fields.contact] for z in in_contact_plane(self.stencils, fields, fields.contact)
        )
        motion = fit_motion(before, after)
        return _without_interval(motion.angle, fields.contact)


class Kolamuri:
    """Mean angle about the centre of rotation ([Kolamuri2021]).

    The centre is the least-squares intersection of the perpendicular bisectors of the
    displacements: c = (Σ d dᵀ)⁻¹ Σ d dᵀ m with mid-points m and unit displacements d. For a rigid
    motion this is exact at any angle, so it needs no correction. It ignores slip.
    """

    def __init__(self, stencils: Stencils, noise: Noise | None) -> None:
        """Make the estimator; it does not use the noise."""
        self.stencils = stencils

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact region, from the fields of the next frame.

        There is no angle if all displacements are parallel, since they have no centre.
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


@dataclass(frozen=True)
class DongSettings:
    """How the motion is fitted.

    Attributes:
        exact: fit a finite rotation instead of a small one.
        deviation_mm: deviation from the fit above which a marker counts as slipping [mm]. The
            authors give theirs in pixels of their camera. The default and the erosion by one ring
            of markers are our choices, not checked against the paper.

    Raises:
        ValueError: a deviation that is not above 0.
    """

    exact: bool = False
    deviation_mm: float = 0.1

    def __post_init__(self) -> None:
        """Check the deviation."""
        check_positive("deviation_mm", self.deviation_mm)


class Dong:
    """Rigid fit of the eroded contact region; markers that deviate from it slip ([Dong2019]).

    As published, the fit is linear in the angle, u = t + θ ẑ×r. A marker of a body turned by 20°
    then deviates from the fit by 6 % of its lever arm, and the fit gives the sine of the angle.
    With `exact` the motion is a finite rotation.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: DongSettings = DongSettings(),
    ) -> None:
        """Make the estimator; it does not use the noise."""
        self.stencils = stencils
        self.settings = settings

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact's core, from the fields of the next frame.

        There is no angle if the contact is too small to have a core, or if all of it deviates.
        """
        core = erode(fields.contact, self.stencils)
        if core.sum() < MIN_STICK_MARKERS:
            return Measurement.none(np.zeros_like(core))
        before, after = in_contact_plane(self.stencils, fields, fields.contact)
        motion = fit_motion(before[core], after[core])
        arm = before - motion.origin
        if self.settings.exact:
            angle = motion.angle
            image = np.exp(1j * angle) * arm
        else:
            angle = float(motion.turn.imag)  # Σ r×u / Σ r²
            image = arm + 1j * angle * arm
        with np.errstate(invalid="ignore"):
            stick = fields.contact & (
                np.abs(after - motion.image - image) < self.settings.deviation_mm
            )
        if stick.sum() < MIN_STICK_MARKERS:
            return Measurement.none(stick)
        return _without_interval(angle, stick)


@dataclass(frozen=True)
class CastanoSettings:
    """How the axis is averaged, and when a contact counts as round.

    Attributes:
        window_frames: length of the trailing mean; the default is our choice, not checked against
            the paper [frames].
        largest_error_deg: standard error of the long axis above which the contact counts as round;
            our choice [deg].

    Raises:
        ValueError: a value out of range.
    """

    window_frames: int = 5
    largest_error_deg: float = 5.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.window_frames < 1:
            raise ValueError(f"window_frames is {self.window_frames}; give at least one frame")
        check_positive("largest_error_deg", self.largest_error_deg)


class Castano:
    """Long axis of the contact mask, since the first frame with contact ([Castano2023]).

    The mask consists of the contact's markers at their present positions, with equal weights. The
    axis is unwrapped by half turns and averaged over a trailing window. It belongs to the object,
    whichever markers stick, and needs no correction for softness. The authors reject no contact.
    Here a round contact gets no angle, since it has no long axis and its direction is noise.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: CastanoSettings = CastanoSettings(),
    ) -> None:
        """Make the estimator; it does not use the noise."""
        self.stencils = stencils
        self.largest_error = np.radians(settings.largest_error_deg)
        self._recent: deque[float] = deque(maxlen=settings.window_frames)
        self._first = np.nan

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the contact's mask, from the fields of the next frame."""
        if fields.contact.sum() < MIN_STICK_MARKERS:
            self._recent.clear()
            self._first = np.nan
            return Measurement.none(np.zeros_like(fields.contact))
        rim = fields.contact & ~erode(fields.contact, self.stencils)
        axis, error = _long_axis(fields.positions[fields.contact, :2], rim[fields.contact])
        if error > self.largest_error:
            reason = "the contact has no distinct long axis"
            return Measurement.none(np.zeros_like(fields.contact), reason)
        if not self._recent:
            self._first = axis
        last = self._recent[-1] if self._recent else axis
        self._recent.append(_follow(axis, last))
        return _without_interval(float(np.mean(self._recent) - self._first), fields.contact)


@dataclass(frozen=True)
class InvariantCloudSettings:
    """Density of the cloud and smoothing of its axis, both with the authors' numbers.

    Attributes:
        points_per_pitch: points of the cloud per distance between markers [-].
        newest_weight: weight of the newest frame in the running mean of the axis [-].

    Raises:
        ValueError: a value out of range.
    """

    points_per_pitch: int = 5
    newest_weight: float = 0.5

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.points_per_pitch < 1:
            raise ValueError(f"points_per_pitch is {self.points_per_pitch}; give at least one")
        if not 0.0 < self.newest_weight <= 1.0:
            raise ValueError(f"newest_weight is {self.newest_weight}; give 1 or less, above 0")


class InvariantCloud:
    """Yaw by the long axis of the indexed points under the object ([Ye2026]).

    A denser cloud of numbered points fills the unloaded pattern of markers. The method takes the
    unloaded positions of the points under the contact, without points whose distance from the
    middle exceeds the mean distance by two standard deviations. Their first principal axis is
    unwrapped by half turns and smoothed; the angle counts from the first frame with contact.

    This follows the authors' code (github.com/yepengfei81-cpu/InvariantCloud,
    `flat_frame_rotation.py`), which rejects no contact, though the authors advise against spheres.
    Here a regular lattice fills the pattern, and a point is under the contact if the marker nearest
    to it now is.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: InvariantCloudSettings = InvariantCloudSettings(),
    ) -> None:
        """Make the estimator; it does not use the noise."""
        reach = np.linalg.norm(stencils.offsets, axis=-1)
        step = float(np.median(reach[reach > 0.0])) / settings.points_per_pitch
        low, high = (edge(stencils.reference[:, :2], axis=0) for edge in (np.min, np.max))
        x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
        self.cloud = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self.newest_weight = settings.newest_weight
        self._begin()

    def _begin(self) -> None:
        self._first = self._last = self._smooth = np.nan

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the covered points' axis, from the fields of the next frame."""
        from scipy.spatial import KDTree

        if fields.contact.sum() < MIN_STICK_MARKERS:
            self._begin()
            return Measurement.none(np.zeros_like(fields.contact))
        visible = np.flatnonzero(np.isfinite(fields.positions).all(axis=1))
        _, nearest = KDTree(fields.positions[visible, :2]).query(self.cloud)
        covered = self.cloud[fields.contact[visible[nearest]]]
        far = np.linalg.norm(covered - covered.mean(axis=0), axis=1)
        covered = covered[far <= far.mean() + 2.0 * far.std()]
        axis = float(0.5 * np.angle(_squares(covered).sum()))
        if np.isnan(self._first):
            self._first = self._last = self._smooth = axis
        self._last = _follow(axis, self._last)
        self._smooth += self.newest_weight * (self._last - self._smooth)
        return _without_interval(self._smooth - self._first, fields.contact)


def _long_axis(
    points: Float[np.ndarray, "m 2"], rim: Bool[np.ndarray, " m"]
) -> tuple[float, float]:
    """Direction of the largest spread of points, and its standard error [rad].

    The error is infinite for too few points.

    With w = (x + iy)² from the points' mean, the direction is half the angle of Σw. A point of the
    rim represents an area of which the outline cuts off a random share: the variance of its w is
    |w|²/12, half of it across Σw.
    """
    least_markers = 9
    squared = _squares(points)
    spread, across = squared.sum(), np.sqrt(np.sum(np.abs(squared[rim]) ** 2) / 24.0)
    enough = len(points) >= least_markers and abs(spread) > 0.0
    error = 0.5 * across / abs(spread) if enough else np.inf
    return float(0.5 * np.angle(spread)), float(error)


def _squares(points: Float[np.ndarray, "m 2"]) -> Complex[np.ndarray, " m"]:
    """w = (x + iy)² of points, from their mean."""
    return ((points - points.mean(axis=0)) @ np.array([1.0, 1j])) ** 2


def _follow(axis: float, last: float) -> float:
    """A direction, changed by half turns to be nearest to the last one [rad]."""
    return float(axis + np.pi * np.round((last - axis) / np.pi))


def _without_interval(angle: float, stick: Bool[np.ndarray, " n"]) -> Measurement:
    return Measurement(angle, np.nan, np.nan, stick)
