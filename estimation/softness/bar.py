"""Torsion of a cylinder that stands on the elastomer, gripped at its other end.

Its side is free of traction. A traction τ(r) around the axis turns its face by the bar's twist and
by modes J1(λr) with J2(λW) = 0, each like a layer of the same height H: tanh(λH)/(Gλ). A plate of
that height without sides turns by the same of all waves. Their difference hardly depends on how τ
is spread, so it is given here as an angle for each moment.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.special import j1, jn_zeros, jv

from contactmodel.elasticity.transfer import layer_gain


def radius_of_square(width: float) -> float:
    """Radius of the cylinder that a moment twists as far as a long square bar [mm].

    Args:
        width: width of the square bar [mm].
    """
    return 0.547 * width


@lru_cache(maxsize=1024)
def bar_compliance(side: float, height: float, reach: float, stuck: float) -> float:
    """Turn of a cylinder's face beyond that of a plate without sides, times G over moment [1/mm³].

    For τ ∝ r within the contact, of the rigid motion that is nearest within the sticking part. For
    a long cylinder it is H/J, J = πW⁴/2, less an end of about W/2.

    Args:
        side: radius W of the side [mm].
        height: H from the contact to the grip [mm].
        reach: radius of the contact [mm].
        stuck: radius of the sticking part [mm].
    """
    waves, nodes = 60.0, 4000  # both sums end at the same wave
    lam = jn_zeros(2, 2 + int(waves / stuck * side / np.pi)) / side
    weight = np.tanh(lam * height) / (0.5 * (lam * side * j1(lam * side)) ** 2 * lam)
    bar = height / (0.5 * np.pi * side**4)
    modal = float(np.sum(weight * jv(2, lam * reach) * jv(2, lam * stuck)))
    step = (float(lam[-1]) + 0.5 * np.pi / side) / nodes
    q = (np.arange(nodes) + 0.5) * step
    plate = np.tanh(q * height) * jv(2, q * reach) * jv(2, q * stuck) / q**2
    share = 8.0 / (np.pi * reach**2 * stuck**2)  # of the moment π reach⁴/2
    return bar + share * (modal - step * float(plate.sum()))


def moment_weights(
    distance: Float[np.ndarray, " n"], thickness: float, depth: float, edge: float
) -> Float[np.ndarray, " n"]:
    """Weights whose sum with the markers' arm × displacement is the moment on the gel over G_S.

    The moment is that of the tractions within the edge, where these are r's product with any field
    that is r there; it is made to fade beyond. Lengths are in pitches of a square lattice.

    Args:
        distance: distance of the markers from the axis.
        thickness: h of the elastomer.
        depth: z of the markers.
        edge: radius within which all traction lies.
    """
    fade = 3.0
    r = np.linspace(0.0, edge + 4.0 * fade, 500)[1:]
    field = r * np.exp(-((np.maximum(r - edge, 0.0) / fade) ** 2))
    q = np.linspace(0.0, 6.0, 500)[1:]
    gain = layer_gain(q * thickness, q * depth)
    waves = j1(np.outer(q, r)) @ (r * field) * (r[1] - r[0])
    resolved = np.exp(-0.5 * (0.5 * q) ** 2)
    waves = waves * q**2 * (1.0 + gain.transverse) * (1.0 + gain.below) * resolved * (q[1] - q[0])
    away = np.maximum(distance, 1e-6)
    return np.asarray(j1(np.outer(away, q)) @ waves / away)
