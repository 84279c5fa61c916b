"""Soft balls on gels at finite strain: the motion of the gels' surfaces.

`balls.npz` has it. `python -m papers.finite_strain.balls` solves the grasps again with the finite
elements of `two_bodies` (extra `finite-elements`), in about half an hour of processor time. Each
grasp of an object is pressed to its own depth and twisted to 20°.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.steps import Motion
from papers.finite_strain.surface import Surface, read_surface, surface_arrays, write_arrays
from papers.finite_strain.two_bodies import Ball, cut_ball, hold

FILE = Path(__file__).with_name("data") / "balls.npz"

PRESSES = 8
"""Steps in which a ball is pressed on."""

TURNS_DEG = (*range(1, 11), *range(12, 21, 2))
"""Angles of the grip after pressing [deg]."""

SEEN_MM = 16.0
"""Radius of the stored part of the surface [mm]."""


class Object(NamedTuple):
    """A soft ball, the gel that it is pressed on, and its grasps.

    The ball's body is a cone beyond half of its radius, as wide and as high as twice its radius.

    Attributes:
        radius_mm: R [mm].
        ratio: k, shear modulus of the gel over the ball's [-].
        depths_mm: approach of the grip in each grasp, the smallest first [mm].
        thickness_mm: h of the gel [mm].
        poisson_ratio: ν of the ball [-].
        friction: μ [-].
    """

    radius_mm: float
    ratio: float
    depths_mm: tuple[float, ...]
    thickness_mm: float = 8.0
    poisson_ratio: float = 0.48
    friction: float = 1.0


OBJECTS = {
    "flat": Object(40.0, 0.5, (0.3, 0.7), thickness_mm=4.0),
    "hard": Object(20.0, 0.2, (0.35, 1.2)),
    "middle": Object(20.0, 0.5, (0.4, 0.8, 1.4)),
    "soft": Object(20.0, 1.0, (0.5, 1.6), friction=0.7),
    "foam": Object(20.0, 0.5, (0.5, 1.4), poisson_ratio=0.25),
    "round, thin gel": Object(12.0, 0.5, (0.6, 1.2), thickness_mm=4.0),
    "round": Object(12.0, 1.0, (0.7, 1.6)),
}
"""Objects by name."""


class Grasp(NamedTuple):
    """A solved grasp.

    Attributes:
        contact_mm: radius of the contact when pressed [mm].
        surface: motion of the gel's top.
    """

    contact_mm: float
    surface: Surface


@cache
def read_grasps() -> dict[str, list[Grasp]]:
    """The stored grasps of each object."""
    with np.load(FILE) as stored:
        return {
            name: [
                Grasp(float(stored[f"{name}/{i}/contact_mm"]), read_surface(stored, f"{name}/{i}"))
                for i in range(len(one.depths_mm))
            ]
            for name, one in OBJECTS.items()
        }


def solve_grasp(one: Object, depth: float, coarse: float = 1.0) -> Grasp:
    """Solve a grasp.

    Args:
        one: the object.
        depth: approach of the grip [mm].
        coarse: factor of the elements' sizes [-].
    """
    gel = Gel(one.thickness_mm, 30.0, SHEAR_MODULUS)
    radius, size = one.radius_mm, 2.0 * one.radius_mm
    modulus = SHEAR_MODULUS / one.ratio
    ball = Ball(radius, 0.5 * radius, size, size, modulus, one.poisson_ratio)
    touching = np.sqrt(radius * depth)
    mesh = coarse * 0.055 * touching, 1.3 * touching + 0.3, 1.2
    path = [Motion(depth * (i + 1) / PRESSES, 0.0) for i in range(PRESSES)]
    path += [Motion(depth, float(np.radians(angle))) for angle in TURNS_DEG]
    bodies = (gel, cut(gel, *mesh)), (ball, cut_ball(ball, *mesh))
    solved = hold(*bodies, one.friction, path, rtol=1e-6).gel
    seen, steps = solved.radius < SEEN_MM, slice(PRESSES - 1, None)
    twist = np.array([motion.twist for motion in path])
    return Grasp(
        float(solved.radius[solved.contact[PRESSES - 1]].max()),
        Surface(
            solved.radius[seen],
            solved.moved[steps][:, seen],
            twist[steps],
            solved.stick[steps][:, seen],
        ),
    )


def write_grasps(grasps: Mapping[str, Sequence[Grasp]]) -> None:
    """Write the grasps of each object to the stored file.

    Args:
        grasps: grasps by name of the object.
    """
    arrays: dict[str, np.ndarray] = {}
    for name, solved in grasps.items():
        for i, grasp in enumerate(solved):
            arrays[f"{name}/{i}/contact_mm"] = np.array(grasp.contact_mm)
            arrays |= surface_arrays(grasp.surface, f"{name}/{i}")
    write_arrays(FILE, arrays)


def main() -> None:
    """Solve the grasps, and write them to the stored file."""
    grasps: dict[str, list[Grasp]] = {name: [] for name in OBJECTS}
    for name, one in OBJECTS.items():
        for depth in one.depths_mm:
            grasps[name].append(solve_grasp(one, depth))
            print(f"{name}, {depth:g} mm: contact radius {grasps[name][-1].contact_mm:.2f} mm")
    write_grasps(grasps)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
