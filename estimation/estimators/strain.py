"""The press's uneven strain of the gel, apart from which markers that stick move as one body.

A press stretches the gel by up to a percent, more near the face's edge. The strain lasts and turns
with the object, but it is no turn: it is left out of the fitted motion.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.estimators.body import CORE_MARKERS, Body, fit_body, noise_or_misfit


class Bulge(NamedTuple):
    """Displacement by which a press strains the gel unevenly: around its axis, it turns nothing.

    It is the gradient of a polynomial of the distance from the axis, of the fourth and sixth
    degree; what the second degree gives belongs to the motion.
    """

    origin: complex
    size: float  # of the region [mm]
    parts: Float[np.ndarray, " 4"]  # of `_gradients` [mm]

    def displace(self, points: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
        """Displacement of some points [mm]; beyond the region it grows evenly."""
        x = (points - self.origin) / self.size
        beyond = np.maximum(np.abs(x), 1.0)
        return beyond * (self.parts @ _gradients(x / beyond))


class Press(NamedTuple):
    """Uneven strain by a press, which stays in the gel that sticks; in its unloaded shape.

    Attributes:
        stretch: more along one axis than along the other (`fit_stretch`) [-].
        bulge: around an axis (`fit_bulge`); None if there is none.
    """

    stretch: complex = 0j
    bulge: Bulge | None = None

    def displace(
        self, points: Complex[np.ndarray, " m"], turn: complex
    ) -> Complex[np.ndarray, " m"]:
        """Displacement of some points after a turn, of which the modulus does not count [mm]."""
        turn /= abs(turn)
        moved = self.stretch * turn * np.conj(points)
        return moved if self.bulge is None else moved + turn * self.bulge.displace(points)


class StrainedBody(NamedTuple):
    """A body and its strain by the press.

    Attributes:
        body: the markers and their motion, apart from the strain.
        scale: noise or misfit per coordinate [mm].
        spread: variance of the rotation over that without strain [-].
        press: the strain.
    """

    body: Body
    scale: float
    spread: float = 1.0
    press: Press = Press()

    def has_more(self, other: "StrainedBody") -> bool:
        """Whether more markers move as one body, at no larger misfit."""
        more = self.body.weights.sum() > other.body.weights.sum()
        return bool(more and self.scale <= other.scale)


class Segment(NamedTuple):
    """Markers that may stick, among all of a layout.

    Attributes:
        before: positions of all before, in the contact's plane [mm].
        after: positions now [mm].
        markers: those of the segment.
        centre: the marker from which a fit starts.
        noise: noise per coordinate of the motion [mm]; 0 if unknown.
    """

    before: Complex[np.ndarray, " n"]
    after: Complex[np.ndarray, " n"]
    markers: Bool[np.ndarray, " n"]
    centre: int
    noise: float

    def fit_without(
        self, press: Press = Press(), turn: complex = 1.0 + 0j
    ) -> tuple[StrainedBody, "Segment"]:
        """The body apart from some strain, turned by so much, and the markers without it."""
        even = self._replace(after=self.after - press.displace(self.before, turn))
        return StrainedBody(*fit_body(*even), press=press), even

    def misfit(self, fitted: StrainedBody) -> float:
        """Mean square misfit of a body's markers over that of noise, 1 if noise explains it [-].

        Markers near the cut of the weights, where strain remains, add to the rotation's variance.
        """
        x, y = self.before[self.markers], self.after[self.markers]
        residual = fitted.body.motion.residual(x, y)[fitted.body.weights > 0.0]
        return (noise_or_misfit(residual, fitted.scale) / fitted.scale) ** 2


def fit_strained_body(
    segment: Segment, known: Press = Press(), sought: bool = True
) -> tuple[StrainedBody, Segment]:
    """The body of a segment, and its markers, without strain by the press that it clearly has.

    Under friction, an elongated object that is pressed on stretches the gel more along one axis
    than along the other. Markers that lie unevenly then seem to turn. Around its axis, any press
    strains the gel by some tenths of a percent, which keeps outer markers that stick out of the
    body if the noise is fine. The strain lasts and turns with the object, and markers that stick
    may be found only without it. Where most of the contact slips, slip looks like strain, so that
    only the known one counts.

    Args:
        segment: the markers that may stick.
        known: the strain found in an earlier frame.
        sought: whether to look for strain beyond the known one.
    """
    x = segment.before[segment.markers]
    found, even = segment.fit_without()
    turn = found.body.motion.turn
    turn /= abs(turn)
    if known.stretch:
        found, even = segment.fit_without(Press(known.stretch), turn)
    for _ in range(3):
        y = even.after[segment.markers]
        refined = bool(found.press.stretch)
        stretch, spread = fit_stretch(x, y, found.body.weights, segment.noise, refined)
        found = found._replace(spread=spread if found.press.stretch else 1.0)
        if not (stretch and sought):
            break
        found, even = segment.fit_without(Press(found.press.stretch + stretch / turn), turn)
        found = found._replace(spread=spread)
    if sought:
        return _fit_bulge(segment, found, even, turn)
    bulging, flat = segment.fit_without(known, turn) if known.bulge else (found, even)
    if not bulging.has_more(found):
        return found, even
    return bulging._replace(spread=found.spread * flat.misfit(bulging)), flat


def _fit_bulge(
    segment: Segment, found: StrainedBody, even: Segment, turn: complex
) -> tuple[StrainedBody, Segment]:
    """A body and its markers without their bulge, if more of them then move as one body.

    The bulge of all markers starts the search.

    Args:
        segment: the markers that may stick.
        found: the body without a bulge.
        even: the markers without its stretch.
        turn: its turn, of modulus 1.
    """
    # markers among which a bulge differs from slip; most fits, and their change of the weights at
    # which they have converged [-]
    many, most, settled = 2 * CORE_MARKERS, 6, 0.02
    x, y = segment.before[segment.markers], even.after[segment.markers]
    best, weights = (found, even), np.ones(len(x))
    for _ in range(most):
        if (weights > 0.0).sum() < many:
            break
        bulge, spread = fit_bulge(x, y, weights, segment.noise, turn)
        if bulge is None:
            break
        bulging, flat = segment.fit_without(found.press._replace(bulge=bulge), turn)
        if bulging.has_more(best[0]):
            best = bulging._replace(spread=spread * flat.misfit(bulging)), flat
        change, weights = np.abs(bulging.body.weights - weights).max(), bulging.body.weights
        if change < settled:
            break
    return best


def fit_stretch(
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    weights: Float[np.ndarray, " m"],
    noise: float,
    refined: bool = False,
) -> tuple[complex, float]:
    """Uneven stretch of weighted points, where it clearly exceeds the noise.

    The motion is least squares of the form `after` = turn · `before` + stretch · conj(`before`) +
    shift.

    Args:
        before: positions before [mm].
        after: positions now [mm].
        weights: weights of the points [-].
        noise: noise per coordinate [mm].
        refined: whether some of it has been found, so that the rest need not exceed the noise.

    Returns:
        The stretch [-], 0 if the noise may cause it, and the variance of the turn with it over that
        without it.
    """
    clear, most = 13.8, 0.01  # 99.9 % of χ² of two numbers; largest strain by pressing
    share = weights / weights.sum()
    x, y = before - share @ before, after - share @ after
    size, skew = float(weights @ np.abs(x) ** 2), complex(weights @ x**2)
    left = size**2 - abs(skew) ** 2
    if left < 1e-3 * size**2 or not noise > 0.0:
        return 0j, 1.0
    stretch = (size * (weights @ (x * y)) - skew * (weights @ (np.conj(x) * y))) / left
    clearly = refined or abs(stretch) ** 2 * left / size >= clear * noise**2
    if abs(stretch) > most or not clearly:
        stretch = 0j
    return complex(stretch), size**2 / left


def fit_bulge(
    before: Complex[np.ndarray, " m"],
    after: Complex[np.ndarray, " m"],
    weights: Float[np.ndarray, " m"],
    noise: float,
    turn: complex,
) -> tuple[Bulge | None, float]:
    """Bulge of weighted points, where it clearly exceeds the noise.

    One of less than the noise in root mean square keeps no markers out of the body, and cannot be
    distinguished from slip that the noise hides.

    Args:
        before: positions before [mm].
        after: positions now [mm].
        weights: weights of the points [-].
        noise: noise per coordinate [mm].
        turn: turn of the points, of modulus 1, with which the bulge turns.

    Returns:
        The bulge before the turn, None if the noise may cause it, and the variance of the turn with
        it over that without it.
    """
    clear, most = 18.5, 0.03  # 99.9 % of χ² of four numbers; largest strain by pressing
    known = weights > 0
    if not noise > 0.0:
        return None, 1.0
    share = weights / weights.sum()
    origin = complex(share @ before)
    x = (before - origin)[known]
    size = float(np.abs(x).max())
    x, one = x / size, np.ones_like(x)
    linear = np.stack([one, 1j * one, 1j * x, x, np.conj(x), 1j * np.conj(x)])
    columns = np.concatenate([linear, _gradients(x)]) * np.sqrt(weights[known])
    matrix = np.concatenate([columns.real, columns.imag], axis=1)
    normal = matrix @ matrix.T
    if np.linalg.cond(normal) > 1e8:
        return None, 1.0
    seen = (after - share @ after)[known] * np.sqrt(weights[known]) / turn
    covariance, own = np.linalg.inv(normal), slice(len(linear), None)
    parts = (covariance @ (matrix @ np.r_[seen.real, seen.imag]))[own]
    evidence = float(parts @ np.linalg.solve(covariance[own, own], parts))
    bulge = Bulge(origin, size, parts)
    strained = np.abs(bulge.displace(before[known])).max() > most * size
    if strained or evidence < max(clear, 2.0 * weights.sum()) * noise**2:
        return None, 1.0
    return bulge, float(covariance[2, 2] * normal[2, 2])


def _gradients(x: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, "4 m"]:
    """Gradients of |x|⁴ and |x|⁶, and changes of the first one if the axis moves from 0."""
    square = np.abs(x) ** 2
    beside = (2.0 * square + x**2, 1j * (2.0 * square - x**2))
    return np.stack([x * square, *beside, x * square**2])
