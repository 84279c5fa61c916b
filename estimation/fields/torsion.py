"""The rotation of gel around a face that turns and slips from its edge inwards.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".

Under a constant load each small twist moves the gel like a rigid disc as large as the region that
still sticks ([Jaeger1995]). So the rotation at a distance from the axis is the integral of the
rotation around that disc (`profile`) over the twist, along the curve on which the disc shrinks
(`contactmodel.analytic.layer_torsion_curve`). It depends on the twist over one scale, which grows
with friction and pressure and falls with the gel's modulus.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.analytic import layer_torsion_curve, press_layer_punch
from estimation.fields.face import find_place
from estimation.fields.profile import share_around


class Turned(NamedTuple):
    """Gel around a face that has turned.

    Attributes:
        value: rotation at the points, over the twist's scale [-].
        share: its derivative by the twist [-].
        by_distance: its derivative by the distance.
        by_thinness: its derivative by a/(a + h).
        by_flat: its derivative by the flat part.
    """

    value: Float[np.ndarray, " m"]
    share: Float[np.ndarray, " m"]
    by_distance: Float[np.ndarray, " m"]
    by_thinness: Float[np.ndarray, " m"]
    by_flat: Float[np.ndarray, " m"]


class _Knots(NamedTuple):
    """Faces that are solved; others are interpolated.

    Attributes:
        thinness: a/(a + h).
        flat: radius of the flat part over that of the contact.
        least_stick_ratio: c/a up to which the curves are known; beyond, the disc stays as large.
        step: step of the distance over the contact's radius.
        furthest: largest distance.
    """

    thinness: tuple[float, ...] = (0.0, 0.2, 0.35, 0.5, 0.63, 0.76)
    flat: tuple[float, ...] = (0.0, 0.3, 0.5, 0.67, 0.8, 0.88, 0.94)
    least_stick_ratio: float = 0.05
    step: float = 0.025
    furthest: float = 3.0


def clip_turning(thinness: float, flat: float) -> tuple[float, float]:
    """The nearest thinness and flat part of the faces that are solved."""
    most = _Knots().thinness[-1], _Knots().flat[-1]
    within = np.clip((thinness, flat), 0.0, most)
    return float(within[0]), float(within[1])


class TurningFace:
    """A face that turns on a layer."""

    def __init__(self, thinness: float, flat: float) -> None:
        """Make one.

        Args:
            thinness: a/(a + h) of the contact's radius a and the gel's thickness h [-].
            flat: radius of the face's flat part over that of the contact [-].
        """
        i, x, dx = find_place(thinness, _Knots().thinness)
        j, y, dy = find_place(flat, _Knots().flat)
        self._corners = [_solve(u, b) for u in (i, i + 1) for b in (j, j + 1)]
        thin, flats = np.array([1.0 - x, x]), np.array([1.0 - y, y])
        step = np.array([-1.0, 1.0])
        # weights of the corners, and their derivatives by thinness and flat part
        pairs = ((thin, flats), (dx * step, flats), (thin, dy * step))
        self._weights = np.stack([np.outer(*pair).ravel() for pair in pairs])
        self._twist = self._weights @ np.array([corner.twist for corner in self._corners])

    def stick_ratio(self, twist: float) -> float:
        """Radius of the disc that sticks after a twist over the scale, over the contact's [-]."""
        return float(np.interp(twist, self._twist[0], _stick_ratios()))

    def find_disc(self, twist: float) -> tuple[float, Float[np.ndarray, " 3"]]:
        """`stick_ratio`, and its derivatives by the scale's logarithm, thinness and flat part."""
        known, ratios = self._twist, _stick_ratios()
        ratio = self.stick_ratio(twist)
        along = np.interp(twist, known[0], np.gradient(ratios, known[0]))
        by_face = [np.interp(twist, known[0], row) for row in known[1:]]
        return ratio, -along * np.array([twist, *by_face])

    def turn(self, twist: float, distance: Float[np.ndarray, " m"]) -> Turned:
        """The rotation at distances from the axis, over the contact's radius.

        Args:
            twist: rotation of the face over the scale, 0 or more [-].
            distance: distances [-].
        """
        known = self._twist[0]
        beyond = max(twist - float(known[-1]), 0.0)
        j = int(np.searchsorted(known, twist - beyond, side="right")) - 1
        j = min(max(j, 0), len(known) - 2)
        part = (twist - beyond - known[j]) / (known[j + 1] - known[j])
        along = np.array([1.0 - part, part])
        near = np.array([corner.fields[j : j + 2] for corner in self._corners])
        rows = np.einsum("wc,t,ctrk->rwk", self._weights, along, near)
        place = np.minimum(np.nan_to_num(distance / _Knots().step), len(rows) - 1.001)
        left = place.astype(int)
        start = rows.take(left, axis=0)
        slope = rows.take(left + 1, axis=0) - start
        fields = start + (place - left)[:, None, None] * slope
        value, share = fields[..., 0].T, fields[..., 1].T
        by_face = value[1:] - share[0] * (self._twist[1:, j : j + 2] @ along)[:, None]
        return Turned(
            value=value[0] + beyond * share[0],
            share=share[0],
            by_distance=slope[:, 0, 0] / _Knots().step,
            by_thinness=by_face[0],
            by_flat=by_face[1],
        )


class _Solved(NamedTuple):
    """Twists over the scale, and the fields there over the distance: rotation and share."""

    twist: Float[np.ndarray, " points"]
    fields: Float[np.ndarray, "points distances 2"]


@cache
def _stick_ratios() -> Float[np.ndarray, " points"]:
    return 1.0 - (1.0 - _Knots().least_stick_ratio) * np.linspace(0.0, 1.0, 81) ** 1.5


def prepare_faces() -> None:
    """Solve all faces, so that no frame of a live source waits for them; takes 0.1 to 0.2 s."""
    for place in np.ndindex(len(_Knots().thinness), len(_Knots().flat)):
        _solve(*place)


@cache
def _solve(thin: int, flat: int) -> _Solved:
    """The face of two knots; solved once, which takes some milliseconds."""
    from scipy.interpolate import PchipInterpolator  # slow to import, as in `edge`

    thickness, shares = _thickness(thin), _shares(thin)
    (punch,) = press_layer_punch(np.zeros(1), thickness, np.array([_Knots().flat[flat]]))
    curve = layer_torsion_curve(punch.pressure, thickness, _Knots().least_stick_ratio, points=28)
    twist = PchipInterpolator(-curve.stick_ratio, curve.twist)(-_finer(_stick_ratios()))
    twist[0] = 0.0
    steps = 0.5 * (shares[1:] + shares[:-1]) * np.diff(twist)[:, None]
    turned = np.concatenate([np.zeros((1, shares.shape[1])), np.cumsum(steps, axis=0)])
    return _Solved(twist[::4], np.stack([turned, shares], axis=2)[::4])


@cache
def _shares(thin: int) -> Float[np.ndarray, "ratios distances"]:
    """Rotations around discs of all sizes, on the layer of a knot."""
    thickness, knots = _thickness(thin), _Knots()
    count = round(knots.furthest / knots.step) + 1
    distance = np.maximum(knots.step * np.arange(count), 1e-9)
    return np.stack(
        [
            share_around(np.minimum(c / distance, 1.0), c / thickness).value
            for c in _finer(_stick_ratios())
        ]
    )


def _thickness(thin: int) -> float:
    """Thickness of the layer of a knot, over the contact's radius [-]."""
    thinness = _Knots().thinness[thin]
    return 1.0 / thinness - 1.0 if thinness else np.inf


def _finer(values: Float[np.ndarray, " points"]) -> Float[np.ndarray, " more"]:
    """Four steps between two values instead of one, over which the rotation is integrated."""
    fine = np.arange(4 * (len(values) - 1) + 1) / 4
    return np.interp(fine, fine[::4], values)
