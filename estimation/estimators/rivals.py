"""Published rivals, as their authors give them, and corrected beside that where they are wrong.

[Kolamuri2021] R. Kolamuri, Z. Si, Y. Zhang, A. Agarwal, W. Yuan, "Improving Grasp Stability with
Rotation Measurement from Tactile Sensing".
[Dong2019] S. Dong, D. Ma, E. Donlon, A. Rodriguez, "Maintaining Grasps within Slipping Bounds by
Monitoring Incipient Slip".
[Castano2023] J. Castaño-Amorós, P. Gil, "Measuring Object Rotation via Visuo-Tactile Segmentation
of Grasping Region".
[Kabsch1976] W. Kabsch, "A solution for the best rotation to relate two sets of vectors".
[Ye2026] P. Ye, Y. Ma, Y. Zhou, W. Chen, W. Dong, M. Duan, "InvariantCloud: A Globally Invariant,
Uniquely Indexed Point Cloud Framework for Robust 6-DoF Tactile Pose Tracking", arXiv 2605.25216.

Their markers lie in an image; here they lie in the contact's tangent plane. None of them gives an
interval, so `low` and `high` are NaN. All but [Dong2019] take the whole contact to stick and name
all of it as sticking.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.measurement import Measurement
from estimation.estimators.plane import fit_motion, in_contact_plane
from estimation.fields.measure import Fields
from estimation.fields.outline import LEAST_MARKERS
from estimation.fields.stencils import Stencils
from estimation.fields.stick import MIN_STICK_MARKERS, check_positive
from estimation.frames.noise import Noise

ROUND = "the contact has no distinct long axis"


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


@dataclass(frozen=True)
class DongSettings:
    """How the motion is fitted.

    Attributes:
        exact: whether the motion is a finite rotation instead of a small one.
        deviation_mm: deviation from the fit from which a marker counts as slipping [mm]; the
            authors' is in pixels of their camera. 0.1 is ours, not checked against the paper, and
            so is the erosion by one ring of markers.

    Raises:
        ValueError: a deviation that is not above 0.
    """

    exact: bool = False
    deviation_mm: float = 0.1

    def __post_init__(self) -> None:
        """Check the deviation."""
        check_positive("deviation_mm", self.deviation_mm)


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
        settings: DongSettings = DongSettings(),
    ) -> None:
        """Make the estimator; the noise plays no part."""
        self.stencils = stencils
        self.settings = settings

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
        if self.settings.exact:
            angle = float(np.angle(motion.turn))
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
    """How the axis is averaged, and when there is one.

    Attributes:
        window_frames: frames of the trailing mean; 5 is our choice, not checked against the paper
            [frames].
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

    The mask holds the contact's markers where they are now, all alike. The axis is followed by half
    turns and averaged over a trailing window. It is the object's own, whatever sticks, and wants no
    correction for softness. The authors refuse no contact, but a round one has no long axis, and
    the direction of its mask is noise: it gets no angle here.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: CastanoSettings = CastanoSettings(),
    ) -> None:
        """Make the estimator; the noise plays no part."""
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
            return Measurement.none(np.zeros_like(fields.contact), ROUND)
        if not self._recent:
            self._first = axis
        last = self._recent[-1] if self._recent else axis
        self._recent.append(_follow(axis, last))
        return _without_interval(float(np.mean(self._recent) - self._first), fields.contact)


@dataclass(frozen=True)
class InvariantCloudSettings:
    """How dense the cloud is, and how its axis is smoothed; both are the authors' numbers.

    Attributes:
        points_per_pitch: points of the cloud from one marker to the next [-].
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

    The markers of the unloaded pattern are filled up to a denser cloud whose points keep their
    numbers. Those that the contact covers now are taken where they lay unloaded, without those
    farther from their middle than the mean by two standard deviations. Their first principal axis
    is followed by half turns and smoothed; the angle counts from the first frame with contact.

    This is what the authors' code computes (github.com/yepengfei81-cpu/InvariantCloud,
    `flat_frame_rotation.py`); it refuses no contact, though they advise against spheres. Here a
    regular lattice fills the pattern, and the contact covers a point if it covers the marker that
    is nearest now.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: InvariantCloudSettings = InvariantCloudSettings(),
    ) -> None:
        """Make the estimator; the noise plays no part."""
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
        seen = np.flatnonzero(np.isfinite(fields.positions).all(axis=1))
        _, nearest = KDTree(fields.positions[seen, :2]).query(self.cloud)
        covered = self.cloud[fields.contact[seen[nearest]]]
        far = np.linalg.norm(covered - covered.mean(axis=0), axis=1)
        covered = covered[far <= far.mean() + 2.0 * far.std()]
        axis = float(0.5 * np.angle(_squares(covered).sum()))
        if np.isnan(self._first):
            self._first = self._last = self._smooth = axis
        self._last = _follow(axis, self._last)
        self._smooth += self.newest_weight * (self._last - self._smooth)
        return _without_interval(self._smooth - self._first, fields.contact)


def erode(markers: Bool[np.ndarray, " n"], stencils: Stencils) -> Bool[np.ndarray, " n"]:
    """The markers of a region all of whose neighbours belong to it."""
    return markers & (markers[stencils.neighbours] | (stencils.neighbours < 0)).all(axis=1)


def _long_axis(
    points: Float[np.ndarray, "m 2"], rim: Bool[np.ndarray, " m"]
) -> tuple[float, float]:
    """Direction in which points spread most, and its standard error [rad].

    The error is infinite where too few points make an outline.

    With w = (x + iy)² from the points' mean, the direction is half the angle of Σw. A point of the
    rim stands for an area of which the outline cuts off any share: the variance of its w is
    |w|²/12, half of it across Σw.
    """
    squared = _squares(points)
    spread, across = squared.sum(), np.sqrt(np.sum(np.abs(squared[rim]) ** 2) / 24.0)
    known = len(points) >= LEAST_MARKERS and abs(spread) > 0.0
    error = 0.5 * across / abs(spread) if known else np.inf
    return float(0.5 * np.angle(spread)), float(error)


def _squares(points: Float[np.ndarray, "m 2"]) -> Complex[np.ndarray, " m"]:
    """w = (x + iy)² of points, from their mean."""
    return ((points - points.mean(axis=0)) @ np.array([1.0, 1j])) ** 2


def _follow(axis: float, last: float) -> float:
    """A direction, turned by half turns until it is the nearest to the last one [rad]."""
    return float(axis + np.pi * np.round((last - axis) / np.pi))


def _without_interval(angle: float, stick: Bool[np.ndarray, " n"]) -> Measurement:
    return Measurement(angle, np.nan, np.nan, stick)
