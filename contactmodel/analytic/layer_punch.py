"""A round punch that is pressed into a bonded layer without friction.

[Sneddon1966] I. N. Sneddon, "Mixed Boundary Value Problems in Potential Theory".
[NIST] NIST Digital Library of Mathematical Functions, https://dlmf.nist.gov.

Lengths are over the contact's radius. A pressure (1 − r²)^q has the transform
2^q Γ(q+1) J_{q+1}(k)/k^{q+1}, so that it presses the surface in by ∫ C(k) J₀(kr) dk times this.
On a half-space C = 1, and the integral is Weber's and Schafheitlin's ([NIST] 10.22.56, 10.22.57);
what a layer adds decays exponentially. The face of the punch is flat up to some radius and round
beyond. Its pressure vanishes at the edge of the contact as √(1 − r²), and is a sum over
q = ½, 3/2, … that follows the face.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gamma, hyp2f1, j0, jv

from contactmodel.analytic.quadrature import gauss
from contactmodel.elasticity.transfer import base_transfer

_FURTHEST = 22.0  # kh up to which a layer differs from a half-space by more than rounding


class LayerPunch(NamedTuple):
    """A punch that is pressed into a layer by 1.

    Attributes:
        indentation: displacement of the surface into the layer [-].
        misfit: largest deviation of the surface from the punch in the contact [-].
        series: factors of the pressures (1 − r²)^q, q = ½, 3/2, …, over G/(1 − ν) [-].
    """

    indentation: Float[np.ndarray, " points"]
    misfit: float
    series: Float[np.ndarray, " terms"]

    def pressure(self, r: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Pressure at r, over G/(1 − ν); 0 beyond the contact [-]."""
        rest = np.maximum(1.0 - np.asarray(r) ** 2, 0.0)
        return np.sqrt(rest) * np.polynomial.polynomial.polyval(rest, self.series)

    @property
    def arm(self) -> float:
        """Mean distance of the pressure from the axis: 3π/16 by Hertz [-]."""
        at, weight = gauss(64)
        r = np.sin(0.5 * np.pi * at)
        pressed = weight * np.cos(0.5 * np.pi * at) * r * self.pressure(r)
        return float(np.sum(pressed * r) / np.sum(pressed))


def press_layer_punch(
    distance: Float[np.ndarray, " points"],
    thickness: float,
    flat: Float[np.ndarray, " punches"],
    poisson_ratio: float = 0.48,
    terms: int = 14,
) -> list[LayerPunch]:
    """Press punches with rounded faces into a layer bonded to a rigid base ([Sneddon1966]).

    A punch without a flat part is a paraboloid. Friction and the layer's shear modulus do not
    appear; friction hardly changes the indentation.

    Args:
        distance: distance from the axis, over the contact's radius; on a layer, at most 30
            thicknesses [-].
        thickness: of the layer, over the contact's radius; infinite for a half-space [-].
        flat: radius of each punch's flat part over that of the contact, 0 or more and below 1 [-].
        poisson_ratio: ν of the layer [-].
        terms: number of pressures in the sum.

    Raises:
        ValueError: a thickness that is not positive, or a flat part outside [0, 1).
    """
    flat = np.asarray(flat, dtype=float)
    if not thickness > 0.0:
        raise ValueError(f"the thickness must be positive, but it is {thickness:g} contact radii")
    if not ((flat >= 0.0) & (flat < 1.0)).all():
        raise ValueError(f"flat parts must be 0 or more and below 1 radius, but they are {flat}")
    face = np.sin(0.5 * np.pi * gauss(4 * terms)[0])  # closer together at the edge
    r = np.asarray(distance, dtype=float)
    moved = _surface((*face.tolist(), *r.tolist()), thickness, poisson_ratio, terms)
    # the pressures and the depth that fit the face, (r − flat)² lower beyond its flat part
    design = np.column_stack([moved[: len(face)], -np.ones(len(face))])
    lower = np.maximum(face[:, None] - flat, 0.0) ** 2
    scale = np.linalg.norm(design, axis=0)
    fit = np.linalg.lstsq(design / scale, -lower, rcond=1e-10)[0] / scale[:, None]
    misfit = np.abs(design @ fit + lower).max(axis=0) / fit[-1]
    series = fit[:-1] / fit[-1]
    moved = moved[len(face) :] @ series
    return [LayerPunch(*punch) for punch in zip(moved.T, misfit.tolist(), series.T, strict=True)]


@lru_cache(maxsize=8)
def _surface(
    r: tuple[float, ...], thickness: float, poisson_ratio: float, terms: int
) -> Float[np.ndarray, "points terms"]:
    """Displacement under each pressure (1 − r²)^q, times G/(1 − ν); cached for punches alike."""
    powers = np.arange(terms) + 0.5
    moved = _half_spaces(r, terms)
    if not np.isfinite(thickness):
        return moved
    x, step = (_FURTHEST * part for part in gauss(400))
    k = x / thickness
    more = base_transfer(x, poisson_ratio, np.zeros_like(x)).normal / (1.0 - poisson_ratio)
    pressures = np.stack(
        [2.0**q * gamma(q + 1.0) * jv(q + 1.0, k) / k ** (q + 1.0) for q in powers], axis=1
    )
    moved = moved + j0(np.outer(r, k)) @ (pressures * (step * more / thickness)[:, None])
    moved.flags.writeable = False
    return moved


@lru_cache(maxsize=1)
def _half_spaces(r: tuple[float, ...], terms: int) -> Float[np.ndarray, "points terms"]:
    """Displacements of a half-space under all pressures; cached, since a table has many layers."""
    moved = np.stack([_half_space(np.array(r), q) for q in np.arange(terms) + 0.5], axis=1)
    moved.flags.writeable = False
    return moved


def _half_space(r: Float[np.ndarray, " points"], q: float) -> Float[np.ndarray, " points"]:
    """Displacement of a half-space under the pressure (1 − r²)^q, times G/(1 − ν)."""
    inside, beyond = np.minimum(r, 1.0), np.maximum(r, 1.0)
    middle = np.sqrt(np.pi) * gamma(q + 1.0) / (2.0 * gamma(q + 1.5))
    near = middle * hyp2f1(0.5, -q - 0.5, 1.0, inside**2)
    far = hyp2f1(0.5, 0.5, q + 2.0, beyond**-2) / (2.0 * (q + 1.0) * beyond)
    return np.where(r <= 1.0, near, far)
