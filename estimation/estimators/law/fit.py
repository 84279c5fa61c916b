"""Fit of a turning contact to all of its markers, whether they stick or slip.

Gel around a face that turns follows `estimation.fields.torsion`, first loading up to the last turn
of the object and, by Masing's rule, the same curve enlarged twice since then. A contact that is not
round is treated like a round one in the coordinates of its outline (`estimation.fields.edge`).
While nearly all sticks, the slip has grown along an outline that had turned by half of the object's
angle on average; the more slips, the closer it follows the present outline. What this leaves out is
a smooth factor on the slip, whose standard deviation grows with the outline's deviation from a
circle. The press stretches gel under an elongated object, in two waves that turn with the gel.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.law.state import At, Belief, LawFit, LawModel
from estimation.fields.edge import Polar, measure_places, outline_slopes
from estimation.fields.face import Indentation
from estimation.fields.torsion import TurningFace, clip_turning


class _Prediction(NamedTuple):
    """Residuals of the markers, around the axis and away from it, and their derivatives."""

    residual: Float[np.ndarray, " k"]
    slopes: Float[np.ndarray, "26 k"]
    spread: Float[np.ndarray, " k"]
    deviation: float
    aligned: float
    stick_ratio: float
    held_ratio: float


class _Rotated(NamedTuple):
    """Rotation of the gel at the markers by the law, and its derivatives."""

    value: Float[np.ndarray, " m"]
    by_angle: Float[np.ndarray, " m"]
    by_contact: Float[np.ndarray, "11 m"]
    plain: Float[np.ndarray, " m"]
    aligned: float
    stick_ratio: float
    held_ratio: float


def fit_law(
    before: Complex[np.ndarray, " n"],
    after: Complex[np.ndarray, " n"],
    noise: float,
    guess: tuple[float, Float[np.ndarray, " 11"]],
    belief: Belief,
    most: int,
    model: LawModel = LawModel(),
) -> LawFit | None:
    """The most probable angle and contact; None without markers enough or if the fit diverges.

    Args:
        before: positions of the markers before the contact [mm].
        after: positions now [mm].
        noise: noise per coordinate [mm].
        guess: angle [rad] and parameters from which the fit starts.
        belief: what is known of the contact.
        most: largest number of steps.
        model: how far the contact may deviate from the law.
    """
    angle, contact = guess
    arm = before - complex(*contact[At.centre])
    known = before - complex(*belief.mean[At.centre])
    near = _within(known, after, model.reach * float(np.exp(belief.mean[At.radius])))
    if near.sum() < model.fewest:
        return None
    z, w = before[near], after[near]
    inner = np.abs(arm[near]) <= np.sort(np.abs(arm[near]))[8]
    shift = np.mean((w - z)[inner] - (np.exp(1j * angle) - 1.0) * arm[near][inner])
    start = np.r_[angle, shift.real, shift.imag, 0.0, contact, np.zeros(At.count - At.contact.stop)]
    with np.errstate(over="ignore", invalid="ignore"):  # a step may go too far
        solved = _solve(start, z, w, noise, belief, most, model)
    if solved is None or abs(solved[0][At.angle]) > np.pi:
        return None
    v, made, precision, cost = solved
    scaled = made.slopes / made.spread
    every = np.linalg.inv(scaled @ scaled.T + precision)
    kept = [At.angle, *range(4, 15)]
    around, away = np.split(made.residual / made.spread, 2)
    arm = np.nan_to_num(before - complex(*v[At.contact][At.centre]), nan=1e6)
    return LawFit(
        angle=float(v[At.angle]),
        shift=float(np.hypot(*v[At.shift])),
        parameters=v[At.contact],
        covariance=every[np.ix_(kept, kept)],
        known=float(every[At.angle] @ precision @ every[At.angle] / every[At.angle, At.angle]),
        misfit=float(around @ around) / max(len(z) - 6, 1),
        cost=cost - float(away @ away),
        stick_ratio=made.stick_ratio,
        held_ratio=made.held_ratio,
        places=_place(arm, v[At.contact], made.aligned).distance,
    )


class LawFits:
    """Fits of the last frame, made once for all readers that share them."""

    def __init__(self) -> None:
        """Begin without fits."""
        self._made: dict[bytes, dict[tuple[bytes, LawModel], LawFit | None]] = {}  # by positions

    def share(self, others: "LawFits") -> None:
        """Share the fits of other readers of the same frames."""
        self._made = others._made

    def fit(
        self,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        noise: float,
        guess: tuple[float, Float[np.ndarray, " 11"]],
        belief: Belief,
        most: int,
        model: LawModel,
    ) -> LawFit | None:
        """The fit as of `fit_law`."""
        now = after.tobytes()
        if now not in self._made:
            self._made.clear()
        made = self._made.setdefault(now, {})
        values = before, noise, *guess, *belief, most
        key = b"".join(np.asarray(value).tobytes() for value in values), model
        if key not in made:
            made[key] = fit_law(before, after, noise, guess, belief, most, model)
        return made[key]


def _within(
    arm: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], reach: float
) -> Bool[np.ndarray, " n"]:
    near = np.isfinite(arm + after)
    near[near] = np.abs(arm[near]) < reach
    return near


def _solve(
    v: Float[np.ndarray, " 26"],
    z: Complex[np.ndarray, " m"],
    w: Complex[np.ndarray, " m"],
    noise: float,
    belief: Belief,
    most: int,
    model: LawModel,
) -> tuple[np.ndarray, _Prediction, np.ndarray, float] | None:
    """Levenberg's and Marquardt's steps: parameters, prediction, prior precision and cost."""
    settled = 1e-2  # change of the squares at which a fit has converged
    mean, prior = _prior(belief, model)
    made, damping = _predict(v, z, w, noise, belief, model), 1e-3
    away = made.spread[len(z) :]
    precision, cost = _weigh(v, made, mean, prior)
    for _ in range(most):
        if not np.isfinite(cost):
            return None
        scaled, left = made.slopes / made.spread, made.residual / made.spread
        normal = scaled @ scaled.T + precision
        slope = scaled @ left + precision @ (v - mean)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -slope)
        new = _bound(v, step)
        tried = _predict(new, z, w, noise, belief, model, away)
        ahead, reached = _weigh(new, tried, mean, prior)
        if reached <= cost:
            gained, cost = cost - reached, reached
            v, made, precision, damping = new, tried, ahead, 0.2 * damping
            if gained < settled:
                break
        else:
            damping = max(8.0 * damping, 1e-4)
    if not np.isfinite(cost):
        return None
    return v, made, precision, cost


def _weigh(
    v: Float[np.ndarray, " 26"], made: _Prediction, mean: np.ndarray, prior: np.ndarray
) -> tuple[Float[np.ndarray, "26 26"], float]:
    """Precision of all parameters before the frame, and the cost of the fit (`LawFit`)."""
    precision, of_slip = prior.copy(), np.arange(At.count)[At.deviations]
    precision[of_slip, of_slip] += made.deviation**-2
    left = made.residual / made.spread
    around = made.spread[: len(made.spread) // 2]
    spread = float(np.sum(np.log(around))) + 9.0 * np.log(made.deviation)
    return precision, float(left @ left + (v - mean) @ precision @ (v - mean)) + 2.0 * spread


def _prior(belief: Belief, model: LawModel) -> tuple[np.ndarray, np.ndarray]:
    """Mean and precision of all parameters but the deviations; 1e-9 where nothing is known."""
    mean, precision = np.zeros(At.count), 1e-9 * np.eye(At.count)
    contact = At.contact
    mean[contact] = belief.mean
    precision[contact, contact] += np.linalg.inv(belief.covariance)
    precision[At.stretch, At.stretch] = model.even**-2
    mean[At.waves] = belief.stretch.imag, -belief.stretch.real
    spread = max(model.waves * abs(belief.stretch), 1e-7)
    precision[At.waves, At.waves] = spread**-2 * np.eye(2)
    return mean, precision


def _bound(v: Float[np.ndarray, " 26"], step: Float[np.ndarray, " 26"]) -> np.ndarray:
    """The parameters after a step that is not too long, for faces in the table."""
    firm = 8.0  # scale over the turn, from which nearly all of a face sticks
    longest = np.full(At.count, np.inf)
    longest[At.contact] = 0.3
    longest[At.contact][At.scale] = 0.7
    new = v + np.clip(step, -longest, longest)
    contact = new[At.contact]
    contact[[At.thinness, At.flat]] = clip_turning(*contact[[At.thinness, At.flat]])
    contact[At.corners] = np.clip(contact[At.corners], -0.15, 0.15)
    turned = max(abs(new[At.angle]), abs(contact[At.turn]), 1e-3)
    contact[At.scale] = min(contact[At.scale], np.log(firm * turned))
    return new


def _predict(
    v: Float[np.ndarray, " 26"],
    z: Complex[np.ndarray, " m"],
    w: Complex[np.ndarray, " m"],
    noise: float,
    belief: Belief,
    model: LawModel,
    away: Float[np.ndarray, " m"] | None = None,
) -> _Prediction:
    """Residuals of the markers in the frame that turns with the gel.

    Their spread away from the axis is given or follows from the slip.
    """
    contact = v[At.contact]
    arm = z - complex(*contact[At.centre])
    r = np.maximum(np.abs(arm), 1e-6)
    toward = arm / r
    law = _rotate(float(v[At.angle]), contact, z, belief)
    shaped = float(np.hypot(*contact[At.outline]) + np.hypot(*contact[At.corners]))
    modes = _modes(law.plain, toward)
    lag = v[At.angle] - law.value
    # gel that rests under a sliding object deviates from the law no further
    most = float(np.ptp(np.append(law.value, 0.0)))
    capped = np.abs(lag) > most
    lag = np.clip(lag, -most, most)
    deviation = v[At.deviations] @ modes
    more = np.where(capped, 1.0, 1.0 + deviation)
    slip = np.abs(lag) * r
    turn = np.conj(toward * np.exp(1j * (law.value - lag * deviation)))
    seen = turn * (w - complex(*contact[At.centre]) - complex(*v[At.shift]))
    by = np.zeros((At.count, len(z)))  # of the rotation
    by[At.angle] = 1.0 - (1.0 - law.by_angle) * more
    by[At.contact] = more * law.by_contact
    by[4] += toward.imag / r
    by[5] -= toward.real / r
    by[At.deviations] = -lag * modes
    slopes = -1j * seen * by
    for place, one in ((1, 1.0), (2, 1.0j), (4, 1.0), (5, 1.0j)):
        slopes[place] -= turn * one
    slopes[4] += toward.real
    slopes[5] += toward.imag
    slopes[At.stretch] -= r
    waves = r * _wave(law.plain, toward)
    slopes[At.waves] = -1j * waves
    spread = np.hypot(noise, (model.rough + 0.5 * model.shaped * shaped) * slip)
    across = away
    if across is None:
        across = np.sqrt(noise**2 + (model.radial * slip) ** 2 + (model.strain * r) ** 2)
    return _Prediction(
        residual=np.concatenate(
            [seen.imag - v[At.waves] @ waves, seen.real - r * (1.0 + v[At.stretch])]
        ),
        slopes=np.concatenate([slopes.imag, slopes.real], axis=1),
        spread=np.concatenate([spread, across]),
        deviation=model.smooth + model.shaped * shaped,
        aligned=law.aligned,
        stick_ratio=law.stick_ratio,
        held_ratio=law.held_ratio,
    )


def _rotate(
    angle: float,
    contact: Float[np.ndarray, " 11"],
    z: Complex[np.ndarray, " m"],
    belief: Belief,
) -> _Rotated:
    """Rotation of the gel by the law, after the last turn by Masing's rule.

    Once the object has turned back by twice that turn, all has slipped the other way, and the gel
    lies as if the object had turned that way at first.
    """
    arm, last = z - complex(*contact[At.centre]), float(contact[At.turn])
    face = TurningFace(contact[At.thinness], contact[At.flat])
    scale = float(np.exp(contact[At.scale]))
    legs = [(0.0, angle, scale)]
    if 0.0 < (last - angle) * belief.way < 2.0 * abs(last):
        legs = [(0.0, last, scale), (last, angle, 2.0 * scale)]
    shape = contact[At.radius : At.scale], [1.0], contact[At.corners]
    outline = np.concatenate([[0.0, 0.0], *shape])
    value, by = np.zeros(len(z)), np.zeros((11, len(z)))
    shares, ratios, aligned, plain = [], [], 0.0, value
    for start, end, size in legs:
        twist = end - start
        ratios.append(face.stick_ratio(abs(twist) / size))
        aligned = start + twist * (1.0 - 0.5 * np.cbrt(ratios[-1]))
        polar = _place(arm, contact, aligned)
        leg, along = face.turn(abs(twist) / size, polar.distance), np.sign(twist) * size
        own = [leg.value, leg.by_distance, leg.by_thinness, leg.by_flat]
        slopes = outline_slopes(outline, polar, Indentation(*(along * one for one in own)))
        moved = (slopes[0] + 1j * slopes[1]) * np.exp(1j * aligned)
        by[0] += moved.real
        by[1] += moved.imag
        by[At.radius : At.scale] += slopes[At.radius : At.scale]
        by[At.scale] += along * leg.value - twist * leg.share
        by[At.corners] += slopes[At.corners]
        value += along * leg.value
        shares.append(leg.share)
        plain = polar.plain
    by[At.turn] = shares[0] - shares[-1]
    return _Rotated(value, shares[-1], by, plain, aligned, ratios[-1], ratios[0])


def _place(
    arm: Complex[np.ndarray, " m"], contact: Float[np.ndarray, " 11"], turned: float
) -> Polar:
    """Places of points about the centre, in the contact's outline after it has turned."""
    back = arm * np.exp(-1j * turned)
    points = np.stack([back.real, back.imag], axis=1)
    return measure_places(points, np.concatenate([[0.0, 0.0], contact[At.radius : At.turn]]))


def _modes(
    plain: Float[np.ndarray, " m"], toward: Complex[np.ndarray, " m"]
) -> Float[np.ndarray, "9 m"]:
    """Smooth factors on the slip: over the distance, and around the axis."""
    x = np.minimum(plain / 1.5, 1.0)
    waves = np.stack([toward, toward**2, toward**4])
    around = np.concatenate([np.real(waves), np.imag(waves)])
    return np.stack([np.ones_like(x), 2.0 * x - 1.0, 6.0 * x * x - 6.0 * x + 1.0, *around])


def _wave(
    plain: Float[np.ndarray, " m"], toward: Complex[np.ndarray, " m"]
) -> Float[np.ndarray, "2 m"]:
    """Two waves around the axis, which fade outside the contact."""
    wave = toward**2 / (1.0 + plain**6)
    return np.stack([wave.real, wave.imag])
