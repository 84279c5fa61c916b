"""Friction that falls with pressure: two half-spaces under Hertz's pressure, in closed form.

The limit of friction is q(r) = q0 (1 − r²/a²)^m, m = (1−γ)/2, q0 = μ₀ p0 (p0/p_ref)^(−γ). In full
slip friction carries ∫q dA = 2πa² q0/(3−γ) along the shift, or ∫q r dA = πa³ q0 B(3/2, m+1) about
the axis. For any q, a disc of radius c still sticks at the twist θ = A(c)/2G*, with Abel's integral
A(s) = ∫_s^a q/√(r²−s²) dr, and the moment is (8/3) [c³A(c) + 3 ∫_c^a s²A ds] ([Jaeger1995], the
sums over punches integrated by parts).

[Jaeger1995] J. Jäger, "Axi-symmetric bodies of equal material in contact under torsion or shift".
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.integrate import quad
from scipy.special import beta

from contactmodel.contact import Contact
from contactmodel.friction import PowerLawFriction
from contactmodel.grid import Grid
from contactmodel.pose import Pose
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact
from contactmodel.verify.rows import (
    APPROACH,
    BALL,
    ELASTOMER,
    OBJECT,
    RADIUS,
    SIDE,
    Row,
    by_cell,
    hertz_case,
    relative,
)

NAMES, VALUES = ("μ₀", "p_ref", "γ"), (0.5, 0.2, 0.3)


def solve_power_law(
    count: int, values: Float[Array, "3"] | tuple[float, float, float] = VALUES, **motion
) -> ContactSolution:
    """Solve the Hertz contact with power-law friction, pressed and moved by twist and shift.

    Args:
        count: cells along a side.
        values: μ₀ [-], p_ref [MPa] and γ [-].
        motion: arguments of the `Pose`, such as `twist` and `shift`.
    """
    grid, (mu, reference, exponent) = Grid((count, count), (SIDE, SIDE)), values
    friction = PowerLawFriction(mu, reference, exponent)
    pose = Pose(APPROACH, linear=True, **motion)
    contact = Contact(ELASTOMER, OBJECT, BALL, grid, friction)
    return solve_contact(contact, pose, rtol=1e-9)


def most_traction() -> float:
    """q0, the limit of friction under the peak pressure [MPa]."""
    (mu, reference, exponent), peak = VALUES, float(hertz_case().hertz.peak_pressure)
    return mu * peak * (peak / reference) ** -exponent


def check_power_law(count: int) -> list[Row]:
    """Full slip along and about the axis, and a twist at which a disc still sticks."""
    case, q0, power = hertz_case(), most_traction(), 0.5 * (1.0 - VALUES[2])
    force = 2.0 * np.pi * RADIUS**2 * q0 / (3.0 - VALUES[2])
    most = np.pi * RADIUS**3 * q0 * beta(1.5, power + 1.0)

    def abel(s: float) -> float:  # r² = s² + x², x from 0 to the edge as sin t
        edge = np.sqrt(RADIUS**2 - s**2)

        def part(t: float) -> float:
            share = (edge * np.cos(t) / RADIUS) ** 2  # 1 − r²/a²
            return q0 * share**power * edge * np.cos(t) / np.hypot(s, edge * np.sin(t))

        return quad(part, 0.0, 0.5 * np.pi)[0]

    disc = 0.7 * RADIUS
    twist = abel(disc) / (2.0 * case.shear_modulus)
    punches, _ = quad(lambda s: 3.0 * s**2 * abel(s), disc, RADIUS)
    moment = 8.0 / 3.0 * (disc**3 * abel(disc) + punches)
    shifted = solve_power_law(count, shift=(3.0, 0.0)).force[0]
    slid, turned = (solve_power_law(count, twist=turn).moment for turn in (3.0, twist))
    why = "second order, with noise from cells cut by the rim"
    return [
        relative("μ falls with p, full slip: force [N]", shifted, force,
                 by_cell(2e-4, 1.5, count), why),
        relative("μ falls with p, full slip: moment [N·mm]", slid, most,
                 by_cell(4e-4, 1.5, count), why),
        Row("μ falls with p, c/a = 0.7: moment [N·mm]", float(turned), moment,
            abs(float(turned) - moment) / most, by_cell(3e-4, 1.5, count), why),
    ]  # fmt: skip


def check_power_law_gradients(count: int) -> list[Row]:
    """Gradient of the force Q in full slip: Q/μ₀, γQ/p_ref and Q [ln(p_ref/p0) + 1/(3−γ)]."""
    (mu, reference, exponent), peak = VALUES, float(hertz_case().hertz.peak_pressure)
    force = 2.0 * np.pi * RADIUS**2 * most_traction() / (3.0 - exponent)
    by_exponent = np.log(reference / peak) + 1.0 / (3.0 - exponent)
    expected = (force / mu, force * exponent / reference, force * by_exponent)
    values = jnp.asarray(VALUES)
    slid = jax.grad(lambda v: solve_power_law(count, v, shift=(3.0, 0.0)).force[0])(values)
    return [
        relative(f"μ falls with p, full slip: dQ/d{name}", value, exact,
                 by_cell(3e-3, 1.5, count), "as for the force")
        for name, value, exact in zip(NAMES, slid, expected, strict=True)
    ]  # fmt: skip
