"""Rows of the table of `verify`, and the Hertz contact of its checks."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from contactmodel import analytic
from contactmodel.common.arrays import AnyArray
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace, stiffness_ratio
from contactmodel.grid import Grid
from contactmodel.indenters import Paraboloid
from contactmodel.pose import Pose
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact

RADIUS = 3.0  # a of the Hertz contact [mm]
SIDE = 10.0  # of the grid [mm]
CURVATURE = 30.0  # R of the paraboloid [mm]
FRICTION = 0.5
ELASTOMER = HalfSpace(shear_modulus=1.0, poisson_ratio=0.45)
OBJECT = HalfSpace(shear_modulus=3.0, poisson_ratio=0.35)  # equal (1−2ν)/G, so not coupled
INCOMPRESSIBLE = HalfSpace(shear_modulus=1.0, poisson_ratio=0.5)  # not coupled to a rigid object
BALL = Paraboloid(CURVATURE)
APPROACH = RADIUS**2 / CURVATURE


class Row(NamedTuple):
    """A line of the table."""

    what: str  # name of the check
    value: float  # value of the model, or size of an error
    expected: float  # expected value
    error: float  # error in the measure of the tolerance
    tolerance: float  # largest error that passes
    because: str  # reason that limits the agreement

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; False for NaN."""
        return bool(self.error <= self.tolerance)


def by_cell(tolerance: float, order: float, count: int) -> float:
    """Convert a tolerance for 128 cells along a side to another number of cells."""
    return tolerance * (128.0 / count) ** order


class HertzCase(NamedTuple):
    """The Hertz contact of the checks, in closed form."""

    hertz: analytic.Hertz  # radius, peak pressure, approach and force
    shear_modulus: float  # G* [MPa]
    friction_ratio: float  # μp0/2G* [-]

    @property
    def limit(self) -> float:
        """μPa, the scale of moments [N·mm]."""
        return FRICTION * float(self.hertz.force) * RADIUS

    def moment(self, stick_ratio: float) -> float:
        """Lubkin's moment [N·mm]."""
        return float(analytic.lubkin_moment(stick_ratio, FRICTION, self.hertz.force, RADIUS))


def hertz_case(elastomer: HalfSpace = ELASTOMER, object_: HalfSpace = OBJECT) -> HertzCase:
    """Closed form of the Hertz contact of two half-spaces under the paraboloid."""
    softness = sum(0.5 * (1.0 - b.poisson_ratio) * b.softness for b in (elastomer, object_))
    hertz = analytic.hertz_from_approach(APPROACH, CURVATURE, 1.0 / softness)
    k = stiffness_ratio(elastomer, object_)
    modulus = float(analytic.pair_shear_modulus(elastomer.shear_modulus, k))
    return HertzCase(hertz, modulus, FRICTION * float(hertz.peak_pressure) / (2.0 * modulus))


def solve_hertz(count: int, **motion) -> ContactSolution:
    """Solve the Hertz contact on a grid, pressed and moved by a linear twist and shift."""
    grid = Grid((count, count), (SIDE, SIDE))
    pose = Pose(APPROACH, linear=True, **motion)
    return solve_contact(Contact(ELASTOMER, OBJECT, BALL, grid, FRICTION), pose, rtol=1e-9)


def relative(what: str, value, expected, tolerance: float, because: str) -> Row:
    """A row whose error is relative to the expected value."""
    value, expected = float(value), float(expected)
    return Row(what, value, expected, abs(value / expected - 1.0), tolerance, because)


def error(what: str, error, tolerance: float, because: str) -> Row:
    """A row whose value is itself an error."""
    return Row(what, float(error), 0.0, float(error), tolerance, because)


def l2_error(field: Array, exact: AnyArray) -> float:
    """Relative error of a field in the L2 norm."""
    return float(jnp.linalg.norm(field - exact) / jnp.linalg.norm(exact))
