"""Factors on force and moment: gels that stiffen with depth, and pads with a free side.

Linear elasticity of a wide layer leaves out both. If both moduli of a gel under a rigid object are
scaled, displacements, slip and stick region stay, and all tractions scale. The corrections are
therefore factors on force and moment after the solve. Their coefficients are fitted to finite
elements of our own (`papers.finite_strain.factors`).

With e = δ/h the depth over the thickness (in mm), x = ρ/h, ρ² the mean of r² under the pressure, s
the mean slope of the object under the pressure and s₂ that under p r², μ_t = M/(ρP) and m = M over
the moment at which all slides, a neo-Hookean gel has

    F/F_linear − 1 = y = s (f₁ + f₂ x)[1 + f₃ (0.48 − ν)] + e (f₄ μ_t² − f₅ m²)
    M/M_linear − 1 = (1 − m⁴)(g₁ s₂ + g₃ e μ_t²) + m⁴ (y + t) + g₂ e x

where t is the mean of 1/cos α − 1 under p r, α the angle of the slope: friction acts on the
inclined area. If friction is multiplied by a mean factor q in the solve (`reading`), y + t becomes
(1 + y + t)/q − 1. The side of a pad of radius W multiplies by

    exp[−A (1 + B k) (a/h)^α (h/W)^β e^{γ (ν − 0.48)}]

with one set of numbers for the force and one for the moment. Radius a and exponent k are those of
a round contact under p ∝ (1 − r²/a²)^k (k = ½ for Hertz) with ρ and the mean of r² under √p.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from contactmodel.common.arrays import root

_FORCE = (-0.162, 0.812, 12.1, 0.433, 0.0996)
_MOMENT = (0.296, -0.441, 0.696)
_SIDE_FORCE = (0.61, 0.202, 1.739, 3.002, 8.312)
_SIDE_MOMENT = (0.93, 0.346, 1.983, 3.227, 11.918)

RANGE = (
    "the fitted range (see `ContactSolution.correction`): depth up to 0.25 of the thickness, "
    "Poisson's ratio from 0.45 to 0.49, μ from 0.25 (0.4 beyond a depth of 0.14) to 1, twists up "
    "to 25° (6° without corotated poses), round or square contacts, or ellipses up to twice as "
    "long as wide (not on narrow pads), with rounded edges and little shear force, far from the "
    "pad's side"
)
"""The range in which `Correction.covered` is true, for the warning."""


class Correction(eqx.Module):
    """Factors on the force and the moment of a linear contact; 1 if nothing is corrected.

    Attributes:
        force: factor on the force [-].
        moment: factor on the moment [-].
        covered: whether the contact lies in the range on which the factors were fitted.

    Examples:
        >>> from contactmodel import Contact, Grid, Layer, Pose, Rigid, Sphere, solve_contact
        >>> gel = Layer(0.2, poisson_ratio=0.48, thickness=8.0, radius=12.0, neo_hookean=True)
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), Grid((24, 24), (14.0, 14.0)), 0.5)
        >>> correction = solve_contact(contact, Pose(approach=1.0)).correction
        >>> print(f"force times {correction.force:.2f}, covered: {bool(correction.covered)}")
        force times 0.93, covered: True
    """

    force: Float[Array, "*path"]
    moment: Float[Array, "*path"]
    covered: Bool[Array, "*path"]


class Loading(NamedTuple):
    """Dimensionless numbers of a contact, by step."""

    reach: Float[Array, "*path"]  # ρ, root of the mean of r² under the pressure [mm]
    radius: Float[Array, "*path"]  # a, radius of the contact [mm]
    exponent: Float[Array, "*path"]  # k, exponent of the pressure [-]
    slope: Float[Array, "*path"]  # s, mean slope of the object under the pressure [-]
    rim_slope: Float[Array, "*path"]  # s₂, mean slope under p r² [-]
    tilt: Float[Array, "*path"]  # t, mean of 1/cos α − 1 under p r [-]
    sheared: Float[Array, "*path"]  # μ_t², (M/ρP)² [-]
    used: Float[Array, "*path"]  # m², (moment over the moment at which all slides)², at most 1 [-]
    friction: Float[Array, "*path"]  # mean of the friction coefficient under p r [-]
    gain: Float[Array, "*path"]  # mean factor on the limit of friction under p r (`reading`) [-]
    # whether the contact is round, square or a short ellipse, and carries little shear force
    simple: Bool[Array, "*path"]
    even: Bool[Array, "*path"]  # whether it is about as long as wide


def measure_loading(
    points: Float[Array, "2 nx ny"],
    slope: Float[Array, "2 nx ny"],
    pressure: Float[Array, "*path nx ny"],
    traction: Float[Array, "*path 2 nx ny"],
    limit: Float[Array, "*path nx ny"],
    raised: Float[Array, "*path nx ny"] | None = None,
) -> Loading:
    """Measure the numbers from which the corrections follow.

    Args:
        points: centres of the cells [mm].
        slope: derivatives of the object's height by x and y [-].
        pressure: p [MPa].
        traction: τ [MPa].
        limit: largest traction [MPa].
        raised: largest traction by the friction that the contact was solved with; None if it is
            `limit` [MPa].
    """

    def total(field: Array) -> Array:
        return jnp.sum(field, axis=(-2, -1))

    contact = pressure > 0.0
    share = pressure / _or_one(total(pressure))[..., None, None]
    x, y = (part - total(share * part)[..., None, None] for part in points)
    distance = root(x**2 + y**2)
    incline = root(jnp.where(contact, slope[0] ** 2 + slope[1] ** 2, 0.0))
    xx, yy, xy = total(share * x**2), total(share * y**2), total(share * x * y)
    square, even = xx + yy, root(pressure)
    evenly = total(even * distance**2) / _or_one(total(even))
    radius = square * evenly / _or_one(square - 0.5 * evenly)  # its square
    lever = total(share * distance)
    tau_x, tau_y = jnp.moveaxis(traction, -3, 0)
    moment, force = total(x * tau_y - y * tau_x), total(pressure)
    most = total(limit * distance)
    used = most if raised is None else total(raised * distance)
    sideways = total(tau_x) ** 2 + total(tau_y) ** 2
    longer = ((xx - yy) ** 2 + 4.0 * xy**2) / _or_one(square**2)  # 0 for a round contact
    corners = total(share * (x**4 - 6.0 * x**2 * y**2 + y**4)) ** 2  # 0 for a round contact
    corners = corners + total(share * 4.0 * x * y * (x**2 - y**2)) ** 2
    return Loading(
        reach=root(square),
        radius=root(jnp.maximum(radius, 0.0)),
        exponent=radius / _or_one(square) - 2.0,
        slope=total(share * incline),
        rim_slope=total(share * distance**2 * incline) / _or_one(square),
        tilt=total(share * distance * (jnp.sqrt(1.0 + incline**2) - 1.0)) / _or_one(lever),
        sheared=moment**2 / _or_one(square * force**2),
        used=jnp.minimum((moment / _or_one(used)) ** 2, 1.0),
        friction=most / _or_one(lever * force),
        gain=jnp.where(most > 0.0, used / _or_one(most), 1.0),
        simple=(longer <= 0.72**2)
        & (corners <= (0.62 * total(share * distance**4)) ** 2)
        & (sideways <= (0.05 * force) ** 2),
        even=longer <= 0.3**2,
    )


def stiffen(
    loading: Loading,
    approach: Float[Array, "*path"],
    poisson_ratio: Float[Array, ""],
    thickness: Float[Array, ""],
    numbers: Sequence[float] = (*_FORCE, *_MOMENT),
) -> Correction:
    """Factors of a neo-Hookean gel, from the linear contact and the numbers f₁ to f₅, g₁ to g₃."""
    f, g, nu = numbers[:5], numbers[5:], poisson_ratio
    depth, x = approach / thickness, loading.reach / thickness
    sheared, used = depth * loading.sheared, loading.used
    force = press_gain(loading, nu, thickness, f) + f[3] * sheared - f[4] * depth * used
    holds = g[0] * loading.rim_slope + g[2] * sheared
    slides = (1.0 + force + loading.tilt) / loading.gain - 1.0
    moment = (1.0 - used**2) * holds + used**2 * slides + g[1] * depth * x
    touches = x > 0.0
    rounded = loading.slope * x >= 0.35 * depth  # 0.44 to 0.69 where fitted; 0 for sharp edges
    within = (depth <= 0.2501) & (x <= 0.9) & (loading.slope <= 0.45) & (jnp.abs(nu - 0.47) < 0.021)
    least = jnp.where(depth <= 0.14, 0.249, 0.399)
    rubs = (loading.friction >= least) & (loading.friction <= 1.001)
    covered = (within & rounded & rubs & loading.simple) | ~touches
    return Correction(
        1.0 + jnp.where(touches, force, 0.0), 1.0 + jnp.where(touches, moment, 0.0), covered
    )


def press_gain(
    loading: Loading,
    poisson_ratio: Float[Array, ""],
    thickness: Float[Array, ""],
    numbers: Sequence[float] = _FORCE,
) -> Float[Array, "*path"]:
    """s (f₁ + f₂ x)[1 + f₃ (0.48 − ν)], by which the force is larger before any twist [-]."""
    x = loading.reach / thickness
    return (
        loading.slope * (numbers[0] + numbers[1] * x) * (1.0 + numbers[2] * (0.48 - poisson_ratio))
    )


def stick_gain(
    loading: Loading, approach: Float[Array, "*path"], thickness: Float[Array, ""]
) -> Float[Array, "*path"]:
    """g₁ s₂ + g₂ e x, by which the moment of a neo-Hookean gel is larger where all sticks [-]."""
    x = loading.reach / thickness
    return _MOMENT[0] * loading.rim_slope + _MOMENT[1] * approach / thickness * x


def narrow(
    loading: Loading,
    poisson_ratio: Float[Array, ""],
    thickness: Float[Array, ""],
    radius: Float[Array, ""],
    numbers: tuple[Sequence[float], Sequence[float]] = (_SIDE_FORCE, _SIDE_MOMENT),
) -> Correction:
    """Factors of a round pad of radius W [mm] whose side is free, from the contact on a wide pad.

    The numbers are A, B, α, β and γ, for the force and for the moment [-].
    """
    width = radius / thickness
    touches = loading.radius > 0.0
    wide = jnp.where(touches, loading.radius, 1.0) / thickness

    def loss(numbers: Sequence[float]) -> Array:
        size, shape, power, width_power, rate = numbers
        share = size * (1.0 + shape * loading.exponent) * wide**power * width**-width_power
        return jnp.where(touches, share * jnp.exp(rate * (poisson_ratio - 0.48)), 0.0)

    lost = loss(numbers[0])
    within = (lost <= 0.2) & (width >= 1.0) & (jnp.abs(poisson_ratio - 0.47) < 0.021)
    within = within & loading.simple & loading.even & (loading.radius < 0.7 * radius)
    return Correction(jnp.exp(-lost), jnp.exp(-loss(numbers[1])), within | ~touches)


def _or_one(value: Array) -> Array:
    """The value, or 1 in place of 0, for divisions."""
    return jnp.where(value == 0.0, 1.0, value)
