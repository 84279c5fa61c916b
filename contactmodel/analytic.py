"""Closed forms of axisymmetric contact: Hertz pressure, torsion with and without slip, shift.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.4, 4.2 and 7.2.
[Lubkin1951] J. L. Lubkin, "The torsion of elastic spheres in contact".
[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
[Reissner1944] E. Reissner, H. F. Sagoci, "Forced torsional oscillations of an elastic half-space".
[Masing1926] G. Masing, "Eigenspannungen und Verfestigung beim Messing".

Symbols: a contact radius, c radius of the stick region, κ = c/a, p0 peak pressure, P normal force,
μ friction coefficient, θ twist of one body against the other, G* = 1/(1/G_S + 1/G_B) the shear
modulus of the pair, E* its contact modulus. Displacements under twist are those of one surface
against the other; the elastomer's share of them is 1/(1+k). Arguments are numbers or arrays that
broadcast against each other; everything is differentiable.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.checks import positive, refuse

Density = Callable[[Array], Array]


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre points and weights on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (points + 1.0), 0.5 * weights


_POINTS, _WEIGHTS = _gauss(32)
_ABEL_POINTS, _ABEL_WEIGHTS = _gauss(96)  # 1/r peaks where s is small
_TINY = 1e-9  # κ below which K = ln(4/κ) and E = 1 to rounding
_NO_MOMENT = 1e-6  # share of the radius within which a moment, going like s³, is below rounding


class Hertz(NamedTuple):
    """A Hertz contact.

    Attributes:
        radius: a [mm].
        peak_pressure: p0 [MPa].
        approach: δ [mm].
        force: P [N].
    """

    radius: Array
    peak_pressure: Array
    approach: Array
    force: Array


def pair_shear_modulus(elastomer: ArrayLike, stiffness_ratio: ArrayLike) -> Array:
    """G* = 1/(1/G_S + 1/G_B) from G_S [MPa] and k = G_S/G_B."""
    return jnp.asarray(elastomer) / (1.0 + jnp.asarray(stiffness_ratio))


def hertz_from_approach(
    approach: ArrayLike, radius_of_curvature: ArrayLike, contact_modulus: ArrayLike
) -> Hertz:
    """Hertz contact of a given approach, no force below 0 ([Johnson1985] Eqs. 4.22 to 4.24).

    Args:
        approach: δ [mm].
        radius_of_curvature: R of the gap r²/2R [mm].
        contact_modulus: E*, 1/E* = (1−ν_S)/2G_S + (1−ν_B)/2G_B [MPa].

    Raises:
        ValueError: a radius or modulus that is not above 0.
    """
    delta, curvature = jnp.asarray(approach), positive(radius_of_curvature)
    modulus = positive(contact_modulus)
    a = _root(curvature * delta)
    return Hertz(
        radius=a,
        peak_pressure=2.0 * modulus * a / (jnp.pi * curvature),
        approach=delta,
        force=4.0 / 3.0 * modulus * a * delta,
    )


def hertz_pressure(r: ArrayLike, radius: ArrayLike, peak_pressure: ArrayLike) -> Array:
    """p0 √(1 − r²/a²), 0 outside [MPa]."""
    return jnp.asarray(peak_pressure) * _root(1.0 - (jnp.asarray(r) / jnp.asarray(radius)) ** 2)


def hertz_indentation(
    r: ArrayLike, radius: ArrayLike, peak_pressure: ArrayLike, modulus: ArrayLike
) -> Array:
    """Displacement of a surface into its body ([Johnson1985] Eqs. 3.42a and b) [mm].

    Args:
        r: distance from the axis [mm].
        radius: a [mm].
        peak_pressure: p0 [MPa].
        modulus: 2G/(1−ν) of the body, or E* for the sum of both [MPa].
    """
    x = jnp.asarray(r) / jnp.asarray(radius)
    outside = jnp.maximum(x, 1.0)
    parabola = 2.0 - x**2
    inner = 0.5 * jnp.pi * parabola
    outer = parabola * _arcsin(1.0 / outside) + _root(outside**2 - 1.0)
    scale = jnp.asarray(peak_pressure) * jnp.asarray(radius) / (2.0 * jnp.asarray(modulus))
    return scale * jnp.where(x <= 1.0, inner, outer)


def hertz_radial_displacement(
    r: ArrayLike,
    radius: ArrayLike,
    peak_pressure: ArrayLike,
    shear_modulus: ArrayLike,
    poisson_ratio: ArrayLike,
) -> Array:
    """Displacement of a body's surface away from the axis ([Johnson1985] Eqs. 3.41b, 3.42c) [mm].

    It is towards the axis (below 0) and vanishes for ν = ½. Arguments as above, with the body's
    own shear modulus [MPa] and Poisson's ratio.
    """
    x = jnp.asarray(r) / jnp.asarray(radius)
    y = jnp.where(x <= 1.0, 1.0 - x**2, 0.0)
    inside = x * (1.0 + y + y**2) / (1.0 + y * _root(y))  # (1 − y^{3/2})/x, exact at x = 0 too
    shape = jnp.where(x <= 1.0, inside, 1.0 / jnp.maximum(x, 1.0))
    softness = (1.0 - 2.0 * jnp.asarray(poisson_ratio)) / (6.0 * jnp.asarray(shear_modulus))
    return -softness * jnp.asarray(peak_pressure) * jnp.asarray(radius) * shape


def reissner_sagoci_moment(twist: ArrayLike, radius: ArrayLike, shear_modulus: ArrayLike) -> Array:
    """Moment of a disc that sticks everywhere, (16/3) G* a³ θ ([Reissner1944]) [N·mm]."""
    return 16.0 / 3.0 * jnp.asarray(shear_modulus) * jnp.asarray(radius) ** 3 * jnp.asarray(twist)


def reissner_sagoci_traction(
    r: ArrayLike, twist: ArrayLike, radius: ArrayLike, shear_modulus: ArrayLike
) -> Array:
    """Circumferential traction of such a disc, (4G*θ/π) r/√(a² − r²), for r < a [MPa]."""
    r = jnp.asarray(r)
    depth = jnp.sqrt(jnp.asarray(radius) ** 2 - r**2)
    return 4.0 / jnp.pi * jnp.asarray(shear_modulus) * jnp.asarray(twist) * r / depth


def punch_displacement(r: ArrayLike, radius: ArrayLike) -> Array:
    """Circumferential displacement of the surface around a disc turned by 1 ([Reissner1944]) [mm].

    r inside the disc, (2/π)[r asin(s/r) − s √(1 − s²/r²)] outside, s its radius.
    """
    r, s = jnp.asarray(r), jnp.asarray(radius)
    ratio = jnp.minimum(s / jnp.maximum(r, s), 1.0)
    outside = 2.0 / jnp.pi * (r * _arcsin(ratio) - s * _root(1.0 - ratio**2))
    return jnp.where(r <= s, r, outside)


def hertz_density(radius: ArrayLike, friction_ratio: ArrayLike) -> Density:
    """Jäger's density of a Hertz contact, f(s) = (μp0/2G*) E(1 − s²/a²)/s ([Jaeger1995]).

    Args:
        radius: a [mm].
        friction_ratio: μp0/2G* [-].
    """
    a, ratio = jnp.asarray(radius), jnp.asarray(friction_ratio)
    return lambda s: ratio * complete_elliptic(jnp.minimum(s / a, 1.0))[1] / s


def jaeger_density(friction: Density, radius: ArrayLike, shear_modulus: ArrayLike) -> Density:
    """Density of punches that an axisymmetric friction limit lets slip ([Jaeger1995]).

    f(s) = −(1/2G*) d/ds ∫_s^a μp(r)/√(r² − s²) dr, for a limit that falls to 0 at the edge.

    Args:
        friction: the limit μp(r), of an array of radii [MPa].
        radius: a [mm].
        shear_modulus: G* [MPa].
    """
    a, modulus = jnp.asarray(radius), jnp.asarray(shear_modulus)

    def abel(s: Array) -> Array:  # r² = s² + x², x from 0 to the edge as sin t
        t = 0.5 * jnp.pi * _ABEL_POINTS
        edge = _root(a**2 - s**2)
        r = jnp.sqrt(s**2 + (edge * jnp.sin(t)) ** 2)
        return jnp.sum(friction(r) / r * edge * jnp.cos(t) * 0.5 * jnp.pi * _ABEL_WEIGHTS)

    slope = jnp.vectorize(jax.grad(abel))
    return lambda s: -slope(s) / (2.0 * modulus)


def torsion_twist(density: Density, stick_radius: ArrayLike, radius: ArrayLike) -> Array:
    """Twist that leaves a stick region of radius c, ∫_c^a f ds ([Jaeger1995]) [rad]."""
    s, ds = _between(stick_radius, radius)
    return jnp.sum(density(s) * ds, axis=-1)


def torsion_moment(
    density: Density, stick_radius: ArrayLike, radius: ArrayLike, shear_modulus: ArrayLike
) -> Array:
    """Moment at that stick radius, (16/3) G* ∫_c^a s³ f ds ([Jaeger1995]) [N·mm]."""
    s, ds = _between(jnp.maximum(stick_radius, _NO_MOMENT * jnp.asarray(radius)), radius)
    return 16.0 / 3.0 * jnp.asarray(shear_modulus) * jnp.sum(s**3 * density(s) * ds, axis=-1)


def torsion_traction(
    r: ArrayLike,
    density: Density,
    stick_radius: ArrayLike,
    radius: ArrayLike,
    shear_modulus: ArrayLike,
) -> Array:
    """Circumferential traction: the sum of punches larger than r ([Jaeger1995]) [MPa].

    In the slip region it is the friction limit.
    """
    r, c, a = (jnp.asarray(value)[..., None] for value in (r, stick_radius, radius))
    low, high = _root(jnp.maximum(c**2 - r**2, 0.0)), _root(a**2 - r**2)  # s² = r² + x²
    x = low + (high - low) * _POINTS
    s = jnp.sqrt(jnp.minimum(r, a) ** 2 + x**2)
    total = jnp.sum(density(s) / s * (high - low) * _WEIGHTS, axis=-1)
    return 4.0 / jnp.pi * jnp.asarray(shear_modulus) * r[..., 0] * total


def torsion_displacement(
    r: ArrayLike, density: Density, stick_radius: ArrayLike, radius: ArrayLike
) -> Array:
    """u_θ of one surface against the other, inside and outside the contact ([Jaeger1995]) [mm].

    Inside the stick region it is r θ.
    """
    r, c, a = (jnp.asarray(value)[..., None] for value in (r, stick_radius, radius))
    edge = jnp.where(r <= c, c, jnp.where(r <= a, r, a))  # not clip: it halves slopes at c and a
    # punches that hold r; with c = 0 they are all at r = 0, which stays where it is
    s, ds = _between(jnp.where(edge > 0.0, edge, a)[..., 0], a[..., 0])
    inner = r[..., 0] * jnp.sum(density(s) * ds, axis=-1)
    # punches that do not, s = r sin α; where there are none, any length will do
    far = jnp.where(r <= c, jnp.where(c > 0.0, c, a), r)
    low, high = _arcsin(c / far), _arcsin(edge / far)
    alpha = low + (high - low) * _POINTS
    s = far * jnp.sin(alpha)
    lag = 2.0 / jnp.pi * far * (alpha - jnp.sin(alpha) * jnp.cos(alpha))
    ds = far * jnp.cos(alpha) * (high - low) * _WEIGHTS
    lagging = density(jnp.where(s > 0.0, s, a)) * lag * ds
    return inner + jnp.sum(lagging, axis=-1)


def lubkin_twist(stick_ratio: ArrayLike, friction_ratio: ArrayLike) -> Array:
    """θ = (μp0/2G*)[K − E] of a Hertz contact, parameter 1 − κ² ([Lubkin1951]) [rad].

    Args:
        stick_ratio: κ = c/a, 0 < κ ≤ 1 [-].
        friction_ratio: μp0/2G* [-].

    Raises:
        ValueError: κ outside (0, 1].
    """
    kappa = jnp.asarray(stick_ratio)
    kappa = refuse(kappa, ~((kappa > 0) & (kappa <= 1)), "κ = c/a must lie in (0, 1]")
    first, second = complete_elliptic(kappa)
    return jnp.asarray(friction_ratio) * (first - second)


def lubkin_stick_ratio(twist: ArrayLike, friction_ratio: ArrayLike) -> Array:
    """κ = c/a at a twist of either sign, the inverse of `lubkin_twist` [-].

    It falls like 4 exp(−1 − θ/(μp0/2G*)) and never reaches 0: beyond θ/(μp0/2G*) = 700 it stays
    at what a double can hold.
    """

    def solve(target: Array) -> Array:
        def excess(log_kappa: Array, target: Array) -> Array:
            first, second = complete_elliptic(jnp.exp(log_kappa))
            return first - second - target

        # K − E is above ln(4/κ) − ½π, and below 0 for κ > 1
        bracket = {"lower": -target - 1.0, "upper": jnp.full_like(target, 0.5)}
        solver = optx.Bisection(rtol=1e-14, atol=1e-14)
        start = -0.5 * target
        solution = optx.root_find(
            excess, solver, start, target, options=bracket, max_steps=80, throw=False
        )
        return jnp.minimum(jnp.exp(solution.value), 1.0)

    target = jnp.abs(jnp.asarray(twist)) / jnp.asarray(friction_ratio)
    return jnp.vectorize(solve)(jnp.minimum(target, 700.0))


def lubkin_moment(
    stick_ratio: ArrayLike, friction_coefficient: ArrayLike, force: ArrayLike, radius: ArrayLike
) -> Array:
    """M = (4/π) μPa ∫_κ^1 s² E(1−s²) ds, parameter 1 − s² ([Lubkin1951]) [N·mm]."""
    s, ds = _between(jnp.maximum(stick_ratio, _NO_MOMENT), 1.0)
    integral = jnp.sum(s**2 * complete_elliptic(s)[1] * ds, axis=-1)
    limit = jnp.asarray(friction_coefficient) * jnp.asarray(force) * jnp.asarray(radius)
    return 4.0 / jnp.pi * limit * integral


def flat_disc_twist(
    stick_ratio: ArrayLike,
    friction_coefficient: ArrayLike,
    force: ArrayLike,
    radius: ArrayLike,
    shear_modulus: ArrayLike,
) -> Array:
    """Twist of a flat disc beyond first slip, μP K/(4πG*a²), parameter 1 − κ² ([Jaeger1995]) [rad].

    At κ = 1 it is μP/8G*a², up to which everything sticks.
    """
    limit = jnp.asarray(friction_coefficient) * jnp.asarray(force)
    area = 4.0 * jnp.pi * jnp.asarray(shear_modulus) * jnp.asarray(radius) ** 2
    return limit * complete_elliptic(stick_ratio)[0] / area


def flat_disc_moment(
    stick_ratio: ArrayLike, friction_coefficient: ArrayLike, force: ArrayLike, radius: ArrayLike
) -> Array:
    """Moment at that twist, (4/3π) μPa [κ³K + 3∫_κ^1 s² K(1−s²) ds] ([Jaeger1995]) [N·mm].

    (16/3) G* ∫ s³ f ds by parts, so that the jump of f at the edge is in it: ⅔ μPa when slip
    starts, (π/4) μPa when everything slips.
    """
    kappa = jnp.maximum(stick_ratio, _NO_MOMENT)
    s, ds = _between(kappa, 1.0)
    slipped = 3.0 * jnp.sum(s**2 * complete_elliptic(s)[0] * ds, axis=-1)
    limit = jnp.asarray(friction_coefficient) * jnp.asarray(force) * jnp.asarray(radius)
    return 4.0 / (3.0 * jnp.pi) * limit * (kappa**3 * complete_elliptic(kappa)[0] + slipped)


def mindlin_shift(
    shear_force: ArrayLike,
    friction_coefficient: ArrayLike,
    force: ArrayLike,
    radius: ArrayLike,
    tangential_compliance: ArrayLike,
) -> tuple[Array, Array]:
    """Shift of a Hertz contact under a tangential force, and its stick ratio ([Johnson1985] 7.2).

    Exact for ν = 0; for other ν the traction is not quite along the force.

    Args:
        shear_force: Q of either sign, |Q| ≤ μP [N].
        friction_coefficient: μ [-].
        force: P [N].
        radius: a [mm].
        tangential_compliance: (2−ν_S)/G_S + (2−ν_B)/G_B [1/MPa].

    Returns:
        Shift of one body against the other [mm] and κ = c/a [-].

    Raises:
        ValueError: a tangential force that friction cannot carry, or a radius not above 0.
    """
    limit = jnp.asarray(friction_coefficient) * jnp.asarray(force)
    shear = jnp.asarray(shear_force)
    shear = refuse(shear, ~(jnp.abs(shear) <= limit), "friction carries no more than |Q| = μP")
    sign = jnp.where(shear < 0.0, -1.0, 1.0)
    rest = 1.0 - sign * shear / limit
    scale = 3.0 * limit / (16.0 * positive(radius)) * jnp.asarray(tangential_compliance)
    return sign * scale * (1.0 - jnp.cbrt(rest) ** 2), jnp.cbrt(rest)


def masing(virgin: Callable[[Any], Any], turns: Sequence[Any], twist: Any) -> Any:
    """A quantity after reversals at constant pressure ([Masing1926]).

    Each branch is the first-loading curve enlarged twice from the point where it turned, as long
    as the twist stays within the last two turns.

    Args:
        virgin: the quantity on first loading, odd in its argument (moment, u_θ at a radius, …).
        turns: twists at the reversals that are still open, oldest first [rad].
        twist: twist now [rad].
    """
    first, *rest = (*turns, twist)
    value = virgin(first)
    for start, end in zip(turns, rest, strict=True):
        value = value + 2.0 * virgin(0.5 * (end - start))
    return value


def open_turns(path: Sequence[float]) -> list[tuple[float, ...]]:
    """For each twist of a path from 0, the reversals that it still remembers.

    A reversal is forgotten with its partner when the path passes the twist at which it began; one
    that goes beyond every earlier twist is on the first-loading curve again.
    """
    remembered: list[tuple[float, ...]] = []
    turns: list[float] = []
    last = 0.0
    direction = 0.0
    for twist in path:
        step = float(np.sign(twist - last))
        if step and direction and step != direction:
            turns.append(last)
        direction = step or direction
        while turns and _passed(turns, twist):
            del turns[-2:]
        remembered.append(tuple(turns))
        last = twist
    return remembered


def complete_elliptic(kappa: ArrayLike) -> tuple[Array, Array]:
    """K and E of parameter m = 1 − κ², 0 < κ ≤ 1, by the arithmetic–geometric mean."""
    kappa = jnp.asarray(kappa)
    tiny = kappa < _TINY
    geometric = jnp.where(tiny, 1.0, kappa)
    mean = jnp.ones_like(geometric)
    total, power = 0.5 * (1.0 - geometric**2), 0.5
    for _ in range(8):  # converges quadratically: exact to rounding above _TINY
        half = 0.5 * (mean - geometric)
        mean, geometric = 0.5 * (mean + geometric), jnp.sqrt(mean * geometric)
        power *= 2.0
        total = total + power * half**2
    first = jnp.pi / (2.0 * mean)
    limit = jnp.log(4.0 / jnp.where(tiny, kappa, 1.0))
    return jnp.where(tiny, limit, first), jnp.where(tiny, 1.0, first * (1.0 - total))


def _between(low: ArrayLike, high: ArrayLike) -> tuple[Float[Array, "*batch q"], Array]:
    """Points and weights of a quadrature, spaced by ratio as f falls like 1/s."""
    low, high = jnp.asarray(low)[..., None], jnp.asarray(high)[..., None]
    ratio = jnp.log(high / low)
    points = low * jnp.exp(ratio * _POINTS)
    return points, points * ratio * _WEIGHTS


def _passed(turns: Sequence[float], twist: float) -> bool:
    """Whether the branch from the last turn has closed the loop it is part of."""
    if len(turns) == 1:
        return abs(twist) > abs(turns[0])
    return abs(twist - turns[-1]) >= abs(turns[-2] - turns[-1])


def _arcsin(ratio: Array) -> Array:
    """Arcsine of a ratio from 0 to 1, with a finite derivative (0) at 1."""
    below = ratio < 1.0
    return jnp.where(below, jnp.arcsin(jnp.where(below, ratio, 0.0)), 0.5 * jnp.pi)


def _root(square: Array) -> Array:
    """√ of what is above 0, else 0, with finite derivatives."""
    above = square > 0.0
    return jnp.where(above, jnp.sqrt(jnp.where(above, square, 1.0)), 0.0)
