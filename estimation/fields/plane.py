"""Motions in the contact's tangent plane: projection of markers and least-squares fits.

[Kabsch1976] W. Kabsch, "A solution for the best rotation to relate two sets of vectors".
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.fields.measure import Fields, tilt
from estimation.fields.stencils import Stencils, cross
from estimation.fields.stick import MIN_STICK_MARKERS


class Motion(NamedTuple):
    """A motion of the plane: multiplication by `turn` about `origin`, which moves to `image`.

    The modulus of `turn` is an even stretch, which pressure causes unless ν = ½. In least squares
    it does not change the angle.
    """

    turn: complex
    origin: complex
    image: complex

    @property
    def angle(self) -> float:
        """Rotation [rad]."""
        return float(np.angle(self.turn))

    def residual(
        self, before: Complex[np.ndarray, " m"], after: Complex[np.ndarray, " m"]
    ) -> Complex[np.ndarray, " m"]:
        """Observed positions less those of the motion [mm]."""
        return after - self.image - self.turn * (before - self.origin)

    def lead(
        self, before: Complex[np.ndarray, " m"], after: Complex[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """The residual around the origin, counter-clockwise [mm]; 0 at the origin."""
        arm = self.turn * (before - self.origin)
        around = np.imag(np.conj(arm) * self.residual(before, after))
        return around / np.maximum(np.abs(arm), 1e-9)


def fit_motion(
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    weights: Float[np.ndarray, " m"] | None = None,
) -> Motion:
    """Least-squares motion ([Kabsch1976] in the plane); all points weigh alike by default."""
    weights = np.ones(len(before)) if weights is None else weights
    share = weights / weights.sum()
    origin, image = complex(share @ before), complex(share @ after)
    arm = before - origin
    lever = share * arm
    turn = complex(np.vdot(lever, after - image)) / max(float(np.vdot(lever, arm).real), 1e-30)
    return Motion(turn, origin, image)


def shear_strain(before: Complex[np.ndarray, " m"], after: Complex[np.ndarray, " m"]) -> float:
    """Largest shear strain of the least-squares affine motion of some points [-].

    It is half the difference between the principal stretches.

    Args:
        before: positions before, three or more [mm].
        after: positions now [mm].
    """
    x, y = before - before.mean(), after - after.mean()
    # y = turn x + shear conj(x), in least squares
    parts = np.column_stack([x, np.conj(x)])
    return float(np.abs(np.linalg.lstsq(parts, y)[0][1]))


def in_contact_plane(
    stencils: Stencils,
    fields: Fields,
    markers: Bool[np.ndarray, " n"],
    since: Fields | None = None,
) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
    """Positions of all markers in the tangent plane of some, before and now, as x + iy [mm].

    The tilt of the plane, from the mean normals before and now, is removed. The fields `since`
    replace the unloaded shape.
    """
    positions = stencils.reference if since is None else since.positions
    basis = basis_now = np.eye(2, 3)
    if not stencils.flat:
        normals = stencils.normals if since is None else since.normals
        normal = _mean_direction(normals[markers])
        basis = _span_plane(stencils, markers, normal)
        basis_now = tilt(basis, normal, _mean_direction(fields.normals[markers]))
    return _project(positions, basis), _project(fields.positions, basis_now)


def in_plane_of_edge(
    stencils: Stencils, fields: Fields
) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
    """Positions of all markers in the tangent plane at the centre of the contact's edge [mm].

    Unlike the mean normal of the markers in contact, that of a surface fitted to them does not
    depend on which of them are visible.
    """
    fewest = 12  # markers for a quadratic surface
    contact, edge = fields.contact, fields.edge
    if edge is None or stencils.flat or contact.sum() < fewest:
        return in_contact_plane(stencils, fields, contact)
    normal = _mean_direction(stencils.normals[contact])
    basis = _span_plane(stencils, contact, normal)
    axes = np.vstack([basis, normal])
    before, after = stencils.reference @ axes.T, fields.positions @ axes.T
    centre = axes[:2, :2] @ edge.parameters[:2]
    moved = (after - before)[contact, :2].mean(axis=0)
    slopes = _slope(before[contact], centre), _slope(after[contact], centre + moved)
    ends = (_mean_direction(np.append(-slope, 1.0)[None]) @ axes for slope in slopes)
    return _project(stencils.reference, basis), _project(fields.positions, tilt(basis, *ends))


def _slope(points: Float[np.ndarray, "m 3"], centre: Float[np.ndarray, " 2"]) -> np.ndarray:
    """Slope of the quadratic surface through some points at a place in the plane."""
    x, y = (points[:, :2] - centre).T
    terms = np.column_stack([x, y, np.ones_like(x), x * x, x * y, y * y])
    return np.linalg.lstsq(terms, points[:, 2])[0][:2]


def _span_plane(
    stencils: Stencils, markers: Bool[np.ndarray, " n"], normal: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "2 3"]:
    """Unit vectors that span the plane across a normal, along the rows of some markers."""
    along = stencils.tangents[markers][0, :, 0]
    along = _mean_direction((along - normal * (along @ normal))[None])
    return np.stack([along, cross(normal, along)])


def _project(
    positions: Float[np.ndarray, "n 3"], basis: Float[np.ndarray, "2 3"]
) -> Complex[np.ndarray, " n"]:
    return (positions @ basis.T) @ np.array([1.0, 1.0j])


def _mean_direction(vectors: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " 3"]:
    total = vectors.sum(axis=0)
    return total / np.sqrt(total @ total)


def surround(points: Complex[np.ndarray, " n"], centre: complex, radius: float) -> bool:
    """Whether points lie all around a circle: outside of it, in every quarter of the turn."""
    arm = points[np.isfinite(points)] - centre
    way = np.sort(np.angle(arm[np.abs(arm) > radius]))
    if not len(way):
        return False
    gaps = np.diff(way, append=way[0] + 2.0 * np.pi)
    return bool(gaps.max() < 0.5 * np.pi)


def fit_turn(
    before: Complex[np.ndarray, " m"], after: Complex[np.ndarray, " m"], noise: float
) -> tuple[float, float]:
    """Rotation of some markers as one body, and its standard error [rad]."""
    if len(before) < MIN_STICK_MARKERS:
        return np.nan, np.inf
    motion = fit_motion(before, after)
    arms = before - motion.origin
    return motion.angle, noise / float(np.sqrt(np.vdot(arms, arms).real))


def has_turned(
    before: Complex[np.ndarray, " m"], after: Complex[np.ndarray, " m"], noise: float
) -> bool:
    """Whether some markers have clearly turned as one body."""
    clear = 5.0  # standard errors of the turn
    turn, error = fit_turn(before, after, noise)
    return bool(abs(turn) > clear * error)


def leads(
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    body: Bool[np.ndarray, " n"],
    others: Bool[np.ndarray, " n"],
    noise: float,
    certain: float = 4.0,
) -> bool:
    """Whether a body has clearly moved further along its way than other markers as one body.

    Friction moves the gel no further than the object, so the others then slip.

    Args:
        before: positions before [mm].
        after: positions now [mm].
        body: markers of the body.
        others: the other markers, which may include some of the body.
        noise: noise per coordinate of the motion [mm].
        certain: standard errors by which it must have.
    """
    if min(body.sum(), others.sum()) < MIN_STICK_MARKERS:
        return False
    x, y = before[others], after[others]
    motion = fit_motion(x, y)
    way = after[body] - before[body]
    way = way / max(float(np.linalg.norm(way)), 1e-12)
    ahead = float(np.vdot(way, motion.residual(before[body], after[body])).real)
    arms, levers = x - motion.origin, before[body] - motion.origin
    turned = abs(np.vdot(way, levers)) ** 2 / float(np.vdot(arms, arms).real)
    variance = 1.0 + abs(way.sum()) ** 2 / len(x) + turned
    return bool(ahead > certain * noise * np.sqrt(variance))
