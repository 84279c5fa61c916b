"""The Cramér–Rao bound of the angle, and the errors of the linear model at finite rotations.

No unbiased estimate has a smaller standard deviation than the Cramér–Rao bound of its data: one
frame, or after a turn back all frames since the turn.
Everything else in `papers` assumes linear elasticity at small strain: a homogeneous elastomer, dry
friction with one coefficient. The last three functions give its errors under a finite rotation; at
20° they exceed the noise. The model leaves out, and this module does not estimate: the silicone's
nonlinear stress–strain curve, creep, adhesion, a friction coefficient that falls with pressure, and
contacts that slide far.
"""

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.profile import share_around

Angles = Float[np.ndarray, "*angles"]

MEAN_ABSOLUTE = float(np.sqrt(2.0 / np.pi))
"""Mean absolute error of a normal error of standard deviation 1."""


def angle_limit(
    points: Float[np.ndarray, "n 2"], stick: Bool[np.ndarray, " n"], noise: float
) -> float:
    """Least standard deviation of an unbiased angle from the sticking markers, σ/(r_rms √n).

    It assumes an exact reference, an unknown centre, and white normal noise of the markers.

    Args:
        points: positions of the markers [mm].
        stick: mask of the markers that move with the object.
        noise: σ, standard deviation of each coordinate [mm].

    Returns:
        The standard deviation [rad]; infinite for fewer than two markers.
    """
    arms = points[stick] - points[stick].mean(axis=0) if stick.sum() > 1 else np.zeros((1, 2))
    moment = float(np.sum(arms**2))
    return noise / np.sqrt(moment) if moment > 0 else np.inf


def contact_limit(
    points: Float[np.ndarray, "n 2"], radius: float, thickness: float, noise: float
) -> float:
    """Least standard deviation of an unbiased angle from all markers, sticking and slipping.

    A small twist moves the gel like a disc as large as the region that sticks. Everything else,
    such as friction and pressure, is assumed to be known exactly, and the contact to be round.

    Args:
        points: positions of the markers from the axis [mm].
        radius: radius of the disc that sticks [mm].
        thickness: of the layer [mm].
        noise: σ, standard deviation of each coordinate [mm].

    Returns:
        The standard deviation [rad]; infinite if nothing sticks.
    """
    information = float(np.sum(_moved(points, radius, thickness) ** 2))
    return noise / np.sqrt(information) if information > 0.0 else np.inf


def _moved(
    points: Float[np.ndarray, "n 2"], radius: float, thickness: float
) -> Float[np.ndarray, " n"]:
    """Displacements of markers per angle of the object, whose disc of this radius sticks [mm]."""
    distance = np.maximum(np.hypot(*points.T), 1e-9)
    return distance * share_around(np.minimum(radius / distance, 1.0), radius / thickness).value


def turned_limits(
    points: Float[np.ndarray, "n 2"],
    held: Bool[np.ndarray, "frames n"],
    stick: Bool[np.ndarray, "frames n"],
    noise: float,
) -> Float[np.ndarray, " frames"]:
    """Least standard deviations of unbiased angles from each frame and all frames before it.

    The object's rotation and shift are unknown in each frame. Markers that have never slipped have
    known places on the object. The place of any other marker is unknown but fixed until it slips
    again, so that such markers show how far the object has turned since the frames before.

    Args:
        points: positions of the markers [mm].
        held: markers that have never slipped.
        stick: markers that have not slipped since the frame before.
        noise: σ, standard deviation of each coordinate, independent in each frame [mm].

    Returns:
        The standard deviations [rad]; infinite where the markers do not determine the angle.
    """
    arms = points - points.mean(axis=0)
    motion = np.zeros((len(arms), 2, 3))  # displacement by shift and rotation
    motion[:, 0, 0] = motion[:, 1, 1] = 1.0
    motion[:, :, 2] = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    information = np.einsum("nki,nkj->nij", motion, motion)
    place = np.cumsum(~stick, axis=0)  # number of the marker's place on the object
    limits = np.full(len(stick), np.inf)
    for count in range(1, len(stick) + 1):
        same = place[:count, None] == place[:count]
        unknown = same & ~held[:count, None]
        weight = np.eye(count)[..., None] - unknown / same.sum(axis=1, keepdims=True)
        whole = np.tensordot(weight, information, 1).swapaxes(1, 2).reshape(3 * count, -1)
        values, vectors = np.linalg.eigh(whole)
        known = values > 1e-9 * max(values[-1], 1e-30)
        if np.abs(vectors[-1, ~known]).max(initial=0.0) < 1e-6:
            limits[count - 1] = noise * np.sqrt(np.sum(vectors[-1, known] ** 2 / values[known]))
    return limits


def turned_contact_limits(
    points: Float[np.ndarray, "n 2"],
    radii: Float[np.ndarray, " frames"],
    thickness: float,
    noise: float,
) -> Float[np.ndarray, " frames"]:
    """The same from all markers of a contact that turns back, sticking and slipping.

    As for `contact_limit`, only the angles are unknown: that of the turn, in the first frame, and
    that of each frame since.

    Args:
        points: positions of the markers from the axis [mm].
        radii: of the disc that sticks, from the turn on [mm].
        thickness: of the layer [mm].
        noise: σ, standard deviation of each coordinate, independent in each frame [mm].
    """
    moved = [_moved(points, radius, thickness) for radius in radii]
    at_turn = float(moved[0] @ moved[0])
    limits = [noise / np.sqrt(at_turn) if at_turn > 0.0 else np.inf]
    for now in moved[1:]:  # displacement by the angle, and by that of the turn
        before, own = moved[0] - now, float(now @ now)
        cross = float(now @ before) / own if own > 0.0 else 0.0
        at_turn += float(np.sum((before - cross * now) ** 2))
        known = own > 0.0 and at_turn > 0.0
        limits.append(noise * np.sqrt(1.0 / own + cross**2 / at_turn) if known else np.inf)
    return np.array(limits)


def line_shortfall(theta: Angles) -> Angles:
    """Error of the angle of a line element under the linear twist θ × r, atan θ − θ [rad]."""
    return np.arctan(theta) - theta


def curl_shortfall(theta: Angles) -> Angles:
    """Error of half the curl under a true rotation (R − I) r, sin θ − θ [rad]."""
    return np.sin(theta) - theta


def traction_excess(theta: Angles, poisson_ratio: float) -> Angles:
    """Relative excess of the traction if (R − I) r is imposed on a linear half-space [-].

    The half-space takes the contraction 1 − cos θ for strain and adds an inward traction:
    tan(θ/2)/(1−ν) times the traction of the twist.
    """
    return np.sqrt(1.0 + (np.tan(0.5 * theta) / (1.0 - poisson_ratio)) ** 2) - 1.0
