"""Cubes and ellipsoids pressed on square gels and turned, up and back, by `bricks` and `press`.

The repository contains force and moment (`data/solids.csv`) and, for some cases, the motion of the
surface (`data/solids.npz`). `python -m papers.finite_strain.solids.cases` solves the cases again
(extra `finite-elements`) and writes both.
"""

import csv
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from papers.finite_strain.gel import Gel, grow
from papers.finite_strain.reference import read_steps
from papers.finite_strain.settings import SHEAR_MODULUS, THICKNESS
from papers.finite_strain.solids.bricks import Bricks, lay_bricks
from papers.finite_strain.solids.press import Block, Egg, Solid, press
from papers.finite_strain.steps import press_and_turn
from papers.finite_strain.surface import write_arrays

FOLDER = Path(__file__).parents[1] / "data"

_PRESSES = 6
_BACK = (19, 18, 17, 16, 15, 14, 13, 12, 11, 10, 8, 6, 4, 2, 0)
_FULL = (*range(1, 21), *_BACK)
_ROUGH = (2.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 19, 17.5, 15, 12.5, 10)
_UP_DEG = (0.0, 5.0, 10.0, 15.0, 20.0)
_BACK_DEG = (15.0, 10.0)
_READ_MM, _UNIT_MM = 14.8, 1e-4


class Case(NamedTuple):
    """A contact on a gel of G = 0.2 MPa, h = 8 mm and ν = 0.48.

    Attributes:
        flat_mm: half of the width of a cube's flat face; 0 for others [mm].
        edge_mm: radius of a cube's edges, or of a sphere; 0 for an ellipsoid [mm].
        a_mm: half of an ellipsoid's length along x; 0 for others [mm].
        b_mm: half of its length along y [mm].
        c_mm: half of its height [mm].
        depth_mm: indentation depth [mm].
        friction: μ [-].
        pad_mm: half of the width of the square gel [mm].
    """

    flat_mm: float = 0.0
    edge_mm: float = 0.0
    a_mm: float = 0.0
    b_mm: float = 0.0
    c_mm: float = 0.0
    depth_mm: float = 1.0
    friction: float = 0.5
    pad_mm: float = 30.0

    @property
    def solid(self) -> Solid:
        """Shape of the object."""
        if self.edge_mm:
            return Block(self.flat_mm, self.edge_mm)
        return Egg(self.a_mm, self.b_mm, self.c_mm)

    @property
    def name(self) -> str:
        """Name of the object, with its sizes in mm."""
        if not self.edge_mm:
            return f"ellipsoid, {self.a_mm:g} × {self.b_mm:g} × {self.c_mm:g}"
        width = 2.0 * (self.flat_mm + self.edge_mm)
        return f"cube, {width:g}" if self.flat_mm else f"sphere, {self.edge_mm:g}"


class Mesh(NamedTuple):
    """Spacing of a case's nodes, and its path.

    Attributes:
        cells_mm: smallest spacing along x, y and z [mm].
        zone_mm: ends of the evenly meshed part along x and y [mm].
        growth: ratio of the spacings of neighbouring elements beyond it [-].
        turns_deg: angles after pressing [deg].
    """

    cells_mm: tuple[float, float, float]
    zone_mm: tuple[float, float]
    growth: float = 1.45
    turns_deg: tuple[float, ...] = _FULL


_CUBE = Case(flat_mm=3.0, edge_mm=1.0)
_BLUNT = Case(flat_mm=3.0, edge_mm=1.5, depth_mm=0.8)
_EGG = Case(a_mm=16.0, b_mm=8.0, c_mm=8.0)
_BALL = Case(edge_mm=20.0)

CASES = {
    _CUBE._replace(depth_mm=0.5): Mesh((0.3, 0.3, 0.3), (4.2, 4.2)),
    _BLUNT: Mesh((0.35, 0.35, 0.35), (4.5, 4.5)),
    _EGG._replace(depth_mm=0.5): Mesh((0.5, 0.3, 0.35), (5.0, 3.3)),
    _EGG: Mesh((0.6, 0.4, 0.4), (6.6, 4.4), 1.5),
    Case(flat_mm=2.5, edge_mm=2.0, depth_mm=1.2): Mesh(
        (0.35, 0.35, 0.35), (4.5, 4.5), turns_deg=_ROUGH
    ),
    Case(a_mm=12.0, b_mm=8.0, c_mm=8.0, depth_mm=1.5, friction=0.8): Mesh(
        (0.6, 0.45, 0.45), (6.0, 4.8), 1.5, _ROUGH
    ),
    _BALL: Mesh((0.4, 0.4, 0.4), (5.4, 5.4), 1.3, _ROUGH),
    _BALL._replace(depth_mm=0.5, pad_mm=12.0): Mesh((0.3, 0.3, 0.3), (3.9, 3.9), 1.3, _ROUGH),
    _BALL._replace(pad_mm=12.0): Mesh((0.4, 0.4, 0.4), (5.4, 5.4), 1.3, _ROUGH),
    _BLUNT._replace(pad_mm=12.0): Mesh((0.35, 0.35, 0.35), (4.5, 4.5), 1.35, _ROUGH),
}
"""Cubes and ellipsoids on wide pads, a sphere to compare with `press`, and square pads of 24 mm."""

FIELDS = tuple(CASES)[:4]
"""Cases whose surface is shipped."""


class Turned(NamedTuple):
    """Force and moment of a case, when pressed, turned and turned back.

    Attributes:
        angle_deg: angle of the object, by step [deg].
        force_n: pressing force [N].
        moment_nmm: moment on the gel [N·mm].
    """

    angle_deg: Float[np.ndarray, " steps"]
    force_n: Float[np.ndarray, " steps"]
    moment_nmm: Float[np.ndarray, " steps"]


class Field(NamedTuple):
    """Motion of a gel's top along a path; of a quarter if x starts at 0, else of half.

    Attributes:
        x: coordinates of the undeformed top's nodes [mm].
        y: coordinates of these nodes [mm].
        moved: their displacement [mm].
        twist: twist of the object [rad].
        contact: mask of the nodes in contact.
        stick: mask of the nodes in contact that do not slip in the step.
    """

    x: Float[np.ndarray, " nx"]
    y: Float[np.ndarray, " ny"]
    moved: Float[np.ndarray, "steps nx ny 3"]
    twist: Float[np.ndarray, " steps"]
    contact: Bool[np.ndarray, "steps nx ny"]
    stick: Bool[np.ndarray, "steps nx ny"]


def lay_out(case: Case, mesh: Mesh) -> Bricks:
    """The mesh of a case: small elements at a cube's edges, larger ones below its face."""
    x, y = (
        space_evenly(max(case.flat_mm - 2.0 * cell, 0.0), zone, case.pad_mm, cell, mesh.growth)
        for cell, zone in zip(mesh.cells_mm[:2], mesh.zone_mm, strict=True)
    )
    along = grow(THICKNESS, mesh.cells_mm[2], mesh.growth)
    return lay_bricks(np.append(-x[:0:-1], x) if isinstance(case.solid, Egg) else x, y, along)


def space_evenly(face: float, zone: float, width: float, cell: float, growth: float) -> np.ndarray:
    """Coordinates from 0, twice as far apart below a face, evenly up to a zone's end [mm].

    Args:
        face: end of the part below the face [mm].
        zone: end of the evenly spaced part [mm].
        width: the last coordinate [mm].
        cell: spacing in the even part [mm].
        growth: ratio of neighbouring spacings beyond it [-].
    """
    inner = np.linspace(0.0, face, max(round(0.5 * face / cell), 1) + 1)[:-1] if face else []
    fine = np.linspace(face, zone, max(round((zone - face) / cell), 1) + 1)
    outer = zone + grow(width - zone, cell, growth)[1:] if width > zone else []
    return np.concatenate([inner, fine, outer])


def solve(case: Case, mesh: Mesh) -> tuple[Turned, Field]:
    """Solve a case: pressed on in six steps, then turned."""
    gel, bricks, depth = (
        Gel(THICKNESS, case.pad_mm, SHEAR_MODULUS),
        lay_out(case, mesh),
        case.depth_mm,
    )
    path = press_and_turn(depth, _PRESSES, mesh.turns_deg)
    solved = press(gel, bricks, case.solid, case.friction, path, rtol=1e-5)
    field = Field(
        *bricks.grid,
        solved.moved,
        np.array([motion.twist for motion in path]),
        solved.contact,
        solved.stick,
    )
    return keep_steps(field.twist, solved.normal_force, solved.moment), field


def keep_steps(twist: np.ndarray, force: np.ndarray, moment: np.ndarray) -> Turned:
    """The steps of the table: pressed, up to 20° and back to 10°."""
    angle = np.degrees(twist)
    peak = int(angle.argmax())
    up = [int(np.abs(angle[:peak] - at).argmin()) for at in _UP_DEG[1:-1]]
    back = [peak + int(np.abs(angle[peak:] - at).argmin()) for at in _BACK_DEG]
    kept = [_PRESSES - 1, *up, peak, *back]
    return Turned(angle[kept], force[kept], moment[kept])


def make_whole(field: Field) -> Field:
    """The motion of the whole top, from that of a quarter or half of it."""
    if field.x[0] == 0.0:
        field = _join(field, 1)
    return _join(field, 2)


def _join(field: Field, quarters: int) -> Field:
    """Join a quarter with its copy to a half, x ≤ 0, or a half with its copy to the whole."""
    turn = np.exp(0.5j * np.pi * quarters)
    flat = (field.moved[..., 0] + 1j * field.moved[..., 1]) * turn
    turned = np.stack([flat.real, flat.imag, field.moved[..., 2]], axis=-1)

    def join(own: np.ndarray, other: np.ndarray) -> np.ndarray:
        other = np.rot90(other, quarters, axes=(1, 2))
        if quarters == 1:
            return np.concatenate([other[:, :-1], own], axis=1)
        return np.concatenate([other[:, :, :-1], own], axis=2)

    along = np.append(-field.y[:0:-1], field.y)
    x, y = (along, field.y) if quarters == 1 else (field.x, along)
    contact, stick = (join(part, part) for part in field[4:])
    return Field(x, y, join(field.moved, turned), field.twist, contact, stick)


def move_on_grid(
    field: Field, reference: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "steps n 3"], Bool[np.ndarray, "steps n"]]:
    """Displacements of markers [mm], and the mask of those that stick, in each step.

    Between the nodes the motion up to the turn, and heights, are cubic splines: the elements' own
    linear functions are off by up to 3 µm. The slip since then, seen from the object, is
    interpolated without overshoot, so that it is 0 between nodes that stick. A marker sticks if all
    nodes around it do.

    Args:
        field: motion of the whole top (`make_whole`).
        reference: positions of the markers on the unloaded gel [mm].
    """
    grid, before = field[:2], reference[:, 0] + 1j * reference[:, 1]
    pressed = int(np.argmax(field.twist != 0.0)) - 1
    back = np.exp(-1j * field.twist[pressed + 1 :, None])

    def smooth(steps: np.ndarray) -> np.ndarray:
        splines = (RectBivariateSpline(*grid, step) for step in steps)
        return np.stack([spline(*reference.T, grid=False) for spline in splines])

    start = smooth(field.moved[: pressed + 1, ..., 0]) + 1j * smooth(
        field.moved[: pressed + 1, ..., 1]
    )
    flat = field.moved[..., 0] + 1j * field.moved[..., 1]
    flat = flat + grid[0][:, None] + 1j * grid[1]
    slip = np.moveaxis(flat[pressed + 1 :] * back[..., None] - flat[pressed], 0, -1)
    slip = np.concatenate([slip.real, slip.imag], axis=-1)
    slip = RegularGridInterpolator(grid, slip, method="pchip")(reference)
    slip = np.moveaxis(slip.reshape(len(before), 2, -1), 0, -1)
    turned = (before + start[pressed] + slip[0] + 1j * slip[1]) / back - before
    moved = np.concatenate([start, turned])
    stick = np.ones((len(moved), len(before)), dtype=bool)
    i, j = (
        np.clip(np.searchsorted(along, at), 1, len(along) - 1)
        for along, at in zip(grid, reference.T, strict=True)
    )
    for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)):
        stick &= field.stick[:, i - k, j - m]
    return np.stack([moved.real, moved.imag, smooth(field.moved[..., 2])], axis=-1), stick


@cache
def read_solids() -> dict[Case, Turned]:
    """The cases of `solids.csv`."""
    return {
        Case(*case): Turned(*(np.array([row[name] for row in rows]) for name in Turned._fields))
        for case, rows in read_steps(FOLDER / "solids.csv", Case._fields).items()
    }


def write_solids(results: dict[Case, Turned]) -> None:
    """Write the table of the shipped cases."""
    with (FOLDER / "solids.csv").open("w", encoding="utf-8", newline="") as text:
        table = csv.writer(text)
        table.writerow([*Case._fields, *Turned._fields])
        for case, turned in results.items():
            for angle, force, moment in zip(*turned, strict=True):
                values = (*case, round(float(angle), 4), force, moment)
                table.writerow([f"{value:.5g}" for value in values])


@cache
def read_fields() -> dict[Case, Field]:
    """The surfaces of `solids.npz`."""
    with np.load(FOLDER / "solids.npz") as stored:
        return {case: read_field(stored, str(i)) for i, case in enumerate(FIELDS)}


def read_field(stored: Mapping[str, np.ndarray], place: str) -> Field:
    """A motion of a file.

    Args:
        stored: arrays of the file.
        place: first part of their names.
    """
    parts = {name: stored[f"{place}/{name}"] for name in Field._fields}
    moved = _UNIT_MM * np.cumsum(parts["moved"], axis=0, dtype=np.int32)
    return Field(**parts | {"moved": moved})


def field_arrays(field: Field, place: str) -> dict[str, np.ndarray]:
    """The arrays of a motion for a file, as far as markers are read: from step to step, by 0.1 µm.

    Args:
        field: motion of the gel's top.
        place: first part of their names.
    """
    x, y = (
        np.flatnonzero((along > -1.4 * _READ_MM) & (np.append(0.0, along[:-1]) < _READ_MM))
        for along in field[:2]
    )
    near = (slice(None), *np.ix_(x, y))
    whole = np.round(field.moved[near] / _UNIT_MM).astype(np.int32)
    parts = field._replace(
        x=field.x[x],
        y=field.y[y],
        moved=np.diff(whole, axis=0, prepend=0 * whole[:1]).astype(np.int16),
        contact=field.contact[near],
        stick=field.stick[near],
    )
    return {f"{place}/{name}": part for name, part in parts._asdict().items()}


def contact_radius(field: Field, step: int) -> float:
    """Radius of a disc as large as the contact; its rim is half way to the next node [mm].

    Args:
        field: motion of a whole top, or of a quarter.
        step: number of the step.
    """
    lengths = [np.gradient(along) for along in field[:2]]
    if field.x[0] == 0.0:  # nodes on the cuts have half of their length in the quarter
        lengths = [np.append(0.5 * along[0], along[1:]) for along in lengths]
    parts = 4.0 if field.x[0] == 0.0 else 1.0
    return float(np.sqrt(parts * np.sum(np.outer(*lengths)[field.contact[step]]) / np.pi))


def write_fields(results: dict[Case, Field]) -> None:
    """Write the surfaces of the shipped cases."""
    arrays: dict[str, np.ndarray] = {}
    for i, case in enumerate(FIELDS):
        arrays |= field_arrays(results[case], str(i))
    write_arrays(FOLDER / "solids.npz", arrays)


def main() -> None:
    """Solve all cases, in about half an hour of processor time, and write both files."""
    solved = {}
    for case, mesh in CASES.items():
        solved[case] = solve(case, mesh)
        print(case, flush=True)
    write_solids({case: turned for case, (turned, _) in solved.items()})
    write_fields({case: field for case, (_, field) in solved.items()})


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
