"""Checks of the arguments of closed forms; all return the values, and work inside `jit`."""

from typing import Any

import numpy as np

from contactmodel.common.arrays import AnyArray, refuse


def positive(values: AnyArray) -> AnyArray:
    """Refuse values that are not finite and above 0."""
    values = refuse(values, ~(abs(values) < np.inf), "a value must be a finite number")
    return refuse(values, ~(values > 0), "a modulus, radius or length must be above 0")


def share(kappa: AnyArray) -> AnyArray:
    """Refuse stick ratios that are not from 0 to 1."""
    return refuse(kappa, ~((kappa >= 0) & (kappa <= 1)), "κ = c/a must lie from 0 to 1")


def pressing(force: Any) -> AnyArray:
    """Refuse normal forces below 0, as the z component of a solution's force is."""
    message = "P presses the bodies together and must not be below 0: give -force[2] of a solution"
    return refuse(force, ~(force >= 0), message)
