"""Torsion and shift with slip under any axisymmetric pressure, and that of a rounded punch.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
[Ciavarella1998] M. Ciavarella, D. A. Hills, G. Monno, "The influence of rounded edges on
indentation by a flat punch".

The pressures are given as functions of r/a that fall to 0 at the edge of the contact, r = a.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from contactmodel.analytic.quadrature import gauss

Profile = Callable[[Float[np.ndarray, "..."]], Float[np.ndarray, "..."]]


class TorsionCurve(NamedTuple):
    """Twist and moment of a contact that slips from its edge inwards.

    Both are scaled so that the moment of full slip and the stiffness without slip are 1.

    Attributes:
        stick_ratio: c/a, falling from 1 [-].
        twist: θ times stiffness over limit [-].
        moment: M over limit [-].
    """

    stick_ratio: Float[np.ndarray, " points"]
    twist: Float[np.ndarray, " points"]
    moment: Float[np.ndarray, " points"]


def torsion_curve(pressure: Profile, least: float = 0.01, points: int = 800) -> TorsionCurve:
    """First loading of a round contact in torsion under a constant pressure ([Jaeger1995]).

    With A(s) = ∫_s^a μp(r)/√(r² − s²) dr, everything within c sticks at the twist A(c)/2G* and the
    moment (8/3) [c³ A(c) + 3 ∫_c^a s² A(s) ds]. Bodies are half-spaces.

    Args:
        pressure: pressure at r/a, in any unit.
        least: least c/a of the curve [-].
        points: number of points, closer together at the edge.
    """
    kappa = 1.0 - (1.0 - least) * np.linspace(0.0, 1.0, points) ** 2
    abel = abel_integral(pressure, kappa)
    inner = kappa**2 * abel
    steps = 0.5 * (inner[1:] + inner[:-1]) * -np.diff(kappa)
    moment = 8.0 / 3.0 * (kappa**3 * abel + 3.0 * np.append(0.0, np.cumsum(steps)))
    at, weight = gauss(64)
    limit = 2.0 * np.pi * float(np.sum(weight * at**2 * pressure(at)))
    return TorsionCurve(kappa, abel / 2.0 * (16.0 / 3.0) / limit, moment / limit)


def shift_curve(
    pressure: Profile, stick_ratio: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "2 points"]:
    """First loading of a round contact in shift under a constant pressure ([Jaeger1995]).

    With B(s) = ∫_s^a r μp(r)/√(r² − s²) dr, everything within c sticks at a shift proportional to
    B(c), and the force is 4 [c B(c) + ∫_c^a B(s) ds]. Bodies are half-spaces with ν = 0.

    Args:
        pressure: pressure at r/a, in any unit.
        stick_ratio: c/a, falling from 1 [-].

    Returns:
        Shift and force, scaled so that the force of full slip and the stiffness without slip are 1.
    """
    abel = abel_integral(lambda r: r * pressure(r), stick_ratio)
    steps = 0.5 * (abel[1:] + abel[:-1]) * -np.diff(stick_ratio)
    at, weight = gauss(64)
    limit = 0.5 * np.pi * float(np.sum(weight * at * pressure(at)))
    force = stick_ratio * abel + np.append(0.0, np.cumsum(steps))
    return np.stack([abel, force]) / limit


def abel_integral(
    pressure: Profile, ratio: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    """∫_s^a p(r)/√(r² − s²) dr at s/a, in the unit of the pressure.

    Args:
        pressure: pressure at r/a.
        ratio: s/a, at most 1 [-].
    """
    at, weight = gauss(64)
    far = np.arccosh(1.0 / np.minimum(ratio, 1.0))[:, None]  # r = s cosh v
    v, step = far * (1.0 - (1.0 - at) ** 2), 2.0 * far * (1.0 - at) * weight
    return np.sum(pressure(np.minimum(ratio[:, None] * np.cosh(v), 1.0)) * step, axis=1)


def rounded_punch_pressure(flat: float, points: int = 400) -> Profile:
    """The pressure under a flat punch with a rounded edge, on a half-space ([Ciavarella1998]).

    p(r) = ∫_r^a g(s)/√(s² − r²) ds with g(s) = 2√(s² − b²) − b arccos(b/s) beyond b, where the
    rounding begins. Without a flat part it is Hertz's pressure.

    Args:
        flat: radius of the flat part over that of the contact, b/a, below 1 [-].
        points: points of the table between which the pressure is interpolated.

    Raises:
        ValueError: a share outside [0, 1).
    """
    if not 0.0 <= flat < 1.0:
        raise ValueError(f"the flat part must be 0 or more and below 1 radius, but it is {flat:g}")
    fine = np.linspace(0.0, 1.0, points)
    r = 1.0 - (1.0 - fine) ** 2
    at, weight = gauss(200)
    low = np.sqrt(np.maximum(flat**2 - r**2, 0.0))[:, None]  # s² = r² + y²
    span = np.sqrt(1.0 - r**2)[:, None] - low
    y, step = low + span * at**2, 2.0 * span * at * weight
    s = np.maximum(np.hypot(r[:, None], y), flat)
    density = 2.0 * np.sqrt(s**2 - flat**2)
    if flat:
        density -= flat * np.arccos(flat / s)
    table = np.sum(density / np.maximum(s, 1e-12) * step, axis=1)
    return lambda ratio: np.interp(1.0 - np.sqrt(np.maximum(1.0 - ratio, 0.0)), fine, table)
