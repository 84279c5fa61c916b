"""Load curves of contacts in torsion and shear, for pressures from peaked to flat.

How a contact loses its hold depends on its pressure: it is peaked under a sphere on a thin layer,
Hertz's under a sphere on a thick one, and flat under a flat face. Where the contact's edge is
fitted (`estimation.fields.edge`), the object's face and the gel's thickness give the pressure and
the curve on this gel. Elsewhere several pressures are likely, on gel that is thick: its thickness
changes a curve, scaled to stiffness and limit 1, by less than 5 % for layers down to the contact's
radius.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
"""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.analytic import (
    TorsionCurve,
    layer_torsion_curve,
    press_layer_punch,
    rounded_punch_pressure,
    shift_curve,
    torsion_curve,
)
from contactmodel.analytic.any_pressure import Profile

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


def typical_face(faces: Sequence[Face]) -> Face:
    """The median of the known faces."""
    known = np.array(faces).reshape(-1, len(Face._fields))
    known = known[np.isfinite(known).all(axis=1)]
    return Face(*np.median(known, axis=0).tolist()) if len(known) else Face()


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


class LoadCurve(NamedTuple):
    """First loading of a contact that slips from its edge inwards.

    Motion and load are scaled so that the load of full slip and the stiffness without slip are 1.

    Attributes:
        stick_ratio: c/a, falling from 1 [-].
        motion: motion times stiffness over limit [-].
        load: load over limit [-].
        slope: slope of the load over the motion [-].
    """

    stick_ratio: Float[np.ndarray, " points"]
    motion: Float[np.ndarray, " points"]
    load: Float[np.ndarray, " points"]
    slope: Float[np.ndarray, " points"]

    @classmethod
    def of(cls, stick_ratio: np.ndarray, motion: np.ndarray, load: np.ndarray) -> "LoadCurve":
        """The curve through some points."""
        return cls(stick_ratio, motion, load, np.gradient(load, motion))


@lru_cache(maxsize=1024)
def pressure_curve(name: str, twist_share: float = 1.0) -> LoadCurve:
    """First loading up to the least stick ratio under a pressure of this name.

    The curves of torsion and shear alone are known ([Jaeger1995]). For both together, the load at
    a stick ratio is the mean of theirs, and the motion their geometric mean. Its weights turn to
    torsion where most of the load is a moment, since the object then turns about a point within the
    contact, which sticks longest. In solved contacts of balls the ends are within about 10 %.

    Args:
        name: name of the pressure.
        twist_share: share of the moment in the square of the load at first; the rest is shear [-].
    """
    if name in pressure_curves():
        torsion, shear = pressure_curves()[name]
    else:
        torsion, shear = face_curves(_read_face(name))
    if twist_share == 1.0:
        return torsion
    share = twist_share**2 * (3.0 - 2.0 * twist_share)
    motion = shear.motion ** (1.0 - share) * torsion.motion**share
    load = (1.0 - twist_share) * shear.load + twist_share * torsion.load
    return LoadCurve.of(torsion.stick_ratio, motion, load)


@cache
def pressure_curves() -> dict[str, tuple[LoadCurve, LoadCurve]]:
    """Curves in torsion and in shear for faces that are unknown, by the name of the pressure."""
    pressures = {
        f"(1 − r²/a²)^{power:g}": lambda r, power=power: np.maximum(1.0 - r * r, 0.0) ** power
        for power in (1.5, 1.0)
    }
    pressures |= {
        f"flat to {flat:g} a" if flat else HERTZ_NAME: rounded_punch_pressure(flat)
        for flat in (0.0, 0.4, 0.65, 0.85)
    }
    return {
        name: _with_shear(torsion_curve(p, LEAST_STICK_RATIO), p) for name, p in pressures.items()
    }


def prepare_curves(face: Face) -> None:
    """Solve one of the curves that the likely pressures under a face need, unless all are solved.

    Called frame by frame, it spreads the time that they take.
    """
    if not np.isfinite(face.thinness + face.flat):
        return
    solved = _solve_curves.cache_info().misses
    for name in likely_pressures(face):
        thinness, flat, _ = _near(_read_face(name))
        for u, b in product(thinness, flat):
            _solve_curves(u, b)
            if _solve_curves.cache_info().misses > solved:
                return


def face_curves(face: Face) -> tuple[LoadCurve, LoadCurve]:
    """The curves in torsion and in shear under a face, interpolated between those of some faces."""
    thinness, flat, (x, y) = _near(face)
    near = [[_solve_curves(u, b) for b in flat] for u in thinness]
    torsion, shear = np.einsum("i,j,ijlkp->lkp", [1.0 - x, x], [1.0 - y, y], np.array(near))
    return LoadCurve(*torsion), LoadCurve(*shear)


def _read_face(name: str) -> Face:
    """The face in the name of a pressure."""
    *_, flat, thinness = (float(word) for word in name.split() if word[0].isdigit())
    return Face(thinness, flat)


def _near(face: Face) -> tuple[Sequence[float], Sequence[float], tuple[float, float]]:
    """The numbers of the faces around a face, and its place between them."""
    thinness, flat = _Knots()
    i, x = _place(face.thinness, thinness)
    j, y = _place(face.flat, flat)
    return thinness[i : i + 2], flat[j : j + 2], (x, y)


def _with_shear(torsion: TorsionCurve, pressure: Profile) -> tuple[LoadCurve, LoadCurve]:
    """The curves in torsion and in shear at the same stick ratios."""
    shift, force = shift_curve(pressure, torsion.stick_ratio)
    return LoadCurve.of(*torsion), LoadCurve.of(torsion.stick_ratio, shift, force)


def _place(value: float, knots: Sequence[float]) -> tuple[int, float]:
    """The interval of a value, and its place within."""
    i = int(np.clip(np.searchsorted(knots, value, side="right") - 1, 0, len(knots) - 2))
    return i, float(np.clip((value - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0))


@cache
def _solve_curves(thinness: float, flat: float) -> tuple[LoadCurve, LoadCurve]:
    """The curves under a face; solved when asked for, which takes some hundredths of a second.

    That in shear is of a half-space, whose thickness hardly changes a scaled curve.
    """
    thickness = 1.0 / thinness - 1.0 if thinness else np.inf
    (punch,) = press_layer_punch(np.zeros(1), thickness, np.array([flat]))
    torsion = layer_torsion_curve(punch.pressure, thickness, LEAST_STICK_RATIO)
    return _with_shear(torsion, punch.pressure)
