"""Moment–angle curves of contacts in torsion, for pressures from peaked to flat.

How a contact loses its hold depends on its pressure: it is peaked under a sphere on a thin layer,
Hertz's under a sphere on a thick one, and flat under a flat face. Where the contact's edge is
fitted (`estimation.fields.edge`), the object's face and the gel's thickness give the pressure and
the curve on this gel. Elsewhere several pressures are likely, on gel that is thick: its thickness
changes a curve, scaled to stiffness and limit 1, by less than 5 % for layers down to the contact's
radius.
"""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from contactmodel.analytic import (
    TorsionCurve,
    layer_torsion_curve,
    press_layer_punch,
    rounded_punch_pressure,
    torsion_curve,
)

HERTZ_NAME = "Hertz"
"""Name of Hertz's pressure among the curves."""
LEAST_STICK_RATIO = 0.1
"""c/a to which the curves are tabulated [-]; they have no end."""


class Face(NamedTuple):
    """The numbers that determine a pressure; NaN where unknown.

    Attributes:
        thinness: a/(a + h) of the contact's radius a and the gel's thickness h [-].
        flat: radius of the face's flat part over that of the contact [-].
        elongation: long over short axis of the contact's outline [-].
    """

    thinness: float = np.nan
    flat: float = np.nan
    elongation: float = np.nan


class _Knots(NamedTuple):
    """Faces between which curves are interpolated: all pairs of these numbers."""

    thinness: tuple[float, ...] = (0.0, 0.3, 0.45, 0.55, 0.65, 0.76)
    flat: tuple[float, ...] = (0.0, 0.3, 0.5, 0.65, 0.8, 0.9, 0.94)


def likely_pressures(face: Face) -> Mapping[str, float]:
    """Names of the likely pressures, and their probabilities.

    Args:
        face: the fitted face.
    """
    doubt = 0.08  # of the flat part
    if not np.isfinite(face.thinness + face.flat):
        names = pressure_curves()
        return dict.fromkeys(names, 1.0 / len(names))
    likely: dict[str, float] = {}
    for more, share in ((0.0, 0.5), (-doubt, 0.25), (doubt, 0.25)):
        flat = min(max(face.flat + more, 0.0), _Knots().flat[-1])
        name = f"flat to {flat:.2f} a, a/(a + h) = {face.thinness:.2f}"
        likely[name] = likely.get(name, 0.0) + share
    return likely


@lru_cache(maxsize=1024)
def pressure_curve(name: str) -> TorsionCurve:
    """First loading up to the least stick ratio under a pressure of this name."""
    if name in pressure_curves():
        return pressure_curves()[name]
    *_, flat, thinness = (float(word) for word in name.split() if word[0].isdigit())
    return face_curve(Face(thinness, flat))


@cache
def pressure_curves() -> dict[str, TorsionCurve]:
    """Curves for faces that are unknown, by the name of the pressure."""
    pressures = {
        f"(1 − r²/a²)^{power:g}": lambda r, power=power: np.maximum(1.0 - r * r, 0.0) ** power
        for power in (1.5, 1.0)
    }
    pressures |= {
        f"flat to {flat:g} a" if flat else HERTZ_NAME: rounded_punch_pressure(flat)
        for flat in (0.0, 0.4, 0.65, 0.85)
    }
    return {name: torsion_curve(p, LEAST_STICK_RATIO) for name, p in pressures.items()}


def face_curve(face: Face) -> TorsionCurve:
    """The curve under a face, interpolated between those of some faces."""
    thinness, flat = _Knots()
    i, x = _place(face.thinness, thinness)
    j, y = _place(face.flat, flat)
    near = [[_solve_curve(u, b) for b in flat[j : j + 2]] for u in thinness[i : i + 2]]
    curve = np.einsum("i,j,ijkp->kp", [1.0 - x, x], [1.0 - y, y], np.array(near))
    return TorsionCurve(*curve)


def _place(value: float, knots: Sequence[float]) -> tuple[int, float]:
    """The interval of a value, and its place within."""
    i = int(np.clip(np.searchsorted(knots, value, side="right") - 1, 0, len(knots) - 2))
    return i, float(np.clip((value - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0))


@cache
def _solve_curve(thinness: float, flat: float) -> TorsionCurve:
    """The curve under a face; solved when asked for, which takes some hundredths of a second."""
    thickness = 1.0 / thinness - 1.0 if thinness else np.inf
    (punch,) = press_layer_punch(np.zeros(1), thickness, np.array([flat]))
    return layer_torsion_curve(punch.pressure, thickness, LEAST_STICK_RATIO)
