"""Two half-spaces without coupling, against closed forms.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.4, 3.8 and 4.2. The other closed forms
are those of `contactmodel.analytic`.
"""

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from contactmodel import analytic
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace, Rigid
from contactmodel.grid import Grid
from contactmodel.indenters import Cylinder, RoundPunch
from contactmodel.pose import Pose, make_path
from contactmodel.solve import solve_contact, solve_path
from contactmodel.verify.rows import (
    APPROACH,
    BALL,
    CURVATURE,
    ELASTOMER,
    FRICTION,
    INCOMPRESSIBLE,
    OBJECT,
    RADIUS,
    SIDE,
    Row,
    by_cell,
    error,
    hertz_case,
    l2_error,
    relative,
    solve_hertz,
)


def check_hertz(count: int) -> list[Row]:
    """Peak pressure, radius, force and pressure field."""
    case, solution = hertz_case(), solve_hertz(count)
    grid = solution.grid
    r = np.hypot(*grid.points)
    exact = analytic.hertz_pressure(r, RADIUS, case.hertz.peak_pressure)
    area = float(jnp.sum(solution.contact)) * grid.cell_area
    return [
        relative("Hertz: peak pressure [MPa]", jnp.max(solution.pressure),
                  case.hertz.peak_pressure, by_cell(2e-4, 2.0, count), "second order"),
        relative("Hertz: contact radius [mm]", np.sqrt(area / np.pi), RADIUS,
                  by_cell(6e-3, 1.0, count), "area counted in whole cells"),
        relative("Hertz: force [N]", -solution.force[2], case.hertz.force,
                  by_cell(5e-5, 2.0, count), "second order"),
        error("Hertz: pressure, relative L2 error", l2_error(solution.pressure, exact),
               by_cell(7e-3, 1.0, count), "vertical tangent at the rim"),
    ]  # fmt: skip


def check_punch(count: int) -> list[Row]:
    """Flat punch: force, and Reissner and Sagoci's moment under full stick."""
    grid = Grid((count, count), (SIDE, SIDE))
    case, twist, approach = hertz_case(), 0.01, 0.1
    pose = Pose(approach, twist=twist, linear=True)
    solution = solve_contact(Contact(ELASTOMER, OBJECT, RoundPunch(RADIUS), grid, 1e6), pose)
    softness = sum(0.5 * (1.0 - b.poisson_ratio) * b.softness for b in (ELASTOMER, OBJECT))
    force = 2.0 * RADIUS * approach / softness  # [Johnson1985] Eq. (3.36)
    moment = analytic.reissner_sagoci_moment(twist, RADIUS, case.shear_modulus)
    why = "singular edge, first order in the cell"
    return [
        relative("Flat punch: force [N]", -solution.force[2], force,
                  by_cell(7e-3, 1.0, count), why),
        relative("Reissner–Sagoci: moment [N·mm]", solution.moment, moment,
                  by_cell(1.7e-2, 1.0, count), why),
        error("Flat punch, μ = 1e6: sliding fraction",
               1.0 - solution.stick_ratio, 0.0, "exact"),
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
                "error over μPa; second order, with noise from cells cut by the rim"),
            error(f"Lubkin, c/a = {kappa}: traction, relative L2 error", l2_error(size, exact),
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
    turns = [Pose(APPROACH, twist=t, linear=True) for t in (0.0, top, -top, top)]
    path = make_path(turns, [1, 2, 2])
    solution = solve_path(Contact(ELASTOMER, OBJECT, BALL, grid, FRICTION), path)
    twists = np.asarray(path.twist)
    expected = [
        float(analytic.masing(virgin, opened, twist))
        for opened, twist in zip(analytic.open_turns(twists.tolist()), twists, strict=True)
    ]
    places = ("first loading", "unloaded to 0", "fully reversed", "reloaded to 0", "loop closed")
    rows = [
        Row(f"Masing, {place}: moment [N·mm]", float(value), exact,
            abs(float(value) - exact) / case.limit, by_cell(5e-5, 2.0, count),
            "error over μPa; as for Lubkin")
        for place, value, exact in zip(places, solution.moment, expected, strict=True)
    ]  # fmt: skip
    loss = np.diff(np.asarray(solution.dissipated_energy), prepend=0.0)
    name = "Loop: negative dissipation in a step"
    return [*rows, error(name, max(-loss.min(), 0.0), 0.0, "exact law")]


def check_history(count: int) -> list[Row]:
    """Pressed and twisted at once (θ ∝ P) without slip: a point turns only after first touch.

    Each step adds a punch with the present radius s of the contact, dθ = 3θ s²/a³ ds. The sum of
    the rotations ½ rot u is φ = θ[1 − (16/3π)(r/a)³].
    """
    grid = Grid((count, count), (SIDE, SIDE))
    top, steps = 0.01, 40
    share = jnp.arange(1, steps + 1) / steps  # of the radius: equal rings
    zero = jnp.zeros((steps, 2))
    path = Pose(APPROACH * share**2, zero, top * share**3, zero, linear=True)
    solution = solve_path(Contact(INCOMPRESSIBLE, Rigid(), BALL, grid, 1e6), path)
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
                "40 steps of the radius, size of the cells, few cells per ring")
        )  # fmt: skip
    return rows


def check_shift(count: int) -> list[Row]:
    """Cattaneo and Mindlin at ν = 0: the force at the shift that belongs to it."""
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
        pose = Pose(APPROACH, shift=jnp.stack([shift, jnp.zeros(())]))
        solution = solve_contact(Contact(elastomer, object_, BALL, grid, FRICTION), pose)
        value = float(solution.force[0])
        rows.append(
            Row(f"Cattaneo–Mindlin, Q = {share} μP: Q [N]", value, share * limit,
                abs(value / limit - share), by_cell(5e-5, 2.0, count),
                "error over μP; as for Lubkin")
        )  # fmt: skip
    return rows


def check_cylinder(count: int) -> list[Row]:
    """Middle of a long cylinder: peak pressure from the load per length."""
    grid = Grid((count, 2 * count), (4.0, 40.0))
    softness = 0.5 * (1.0 - INCOMPRESSIBLE.poisson_ratio) * INCOMPRESSIBLE.softness
    solution = solve_contact(
        Contact(INCOMPRESSIBLE, Rigid(), Cylinder(CURVATURE), grid, FRICTION),
        Pose(0.1),
        throw=False,
    )
    middle = solution.pressure[:, count]
    load = float(jnp.sum(middle)) * grid.spacing[0]
    expected = np.sqrt(load / (np.pi * CURVATURE * float(softness)))  # [Johnson1985] Eq. (4.45)
    return [
        relative("Cylinder: peak pressure from its load per length [MPa]", jnp.max(middle),
                  expected, 5e-3, "length 10 times the width"),
    ]  # fmt: skip
