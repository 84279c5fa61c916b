"""A disc that turns on a bonded layer, and torsion with slip on it.

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
[Sneddon1966] I. N. Sneddon, "Mixed Boundary Value Problems in Potential Theory".

The dual integral equations of a disc of radius c on a layer of thickness h become one Fredholm
equation of the second kind ([Sneddon1966]). The traction τ(r) = G ∫₀^∞ k B(k) J₁(kr) dk with
B(k) = ∫₀^c φ(t) sin(kt) dt vanishes outside the disc, and the surface turns with the disc inside it
if

    φ(t) + (2/π) ∫₀^c φ(s) ∫₀^∞ (tanh(kh) − 1) sin(ks) sin(kt) dk ds = (4/π) t.

Poisson's ratio plays no part. Without the integral it is Reissner and Sagoci's half-space.

A contact that slips outside a radius c carries μp(r) there. The traction at r depends on φ beyond r
only, so that outside c φ is that of μp, (2/π) t ∫_t^a μp(r)/√(r² − t²) dr, which [Jaeger1995] uses
on half-spaces. Inside c the equation above holds, with what φ outside moves. The angle follows,
since the traction is bounded at c.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import j1

from contactmodel.analytic.any_pressure import Profile, TorsionCurve, abel_integral
from contactmodel.analytic.closed_forms import punch_displacement
from contactmodel.analytic.quadrature import gauss

_FURTHEST = 20.0  # kh up to which tanh(kh) differs from 1 by more than rounding


class LayerDisc(NamedTuple):
    """A disc turned by 1 rad on a bonded layer.

    Attributes:
        displacement: circumferential displacement of the surface, over the disc's radius [-].
        moment: its moment, over that on a half-space of the same modulus [-].
    """

    displacement: Float[np.ndarray, " points"]
    moment: float


def turn_layer_disc(
    distance: Float[np.ndarray, " points"], thickness: float, points: int = 64
) -> LayerDisc:
    """Turn a disc that sticks to a layer bonded to a rigid base ([Sneddon1966]).

    Args:
        distance: distance from the axis, over the disc's radius [-].
        thickness: of the layer, over the disc's radius [-].
        points: points of the quadratures. With 64, thicknesses from 0.25 on are right to 1e-6.

    Raises:
        ValueError: a thickness that is not positive.
    """
    if not thickness > 0.0:
        raise ValueError(f"the thickness must be positive, but it is {thickness:g} disc radii")
    angle, share = gauss(points)
    t, weight = np.sin(0.5 * np.pi * angle), 0.5 * np.pi * np.cos(0.5 * np.pi * angle) * share
    wave, step = (_FURTHEST / thickness * part for part in gauss(2 * points))
    missing = step * (np.tanh(wave * thickness) - 1.0)
    sine = np.sin(np.outer(wave, t))
    kernel = 2.0 / np.pi * (sine.T * missing) @ sine
    half_space = 4.0 / np.pi * t
    density = np.linalg.solve(np.eye(points) + kernel * weight, half_space)
    r = np.asarray(distance, dtype=float)
    beyond = np.maximum(r, 1.0)[:, None]
    root = np.sqrt(np.maximum(beyond**2 - t**2, 1e-300))
    more = (weight * t * (density - half_space) / (beyond * root)).sum(axis=1)
    layer = (missing * j1(np.outer(r, wave))) @ (sine @ (weight * density))
    outside = punch_displacement(r, 1.0) + more + layer
    return LayerDisc(
        displacement=np.where(r <= 1.0, r, outside),
        moment=float(weight @ (t * density) / (weight @ (t * half_space))),
    )


def layer_torsion_curve(
    pressure: Profile, thickness: float, least: float = 0.1, points: int = 40, nodes: int = 20
) -> TorsionCurve:
    """First loading of a round contact in torsion on a layer, under a constant pressure.

    Args:
        pressure: pressure at r/a, in any unit, that vanishes at the edge.
        thickness: of the layer, over the contact's radius; infinite for a half-space [-].
        least: least c/a of the curve [-].
        points: number of points, closer together at the edge.
        nodes: points of the quadratures inside and outside c. With 20, twists are right to 1e-5 for
            thicknesses from 0.4 on.
    """
    stick = 1.0 - (1.0 - least) * np.linspace(0.0, 1.0, points) ** 1.5
    at, share = gauss(nodes)
    inner, inner_weight = np.sin(0.5 * np.pi * at), 0.5 * np.pi * np.cos(0.5 * np.pi * at) * share
    x, step = (_FURTHEST * part for part in gauss(5 * nodes))
    wave, missing = x / thickness, 2.0 / np.pi * step * (np.tanh(x) - 1.0) / thickness
    twist, moment = np.zeros(points), np.zeros(points)
    stiffness, beyond = 1.0, stick[:, None] + (1.0 - stick[:, None]) * at
    slipping = _slip_density(pressure, beyond.ravel()).reshape(beyond.shape)
    at_edge = _slip_density(pressure, stick)
    for i, (c, outside, slips) in enumerate(zip(stick, beyond, slipping, strict=True)):
        t, weight = np.append(c * inner, c), np.append(c * inner_weight, 0.0)
        outside_weight = (1.0 - c) * share
        sine = np.sin(np.outer(wave, t))
        kernel = (sine.T * missing) @ sine
        moved = (sine.T * missing) @ np.sin(np.outer(wave, outside)) @ (outside_weight * slips)
        right = np.stack([4.0 / np.pi * t, -moved], axis=1)
        turned, rest = np.linalg.solve(np.eye(len(t)) + kernel * weight, right).T
        twist[i] = (at_edge[i] - rest[-1]) / turned[-1]
        inside = float(weight @ (t * (twist[i] * turned + rest)))
        moment[i] = inside + float(outside_weight @ (outside * slips))
        if i == 0:
            stiffness = float(weight @ (t * turned))
    limit = float(inner_weight @ (inner * _slip_density(pressure, inner)))
    return TorsionCurve(stick, twist * stiffness / limit, moment / limit)


def _slip_density(
    pressure: Profile, t: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    """The density φ of a traction as large as the pressure."""
    return 2.0 / np.pi * t * abel_integral(pressure, t)
