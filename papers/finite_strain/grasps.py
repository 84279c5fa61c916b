"""Soft objects on gels at finite strain: the motion of the gels' surfaces.

`balls.npz` and `shapes.npz` have it. `python -m papers.finite_strain.grasps` solves the grasps
again with the finite elements of `two_bodies` (extra `finite-elements`), in about half an hour of
processor time; `shapes` behind it solves only those of cylinders and plates. Each grasp of an
object is pressed to its own depth and twisted to 20°.
"""

import sys
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

FILES = {name: Path(__file__).with_name("data") / f"{name}.npz" for name in ("balls", "shapes")}
"""Stored grasps of balls, and of cylinders and plates."""

PRESSES = 8
"""Steps in which a ball is pressed on."""

TURNS_DEG = (*range(1, 11), *range(12, 21, 2))
"""Angles of the grip after pressing [deg]."""

SEEN_MM = 16.0
"""Radius of the stored part of the surface [mm]."""


class Object(NamedTuple):
    """A soft object of revolution, the gel that it is pressed on, and its grasps.

    A ball's body is a cone beyond half of its radius, as wide and as high as twice its radius.

    Attributes:
        radius_mm: R of the tip, or of the edge around its flat face [mm].
        ratio: k, shear modulus of the gel over the object's [-].
        depths_mm: approach of the grip in each grasp, the smallest first [mm].
        thickness_mm: h of the gel [mm].
        poisson_ratio: ν of the object [-].
        friction: μ [-].
        side_mm: radius of the side; twice R if not given [mm].
        height_mm: height from the tip to the grip; twice R if not given [mm].
        flat: whether the face is flat up to the edge.
        held_out: whether the correction was chosen without this object in view.
    """

    radius_mm: float
    ratio: float
    depths_mm: tuple[float, ...]
    thickness_mm: float = 8.0
    poisson_ratio: float = 0.48
    friction: float = 1.0
    side_mm: float | None = None
    height_mm: float | None = None
    flat: bool = False
    held_out: bool = False

    @property
    def body(self) -> Ball:
        """The body of revolution."""
        radius, cone = self.radius_mm, (0.8 if self.flat else 0.5) * self.radius_mm
        side, height = self.side_mm or 2.0 * radius, self.height_mm or 2.0 * radius
        flat = side - radius if self.flat else 0.0
        modulus = SHEAR_MODULUS / self.ratio
        return Ball(radius, cone, side, height, modulus, self.poisson_ratio, flat=flat)


BALLS = {
    "flat": Object(40.0, 0.5, (0.3, 0.7), thickness_mm=4.0),
    "hard": Object(20.0, 0.2, (0.35, 1.2)),
    "middle": Object(20.0, 0.5, (0.4, 0.8, 1.4)),
    "soft": Object(20.0, 1.0, (0.5, 1.6), friction=0.7),
    "foam": Object(20.0, 0.5, (0.5, 1.4), poisson_ratio=0.25),
    "round, thin gel": Object(12.0, 0.5, (0.6, 1.2), thickness_mm=4.0),
    "round": Object(12.0, 1.0, (0.7, 1.6)),
}
"""Balls by name."""

_FACE = Object(1.5, 0.5, (0.25, 0.6), side_mm=5.0, height_mm=5.0, flat=True)
_HELD = _FACE._replace(held_out=True)

SHAPES = {
    "short cylinder": _FACE,
    "long cylinder": _FACE._replace(ratio=0.2, height_mm=15.0),
    "disc, thin gel": _FACE._replace(
        ratio=1.0, height_mm=2.5, thickness_mm=4.0, depths_mm=(0.2, 0.4)
    ),
    "plate": Object(20.0, 0.5, (0.4, 1.0), side_mm=24.0, height_mm=4.0),
    "slim cylinder, thin gel": _HELD._replace(
        side_mm=4.0, height_mm=8.0, thickness_mm=4.0, depths_mm=(0.4,)
    ),
    "stout cylinder": _HELD._replace(ratio=1.0, side_mm=6.0, height_mm=6.0),
    "soft rod": _HELD._replace(ratio=1.0, height_mm=15.0, depths_mm=(0.6,)),
    "hard disc": _HELD._replace(ratio=0.2, side_mm=6.0, height_mm=3.0),
    "foam cylinder": _HELD._replace(height_mm=10.0, poisson_ratio=0.25),
    "domed cylinder": Object(20.0, 0.5, (0.4, 1.0), side_mm=8.0, height_mm=8.0, held_out=True),
    "soft plate, thin gel": Object(
        30.0, 1.0, (0.3, 0.6), thickness_mm=4.0, side_mm=24.0, height_mm=2.5, held_out=True
    ),
}
"""Cylinders and plates by name."""

OBJECTS = BALLS | SHAPES
"""All objects by name."""


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
    grasps = {}
    for file, objects in (("balls", BALLS), ("shapes", SHAPES)):
        with np.load(FILES[file]) as stored:
            for name, one in objects.items():
                places = [f"{name}/{i}" for i in range(len(one.depths_mm))]
                grasps[name] = [
                    Grasp(float(stored[f"{place}/contact_mm"]), read_surface(stored, place))
                    for place in places
                ]
    return grasps


def solve_grasp(one: Object, depth: float, coarse: float = 1.0) -> Grasp:
    """Solve a grasp.

    Args:
        one: the object.
        depth: approach of the grip [mm].
        coarse: factor of the elements' sizes [-].
    """
    gel, body = Gel(one.thickness_mm, 30.0, SHEAR_MODULUS), one.body
    if one.flat:
        mesh = coarse * 0.2, body.width + 0.6, 1.2
    else:
        touching = np.sqrt(one.radius_mm * depth)
        mesh = coarse * 0.055 * touching, 1.3 * touching + 0.3, 1.2
    path = [Motion(depth * (i + 1) / PRESSES, 0.0) for i in range(PRESSES)]
    path += [Motion(depth, float(np.radians(angle))) for angle in TURNS_DEG]
    bodies = (gel, cut(gel, *mesh)), (body, cut_ball(body, *mesh))
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


def write_grasps(grasps: Mapping[str, Sequence[Grasp]], file: Path) -> None:
    """Write the grasps of each object to a file.

    Args:
        grasps: grasps by name of the object.
        file: one of `FILES`.
    """
    arrays: dict[str, np.ndarray] = {}
    for name, solved in grasps.items():
        for i, grasp in enumerate(solved):
            arrays[f"{name}/{i}/contact_mm"] = np.array(grasp.contact_mm)
            arrays |= surface_arrays(grasp.surface, f"{name}/{i}")
    write_arrays(file, arrays)


def main(names: Sequence[str]) -> None:
    """Solve the grasps, and write them to the stored files.

    Args:
        names: names of the files to write; all if empty.
    """
    for file, objects in (("balls", BALLS), ("shapes", SHAPES)):
        if names and file not in names:
            continue
        grasps: dict[str, list[Grasp]] = {name: [] for name in objects}
        for name, one in objects.items():
            for depth in one.depths_mm:
                grasps[name].append(solve_grasp(one, depth))
                contact = grasps[name][-1].contact_mm
                print(f"{name}, {depth:g} mm: contact radius {contact:.2f} mm", flush=True)
        write_grasps(grasps, FILES[file])


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main(sys.argv[1:])
