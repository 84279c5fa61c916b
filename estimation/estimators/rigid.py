"""The rigid estimator: Eq. (15) gives a segment, and a robust rigid fit of it gives the angle.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (15) for the segment.

Markers that stick to one object move as one rigid body. The difference stencils of a mean φ reach
beyond the segment into slipping markers. A fit of the positions does not, and it uses the whole
lever arm of the segment.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from contactmodel.common.ranges import check_count, check_positive
from estimation.estimators.body import CORE_MARKERS, leave_out_slipping
from estimation.estimators.measurement import Z95, Measurement
from estimation.estimators.rotation import RigidFit, fit_rigid_rotation
from estimation.estimators.strain import Press
from estimation.fields.contact import find_stick_centre, reaches_edge
from estimation.fields.measure import Fields
from estimation.fields.plane import fit_motion, fit_turn, has_turned, in_contact_plane, leads
from estimation.fields.stencils import Stencils
from estimation.fields.stick import ANGLE_FLOOR_DEG, MIN_STICK_MARKERS, grow_stick_region
from estimation.frames.noise import Noise


@dataclass(frozen=True)
class RigidSettings:
    """Thresholds for markers that stick.

    At a threshold of 0.2 the segment stays inside the stick region; at the paper's 0.4 it includes
    markers whose slip is hidden by noise. Slip within a few markers shows as strain. Markers that
    stick strain with the gel by some tenths of a percent.

    Attributes:
        threshold: largest relative difference of rotation, Δφ_th of Eq. (15), at which a neighbour
            joins the region that sticks. Larger values let slipping markers in [-].
        angle_floor_deg: smallest denominator of Eq. (15). If the noise requires it, it is raised
            until the threshold equals three standard errors of φ [deg].
        max_strain: misfit of the rigid fit over the size of the region, above which the markers do
            not move as one body [-].
        min_stick_markers: fewest markers that count as sticking [-].

    Raises:
        ValueError: a value out of range.
    """

    threshold: float = 0.2
    angle_floor_deg: float = ANGLE_FLOOR_DEG
    max_strain: float = 0.01
    min_stick_markers: int = MIN_STICK_MARKERS

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("threshold", "angle_floor_deg", "max_strain"):
            check_positive(name, getattr(self, name))
        check_count("min_stick_markers", self.min_stick_markers, MIN_STICK_MARKERS)


class Rigid:
    """Robust rigid fit of the segment grown by Eq. (15)."""

    def __init__(
        self, stencils: Stencils, noise: Noise | None, settings: RigidSettings = RigidSettings()
    ) -> None:
        """Make the estimator; without the noise of the markers, it uses the misfit of the fit."""
        self.stencils = stencils
        self.settings = settings
        self.noise_mm = 0.0 if noise is None else noise.in_plane
        self.floor = max(
            float(np.radians(settings.angle_floor_deg)),
            3.0 * stencils.rotation_noise(self.noise_mm) / settings.threshold,
        )
        self._pitch = float(np.median(np.linalg.norm(stencils.offsets, axis=2).max(axis=1)))
        self.press = Press()
        """Uneven strain of the gel by the press."""
        self._fields: Fields | None = None
        self._fits: list[tuple[Fields | None, np.ndarray | None, RigidFit | None]] = []

    @property
    def key(self) -> tuple[float | int, ...]:
        """The values, apart from the fields, that determine its fits."""
        own = self.settings
        return (self.noise_mm, own.threshold, self.floor, own.max_strain, own.min_stick_markers)

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the sticking elastomer, from the fields of the next frame."""
        if not fields.contact.any():
            self.press = Press()
            return Measurement.none(fields.contact)
        nothing = np.zeros_like(fields.contact)
        fit = self._fit_segment(fields)
        if fit is None:
            return Measurement.none(nothing)
        if fit.strain > self.settings.max_strain:
            return Measurement.none(
                nothing, f"no rigid core: strain beyond {self.settings.max_strain:g}"
            )
        error = Z95 * fit.standard_error
        return Measurement(
            angle=fit.angle,
            low=fit.angle - float(np.hypot(error, min(fit.lag, 0.0))),
            high=fit.angle + float(np.hypot(error, max(fit.lag, 0.0))),
            stick=fit.stick,
        )

    def turn(
        self, markers: Bool[np.ndarray, " n"], fields: Fields | None, since: Fields | None
    ) -> tuple[float, float]:
        """Rotation of some markers since an earlier frame, and its standard error [rad]."""
        if fields is None:  # the unloaded shape
            return 0.0, 0.0
        before, after = in_contact_plane(self.stencils, fields, markers, since)
        return fit_turn(before[markers], after[markers], self.noise_mm)

    def fit(
        self,
        fields: Fields,
        since: Fields | None = None,
        markers: Bool[np.ndarray, " n"] | None = None,
        lately: Bool[np.ndarray, " n"] | None = None,
    ) -> RigidFit | None:
        """Rotation of the markers that have stuck since an earlier frame.

        Args:
            fields: fields of the frame.
            since: fields of the earlier frame; None for the unloaded shape.
            markers: markers that may have stuck; None for all.
            lately: markers that stuck in the last frame, to try too (`_refit`).

        Returns:
            None if too few markers have moved as one body.
        """
        fit = self._fit_segment(fields, since, markers)
        fit = fit if fit is not None and fit.strain <= self.settings.max_strain else None
        if lately is None:
            return fit
        return self._refit(fields, since, lately if markers is None else lately & markers, fit)

    def reading_error(self, fields: Fields) -> float:
        """Standard error of the orientation of a frame's contact, from the marker noise [rad].

        If the noise is unknown, it is taken as a thousandth of the distance between markers.
        """
        return self._orient(fields, fields.contact, self.noise_mm)

    def shading_error(self, fields: Fields, stick: Bool[np.ndarray, " n"]) -> float:
        """Standard error of a rotation by lasting errors of marker positions in pictures [rad].

        An object that is pressed on shades the gel, and the light moves the dots by about a
        thousandth of their distance. Positions in three dimensions do not come from pictures.
        """
        in_plane = not fields.positions[:, 2].any()
        return self._orient(fields, stick, 0.0) if in_plane and stick.any() else 0.0

    def _orient(self, fields: Fields, markers: Bool[np.ndarray, " n"], noise: float) -> float:
        """Standard error of the markers' orientation [rad], by the noise of each [mm].

        A noise of 0 counts as a thousandth of the distance between markers.
        """
        points = fields.positions[markers]
        arms = np.linalg.norm(points - points.mean(axis=0), axis=1)
        return (noise or 1e-3 * self._pitch) / max(float(np.sqrt(arms @ arms)), self._pitch)

    def _fit_segment(
        self,
        fields: Fields,
        since: Fields | None = None,
        markers: Bool[np.ndarray, " n"] | None = None,
    ) -> RigidFit | None:
        """The fit of the segment of Eq. (15), whatever its strain; None for too few markers.

        Fits of the last fields are cached, since several estimators share them.
        """
        if fields is not self._fields:
            self._fields, self._fits = fields, []
        for earlier, body, fit in self._fits:
            if earlier is since and body is markers:
                return fit
        fit = self._fit_since(fields, since, markers)
        self._fits.append((since, markers, fit))
        return fit

    def _refit(
        self,
        fields: Fields,
        since: Fields | None,
        stuck: Bool[np.ndarray, " n"],
        fit: RigidFit | None,
    ) -> RigidFit | None:
        """The fit, or that of markers which stuck in the last frame and still move as one.

        The stencils of φ reach beyond a small region that sticks, so that the markers at its rim
        seem to turn less than the object, and Eq. (15) misses most of them. Their positions do
        not. Slip releases the markers one by one: those that fit worst are left out until the noise
        explains the motion of the others. They replace fewer markers. Under an object that shifts
        as it turns, the stick centre may slip, and Eq. (15) finds markers that slip alike: they lag
        behind those that stick, which then replace them, or leave no fit.

        Gel that has not clearly turned may rest under an object that slides. Fewer than five
        markers, or less than half of those that stuck, may move alike while they slip, and noise
        that makes their rotation coarse hides their slip.

        Args:
            fields: fields of the frame.
            since: fields of the earlier frame; None for the unloaded shape.
            stuck: the markers that stuck in the last frame.
            fit: the fit by Eq. (15); None for too few markers.
        """
        body = stuck & fields.contact & np.isfinite(fields.rotation)
        if since is not None:
            body &= since.contact & np.isfinite(since.rotation)
        least = max(5, (int(body.sum()) + 1) // 2)
        if not self.noise_mm or self.stencils.flat or body.sum() < least:
            return fit
        before, after = in_contact_plane(self.stencils, fields, body, since)
        noise = self.noise_mm if since is None else np.sqrt(2.0) * self.noise_mm
        if since is None:
            turn = fit_motion(before[body], after[body]).turn
            after = after - self.press.displace(before, turn)
        found = 0 if fit is None else int(fit.stick.sum())
        if (
            fit is not None
            and found >= CORE_MARKERS
            and not leads(before, after, body, fit.stick, noise, 1.0)
        ):
            return fit
        body = leave_out_slipping(before, after, body, noise, least)
        if body.sum() < least or not has_turned(before[body], after[body], noise):
            return fit
        slips = fit is not None and leads(before, after, body, fit.stick, noise)
        fewer = found < min(CORE_MARKERS, body.sum())
        if not (slips or fewer):
            return fit
        middle = np.abs(before - before[body].mean())
        centre = int(np.argmin(np.where(body, middle, np.inf)))
        centred = fields._replace(centre=centre)
        known = self.press, self._shows_strain(fields.contact, body)
        more = fit_rigid_rotation(self.stencils, centred, body, self.noise_mm, since, *known)
        coarse = more.standard_error > np.radians(0.06)
        if more.stick.sum() < least or more.strain or coarse:
            return None if slips else fit
        return more

    def _fit_since(
        self, fields: Fields, since: Fields | None, markers: Bool[np.ndarray, " n"] | None
    ) -> RigidFit | None:
        touching = fields.contact
        if since is not None or markers is not None:
            earlier = self.stencils.reference if since is None else since.positions
            turned = fields.rotation - (0.0 if since is None else since.rotation)
            contact = fields.contact & np.isfinite(turned)
            if since is not None:
                contact &= since.contact
            if markers is not None:
                contact &= markers
            centre = fields.centre
            if not contact.any():
                return None
            if not contact[centre]:
                centre = find_stick_centre(
                    fields.positions, fields.positions - earlier, fields.normals, contact
                )
            fields = fields._replace(rotation=turned, contact=contact, centre=centre)
        segment = grow_stick_region(
            fields, self.stencils.adjacent, threshold=self.settings.threshold, floor=self.floor
        )
        if segment.sum() < self.settings.min_stick_markers:
            return None
        sought, noise = self._shows_strain(touching, segment), self.noise_mm
        fit = fit_rigid_rotation(self.stencils, fields, segment, noise, since, self.press, sought)
        least = max(CORE_MARKERS, (int(touching.sum()) + 1) // 2)
        if since is None and sought and fit.stick.sum() >= least:
            self.press = fit.press
        return fit if fit.stick.sum() >= self.settings.min_stick_markers else None

    def _shows_strain(
        self, contact: Bool[np.ndarray, " n"], markers: Bool[np.ndarray, " n"]
    ) -> bool:
        """Whether strain by the press differs from slip: most of a contact in view sticks."""
        half = 2 * int(markers.sum()) >= int(contact.sum())
        return half and not reaches_edge(self.stencils.neighbours, contact)
