"""Moment–angle curves of contacts in torsion, for pressures from peaked to flat.

How a contact loses its hold depends on its pressure, which is not known: it is peaked under a
sphere on a thin layer, Hertz's under a sphere on a thick one, and flat under a flat face. The
thickness of the gel itself changes a curve, scaled to stiffness and limit 1, by less than 5 % for
layers down to the contact's radius.
"""

from functools import cache

import numpy as np

from contactmodel.analytic import TorsionCurve, rounded_punch_pressure, torsion_curve

HERTZ_NAME = "Hertz"
"""Name of Hertz's pressure among the curves."""
LEAST_STICK_RATIO = 0.1
"""c/a to which the curves are tabulated [-]; they have no end."""


@cache
def pressure_curves() -> dict[str, TorsionCurve]:
    """First loading up to the least stick ratio, by the name of the pressure."""
    pressures = {
        f"(1 − r²/a²)^{power:g}": lambda r, power=power: np.maximum(1.0 - r * r, 0.0) ** power
        for power in (1.5, 1.0)
    }
    pressures |= {
        f"flat to {flat:g} a" if flat else HERTZ_NAME: rounded_punch_pressure(flat)
        for flat in (0.0, 0.4, 0.65, 0.85)
    }
    return {name: torsion_curve(p, LEAST_STICK_RATIO) for name, p in pressures.items()}
