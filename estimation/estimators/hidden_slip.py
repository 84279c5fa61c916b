"""Slip that the noise hides, and the error of a fitted angle that it can cause.

The markers that seem to stick may include some at their rim that have slipped by less than the
noise. Those beyond the rim show how steeply the slip grows.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from estimation.estimators.body import CORE_MARKERS, Body
from estimation.estimators.measurement import Z95
from estimation.fields.plane import Motion, fit_motion
from estimation.fields.stencils import Stencils, erode
from estimation.fields.stick import MIN_STICK_MARKERS


@dataclass(frozen=True, eq=False)
class Region:
    """Markers that seem to stick, among all of a layout, and their motion.

    Attributes:
        stencils: stencils of the layout.
        motion: motion of the markers that stick.
        before: positions of all markers before, in the contact's plane [mm].
        after: positions now [mm].
        stick: the markers that seem to stick.
        scale: noise or misfit per coordinate [mm].
    """

    stencils: Stencils
    motion: Motion
    before: Complex[np.ndarray, " n"]
    after: Complex[np.ndarray, " n"]
    stick: Bool[np.ndarray, " n"]
    scale: float

    @cached_property
    def beyond(self) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
        """Pairs of a marker of the region and a neighbour beyond it."""
        inner, slot = np.nonzero(self.stick[:, None] & (self.stencils.neighbours >= 0))
        outer = self.stencils.neighbours[inner, slot]
        beyond = ~self.stick[outer] & np.isfinite(self.before[outer] + self.after[outer])
        beyond &= self.before[outer] != self.motion.origin  # no arm, no lead
        return inner[beyond], outer[beyond]

    @cached_property
    def lead(self) -> Float[np.ndarray, " m"]:
        """How far these neighbours are ahead of the motion, counter-clockwise [mm]."""
        outer = self.beyond[1]
        return self.motion.lead(self.before[outer], self.after[outer])

    @property
    def grows_steeply(self) -> bool:
        """Whether slip grows so steeply beyond many markers that noise hides it in one row at most.

        Slip grows like the distance to the power 3/2. If neighbours beyond have slipped by ten
        standard deviations, and a marker one pitch inside of them by 2.5, which would be detected,
        the edge lies within 1.7 pitches of the neighbours.
        """
        many, one_row = 2 * CORE_MARKERS, 10.0
        known = len(self.lead) and self.stick.sum() >= many
        return bool(known and np.median(np.abs(self.lead)) > one_row * self.scale)

    def join_neighbours(self) -> Bool[np.ndarray, " n"]:
        """The markers with the neighbours, row by row, whose slip the noise hides if any."""
        detected = 2.5  # slip from which a marker is detected [noise]
        region = self
        while True:
            joining = region.beyond[1][np.abs(region.lead) < detected * self.scale]
            if not len(joining):
                return region.stick
            stick = region.stick.copy()
            stick[joining] = True
            region = replace(region, stick=stick)


def allow_for_slip(
    stencils: Stencils,
    body: Body,
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    segment: Bool[np.ndarray, " n"],
    scale: float,
) -> tuple[Body, Region, float]:
    """The body of a segment without slip, its region, and the lag by hidden slip [rad].

    If most markers lie at the region's rim, slip may hide in their noise. The inner half, which
    slips last, is then fitted too: if it turns clearly further, it alone sticks; if not, the
    interval covers how much further it may be, also where slip beyond grows steeply: under a flat
    face it still hides in several rows. The lag of fewer than three markers is NaN.
    """
    # errors of the inner half's lead that the interval covers (95 %); beyond which the rest slips
    inner_likely, inner_certain = 1.645, 1.96
    x, y = before[segment], after[segment]
    while True:
        stick = np.zeros_like(segment)
        stick[segment] = body.weights > 0
        region = Region(stencils, body.motion, before, after, stick, scale)
        if stick.sum() < MIN_STICK_MARKERS:
            return body, region, np.nan
        information, few = body.information(x), bool(stick.sum() < CORE_MARKERS)
        lag = bound_hidden_slip(region, body.influence(x, segment), few)
        if not lag or few or 2 * erode(stick, stencils).sum() >= stick.sum():
            return body, region, lag
        inner = body.take_inner_half(x, y)
        ahead = np.sign(lag) * float(np.angle(inner.motion.turn / body.motion.turn))
        error = scale * np.sqrt(1.0 / inner.information(x) - 1.0 / information)
        if ahead <= inner_certain * error:
            return body, region, np.sign(lag) * max(abs(lag), ahead + inner_likely * error)
        body = inner


def bound_hidden_slip(region: Region, influence: Float[np.ndarray, " n"], few: bool) -> float:
    """Bound on the error of the fitted angle by undetected slip [rad].

    Beyond the edge of the stick region, slip grows like the distance to the power 3/2 (pressure
    is smooth there). Consider a marker at the region's rim, one pitch inside a neighbour that has
    slipped by R standard deviations, with the edge anywhere up to three pitches inside that
    neighbour. The marker has then slipped by 0.21 R on average, and by 1.84 R^(-2/3) if slip above
    2.5 would have been detected.

    A region smaller than the core of the fit consists of rim markers, which may slip alike. Unless
    it has an edge (`_has_edge`), the true angle may exceed the fitted one by as much as the
    neighbours lag behind. If it has one, a slip s of a marker leaves a residual of s (1 − h), h its
    leverage in the fit. Its detection limit in s is larger by (1 − h)^(-1/2), and the average of
    the slip below the limit by (1 − h)^(-5/6). In a larger region, slip may hide in several rows
    (`_bound_wide_slip`).

    Args:
        region: the markers that seem to stick.
        influence: change of the fitted angle by each marker's slip [rad/mm].
        few: whether they are fewer than the core of a fit.

    Returns:
        Positive where the true angle lies counter-clockwise of the fitted one.
    """
    (inner, outer), before, motion = region.beyond, region.before, region.motion
    if not len(outer):
        return 0.0
    side = -np.sign(region.lead.sum())
    if few and not _has_edge(region):
        arm = motion.turn * (before[outer] - motion.origin)
        return float(side * np.abs(np.mean(region.lead / np.abs(arm))))
    slipped = np.clip(-side * region.lead / region.scale, 1e-9, None)
    hidden = np.minimum(0.21 * slipped, 1.84 * slipped ** (-2.0 / 3.0)) * region.scale
    if few:
        # rim markers slip together, which the fit takes for rotation: twice what one may hide
        hidden *= 2.0 * _free_share(before[inner], before[region.stick]) ** (-5.0 / 6.0)
    most = np.zeros(len(before))
    np.maximum.at(most, inner, hidden)
    wide = 0.0 if few else _bound_wide_slip(region)
    return float(side * max(influence @ most, wide))


def _bound_wide_slip(region: Region) -> float:
    """Bound on the error of the angle where slip grows over several markers within the noise [rad].

    At low friction and coarse noise, an outer third of the markers may slip unnoticed. A turn and a
    slip that grows with the power 3/2 from a circle on are fitted to all tangential residuals, for
    ten radii of the circle, which are weighted by their evidence. The power describes slip near
    the edge only, and a square face's edge is no circle: each residual counts with a fifth of
    itself as its error, besides the noise. If the slip exceeds three standard errors and a fifth of
    the markers lies outside the circle, both on average, the bound is the turn's mean plus 1.96
    standard deviations, less the noise of a fit without slip, which counts elsewhere. Otherwise it
    is 0, and the rim's first markers alone hide slip. So it is if the best fit's mean square is
    more than three times that of the errors, as under an elongated object on gel that creeps: such
    a fit is no evidence of slip.
    """
    radii, power, least_share, clear = np.linspace(0.0, 0.95, 10), 1.5, 0.2, 3.0
    inexact = 0.2  # error of the slip's shape, over the slip
    worst_misfit, unknowns = 3.0, 5  # mean square over the errors; turn, axis, slip and radius
    motion, stick, scale = region.motion, region.stick, region.scale
    count, points = stick.sum(), np.append(np.flatnonzero(stick), np.unique(region.beyond[1]))
    before, after = region.before[points], region.after[points]
    arm = motion.turn * (before - motion.origin)
    distance = np.maximum(np.abs(arm), 1e-9)
    along = 1j * arm / distance
    lag = -np.real(np.conj(along) * motion.residual(before, after)) / scale
    lag *= np.sign(lag[count:].sum())
    exact = 1.0 / np.hypot(1.0, inexact * lag)
    lag *= exact
    rigid = exact * np.stack([-distance, along.real, along.imag])
    edges = radii[:, None] * distance.max()
    grown = np.maximum(distance - edges, 0.0) ** power
    grown *= exact / grown.max(axis=1, keepdims=True)
    same = np.broadcast_to(rigid, (len(radii), *rigid.shape))
    columns = np.concatenate([same, grown[:, None]], axis=1)
    information = columns @ np.swapaxes(columns, 1, 2)
    covariance = np.linalg.inv(information + 1e-9 * np.eye(4))  # markers in a row have no inverse
    fitted = (covariance @ (columns @ lag)[:, :, None])[:, :, 0]
    left = lag - np.einsum("ck,ckm->cm", fitted, columns)
    squares = np.sum(left**2, axis=1)
    evidence = np.linalg.slogdet(covariance)[1] - squares
    weights = np.exp(0.5 * (evidence - evidence.max()))
    weights /= weights.sum()
    slipping = weights @ np.sum(distance[:count] > edges, axis=1)
    size = weights @ (fitted[:, 3] / np.sqrt(covariance[:, 3, 3]))
    unexplained = squares.min() > worst_misfit * max(len(lag) - unknowns, 1)
    if slipping < least_share * count or size < clear or unexplained:
        return 0.0
    mean = float(weights @ fitted[:, 0])
    variance = float(weights @ (covariance[:, 0, 0] + fitted[:, 0] ** 2)) - mean**2
    reach = max(mean, 0.0) + Z95 * np.sqrt(variance)
    noise = Z95**2 * float(np.linalg.pinv(rigid[:, :count] @ rigid[:, :count].T)[0, 0])
    return scale * float(np.sqrt(max(reach**2 - noise, 0.0)))


def _has_edge(region: Region) -> bool:
    """Whether a few markers stick, rather than slip alike.

    Where all of a contact slips, traction follows from the pressure, which does not vanish in its
    middle. There the rotation falls like the logarithm of the distance from the middle, within the
    markers as beyond them. The slope of their rotation within is compared with that to their
    neighbours, with the middle at their centre or at any of them. Fewer than five markers may all
    lie at the same distance.
    """
    # slope within, over the slope beyond, up to which markers stick; 95 %, one-sided
    most, likely = 0.15, 1.645
    motion, before, after, outer = region.motion, region.before, region.after, region.beyond[1]
    x, y, out = before[region.stick], after[region.stick], before[outer]
    if len(x) < 5:
        return False
    left, behind = motion.residual(x, y), motion.residual(out, after[outer])
    for middle in (motion.origin, *x):
        within, beyond = (_sliding_profile(motion.turn, points - middle) for points in (x, out))
        alike = fit_motion(x, within)
        within, beyond = alike.residual(x, within), alike.residual(out, beyond)
        information = max(float(np.vdot(within, within).real), 1e-30)
        slope = float(np.vdot(within, left).real) / information
        slope_beyond = np.vdot(beyond, behind).real / np.vdot(beyond, beyond).real
        if slope + likely * region.scale / np.sqrt(information) > most * slope_beyond:
            return False
    return True


def _free_share(
    points: Complex[np.ndarray, " m"], markers: Complex[np.ndarray, " k"]
) -> Float[np.ndarray, " m"]:
    """Share of a marker's own displacement that a fit of the markers leaves as its residual [-]."""
    arm = np.abs(markers - markers.mean())
    leverage = 1.0 / len(markers) + np.abs(points - markers.mean()) ** 2 / (arm @ arm)
    return np.maximum(1.0 - leverage, 0.05)


def _sliding_profile(turn: complex, arm: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
    """Displacement behind the object where all of a contact slips, up to a factor."""
    distance = np.abs(arm)
    return -1j * turn * arm * np.log(np.where(distance > 0.0, distance, 1.0))
