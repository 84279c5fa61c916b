"""Closed forms of axisymmetric contact: Hertz pressure, torsion with and without slip, shift.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.4, 4.2 and 7.2.
[Lubkin1951] J. L. Lubkin, "The torsion of elastic spheres in contact".
[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
[Reissner1944] E. Reissner, H. F. Sagoci, "Forced torsional oscillations of an elastic half-space".

Symbols: a contact radius, c radius of the stick region, κ = c/a, p0 peak pressure, P normal force,
μ friction coefficient, θ twist of one body against the other, G* = 1/(1/G_S + 1/G_B) the shear
modulus of the pair, E* its contact modulus. Displacements under twist are relative between the two
surfaces; the elastomer's share is 1/(1+k). Arguments are numbers or arrays that broadcast against
each other. If one is a JAX array, the result is a differentiable JAX array. Otherwise NumPy
computes everything, without compilation.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from contactmodel.analytic.checks import positive, pressing, share
from contactmodel.analytic.elliptic import complete_elliptic
from contactmodel.analytic.quadrature import gauss, space_by_ratio
from contactmodel.common.arrays import AnyArray, Value, as_arrays, refuse, root

Density = Callable[[Any], Any]


_NO_MOMENT = 1e-6  # share of the radius within which a moment, going like s³, is below rounding


class Hertz(NamedTuple):
    """A Hertz contact.

    Attributes:
        radius: a [mm].
        peak_pressure: p0 [MPa].
        approach: δ [mm].
        force: P [N].
    """

    radius: AnyArray
    peak_pressure: AnyArray
    approach: AnyArray
    force: AnyArray


def pair_shear_modulus(elastomer: Value, stiffness_ratio: Value) -> AnyArray:
    """G* = 1/(1/G_S + 1/G_B) from G_S [MPa] and k = G_S/G_B."""
    _, modulus, k = as_arrays(elastomer, stiffness_ratio)
    return modulus / (1.0 + k)


def hertz_from_approach(
    approach: Value, radius_of_curvature: Value, contact_modulus: Value
) -> Hertz:
    """Hertz contact at an approach; no contact below 0 ([Johnson1985] Eqs. 4.22 to 4.24).

    Args:
        approach: δ [mm].
        radius_of_curvature: R of the gap r²/2R [mm].
        contact_modulus: E*, 1/E* = (1−ν_S)/2G_S + (1−ν_B)/2G_B [MPa].

    Raises:
        ValueError: a radius or modulus is not above 0.
    """
    _, delta, curvature, modulus = as_arrays(approach, radius_of_curvature, contact_modulus)
    curvature, modulus = positive(curvature), positive(modulus)
    a = root(curvature * delta)
    return Hertz(
        radius=a,
        peak_pressure=2.0 * modulus * a / (np.pi * curvature),
        approach=delta,
        force=4.0 / 3.0 * modulus * a * delta,
    )


def hertz_pressure(r: Value, radius: Value, peak_pressure: Value) -> AnyArray:
    """Pressure p0 √(1 − r²/a²) of a Hertz contact, 0 outside [MPa]."""
    _, r, a, peak = as_arrays(r, radius, peak_pressure)
    return peak * root(1.0 - _share(r, a) ** 2)


def hertz_indentation(r: Value, radius: Value, peak_pressure: Value, modulus: Value) -> AnyArray:
    """Displacement of a surface into its body under Hertz pressure ([Johnson1985] Eq. 3.42) [mm].

    Eqs. (3.42a) inside and (3.42b) outside the contact.

    Args:
        r: distance from the axis [mm].
        radius: a [mm].
        peak_pressure: p0 [MPa].
        modulus: 2G/(1−ν) of the body, or E* for the sum over both bodies [MPa].
    """
    xp, r, a, peak, modulus = as_arrays(r, radius, peak_pressure, modulus)
    x = _share(r, a)
    outside = xp.maximum(x, 1.0)
    parabola = 2.0 - x**2
    inner = 0.5 * np.pi * parabola
    outer = parabola * _arcsin(1.0 / outside) + root(outside**2 - 1.0)
    return peak * a / (2.0 * modulus) * xp.where(x <= 1.0, inner, outer)


def hertz_radial_displacement(
    r: Value,
    radius: Value,
    peak_pressure: Value,
    shear_modulus: Value,
    poisson_ratio: Value,
) -> AnyArray:
    """Radial displacement of a surface under Hertz pressure ([Johnson1985] Eqs. 3.41b, 3.42c) [mm].

    It points towards the axis (below 0) and vanishes for ν = ½.

    Args:
        r: distance from the axis [mm].
        radius: a [mm].
        peak_pressure: p0 [MPa].
        shear_modulus: G of the body [MPa].
        poisson_ratio: ν of the body [-].
    """
    xp, r, a, peak, modulus, nu = as_arrays(r, radius, peak_pressure, shear_modulus, poisson_ratio)
    x = _share(r, a)
    y = xp.where(x <= 1.0, 1.0 - x**2, 0.0)
    inside = x * (1.0 + y + y**2) / (1.0 + y * root(y))  # (1 − y^{3/2})/x, exact at x = 0 too
    shape = xp.where(x <= 1.0, inside, 1.0 / xp.maximum(x, 1.0))
    return -(1.0 - 2.0 * nu) / (6.0 * modulus) * peak * a * shape


def reissner_sagoci_moment(twist: Value, radius: Value, shear_modulus: Value) -> AnyArray:
    """Moment of a disc that sticks everywhere, (16/3) G* a³ θ ([Reissner1944]) [N·mm]."""
    _, twist, a, modulus = as_arrays(twist, radius, shear_modulus)
    return 16.0 / 3.0 * modulus * a**3 * twist


def reissner_sagoci_traction(
    r: Value, twist: Value, radius: Value, shear_modulus: Value
) -> AnyArray:
    """Circumferential traction of a disc that sticks everywhere ([Reissner1944]) [MPa].

    (4G*θ/π) r/√(a² − r²), for r < a.
    """
    xp, r, twist, a, modulus = as_arrays(r, twist, radius, shear_modulus)
    return 4.0 / np.pi * modulus * twist * r / xp.sqrt(a**2 - r**2)


def punch_displacement(r: Value, radius: Value) -> AnyArray:
    """Circumferential displacement around a disc turned by 1 rad ([Reissner1944]) [mm].

    r inside the disc of radius s, (2/π)[r asin(s/r) − s √(1 − s²/r²)] outside.
    """
    xp, r, s = as_arrays(r, radius)
    ratio = xp.minimum(s / xp.maximum(r, s), 1.0)
    outside = 2.0 / np.pi * (r * _arcsin(ratio) - s * root(1.0 - ratio**2))
    return xp.where(r <= s, r, outside)


def hertz_density(radius: Value, friction_ratio: Value) -> Density:
    """Jäger's density of a Hertz contact, f(s) = (μp0/2G*) E(1 − s²/a²)/s ([Jaeger1995]).

    Args:
        radius: a [mm].
        friction_ratio: μp0/2G* [-].
    """

    def density(s: AnyArray) -> AnyArray:
        xp, s, a, ratio = as_arrays(s, radius, friction_ratio)
        return ratio * complete_elliptic(xp.minimum(s / a, 1.0))[1] / s

    return density


def jaeger_density(friction: Density, radius: Value, shear_modulus: Value) -> Density:
    """Density of punches under an axisymmetric friction limit ([Jaeger1995]).

    f(s) = −(1/2G*) d/ds ∫_s^a μp(r)/√(r² − s²) dr, for a limit that falls to 0 at the edge.

    Args:
        friction: the limit μp(r) as a function of an array of radii [MPa].
        radius: a [mm].
        shear_modulus: G* [MPa].
    """
    import jax
    import jax.numpy as jnp

    a, modulus = jnp.asarray(radius), jnp.asarray(shear_modulus)
    at, weight = gauss(96)  # 1/r peaks where s is small

    def abel(s: jax.Array) -> jax.Array:  # r² = s² + x², x from 0 to the edge as sin t
        t = 0.5 * np.pi * at
        edge = root(a**2 - s**2)
        r = jnp.sqrt(s**2 + (edge * jnp.sin(t)) ** 2)
        return jnp.sum(friction(r) / r * edge * jnp.cos(t) * 0.5 * np.pi * weight)

    slope = jnp.vectorize(jax.grad(abel))
    return lambda s: -slope(s) / (2.0 * modulus)


def torsion_twist(density: Density, stick_radius: Value, radius: Value) -> AnyArray:
    """Twist ∫_c^a f ds at which a disc of radius c still sticks ([Jaeger1995]) [rad]."""
    s, ds = space_by_ratio(stick_radius, radius)
    return (density(s) * ds).sum(axis=-1)


def torsion_moment(
    density: Density, stick_radius: Value, radius: Value, shear_modulus: Value
) -> AnyArray:
    """Moment (16/3) G* ∫_c^a s³ f ds at the stick radius c ([Jaeger1995]) [N·mm]."""
    xp, c, a, modulus = as_arrays(stick_radius, radius, shear_modulus)
    s, ds = space_by_ratio(xp.maximum(c, _NO_MOMENT * a), a)
    return 16.0 / 3.0 * modulus * (s**3 * density(s) * ds).sum(axis=-1)


def torsion_traction(
    r: Value,
    density: Density,
    stick_radius: Value,
    radius: Value,
    shear_modulus: Value,
) -> AnyArray:
    """Circumferential traction: the sum over the punches larger than r ([Jaeger1995]) [MPa].

    In the slip region it equals the friction limit.
    """
    xp, rho, c, a, modulus = as_arrays(r, stick_radius, radius, shear_modulus)
    rho, c, a = rho[..., None], c[..., None], a[..., None]
    low, high = root(xp.maximum(c**2 - rho**2, 0.0)), root(a**2 - rho**2)  # s² = r² + x²
    at, weight = gauss(32)
    x = low + (high - low) * at
    s = xp.sqrt(xp.minimum(rho, a) ** 2 + x**2)
    total = (density(s) / s * (high - low) * weight).sum(axis=-1)
    return 4.0 / np.pi * modulus * rho[..., 0] * total


def torsion_displacement(
    r: Value, density: Density, stick_radius: Value, radius: Value
) -> AnyArray:
    """Relative u_θ of the two surfaces, inside and outside the contact ([Jaeger1995]) [mm].

    Inside the stick region it is r θ.
    """
    xp, rho, c, a = as_arrays(r, stick_radius, radius)
    # punches larger than r; with c = 0 they are all at r = 0, which does not move
    held = torsion_twist(density, xp.where(c > 0.0, c, a), a)
    slipped = torsion_twist(density, xp.where((rho > 0.0) & (rho <= a), rho, a), a)
    inner = rho * xp.where(rho <= c, held, slipped)
    # punches smaller than r, s = r sin α; without any, the length is arbitrary
    rho, c, a = rho[..., None], c[..., None], a[..., None]
    # not minimum: it halves the slope at a
    edge = xp.where(rho <= c, c, xp.where(rho <= a, rho, a))
    far = xp.where(rho <= c, xp.where(c > 0.0, c, a), rho)
    low, high = _arcsin(c / far), _arcsin(edge / far)
    at, weight = gauss(32)
    alpha = low + (high - low) * at
    sine, cosine = xp.sin(alpha), xp.cos(alpha)
    s = far * sine
    lag = 2.0 / np.pi * far * (alpha - sine * cosine)
    ds = far * cosine * (high - low) * weight
    return inner + (density(xp.where(s > 0.0, s, a)) * lag * ds).sum(axis=-1)


def lubkin_twist(stick_ratio: Value, friction_ratio: Value) -> AnyArray:
    """Twist θ = (μp0/2G*)[K − E] of a Hertz contact, parameter 1 − κ² ([Lubkin1951]) [rad].

    Args:
        stick_ratio: κ = c/a, 0 < κ ≤ 1 [-].
        friction_ratio: μp0/2G* [-].

    Raises:
        ValueError: κ is outside (0, 1].
    """
    _, kappa, ratio = as_arrays(stick_ratio, friction_ratio)
    kappa = refuse(kappa, ~((kappa > 0) & (kappa <= 1)), "κ = c/a must lie in (0, 1]")
    first, second = complete_elliptic(kappa)
    return ratio * (first - second)


def lubkin_stick_ratio(twist: Value, friction_ratio: Value) -> AnyArray:
    """Stick ratio κ = c/a at a twist of either sign, the inverse of `lubkin_twist` [-].

    It falls like 4 exp(−1 − θ/(μp0/2G*)) and never reaches 0. It is constant beyond
    θ/(μp0/2G*) = 700, the limit of double precision.

    Args:
        twist: θ [rad].
        friction_ratio: μp0/2G* [-].

    Raises:
        ValueError: the friction ratio is not above 0.
    """
    xp, twist, ratio = as_arrays(twist, friction_ratio)
    ratio = refuse(ratio, ~(ratio > 0), "the friction ratio μp0/2G* must be above 0")
    target = xp.minimum(xp.abs(twist) / ratio, 700.0)
    # K − E is concave in ln κ with slope −E, and lies below its tangent at κ = 1 and its
    # asymptote. From the nearer of these, Newton's steps never pass the root; five reach rounding.
    log_kappa = xp.minimum(-2.0 / np.pi * target, np.log(4.0) - 1.0 - target)
    for _ in range(5):
        first, second = complete_elliptic(xp.exp(log_kappa))
        log_kappa = log_kappa + (first - second - target) / second
    return xp.minimum(xp.exp(log_kappa), 1.0)


def lubkin_moment(
    stick_ratio: Value, friction_coefficient: Value, force: Value, radius: Value
) -> AnyArray:
    """Moment (4/π) μPa ∫_κ^1 s² E(1−s²) ds, parameter 1 − s² ([Lubkin1951]) [N·mm]."""
    xp, kappa, mu, force, a = as_arrays(stick_ratio, friction_coefficient, force, radius)
    s, ds = space_by_ratio(xp.maximum(share(kappa), _NO_MOMENT), 1.0)
    integral = (s**2 * complete_elliptic(s)[1] * ds).sum(axis=-1)
    return 4.0 / np.pi * mu * pressing(force) * a * integral


def flat_disc_twist(
    stick_ratio: Value,
    friction_coefficient: Value,
    force: Value,
    radius: Value,
    shear_modulus: Value,
) -> AnyArray:
    """Twist of a flat disc beyond first slip, μP K/(4πG*a²), parameter 1 − κ² ([Jaeger1995]) [rad].

    At κ = 1 it is μP/8G*a². Below that twist, everything sticks.
    """
    _, kappa, mu, force, a, modulus = as_arrays(
        stick_ratio, friction_coefficient, force, radius, shear_modulus
    )
    return (
        mu * pressing(force) * complete_elliptic(share(kappa))[0] / (4.0 * np.pi * modulus * a**2)
    )


def flat_disc_moment(
    stick_ratio: Value, friction_coefficient: Value, force: Value, radius: Value
) -> AnyArray:
    """Moment at `flat_disc_twist`, (4/3π) μPa [κ³K + 3∫_κ^1 s² K(1−s²) ds] ([Jaeger1995]) [N·mm].

    This is (16/3) G* ∫ s³ f ds integrated by parts, which includes the jump of f at the edge. It is
    ⅔ μPa when slip starts and (π/4) μPa when everything slips.
    """
    xp, kappa, mu, force, a = as_arrays(stick_ratio, friction_coefficient, force, radius)
    kappa = xp.maximum(share(kappa), _NO_MOMENT)
    s, ds = space_by_ratio(kappa, 1.0)
    slipped = 3.0 * (s**2 * complete_elliptic(s)[0] * ds).sum(axis=-1)
    held = kappa**3 * complete_elliptic(kappa)[0]
    return 4.0 / (3.0 * np.pi) * mu * pressing(force) * a * (held + slipped)


def mindlin_shift(
    shear_force: Value,
    friction_coefficient: Value,
    force: Value,
    radius: Value,
    tangential_compliance: Value,
) -> tuple[AnyArray, AnyArray]:
    """Shift of a Hertz contact under a tangential force, and its stick ratio ([Johnson1985] 7.2).

    It is exact for ν = 0. For other ν the traction is not exactly parallel to the force.

    Args:
        shear_force: Q of either sign, |Q| ≤ μP [N].
        friction_coefficient: μ [-].
        force: P [N].
        radius: a [mm].
        tangential_compliance: (2−ν_S)/G_S + (2−ν_B)/G_B [1/MPa].

    Returns:
        Shift of one body against the other [mm] and κ = c/a [-].

    Raises:
        ValueError: friction cannot carry the tangential force, the radius is not above 0, or P is
            below 0.
    """
    xp, shear, mu, force, a, compliance = as_arrays(
        shear_force, friction_coefficient, force, radius, tangential_compliance
    )
    limit = mu * pressing(force)
    shear = refuse(shear, ~(xp.abs(shear) <= limit), "friction carries no more than |Q| = μP")
    sign = xp.where(shear < 0.0, -1.0, 1.0)
    rest = 1.0 - sign * shear / limit
    scale = 3.0 * limit / (16.0 * positive(a)) * compliance
    return sign * scale * (1.0 - xp.cbrt(rest) ** 2), xp.cbrt(rest)


def _share(r: Value, radius: Value) -> AnyArray:
    """r/a; if a is 0, the length is arbitrary, because there is no pressure."""
    xp, r, a = as_arrays(r, radius)
    return r / xp.where(a > 0.0, a, 1.0)


def _arcsin(ratio: AnyArray) -> AnyArray:
    """Arcsine of a ratio from 0 to 1; its derivative at 1 is set to 0."""
    xp = ratio.__array_namespace__()
    below = ratio < 1.0
    return xp.where(below, xp.arcsin(xp.where(below, ratio, 0.0)), 0.5 * np.pi)
