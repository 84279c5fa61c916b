"""Rotation of a set of markers about the contact's normal, by a robust rigid fit.

[Kabsch1976] W. Kabsch, "A solution for the best rotation to relate two sets of vectors", for the
fit; [Beaton1974] for its weights (`estimation.estimators.body`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from estimation.estimators.body import BIWEIGHT_ERROR
from estimation.estimators.hidden_slip import allow_for_slip
from estimation.estimators.strain import Press, Segment, fit_strained_body
from estimation.fields.measure import Fields
from estimation.fields.plane import in_contact_plane
from estimation.fields.stencils import Stencils
from estimation.fields.stick import MIN_STICK_MARKERS


class RigidFit(NamedTuple):
    """Rotation of a set of markers about the contact's normal.

    Attributes:
        angle: rotation [rad].
        standard_error: standard error of the angle, from the marker noise or the misfit, whichever
            is larger [rad].
        lag: largest difference of the true angle from `angle`, with its sign, that undetected slip
            can cause [rad].
        stick: the markers that move with the rotation.
        scale: noise or misfit per coordinate that the fit used [mm].
        noise: noise per coordinate, 0 if unknown [mm].
        strain: misfit beyond the noise over the markers' distance from their centre [-].
        press: strain by the press, which the fit leaves out.
        steep: whether slip grows steeply beyond the markers (`Region.grows_steeply`).
    """

    angle: float
    standard_error: float
    lag: float
    stick: Bool[np.ndarray, " n"]
    scale: float
    noise: float
    strain: float
    press: Press = Press()
    steep: bool = False

    @property
    def noise_error(self) -> float:
        """The standard error from the noise alone, or `standard_error` if it is unknown [rad]."""
        return self.standard_error * (self.noise / self.scale if self.noise else 1.0)

    def widen(self, more: "RigidFit") -> "RigidFit":
        """The fit of more markers if slip of those added cannot hide, else this one.

        They must turn as far as these ones, within a standard error. The error by slip that the
        noise still hides is half of the noise that they average out, as in `turn_back.fit_disc`.
        """
        gained = float(np.sqrt(max(self.standard_error**2 - more.standard_error**2, 0.0)))
        behind = (self.angle - more.angle) * np.sign(more.lag) > gained
        worse = more.scale > self.scale or more.stick.sum() <= self.stick.sum()
        if behind or worse or not more.steep:
            return self
        error = float(np.hypot(more.standard_error, 0.5 * gained))
        return more._replace(standard_error=error)

    def is_around(self, stick: Bool[np.ndarray, " n"], contact: Bool[np.ndarray, " n"]) -> bool:
        """Whether it is most of the contact without the markers that stuck, as gel at rest is."""
        most = 2 * self.stick.sum() > contact.sum()
        return bool(most and 2 * (self.stick & stick).sum() < stick.sum())


def fit_rigid_rotation(
    stencils: Stencils,
    fields: Fields,
    segment: Bool[np.ndarray, " n"],
    noise_mm: float,
    since: Fields | None = None,
    press: Press = Press(),
    sought: bool = True,
    join: bool = True,
) -> RigidFit:
    """Robust rigid fit of a segment in the contact's tangent plane.

    Iteratively reweighted least squares ([Kabsch1976], [Beaton1974]) from the markers nearest the
    stick centre fit the in-plane motion, rigid up to strain by the press. The stencils of φ reach
    beyond the region that sticks, so that Eq. (15) misses markers at its rim. Neighbours that turn
    with the segment are added, as long as slip grows steeply beyond the last of them.

    Args:
        stencils: stencils of the layout.
        fields: fields of the frame.
        segment: markers to fit, at least three, including the stick centre.
        noise_mm: noise per in-plane coordinate and frame [mm]; 0 if unknown.
        since: fields of the frame that the rotation counts from; None for the unloaded shape.
        press: known strain by the press since the unloaded shape.
        sought: whether to look for strain beyond the known one.
        join: whether neighbours may join the segment.
    """
    before, after = in_contact_plane(stencils, fields, segment, since)
    noise_mm = noise_mm if since is None else np.sqrt(2.0) * noise_mm
    moved = Segment(before, after, segment, fields.centre, noise_mm)
    strained = since is None and bool(fields.positions[:, 2].any())  # in space, not in pictures
    fitted, moved = fit_strained_body(moved, press, sought) if strained else moved.fit_without()
    after, scale = moved.after, fitted.scale
    body, region, lag = allow_for_slip(
        stencils, fitted.body, before, after, segment, scale, fields.edge
    )
    information, stick = body.information(before[segment]), region.stick
    if stick.sum() < MIN_STICK_MARKERS:
        return RigidFit(np.nan, np.nan, np.nan, stick, scale, noise_mm, np.inf)
    fit = RigidFit(
        angle=body.motion.angle,
        standard_error=float(BIWEIGHT_ERROR * scale * np.sqrt(fitted.spread / information)),
        lag=lag,
        stick=stick,
        scale=scale,
        noise=noise_mm,
        strain=float(np.sqrt(max(scale**2 - noise_mm**2, 0.0) * body.weights.sum() / information)),
        press=fitted.press,
        steep=region.grows_steeply,
    )
    if not (strained and noise_mm and join):
        return fit
    wider = segment | (region.join_neighbours() & fields.contact)
    if wider.sum() == segment.sum():
        return fit
    more = fit_rigid_rotation(stencils, fields, wider, noise_mm, None, press, sought, False)
    return fit.widen(more)
