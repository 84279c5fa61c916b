"""Laws of contact, friction, equilibrium and energy; equivalent contacts; derivatives.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.2 and 3.6.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel import analytic
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace
from contactmodel.grid import Grid
from contactmodel.indenters import Paraboloid, Placed, SquarePunch
from contactmodel.pose import Pose, Resultants, make_path
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact, solve_path
from contactmodel.verify.rows import (
    APPROACH,
    BALL,
    CURVATURE,
    ELASTOMER,
    FRICTION,
    OBJECT,
    RADIUS,
    SIDE,
    Row,
    by_cell,
    error,
    hertz_case,
    relative,
    solve_hertz,
)

SOFT, OTHER = HalfSpace(1.0, 0.3), HalfSpace(2.0, 0.45)


def check_laws(count: int) -> list[Row]:
    """Complementarity, friction law and reciprocity, for a contact in partial slip."""
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
    reciprocal = jnp.sum(-pressure * sheared.elastomer_displacement()[2])
    why = "tolerance of the solver, 1e-9"
    return [
        error("Overlap over the approach", jnp.maximum(-jnp.min(solution.gap), 0.0) / approach,
               1e-7, why),
        error("Pressure times gap, over peak pressure and approach",
               jnp.max(solution.pressure * jnp.abs(solution.gap)) / peak / approach, 1e-7, why),
        error("Slip of sticking cells over the largest slip",
               jnp.max(stuck) / jnp.max(slipped), 1e-6, why),
        error("Sliding cells: μp s − τ |s|, over μ, peak pressure and largest slip",
               jnp.max(wrong) / (FRICTION * peak * jnp.max(slipped)), 1e-6, why),
        relative("Reciprocity: τ·u(p) = p·w(τ)", work, reciprocal, 1e-10, "rounding"),
    ]  # fmt: skip


def _loaded(solution: ContactSolution, pressure: Array, traction: Array) -> ContactSolution:
    """The solution with other tractions; only its displacement is meaningful."""
    return eqx.tree_at(lambda s: (s.pressure, s.traction), solution, (pressure, traction))


def check_equilibrium(count: int) -> list[Row]:
    """Force and moment from the displacement of both bodies far away, which only they determine.

    On a circle of radius ρ, the mean displacement along x is F_x (2−ν)/4πGρ, normal to the surface
    F_z (1−ν)/2πGρ, and along the circle M/4πGρ² ([Johnson1985] Sections 3.2 and 3.6).
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
        loads = [unit * x / (2.0 - nu), unit * y / (2.0 - nu)]
        loads += [0.5 * unit * z / (1.0 - nu), unit * far * turn]
        names = ("force along x [N]", "along y [N]", "along z [N]", "moment [N·mm]")
        rows += [
            relative(
                f"Equilibrium of the {name}: {what}", value, exact, 1e-4, "(a/ρ)², a/ρ = 1/100"
            )
            for what, value, exact in zip(names, loads, expected, strict=True)
        ]
    return rows


def check_coupling(count: int) -> list[Row]:
    """Dissimilar bodies: swapped bodies, and the energy balance along a path."""
    grid = Grid((count, count), (SIDE, SIDE))
    rest, pressed = Pose(0.0, linear=True), Pose(APPROACH, linear=True)
    turned = Pose(APPROACH, (0.03, 0.0), 0.04, linear=True)
    back = Pose(APPROACH, (-0.03, 0.0), -0.04, linear=True)
    first = solve_contact(Contact(SOFT, OTHER, BALL, grid, FRICTION), turned)
    second = solve_contact(Contact(OTHER, SOFT, BALL, grid, FRICTION), back)
    swapped = float(jnp.max(jnp.abs(first.traction + second.traction)) / jnp.max(first.pressure))

    path = make_path([rest, pressed, turned], [8, 8])
    contacts = solve_path(Contact(SOFT, OTHER, BALL, grid, FRICTION), path)
    force, moment = np.asarray(contacts.force), np.asarray(contacts.moment)
    effort = np.column_stack([-force[:, 2], force[:, :2], moment])
    motion = np.column_stack([path.approach, path.shift, path.twist])
    effort, motion = (np.vstack([np.zeros((1, 4)), part]) for part in (effort, motion))
    work = float(np.sum(0.5 * (effort[1:] + effort[:-1]) * np.diff(motion, axis=0)))
    last = contacts.at_step(-1)
    s, b = last.elastomer_displacement(), last.object_displacement()
    density = last.pressure * (b[2] - s[2]) + jnp.sum(last.traction * (s - b)[:2], axis=0)
    energy = 0.5 * float(jnp.sum(density)) * grid.cell_area + float(last.dissipated_energy)
    return [
        Row("Dissimilar bodies swapped: traction over peak pressure", swapped, 0.0, swapped,
            1e-7, "tolerance of the solver, 1e-8"),
        Row("Stored and dissipated energy against work [N·mm]", energy, work,
            abs(energy / work - 1.0), 5e-3, "16 steps, second order"),
    ]  # fmt: skip


def check_resultant(count: int) -> list[Row]:
    """Given force and moment reproduce the motion that produced them."""
    grid = Grid((count // 2, count // 2), (SIDE, SIDE))
    pose = Pose(APPROACH, (0.02, 0.0), 0.03)
    contact = Contact(SOFT, OTHER, BALL, grid, FRICTION)
    moved = solve_contact(contact, pose)
    resultants = Resultants(-moved.force[2], moved.force[:2], moved.moment)
    solution = solve_contact(contact, Pose(0.8 * APPROACH), resultants)
    twist = float(solution.pose.twist)
    return [
        Row("Given force and moment: twist [rad]", twist, 0.03, abs(twist / 0.03 - 1.0), 1e-5,
            "tolerance of the resultants, 1e-7")
    ]  # fmt: skip


def check_frames(count: int) -> list[Row]:
    """The problem turned by 90° and moved by whole cells (exact), and by 30° (grid's order)."""
    grid = Grid((count, count), (SIDE, SIDE))
    step = 2 * grid.spacing[0]
    face = SquarePunch(4.0, edge_radius=1.0)

    def moment(angle: float, place: tuple[float, float]) -> Float[Array, ""]:
        pose = Pose(0.1, twist=0.02, centre=place, linear=True)
        indenter = Placed(face, place, angle)
        return solve_contact(
            Contact(ELASTOMER, OBJECT, indenter, grid, FRICTION), pose, rtol=1e-9
        ).moment

    here = moment(0.0, (0.0, 0.0))
    why = "tolerance of the solver, 1e-9"
    return [
        relative("Turned by 90°: moment [N·mm]", moment(0.5 * np.pi, (0.0, 0.0)), here, 1e-7, why),
        relative("Moved by two cells: moment [N·mm]", moment(0.0, (step, -step)), here, 1e-7, why),
        relative("Turned by 30°: moment [N·mm]", moment(np.pi / 6, (0.0, 0.0)), here,
                  by_cell(5e-3, 2.0, count), "cells cut by the face"),
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
        return solve_contact(
            Contact(*bodies, Paraboloid(curvature), grid, mu), pose, rtol=1e-11
        ).moment

    values = jnp.asarray([1.0, 0.45, CURVATURE, FRICTION, APPROACH])
    gradient = jax.grad(moment)(values)
    rows = [
        relative(
            "dM/dθ = (16/3) G* c³ [N·mm]",
            slope,
            exact,
            by_cell(1e-2, 1.0, count),
            "stick region counted in whole cells",
        )
    ]
    for i, name in enumerate(("G_S", "ν_S", "R", "μ", "δ")):
        change = jnp.zeros(5).at[i].set(1e-6 * values[i])
        difference = (moment(values + change) - moment(values - change)) / (2.0 * change[i])
        rows.append(
            relative(f"dM/d{name} against a central difference", gradient[i], difference, 3e-5,
                      "cells that change state within the difference")
        )  # fmt: skip
    return rows
