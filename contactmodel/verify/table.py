"""The table of `verify` with all of its rows.

Each check takes the number of cells along a side and returns rows. Each tolerance states its
reason. Tolerances that depend on the cells hold for 128 cells and scale with the stated order.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from contactmodel import analytic
from contactmodel.verify import closed_forms, friction, laws, layers
from contactmodel.verify.rows import RADIUS, Row, hertz_case, l2_error, solve_hertz

CHECKS: tuple[Callable[[int], list[Row]], ...] = (
    closed_forms.check_hertz,
    closed_forms.check_punch,
    closed_forms.check_torsion,
    closed_forms.check_loop,
    closed_forms.check_history,
    closed_forms.check_shift,
    closed_forms.check_cylinder,
    friction.check_power_law,
    friction.check_power_law_gradients,
    laws.check_laws,
    laws.check_equilibrium,
    laws.check_frames,
    laws.check_gradients,
    layers.check_thick_layer,
    layers.check_thin_layer,
    layers.check_depth,
    laws.check_coupling,
    laws.check_resultant,
)


def convergence(counts: tuple[int, ...] = (32, 64, 128, 256)) -> list[Row]:
    """Orders of convergence of the Hertz contact under torsion with the cell size.

    Each order is the least-squares slope of the logarithm of the error over that of the cell size.

    Args:
        counts: cells along a side of each grid.
    """
    case = hertz_case()
    twist = analytic.lubkin_twist(0.7, case.friction_ratio)
    density = analytic.hertz_density(RADIUS, case.friction_ratio)
    errors = []
    for count in counts:
        solution = solve_hertz(count, twist=twist)
        r = np.hypot(*solution.grid.points)
        pressure = analytic.hertz_pressure(r, RADIUS, case.hertz.peak_pressure)
        traction = analytic.torsion_traction(
            np.minimum(r, RADIUS), density, 0.7 * RADIUS, RADIUS, case.shear_modulus
        )
        size = jnp.sqrt(jnp.sum(solution.traction**2, axis=0))
        peak = case.hertz.peak_pressure
        errors.append([
            abs(float(jnp.max(solution.pressure) / peak) - 1.0),
            abs(float(-solution.force[2] / case.hertz.force) - 1.0),
            l2_error(solution.pressure, pressure),
            l2_error(size, traction),
            abs(float(solution.moment) - case.moment(0.7)) / case.limit,
        ])  # fmt: skip
    slopes = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    names = ("peak pressure", "force", "pressure, L2", "traction at c/a = 0.7, L2", "moment")
    expected = (2.0, 1.5, 1.0, 1.0, 1.5)
    return [
        Row(f"Order of convergence: {name}", slope, order, order - slope, 0.5, "lower limit")
        for name, slope, order in zip(names, slopes.tolist(), expected, strict=True)
    ]
