"""Torsion of a cylinder that stands on the elastomer, gripped at its other end.

Its side is free of traction. A traction τ(r) around the axis turns its face by the bar's twist and
by modes J1(λr) with J2(λW) = 0, each like a layer of the same height H: tanh(λH)/(Gλ). A plate of
that height without sides turns by the same of all waves. Their difference hardly depends on how τ
is spread, so it is given here as an angle for each moment.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import j0, j1, jn_zeros, jv

from contactmodel.elasticity.transfer import base_transfer, half_space_transfer, layer_gain

_FADE_PITCHES = 3.0
"""Distance over which the weights fade beyond the edge [pitches]."""


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


def bar_shortening(side: float, height: float, strain: float) -> float:
    """Factor on the turn of a bar that is pressed shorter [-].

    A neo-Hookean bar, pressed to the length λH, turns by λ M H/(G J) under a moment (Rivlin). Its
    modulus against pressing, 3 G, grows by W²/(8 H²) as its end is held (Gent and Lindley).

    Args:
        side: radius W of the side [mm].
        height: H from the contact to the grip [mm].
        strain: pressing force over 3 G π W² of the bar [-].
    """
    return max(1.0 - strain / (1.0 + 0.125 * (side / height) ** 2), 0.5)


def check_edge(edge: float, side: float, radius: float) -> None:
    """Check the edge of a cylinder's flat face.

    Args:
        edge: radius of the edge; 0 if it is sharp or not known [mm].
        side: radius of the side; infinite of a plate [mm].
        radius: radius of a round tip; infinite of a flat face [mm].

    Raises:
        ValueError: there is no flat face with a side, or the edge is wider than half of it.
    """
    if edge == 0.0:
        return
    if np.isinf(side) or np.isfinite(radius):
        raise ValueError(
            f"an edge of {edge:g} mm was given, but only a cylinder with a flat face has one: give "
            "the radius of its side, and none of a round tip, or leave out the edge"
        )
    if not 0.0 < edge <= 0.5 * side:
        raise ValueError(
            f"the edge has a radius of {edge:g} mm; it must be at most half of the side's radius, "
            f"{side:g} mm"
        )


def edge_compliance(side: float, edge: float) -> float:
    """Turn of a cylinder's flat face that a rounded edge adds, times G over moment [1/mm³].

    From linear torsion (`papers.finite_strain.torsion.add_edge`) with edges from 0.1 to 0.5 W and
    contacts that reach 0.1 to 0.7 of the edge, on which the single values depend: 0.6 to 1.5 times
    this, and up to 2.3 times at 0.1 W. The height does not matter.

    Args:
        side: radius W of the side [mm].
        edge: radius of the edge [mm].
    """
    return 0.65 * (edge / side) ** 3.3 / side**3


def tip_share(reach: float, side: float) -> float:
    """Share of a round tip's part that is left beside a side, where less material is missing [-].

    From linear torsion with a up to 0.8 W (`papers.finite_strain.torsion.compare_side`).

    Args:
        reach: radius a of the contact [mm].
        side: radius W of the side [mm].
    """
    return max(1.0 - 1.2 * (reach / side) ** 2, 0.0)


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
    away = np.maximum(distance, 1e-6)
    waves = _make_waves(1, _round_up(max(edge + 4.0 * _FADE_PITCHES, float(away.max()))))
    field = waves.r * np.exp(-((np.maximum(waves.r - edge, 0.0) / _FADE_PITCHES) ** 2))
    return waves.filter(away, field, _resist_turning(thickness, depth)) / away


def force_weights(
    distance: Float[np.ndarray, " n"], thickness: float, depth: float, edge: float
) -> Float[np.ndarray, " n"]:
    """Weights whose sum with the markers' indentation is the pressing force on the gel over G_S.

    The force is that of the pressures within the edge. A ring beyond it counts negatively, so that
    a uniform rise of the surface, which a nearly incompressible gel hardly resists, adds nothing.
    Lengths are in pitches of a square lattice, for ν = 0.48.

    Args:
        distance: distance of the markers from the axis.
        thickness: h of the elastomer.
        depth: z of the markers.
        edge: radius within which all pressure lies.
    """
    waves = _make_waves(0, _round_up(max(edge + 6.0 * _FADE_PITCHES, float(distance.max()))))
    beyond = np.maximum(waves.r - edge, 0.0) / _FADE_PITCHES
    inside = np.exp(-((2.0 * beyond) ** 2))
    ring = beyond * np.exp(-(beyond**2))
    field = inside - ring * np.sum(inside * waves.r) / np.sum(ring * waves.r)
    return waves.filter(distance, field, _resist_pressing(thickness, depth))


class _Waves(NamedTuple):
    """Bessel's function of waves and radii; lengths are in pitches."""

    q: Float[np.ndarray, " waves"]
    r: Float[np.ndarray, " radii"]
    bessel: Float[np.ndarray, "waves radii"]

    def filter(
        self,
        distance: Float[np.ndarray, " n"],
        field: Float[np.ndarray, " radii"],
        factor: Float[np.ndarray, " waves"],
    ) -> Float[np.ndarray, " n"]:
        """A field of the radius, its waves multiplied by a factor, at some distances."""
        waves = self.bessel @ (self.r * field) * (self.r[1] - self.r[0])
        resolved = np.exp(-0.5 * (0.5 * self.q) ** 2) * (self.q[1] - self.q[0])
        made = (waves * self.q * factor * resolved) @ self.bessel
        return np.interp(distance, self.r, made)


def _round_up(reach: float) -> int:
    """A reach in steps of ten pitches, for which the waves are kept."""
    return 10 * int(np.ceil(reach / 10.0 + 1e-9))


@lru_cache(maxsize=8)
def _make_waves(order: int, reach: int) -> _Waves:
    step = 0.04  # between radii; the shortest wave has 26 of them
    q, r = np.linspace(0.0, 6.0, 500)[1:], np.arange(0.0, reach + step, step)
    return _Waves(q, r, (j0, j1)[order](np.outer(q, r)))


@lru_cache(maxsize=8)
def _resist_turning(thickness: float, depth: float) -> Float[np.ndarray, " waves"]:
    q = _make_waves(1, 10).q
    gain = layer_gain(q * thickness, q * depth)
    return np.asarray(q * (1.0 + gain.transverse) * (1.0 + gain.below))


@lru_cache(maxsize=8)
def _resist_pressing(thickness: float, depth: float) -> Float[np.ndarray, " waves"]:
    nu, q = 0.48, _make_waves(0, 10).q
    layer = base_transfer(np.minimum(q * thickness, 1e3), nu, depth / thickness)
    return np.asarray(q / (layer.normal + half_space_transfer(q * depth, nu).normal))
