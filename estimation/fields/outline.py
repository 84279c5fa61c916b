"""Orientation of the contact's outline: an angle of the object that is independent of stick.

Inside the contact the pad takes the object's shape: the indentation is the approach less the gap
between the two, however the pad deforms around it. The principal axes of its curvature are those
of the object's face (the pad's dome adds the same to both), and so is the long axis of the contact
ellipse ([Johnson1985] K. L. Johnson, "Contact Mechanics", Section 4.1). They turn with the object,
whether the markers stick or not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri, stdtrit

from estimation.fields.contact import CONTACT_SHARE
from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.recording import Recording


class Axis(NamedTuple):
    """Long axis of the contact.

    Attributes:
        angle: its direction, −π/2 to π/2 [rad, counter-clockwise from x]; NaN if rejected.
        standard_error: standard error of the direction, from the misfit of the shape [rad].
        elongation: long over short axis of the outline [-]; NaN if unknown.
        curvature: relative curvature of object and pad across the long axis [1/mm].
        reason: reason for a missing direction; otherwise empty.
    """

    angle: float
    standard_error: float
    elongation: float
    curvature: float
    reason: str = ""


def turn_error(before: Axis, after: Axis) -> float:
    """Standard error of the turn from one axis to another [rad]."""
    return float(np.hypot(after.standard_error, before.standard_error))


class Outline(NamedTuple):
    """Long axis of the contact in each frame.

    Attributes:
        angle: its direction [rad, counter-clockwise], unwrapped; NaN if rejected.
        standard_error: standard error of the direction [rad].
        elongation: long over short axis [-].
    """

    angle: Float[np.ndarray, " frames"]
    standard_error: Float[np.ndarray, " frames"]
    elongation: Float[np.ndarray, " frames"]


def measure_axis(fields: Fields) -> Axis:
    """Long axis of the contact in one frame, from a quadratic fit to the indentation.

    The fit takes the deeper half of the contact, which follows the object wherever the edge is. The
    weight of a marker is its depth below the shallowest one, so that the axis does not jump when a
    marker enters or leaves. The axis is rejected if the contact has too few
    markers or is too round, or if the fit is too poor.
    """
    least_markers = 9
    least_elongation = 1.2
    largest_error_deg = 3.0
    nothing = Axis(np.nan, np.nan, np.nan, np.nan)
    deepest = fields.indentation[fields.contact].max(initial=0.0)
    deep = fields.contact & (fields.indentation >= CONTACT_SHARE * deepest)
    points = fields.positions[deep, :2]
    if len(points) < least_markers:
        return nothing._replace(reason=f"{len(points)} markers in contact")
    if not fields.indentation[deep].any():
        return nothing._replace(reason="a single view cannot show the indentation")
    x, y = (points - points.mean(axis=0)).T
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    depth = fields.indentation[deep]
    weights = depth - depth.min()
    try:
        inverse = np.linalg.inv(design.T @ (weights[:, None] * design))
    except np.linalg.LinAlgError:
        return nothing._replace(reason="the contact's markers do not determine its shape")
    solve = inverse @ (design.T * weights)
    shape = solve @ depth
    misfit = depth - design @ shape
    covariance = (solve @ solve.T)[3:, 3:] * _misfit_variance(design, weights, inverse, misfit)
    xx, xy, yy = shape[3:]
    spread = float(np.hypot(xx - yy, xy))
    short, long = xx + yy - spread, xx + yy + spread  # twice the principal values, both below 0
    if long >= 0.0 or spread == 0.0:
        return nothing._replace(reason="the contact is not rounded both ways")
    elongation = float(np.sqrt(short / long))
    gradient = np.array([-xy, xx - yy, xy]) / (2.0 * spread**2)
    error = float(np.sqrt(gradient @ covariance @ gradient))
    axis = Axis(0.5 * float(np.arctan2(xy, xx - yy)), error, elongation, -short)
    if elongation < least_elongation:
        return axis._replace(angle=np.nan, reason=f"the contact is too round: {elongation:.2f}:1")
    if error > np.radians(largest_error_deg):
        return axis._replace(
            angle=np.nan, reason=f"its direction is only known to {np.degrees(error):.1f}°"
        )
    return axis


def _misfit_variance(
    design: Float[np.ndarray, "n 6"],
    weights: Float[np.ndarray, " n"],
    inverse: Float[np.ndarray, "6 6"],
    misfit: Float[np.ndarray, " n"],
) -> float:
    """Variance of a marker's depth by the weighted misfit of the shape [mm²].

    Few markers have little misfit left, by chance sometimes hardly any. The variance is therefore
    enlarged so that 95 % intervals of a normal distribution hold as Student's would; its degrees of
    freedom follow from the first two moments of the weighted sum of squares (Satterthwaite).

    Args:
        design: terms of the shape at each marker.
        weights: weights of the markers.
        inverse: inverse of the fit's normal matrix.
        misfit: depth less the fitted shape [mm].
    """
    once, twice = (inverse @ (design.T * weights**power) @ design for power in (2, 3))
    mean = float(weights.sum() - np.trace(once))
    square = float(weights @ weights - 2.0 * np.trace(twice) + np.trace(once @ once))
    free = mean**2 / max(square, 1e-30)
    student = float(stdtrit(free, 0.975) / ndtri(0.975))
    return student**2 * float(weights @ misfit**2) / max(mean, 1e-30)


def unwrap(angle: float, near: float) -> float:
    """The direction of an axis, changed by half turns to be nearest to another direction [rad]."""
    return angle + np.pi * round((near - angle) / np.pi)


class OutlineFollower:
    """Follows the long axis of the contact frame by frame, restarted with every contact."""

    def __init__(self) -> None:
        """Begin with no frame."""
        self._last = np.nan

    def update(self, fields: Fields | None) -> tuple[float, float, float]:
        """Direction, its standard error and elongation in the next frame, as in `Outline`.

        An unusable frame has no fields.
        """
        if fields is None or not fields.contact.any():
            self._last = self._last if fields is None else np.nan
            return np.nan, np.nan, np.nan
        axis = measure_axis(fields)
        if not np.isfinite(axis.angle):
            return np.nan, np.nan, axis.elongation
        self._last = unwrap(axis.angle, self._last) if np.isfinite(self._last) else axis.angle
        return self._last, axis.standard_error, axis.elongation


def follow_outline(recording: Recording) -> Outline:
    """Follow the long axis of the contact through a recording, restarted with every contact.

    If the source gives the object's imprint, its angle is returned instead.

    Examples:
        >>> from estimation import follow_outline, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> outline = follow_outline(recording)  # of a ball, whose contact has no long axis
        >>> print(outline.elongation[-3:].round(2), outline.angle[-3:])
        [1. 1. 1.] [nan nan nan]
    """
    if recording.imprint is not None:
        nothing = np.full(len(recording), np.nan)
        return Outline(recording.imprint[:, 0], recording.imprint[:, 1], nothing)
    follower, stencils = OutlineFollower(), make_stencils(recording.layout)
    axes = [
        follower.update(None if frame.flaw else measure_fields(stencils, frame))
        for frame in recording
    ]
    return Outline(*np.array(axes).T)
