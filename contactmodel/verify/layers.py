"""Rows of `verify` for layers, and for points below the surface.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Section 3.2 and 5.8 (an elastic foundation).
"""

import jax.numpy as jnp
import numpy as np
from scipy.integrate import quad

from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace, Layer, Rigid
from contactmodel.elasticity.transfer import base_transfer
from contactmodel.grid import Grid
from contactmodel.indenters import RoundPunch
from contactmodel.pose import Pose
from contactmodel.solve import solve_contact
from contactmodel.verify.rows import APPROACH, BALL, CURVATURE, RADIUS, SIDE, Row, by_cell


def check_thick_layer(count: int) -> list[Row]:
    """The first term in a/h: the base reduces the displacement uniformly by P ∫δ_z dx / 2πGh."""
    grid, nu = Grid((count, count), (SIDE, SIDE)), 0.45

    def force(body: HalfSpace | Layer, approach: float) -> float:
        solution = solve_contact(
            Contact(body, Rigid(), BALL, grid, 0.0), Pose(approach), rtol=1e-11
        )
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
    """A compressible layer that is thin relative to the contact: p = 2(1−ν)G w/(1−2ν)h."""
    nu, h, approach = 0.3, 0.16, 0.05
    grid = Grid((count, count), (SIDE, SIDE))
    solution = solve_contact(Contact(Layer(1.0, nu, h), Rigid(), BALL, grid, 0.0), Pose(approach))
    value = float(jnp.max(solution.pressure))
    expected = 2.0 * (1.0 - nu) * approach / ((1.0 - 2.0 * nu) * h)
    return [
        Row("Thin layer, h/a = 0.09: peak pressure [MPa]", value, expected,
            abs(value / expected - 1.0), 2e-2, "(h/a)²")
    ]  # fmt: skip


def check_depth(count: int) -> list[Row]:
    """Points below a half-space's surface, on the axis of a Hertz contact and a sticking disc."""
    grid, body = Grid((count, count), (SIDE, SIDE)), HalfSpace(1.0, 0.5)
    pressed = solve_contact(Contact(body, Rigid(), BALL, grid, 0.0), Pose(APPROACH))
    pose = Pose(0.1, twist=0.01, linear=True)
    glued = solve_contact(Contact(body, Rigid(), RoundPunch(RADIUS), grid, 1e6), pose)
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
            Row(f"Sticking disc, z/a = {ratio}: φ/θ on the axis", value, expected,
                abs(value - expected), by_cell(1e-2, 1.0, count), "singular edge")
        )  # fmt: skip
    return rows
