"""Rows of `verify` beyond two uncoupled half-spaces: layers, depth, coupling, given moments.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Section 3.2 and 5.8 (an elastic foundation).
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.integrate import quad

from contactmodel.bodies import HalfSpace, Layer, Rigid
from contactmodel.grid import Grid
from contactmodel.indenters import Paraboloid, RoundPunch
from contactmodel.pose import Pose, make_path
from contactmodel.resultants import solve_resultant
from contactmodel.solve import solve_contact, solve_path
from contactmodel.transfer import base_transfer
from contactmodel.verify import CURVATURE, FRICTION, RADIUS, SIDE, Row, by_cell

APPROACH = RADIUS**2 / CURVATURE
BALL = Paraboloid(CURVATURE)
SOFT, OTHER = HalfSpace(1.0, 0.3), HalfSpace(2.0, 0.45)


def check_thick_layer(count: int) -> list[Row]:
    """The first term in a/h: a force sinks less by the same everywhere, P ∫δ_z dx / 2πGh."""
    grid, nu = Grid((count, count), (SIDE, SIDE)), 0.45

    def force(body: HalfSpace | Layer, approach: float) -> float:
        solution = solve_contact(body, Rigid(), BALL, Pose(approach), grid, 0.0, rtol=1e-11)
        return float(-solution.force[2])

    half = HalfSpace(1.0, nu)
    integral, _ = quad(lambda x: float(base_transfer(np.asarray(x), nu, 0.0).normal), 0.0, 30.0)
    rows = []
    for ratio in (100.0, 1000.0):
        h = ratio * RADIUS
        value = force(Layer(1.0, nu, h), APPROACH)
        sunk = -value * integral / (2.0 * np.pi * h)
        before = force(half, APPROACH)
        expected = force(half, APPROACH + sunk) - before
        error = abs((value - before) / expected - 1.0)
        rows.append(
            Row(f"Thick layer, h/a = {ratio:g}: force beyond the half-space's [N]", value - before,
                expected, error, 10.0 / ratio**2, "next term, (a/h)²")
        )  # fmt: skip
    return rows


def check_thin_layer(count: int) -> list[Row]:
    """A compressible layer thinner than the contact is a foundation: p = 2(1−ν)G w/(1−2ν)h."""
    nu, h, approach = 0.3, 0.16, 0.05
    grid = Grid((count, count), (SIDE, SIDE))
    solution = solve_contact(Layer(1.0, nu, h), Rigid(), BALL, Pose(approach), grid, 0.0)
    value = float(jnp.max(solution.pressure))
    expected = 2.0 * (1.0 - nu) * approach / ((1.0 - 2.0 * nu) * h)
    return [
        Row("Thin layer, h/a = 0.09: peak pressure [MPa]", value, expected,
            abs(value / expected - 1.0), 2e-2, "(h/a)²")
    ]  # fmt: skip


def check_depth(count: int) -> list[Row]:
    """Below a half-space's surface: on the axis of Hertz's pressure, and of a disc that sticks."""
    grid, body = Grid((count, count), (SIDE, SIDE)), HalfSpace(1.0, 0.5)
    pressed = solve_contact(body, Rigid(), BALL, Pose(APPROACH), grid, 0.0)
    pose = Pose(0.1, twist=0.01, linear=True)
    glued = solve_contact(body, Rigid(), RoundPunch(RADIUS), pose, grid, 1e6)
    peak = 8.0 / np.pi * RADIUS / CURVATURE  # (2/π) E* a/R, E* = 2G/(1−ν) = 4
    near = 1e-3 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    rows = []
    for ratio in (0.1, 0.5):
        z = ratio * RADIUS

        def sinking(r: float, z: float = z) -> float:  # [Johnson1985] Eq. (3.19), ν = ½, G = 1
            length = np.hypot(r, z)
            pressure = peak * np.sqrt(1.0 - (r / RADIUS) ** 2)
            return 0.5 * r * pressure * (z**2 / length**3 + 1.0 / length)

        expected, _ = quad(sinking, 0.0, RADIUS)
        value = float(-pressed.elastomer_displacement_at(np.zeros((1, 2)), z)[0, 2])
        rows.append(
            Row(f"Hertz, z/a = {ratio}: displacement on the axis [mm]", value, expected,
                abs(value / expected - 1.0), by_cell(2e-4, 2.0, count), "second order")
        )  # fmt: skip
        u = np.asarray(glued.elastomer_displacement_at(near, z))
        value = 250.0 * float((u[0, 1] - u[1, 1]) - (u[2, 0] - u[3, 0])) / 0.01
        expected = 2.0 / np.pi * (np.arctan(1.0 / ratio) - ratio / (1.0 + ratio**2))
        rows.append(
            Row(f"Disc that sticks, z/a = {ratio}: φ/θ on the axis", value, expected,
                abs(value - expected), by_cell(1e-2, 1.0, count), "singular edge")
        )  # fmt: skip
    return rows


def check_coupling(count: int) -> list[Row]:
    """Dissimilar bodies: swapped, and the balance of energy along a path."""
    grid = Grid((count, count), (SIDE, SIDE))
    rest, pressed = Pose(0.0, linear=True), Pose(APPROACH, linear=True)
    turned = Pose(APPROACH, (0.03, 0.0), 0.04, linear=True)
    back = Pose(APPROACH, (-0.03, 0.0), -0.04, linear=True)
    one = solve_contact(SOFT, OTHER, BALL, turned, grid, FRICTION)
    other = solve_contact(OTHER, SOFT, BALL, back, grid, FRICTION)
    swapped = float(jnp.max(jnp.abs(one.traction + other.traction)) / jnp.max(one.pressure))

    path = make_path([rest, pressed, turned], [8, 8])
    contacts = solve_path(SOFT, OTHER, BALL, path, grid, FRICTION)
    force, moment = np.asarray(contacts.force), np.asarray(contacts.moment)
    effort = np.column_stack([-force[:, 2], force[:, :2], moment])
    motion = np.column_stack([path.approach, path.shift, path.twist])
    effort, motion = (np.vstack([np.zeros((1, 4)), part]) for part in (effort, motion))
    work = float(np.sum(0.5 * (effort[1:] + effort[:-1]) * np.diff(motion, axis=0)))
    last = contacts.at_step(-1)
    s, b = last.elastomer_displacement(), last.object_displacement()
    density = last.pressure * (b[2] - s[2]) + jnp.sum(last.traction * (s - b)[:2], axis=0)
    kept = 0.5 * float(jnp.sum(density)) * grid.cell_area + float(last.dissipated_energy)
    return [
        Row("Dissimilar bodies swapped: traction, by the peak pressure", swapped, 0.0, swapped,
            1e-7, "tolerance of the solver, 1e-8"),
        Row("Energy stored and dissipated, against work [N·mm]", kept, work,
            abs(kept / work - 1.0), 5e-3, "16 steps, second order"),
    ]  # fmt: skip


def check_resultant(count: int) -> list[Row]:
    """A given force and moment reproduce their motion."""
    grid = Grid((count // 2, count // 2), (SIDE, SIDE))
    pose = Pose(APPROACH, (0.02, 0.0), 0.03)
    moved = solve_contact(SOFT, OTHER, BALL, pose, grid, FRICTION)
    found = solve_resultant(
        SOFT, OTHER, BALL, Pose(0.8 * APPROACH), grid, FRICTION,
        normal_force=-moved.force[2], shear_force=moved.force[:2], moment=moved.moment,
    )  # fmt: skip
    twist = float(found.pose.twist)
    return [
        Row("Given force and moment: twist [rad]", twist, 0.03, abs(twist / 0.03 - 1.0), 1e-5,
            "tolerance of the resultants, 1e-7")
    ]  # fmt: skip


LAYER_CHECKS: tuple[Callable[[int], list[Row]], ...] = (
    check_thick_layer,
    check_thin_layer,
    check_depth,
    check_coupling,
    check_resultant,
)
