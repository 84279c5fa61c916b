"""The model against closed forms, conservation laws and itself: the table of `verify`.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.4, 3.8 and 4.2. The other closed forms
are those of `contactmodel.analytic`.

Each check takes the number of cells along a side and returns rows. Each tolerance says what limits
it; those that the cells limit are given for 128 and grow with the stated order of the cell.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel import analytic
from contactmodel.arrays import AnyArray
from contactmodel.bodies import HalfSpace, Rigid, stiffness_ratio
from contactmodel.grid import Grid
from contactmodel.indenters import Cylinder, Paraboloid, Placed, RoundPunch, SquarePunch
from contactmodel.pose import Pose, make_path
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact, solve_path

RADIUS = 3.0  # a of the Hertz contact [mm]
SIDE = 10.0  # of the grid [mm]
CURVATURE = 30.0  # R of the paraboloid [mm]
FRICTION = 0.5
ELASTOMER = HalfSpace(shear_modulus=1.0, poisson_ratio=0.45)
OBJECT = HalfSpace(shear_modulus=3.0, poisson_ratio=0.35)  # the same (1−2ν)/G: not coupled
INCOMPRESSIBLE = HalfSpace(shear_modulus=1.0, poisson_ratio=0.5)  # not coupled to a rigid object


class Row(NamedTuple):
    """A line of the table.

    Attributes:
        what: what was checked.
        value: what the model has, or the size of an error.
        expected: what it should be.
        error: as the tolerance measures it.
        tolerance: on the error.
        because: what limits the agreement.
    """

    what: str
    value: float
    expected: float
    error: float
    tolerance: float
    because: str

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; NaN is not."""
        return bool(self.error <= self.tolerance)


def by_cell(tolerance: float, order: float, count: int) -> float:
    """A tolerance given for 128 cells along a side, for another number."""
    return tolerance * (128.0 / count) ** order


class HertzCase(NamedTuple):
    """The Hertz contact of the checks, in closed form.

    Attributes:
        hertz: radius, peak pressure, approach and force.
        shear_modulus: G* [MPa].
        friction_ratio: μp0/2G* [-].
    """

    hertz: analytic.Hertz
    shear_modulus: float
    friction_ratio: float

    @property
    def limit(self) -> float:
        """μPa [N·mm]."""
        return FRICTION * float(self.hertz.force) * RADIUS

    def moment(self, stick_ratio: float) -> float:
        """Lubkin's moment [N·mm]."""
        return float(analytic.lubkin_moment(stick_ratio, FRICTION, self.hertz.force, RADIUS))


def hertz_case(elastomer: HalfSpace = ELASTOMER, object_: HalfSpace = OBJECT) -> HertzCase:
    """The closed form of two half-spaces under the paraboloid."""
    softness = sum(0.5 * (1.0 - b.poisson_ratio) * b.softness for b in (elastomer, object_))
    hertz = analytic.hertz_from_approach(RADIUS**2 / CURVATURE, CURVATURE, 1.0 / softness)
    k = stiffness_ratio(elastomer, object_)
    modulus = float(analytic.pair_shear_modulus(elastomer.shear_modulus, k))
    return HertzCase(hertz, modulus, FRICTION * float(hertz.peak_pressure) / (2.0 * modulus))


def solve_hertz(count: int, *, rtol: float = 1e-9, **motion) -> ContactSolution:
    """The Hertz contact on a grid, pressed and then moved by the linear twist and shift."""
    grid = Grid((count, count), (SIDE, SIDE))
    pose = Pose(RADIUS**2 / CURVATURE, linear=True, **motion)
    return solve_contact(ELASTOMER, OBJECT, Paraboloid(CURVATURE), pose, grid, FRICTION, rtol=rtol)


def check_hertz(count: int) -> list[Row]:
    """Peak pressure, radius, force and pressure field."""
    case, solution = hertz_case(), solve_hertz(count)
    grid = solution.grid
    r = np.hypot(*grid.points)
    exact = analytic.hertz_pressure(r, RADIUS, case.hertz.peak_pressure)
    area = float(jnp.sum(solution.contact)) * grid.cell_area
    return [
        _relative("Hertz: peak pressure [MPa]", jnp.max(solution.pressure),
                  case.hertz.peak_pressure, by_cell(2e-4, 2.0, count), "second order"),
        _relative("Hertz: contact radius [mm]", np.sqrt(area / np.pi), RADIUS,
                  by_cell(6e-3, 1.0, count), "cells counted whole"),
        _relative("Hertz: force [N]", -solution.force[2], case.hertz.force,
                  by_cell(5e-5, 2.0, count), "second order"),
        _error("Hertz: pressure, relative L2 error", _l2(solution.pressure, exact),
               by_cell(7e-3, 1.0, count), "vertical tangent at the rim"),
    ]  # fmt: skip


def check_punch(count: int) -> list[Row]:
    """Flat punch: force, and Reissner and Sagoci's moment under full stick."""
    grid = Grid((count, count), (SIDE, SIDE))
    case, twist, approach = hertz_case(), 0.01, 0.1
    pose = Pose(approach, twist=twist, linear=True)
    solution = solve_contact(ELASTOMER, OBJECT, RoundPunch(RADIUS), pose, grid, 1e6)
    softness = sum(0.5 * (1.0 - b.poisson_ratio) * b.softness for b in (ELASTOMER, OBJECT))
    force = 2.0 * RADIUS * approach / softness  # [Johnson1985] Eq. (3.36)
    moment = analytic.reissner_sagoci_moment(twist, RADIUS, case.shear_modulus)
    why = "singular edge, first order in the cell"
    return [
        _relative("Flat punch: force [N]", -solution.force[2], force,
                  by_cell(7e-3, 1.0, count), why),
        _relative("Reissner–Sagoci: moment [N·mm]", solution.moment, moment,
                  by_cell(1.7e-2, 1.0, count), why),
        _error("Flat punch, huge friction: share that slides",
               1.0 - solution.stick_ratio, 0.0, "μ = 1e6"),
    ]  # fmt: skip


def check_torsion(count: int) -> list[Row]:
    """Lubkin's moment and traction at four stick radii."""
    case = hertz_case()
    density = analytic.hertz_density(RADIUS, case.friction_ratio)
    rows = []
    for kappa in (0.9, 0.7, 0.5, 0.3):
        twist = analytic.lubkin_twist(kappa, case.friction_ratio)
        solution = solve_hertz(count, twist=twist)
        r = np.hypot(*solution.grid.points)
        exact = analytic.torsion_traction(
            np.minimum(r, RADIUS), density, kappa * RADIUS, RADIUS, case.shear_modulus
        )
        size = jnp.sqrt(jnp.sum(solution.traction**2, axis=0))
        moment = case.moment(kappa)
        rows += [
            Row(f"Lubkin, c/a = {kappa}: moment [N·mm]", float(solution.moment), moment,
                abs(float(solution.moment) - moment) / case.limit, by_cell(5e-5, 2.0, count),
                "by μPa; second order, with noise of where the rim cuts cells"),
            _error(f"Lubkin, c/a = {kappa}: traction, relative L2 error", _l2(size, exact),
                   by_cell(2.5e-2, 1.0, count), "vertical tangents at the rims"),
        ]  # fmt: skip
    return rows


def check_loop(count: int) -> list[Row]:
    """Unloading, reversal and closing of the loop against Masing's rule."""
    case = hertz_case()
    top = float(analytic.lubkin_twist(0.5, case.friction_ratio))

    def virgin(twist: ArrayLike) -> Array:
        kappa = analytic.lubkin_stick_ratio(twist, case.friction_ratio)
        size = analytic.lubkin_moment(kappa, FRICTION, case.hertz.force, RADIUS)
        return jnp.sign(twist) * size

    grid = Grid((count, count), (SIDE, SIDE))
    turns = [Pose(RADIUS**2 / CURVATURE, twist=t, linear=True) for t in (0.0, top, -top, top)]
    path = make_path(turns, [1, 2, 2])
    solution = solve_path(ELASTOMER, OBJECT, Paraboloid(CURVATURE), path, grid, FRICTION)
    twists = np.asarray(path.twist)
    expected = [
        float(analytic.masing(virgin, opened, twist))
        for opened, twist in zip(analytic.open_turns(twists.tolist()), twists, strict=True)
    ]
    places = ("first loading", "unloaded to 0", "fully reversed", "reloaded to 0", "loop closed")
    rows = [
        Row(f"Masing, {place}: moment [N·mm]", float(value), exact,
            abs(float(value) - exact) / case.limit, by_cell(5e-5, 2.0, count),
            "by μPa; as Lubkin's")
        for place, value, exact in zip(places, solution.moment, expected, strict=True)
    ]  # fmt: skip
    loss = np.diff(np.asarray(solution.dissipated_energy), prepend=0.0)
    return [*rows, _error("Loop: dissipation below 0 in a step", max(-loss.min(), 0.0), 0.0, "law")]


def check_history(count: int) -> list[Row]:
    """Pressed and twisted at once (θ ∝ P), no slip: a point only turns from when it touched.

    Each step adds a punch of the radius s that the contact has then, dθ = 3θ s²/a³ ds; the sum of
    their rotations ½ rot u is φ = θ[1 − (16/3π)(r/a)³].
    """
    grid = Grid((count, count), (SIDE, SIDE))
    top, steps = 0.01, 40
    share = jnp.arange(1, steps + 1) / steps  # of the radius: equal rings
    zero = jnp.zeros((steps, 2))
    path = Pose(RADIUS**2 / CURVATURE * share**2, zero, top * share**3, zero, linear=True)
    solution = solve_path(INCOMPRESSIBLE, Rigid(), Paraboloid(CURVATURE), path, grid, 1e6)
    rotation = solution.at_step(-1).elastomer_rotation()

    r = np.hypot(*grid.points)
    rows = []
    for ratio in (0.2, 0.4, 0.6, 0.8):
        ring = np.abs(r - ratio * RADIUS) < 1.5 * grid.spacing[0]
        expected = 1.0 - 16.0 / (3.0 * np.pi) * float(np.mean(r[ring] ** 3)) / RADIUS**3
        value = float(jnp.mean(rotation[ring])) / top
        rows.append(
            Row(f"Pressed and twisted at once: φ/θ at r/a = {ratio}", value, expected,
                abs(value - expected), 5e-2,
                "steps of a fortieth of the radius, cells, rings of few of them")
        )  # fmt: skip
    return rows


def check_shift(count: int) -> list[Row]:
    """Cattaneo and Mindlin at ν = 0: the force at the shift of a given force."""
    elastomer, object_ = HalfSpace(1.0, 0.0), HalfSpace(1.0, 0.0)  # else pressing causes slip
    case = hertz_case(elastomer, object_)
    grid = Grid((count, count), (SIDE, SIDE))
    limit = FRICTION * float(case.hertz.force)
    softness = 2.0 * (elastomer.softness + object_.softness)
    rows = []
    for share in (0.3, 0.7):
        shift, _ = analytic.mindlin_shift(
            share * limit, FRICTION, case.hertz.force, RADIUS, softness
        )
        pose = Pose(RADIUS**2 / CURVATURE, shift=jnp.stack([shift, jnp.zeros(())]))
        solution = solve_contact(elastomer, object_, Paraboloid(CURVATURE), pose, grid, FRICTION)
        value = float(solution.force[0])
        rows.append(
            Row(f"Cattaneo–Mindlin, Q = {share} μP: Q [N]", value, share * limit,
                abs(value / limit - share), by_cell(5e-5, 2.0, count), "by μP; as Lubkin's")
        )  # fmt: skip
    return rows


def check_cylinder(count: int) -> list[Row]:
    """A long cylinder in its middle: peak pressure from the load per length."""
    grid = Grid((count, 2 * count), (4.0, 40.0))
    softness = 0.5 * (1.0 - INCOMPRESSIBLE.poisson_ratio) * INCOMPRESSIBLE.softness
    solution = solve_contact(  # it ends where the grid does, which `result` tells
        INCOMPRESSIBLE, Rigid(), Cylinder(CURVATURE), Pose(0.1), grid, FRICTION, throw=False
    )
    middle = solution.pressure[:, count]
    load = float(jnp.sum(middle)) * grid.spacing[0]
    expected = np.sqrt(load / (np.pi * CURVATURE * float(softness)))  # [Johnson1985] Eq. (4.45)
    return [
        _relative("Cylinder: peak pressure from its load per length [MPa]", jnp.max(middle),
                  expected, 5e-3, "length 10 times the width"),
    ]  # fmt: skip


def check_laws(count: int) -> list[Row]:
    """Complementarity, friction law and reciprocity, on a contact that sticks and slips."""
    solution = solve_hertz(count, twist=0.05, shift=(0.02, 0.01))
    slip = solution.slip_increment
    slipped = jnp.sqrt(jnp.sum(slip**2, axis=0))
    approach = float(solution.pose.approach)
    peak = float(jnp.max(solution.pressure))
    wrong = FRICTION * solution.pressure * slip - slipped * solution.traction
    wrong = jnp.where(solution.sliding, jnp.sqrt(jnp.sum(wrong**2, axis=0)), 0.0)
    stuck = jnp.where(solution.stick, slipped, 0.0)
    pressure, *traction = jax.random.normal(jax.random.key(0), (3, count, count))
    zero = jnp.zeros_like(pressure)
    pressed = _loaded(solution, pressure, jnp.stack([zero, zero]))
    sheared = _loaded(solution, zero, jnp.stack(traction))
    work = jnp.sum(jnp.stack(traction) * pressed.elastomer_displacement()[:2])
    other = jnp.sum(-pressure * sheared.elastomer_displacement()[2])
    why = "tolerance of the solver, 1e-9"
    return [
        _error("Overlap, by the approach", jnp.maximum(-jnp.min(solution.gap), 0.0) / approach,
               1e-7, why),
        _error("Pressure times gap, by peak and approach",
               jnp.max(solution.pressure * jnp.abs(solution.gap)) / peak / approach, 1e-7, why),
        _error("Slip where it sticks, by the largest slip",
               jnp.max(stuck) / jnp.max(slipped), 1e-6, why),
        _error("Where it slides: μp s − τ |s|, by μ times peak and the largest slip",
               jnp.max(wrong) / (FRICTION * peak * jnp.max(slipped)), 1e-6, why),
        _relative("Reciprocity: τ·u(p) = p·w(τ)", work, other, 1e-10, "rounding"),
    ]  # fmt: skip


def _loaded(solution: ContactSolution, pressure: Array, traction: Array) -> ContactSolution:
    """A solution under other tractions, of which only the displacement is asked."""
    return eqx.tree_at(lambda s: (s.pressure, s.traction), solution, (pressure, traction))


def check_equilibrium(count: int) -> list[Row]:
    """Force and moment from the displacement of both bodies far away, where only they are left.

    On a circle of radius ρ, the means of the displacement are F_x (2−ν)/4πGρ, that normal to the
    surface F_z (1−ν)/2πGρ, and along the circle M/4πGρ² ([Johnson1985] Sections 3.2 and 3.6).
    """
    solution = solve_hertz(count, twist=0.05, shift=(0.02, 0.01))
    far, angle = 100.0 * RADIUS, 2.0 * np.pi * np.arange(8) / 8
    away = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    expected = [*solution.force.tolist(), float(solution.moment)]
    bodies = (
        ("elastomer", ELASTOMER, 1.0, solution.elastomer_displacement_at(far * away)),
        ("object", OBJECT, -1.0, solution.object_displacement_at(far * away)),
    )
    rows = []
    for name, body, sign, moved in bodies:
        unit = sign * 4.0 * np.pi * float(body.shear_modulus) * far
        nu = float(body.poisson_ratio)
        x, y, z = np.mean(np.asarray(moved), axis=0)
        turn = np.mean(np.sum(np.asarray(moved)[:, :2] * along, axis=1))
        found = [unit * x / (2.0 - nu), unit * y / (2.0 - nu)]
        found += [0.5 * unit * z / (1.0 - nu), unit * far * turn]
        names = ("force along x [N]", "along y [N]", "along z [N]", "moment [N·mm]")
        rows += [
            _relative(
                f"Equilibrium of the {name}: {what}", value, exact, 1e-4, "(a/ρ)², a/ρ = 1/100"
            )
            for what, value, exact in zip(names, found, expected, strict=True)
        ]
    return rows


def check_frames(count: int) -> list[Row]:
    """The problem turned by 90° and moved by whole cells exactly, by 30° at the grid's order."""
    grid = Grid((count, count), (SIDE, SIDE))
    step = 2 * grid.spacing[0]
    face = SquarePunch(4.0, edge_radius=1.0)

    def moment(angle: float, place: tuple[float, float]) -> Float[Array, ""]:
        pose = Pose(0.1, twist=0.02, centre=place, linear=True)
        indenter = Placed(face, place, angle)
        return solve_contact(ELASTOMER, OBJECT, indenter, pose, grid, FRICTION, rtol=1e-9).moment

    here = moment(0.0, (0.0, 0.0))
    why = "tolerance of the solver, 1e-9"
    return [
        _relative("Turned by 90°: moment [N·mm]", moment(0.5 * np.pi, (0.0, 0.0)), here, 1e-7, why),
        _relative("Moved by two cells: moment [N·mm]", moment(0.0, (step, -step)), here, 1e-7, why),
        _relative("Turned by 30°: moment [N·mm]", moment(np.pi / 6, (0.0, 0.0)), here,
                  by_cell(5e-3, 2.0, count), "where the face cuts cells"),
    ]  # fmt: skip


def check_gradients(count: int) -> list[Row]:
    """dM/dθ = (16/3) G* c³, and derivatives against central differences."""
    case = hertz_case()
    kappa = 0.7
    twist = analytic.lubkin_twist(kappa, case.friction_ratio)
    slope = jax.grad(lambda t: solve_hertz(count, twist=t).moment)(twist)
    exact = 16.0 / 3.0 * case.shear_modulus * (kappa * RADIUS) ** 3
    grid = Grid((count, count), (SIDE, SIDE))

    @jax.jit
    def moment(values: Float[Array, "5"]) -> Float[Array, ""]:
        modulus, nu, curvature, mu, approach = values
        pose = Pose(approach, twist=twist, shift=(0.01, 0.02))
        bodies = HalfSpace(modulus, nu), OBJECT
        return solve_contact(*bodies, Paraboloid(curvature), pose, grid, mu, rtol=1e-11).moment

    values = jnp.asarray([1.0, 0.45, CURVATURE, FRICTION, RADIUS**2 / CURVATURE])
    gradient = jax.grad(moment)(values)
    rows = [
        _relative(
            "dM/dθ = (16/3) G* c³ [N·mm]",
            slope,
            exact,
            by_cell(1e-2, 1.0, count),
            "cells of the stick region counted whole",
        )
    ]
    for i, name in enumerate(("G_S", "ν_S", "R", "μ", "δ")):
        change = jnp.zeros(5).at[i].set(1e-6 * values[i])
        difference = (moment(values + change) - moment(values - change)) / (2.0 * change[i])
        rows.append(
            _relative(f"dM/d{name} against a central difference", gradient[i], difference, 3e-5,
                      "cells that change state in between")
        )  # fmt: skip
    return rows


CHECKS: tuple[Callable[[int], list[Row]], ...] = (
    check_hertz,
    check_punch,
    check_torsion,
    check_loop,
    check_history,
    check_shift,
    check_cylinder,
    check_laws,
    check_equilibrium,
    check_frames,
    check_gradients,
)


def convergence(counts: tuple[int, ...] = (32, 64, 128, 256)) -> list[Row]:
    """Orders at which the errors of the Hertz contact under torsion fall with the cell.

    The slope of log error over log cell, by least squares.
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
            _l2(solution.pressure, pressure),
            _l2(size, traction),
            abs(float(solution.moment) - case.moment(0.7)) / case.limit,
        ])  # fmt: skip
    slopes = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    names = ("peak pressure", "force", "pressure, L2", "traction at c/a = 0.7, L2", "moment")
    expected = (2.0, 1.5, 1.0, 1.0, 1.5)
    return [
        Row(f"Order of convergence: {name}", slope, order, order - slope, 0.5, "no less")
        for name, slope, order in zip(names, slopes.tolist(), expected, strict=True)
    ]


def _relative(what: str, value, expected, tolerance: float, because: str) -> Row:
    value, expected = float(value), float(expected)
    return Row(what, value, expected, abs(value / expected - 1.0), tolerance, because)


def _error(what: str, error, tolerance: float, because: str) -> Row:
    return Row(what, float(error), 0.0, float(error), tolerance, because)


def _l2(field: Array, exact: AnyArray) -> float:
    return float(jnp.linalg.norm(field - exact) / jnp.linalg.norm(exact))
