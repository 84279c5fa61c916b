"""Soft objects on gels at finite strain: the motion of the gels' surfaces.

`balls.npz`, `shapes.npz` and `bars.npz` have it. `python -m papers.finite_strain.grasps` solves the
grasps again with the finite elements of `two_bodies`, and for square bars of `solids.two_bodies`
(extra `finite-elements`), in about an hour of processor time; `bars` behind it solves only those of
square bars. Each grasp of an object is pressed to its own depth and twisted to 20°.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from papers.finite_strain.gel import Gel, cut, grow
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.solids import two_bodies as bars
from papers.finite_strain.solids.bricks import lay_bricks
from papers.finite_strain.solids.cases import (
    Field,
    contact_radius,
    field_arrays,
    make_whole,
    move_on_grid,
    read_field,
    space_evenly,
)
from papers.finite_strain.steps import press_and_turn
from papers.finite_strain.surface import (
    Surface,
    move_markers,
    read_surface,
    surface_arrays,
    write_arrays,
)
from papers.finite_strain.two_bodies import Ball, cut_ball, hold

FILES = {
    name: Path(__file__).with_name("data") / f"{name}.npz"
    for name in ("balls", "shapes", "bars", "fresh")
}
"""Stored grasps of balls, of cylinders and plates, of square bars, and of fresh objects."""

PRESSES = 8
"""Steps in which a ball is pressed on."""

TURNS_DEG = (*range(1, 11), *range(12, 21, 2))
"""Angles of the grip after pressing [deg]."""

SEEN_MM = 16.0
"""Radius of the stored part of the surface [mm]."""


class Object(NamedTuple):
    """A soft object of revolution or a square bar, the gel that it is pressed on, and its grasps.

    A ball's body is a cone beyond half of its radius, as wide and as high as twice its radius.

    Attributes:
        radius_mm: R of the tip, or of the edge around its flat face [mm].
        ratio: k, shear modulus of the gel over the object's [-].
        depths_mm: approach of the grip in each grasp, the smallest first [mm].
        thickness_mm: h of the gel [mm].
        poisson_ratio: ν of the object [-].
        friction: μ [-].
        side_mm: radius of the side, of a square bar half of its width; twice R if not given [mm].
        height_mm: height from the tip to the grip; twice R if not given [mm].
        flat: whether the face is flat up to the edge.
        held_out: whether the correction was chosen without this object in view.
        square: whether it is a square bar.
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
    square: bool = False

    @property
    def body(self) -> Ball:
        """The body of revolution; of a square bar the one inside it."""
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

_BAR = Object(1.5, 0.5, (0.25, 0.6), side_mm=5.0, height_mm=10.0, flat=True, held_out=True,
              square=True)  # fmt: skip

BARS = {
    "cube": _BAR,
    "long bar": _BAR._replace(ratio=0.2, side_mm=4.0, height_mm=16.0),
    "low bar": _BAR._replace(ratio=1.0, height_mm=5.0),
    "cube, thin gel": _BAR._replace(
        ratio=1.0, side_mm=4.5, height_mm=9.0, thickness_mm=4.0, depths_mm=(0.7, 1.1)
    ),
}
"""Cubes and other square bars by name."""

FRESH = {
    "fresh disc": _HELD._replace(height_mm=2.5, thickness_mm=6.0),
    "fresh hard disc": _HELD._replace(ratio=0.3, side_mm=5.5, height_mm=3.0, thickness_mm=5.0),
    "fresh soft disc": _HELD._replace(ratio=1.0, side_mm=6.0, height_mm=3.0),
    "fresh disc, small edge": _HELD._replace(radius_mm=0.8, height_mm=3.0, thickness_mm=5.0),
    "fresh cylinder, thin gel": _HELD._replace(
        ratio=1.0, side_mm=4.5, height_mm=9.0, thickness_mm=4.0
    ),
    "fresh stout cylinder": _HELD._replace(
        ratio=0.7, side_mm=7.0, height_mm=10.0, thickness_mm=6.0
    ),
    "fresh rod": _HELD._replace(side_mm=6.0, height_mm=20.0, thickness_mm=6.0, depths_mm=(0.6,)),
    "fresh dome": Object(15.0, 0.7, (0.4, 1.0), 6.0, side_mm=6.0, height_mm=8.0, held_out=True),
}
"""Objects that neither the correction nor its intervals were chosen on."""

OBJECTS = BALLS | SHAPES | BARS | FRESH
"""All objects by name."""

_SETS = {"balls": BALLS, "shapes": SHAPES, "bars": BARS, "fresh": FRESH}


class Grasp(NamedTuple):
    """A solved grasp.

    Attributes:
        contact_mm: radius of the contact when pressed, under a bar that of a disc as large [mm].
        surface: motion of the gel's top; under a bar that of a quarter.
    """

    contact_mm: float
    surface: Surface | Field

    def move(
        self, reference: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "steps n 3"], Bool[np.ndarray, "steps n"]]:
        """Displacements of markers [mm], and the mask of those that stick, in each step.

        Args:
            reference: positions of the markers on the unloaded gel [mm].
        """
        if isinstance(self.surface, Surface):
            return move_markers(self.surface, reference)
        return move_on_grid(make_whole(self.surface), reference[:, :2])


@cache
def read_grasps() -> dict[str, list[Grasp]]:
    """The stored grasps of each object."""
    grasps = {}
    for file, objects in _SETS.items():
        with np.load(FILES[file]) as stored:
            for name, one in objects.items():
                read = read_field if one.square else read_surface
                places = [f"{name}/{i}" for i in range(len(one.depths_mm))]
                grasps[name] = [
                    Grasp(float(stored[f"{place}/contact_mm"]), read(stored, place))
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
    if one.square:
        return _solve_bar(one, depth, 0.35 * coarse)
    gel, body = Gel(one.thickness_mm, 30.0, SHEAR_MODULUS), one.body
    if one.flat:
        mesh = coarse * 0.2, body.width + 0.6, 1.2
    else:
        touching = np.sqrt(one.radius_mm * depth)
        mesh = coarse * 0.055 * touching, 1.3 * touching + 0.3, 1.2
    path = press_and_turn(depth, PRESSES, TURNS_DEG)
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


def _solve_bar(one: Object, depth: float, cell: float) -> Grasp:
    """Solve a grasp of a square bar, on a square gel."""
    round_, growth, width = one.body, 1.45, 26.0
    bar = bars.Bar(round_.flat, round_.radius, *round_[3:6])
    half, gel = 0.5 * bar.width, Gel(one.thickness_mm, width, SHEAR_MODULUS)
    across = space_evenly(max(bar.flat - 2.0 * cell, 0.0), half, half, cell, growth)
    beside = np.append(across[:-1], half + np.arange(3) * cell)
    beside = np.append(beside, beside[-1] + grow(width - beside[-1], cell, growth)[1:])
    bricks = lay_bricks(beside, beside, grow(gel.thickness, cell, growth))
    bodies = (gel, bricks), (bar, bars.cut_bar(bar, across, cell, growth))
    path = press_and_turn(depth, PRESSES, TURNS_DEG)
    solved, steps = bars.hold(*bodies, one.friction, path, rtol=1e-5).gel, slice(PRESSES - 1, None)
    twist = np.array([motion.twist for motion in path])
    field = Field(*bricks.grid, solved.moved, twist, solved.contact, solved.stick)
    field = Field(*field[:2], *(part[steps] for part in field[2:]))
    return Grasp(contact_radius(field, 0), field)


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
            surface, place = grasp.surface, f"{name}/{i}"
            known = isinstance(surface, Surface)
            arrays |= surface_arrays(surface, place) if known else field_arrays(surface, place)
    write_arrays(file, arrays)


def main(names: Sequence[str]) -> None:
    """Solve the grasps, and write them to the stored files.

    Args:
        names: names of the files to write; all if empty.
    """
    for file, objects in _SETS.items():
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
