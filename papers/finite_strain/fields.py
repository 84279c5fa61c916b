"""Errors of the surface field at finite strain, by pose and correction.

The finite elements of `gel` and `press` press an object on in eight steps, turn it to 20°, and back
to 10°. `data/turns.npz` has the surfaces; `python -m papers.finite_strain.fields` solves them again
(extra `finite-elements`, about half an hour). Errors are L2 norms over the surface up to three
radii of the contact, relative to the norm of u_θ: on the way up of the motion since the press, on
the way back since the turn.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from contactmodel import ContactSolution, Layer, Pose, solve_path
from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.model import CELLS, find_scale, make_contact
from papers.finite_strain.press import Round, press
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.steps import Motion, press_and_turn
from papers.finite_strain.surface import (
    Surface,
    TurnedContact,
    read_contacts,
    write_contacts,
)
from papers.items import Track

FILE = Path(__file__).with_name("data") / "turns.npz"


class Way(NamedTuple):
    """How the model is solved."""

    corotated: bool  # whether poses are corotated
    corrected: bool  # whether the layer is `neo_hookean`
    cells: int = 64  # along a side of the grid


WAYS = {
    "plain": Way(False, False),
    "corotated": Way(True, False),
    "corrected": Way(True, True),
    "corrected, coarse grid": Way(True, True, CELLS),
}
"""Ways by name."""

_DRAWN = ("plain", "corotated", "corrected")

_PRESSES = 8
_TURNS_DEG = (1, 2, 3.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 19, 18, 17, 16, 15, 12.5, 10)
_SOLVED = (1, 3, 5, 7, 9, 11, 13, 15, 17, 22, 24)  # steps of the model
_KEPT = (7, 11, 13, 15, 17, 22, 24)  # pressed, 5, 10, 15 and 20°, back to 15 and 10°
_RISING, _BACK = slice(1, 5), slice(5, 7)  # of these
_POINTS = 80  # most points of a surface
_AZIMUTHS = np.radians([0.0, 22.5, 45.0])


class Case(NamedTuple):
    """A contact; lengths as in `settings.Series`.

    Attributes:
        held_out: whether the fit of the coefficients leaves the case out.
        second_share: share of the second invariant in a Mooney–Rivlin gel, see `gel.Gel` [-].
    """

    flat_mm: float
    edge_mm: float
    depth_mm: float
    friction: float = 0.5
    poisson_ratio: float = 0.48
    pad_mm: float = 40.0
    thickness_mm: float = 8.0
    cell_mm: float = 0.15
    held_out: bool = False
    second_share: float = 0.0


CASES = (
    Case(0.0, 15.0, 0.78, pad_mm=30.0, thickness_mm=6.0, cell_mm=0.12, held_out=True),
    Case(0.0, 30.0, 1.0, thickness_mm=10.0, cell_mm=0.18, held_out=True),
    Case(0.0, 8.0, 0.6, 0.7, 0.47, 25.0, 5.0, 0.08, held_out=True),
    Case(3.5, 1.5, 1.0, cell_mm=0.1, held_out=True),
    Case(0.0, 12.0, 1.6, 0.8, cell_mm=0.13, held_out=True),
    Case(0.0, 15.0, 1.5, pad_mm=30.0, thickness_mm=6.0, cell_mm=0.13, held_out=True),
    Case(0.0, 30.0, 2.0, 0.4, thickness_mm=10.0, cell_mm=0.2, held_out=True),
    Case(0.0, 20.0, 0.5, cell_mm=0.12),
    Case(0.0, 20.0, 1.04),
    Case(0.0, 10.0, 1.04, cell_mm=0.11),
    Case(0.0, 40.0, 1.0, cell_mm=0.2),
    Case(3.0, 1.0, 0.64, cell_mm=0.1),
    Case(4.0, 2.0, 0.8, cell_mm=0.12),
    Case(0.0, 20.0, 1.04, poisson_ratio=0.45),
    Case(0.0, 20.0, 1.04, 1.0),
    Case(0.0, 20.0, 1.04, 0.25),
    Case(0.0, 20.0, 2.0, cell_mm=0.17),
    Case(0.0, 10.0, 2.0),
    Case(0.0, 40.0, 1.8, cell_mm=0.25),
    Case(0.0, 20.0, 2.0, 1.0, cell_mm=0.17),
    Case(3.0, 1.0, 1.2, cell_mm=0.1),
    Case(0.0, 20.0, 1.04, held_out=True, second_share=0.3),
    Case(0.0, 20.0, 2.0, cell_mm=0.17, held_out=True, second_share=0.3),
    Case(3.5, 1.5, 1.0, cell_mm=0.1, held_out=True, second_share=0.3),
)
"""Cases left out of the fit, then those of the fit, in each group the shallow ones first, and
Mooney–Rivlin gels, which the fit leaves out."""


class Errors(NamedTuple):
    """Relative errors of the field [-].

    Attributes:
        pressed: of u_r and u_z when pressed, each over its own norm.
        up: of u_r, u_θ and u_z, at 5, 10, 15 and 20°.
        back: of u_r, u_θ and u_z, back at 15 and 10°.
        force: when pressed, and at the angles of `up`.
        moment: at the angles of `up`.
    """

    pressed: Float[np.ndarray, "2"]
    up: Float[np.ndarray, "4 3"]
    back: Float[np.ndarray, "2 3"]
    force: Float[np.ndarray, "5"]
    moment: Float[np.ndarray, "4"]


def compute(quick: bool = False, track: Track = iter) -> dict[Case, dict[str, Errors]]:
    """Compare every case, in some minutes; the quick size is the first punch, in two ways."""
    places, ways = ([3], _DRAWN[1:]) if quick else (range(len(CASES)), WAYS)
    turns = read_turns()
    return {
        CASES[i]: {way: measure(CASES[i], turns[i], WAYS[way]) for way in ways}
        for i in track(places)
    }


@cache
def read_turns() -> list[TurnedContact]:
    """The contacts of `CASES`, from the stored file."""
    return read_contacts(FILE, len(CASES))


def _poses(case: Case) -> list[Motion]:
    return press_and_turn(case.depth_mm, _PRESSES, _TURNS_DEG)


def solve(case: Case) -> TurnedContact:
    """Solve a case with the finite elements."""
    return solve_turned(case, _poses(case), _KEPT, 3.0)


def solve_turned(
    case: Case, path: list[Motion], kept: Sequence[int], reach: float
) -> TurnedContact:
    """Solve a contact along a path with the finite elements.

    Args:
        case: the contact.
        path: of the object.
        kept: steps of the solution, the first one pressed.
        reach: radius of the surface that is kept, over the contact's [-].
    """
    sizes = case.thickness_mm, case.pad_mm
    gel = Gel(*sizes, SHEAR_MODULUS, case.poisson_ratio, case.second_share)
    shape, steps = Round(case.flat_mm, case.edge_mm), list(kept)
    elements = cut(gel, case.cell_mm, shape.reach(case.depth_mm), 1.15)
    solved = press(gel, elements, shape, case.friction, path, rtol=1e-6)
    touching = float(solved.radius[solved.contact[steps[0]]].max())
    seen = solved.radius <= reach * touching
    surface = Surface(
        solved.radius[seen],
        solved.moved[steps][:, seen],
        np.array([path[i].twist for i in steps]),
        solved.stick[steps][:, seen],
    )
    return TurnedContact(surface, solved.normal_force[steps], solved.moment[steps], touching)


def measure(case: Case, turned: TurnedContact, way: Way) -> Errors:
    """Errors of the model's field.

    Args:
        case: the contact.
        turned: its solution by the finite elements.
        way: how the model is solved.
    """
    radius = turned.surface.radius
    scale = find_scale(1.1 * turned.contact_mm + 0.15, case.flat_mm, case.edge_mm)
    flat, edge, thickness = (scale * n for n in (case.flat_mm, case.edge_mm, case.thickness_mm))
    gel = Layer(SHEAR_MODULUS, case.poisson_ratio, thickness, neo_hookean=way.corrected)
    contact = make_contact(gel, flat, edge, case.friction, cells=way.cells)
    approach, twist = np.array([_poses(case)[i] for i in _SOLVED]).T
    pose = Pose(scale * approach, twist=twist, corotated=way.corotated)
    path, kept = solve_path(contact, pose, rtol=1e-5), [_SOLVED.index(step) for step in _KEPT]
    padded = np.pad(scale * radius, (0, _POINTS - len(radius)), mode="edge")  # one program for all
    model = read_radially(path, padded)[kept, : len(radius)] / scale
    force = -np.asarray(path.force)[kept, 2] / scale**2
    moment = np.asarray(path.moment)[kept] / scale**3
    pressed, up, back = _compare_fields(model, turned.surface.moved, radius)
    return Errors(
        *(pressed, up, back),
        force=(force / turned.force)[: _RISING.stop] - 1.0,
        moment=moment[_RISING] / turned.moment[_RISING] - 1.0,
    )


def read_radially(path: ContactSolution, radius: np.ndarray) -> Float[np.ndarray, "steps n 3"]:
    """u_r, u_θ and u_z of a path at radii [mm], means over three azimuths [mm]."""
    c, s = np.cos(_AZIMUTHS)[:, None], np.sin(_AZIMUTHS)[:, None]
    points = np.stack([c * radius, s * radius], axis=-1).reshape(-1, 2)
    moved: Array = path.elastomer_displacement_at(points)
    x, y, z = np.moveaxis(np.asarray(moved).reshape(-1, 3, len(radius), 3), -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1).mean(axis=1)


def _compare_fields(
    model: np.ndarray, field: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors when pressed, on the way up and on the way back, see `Errors`."""
    weight = np.gradient(radius) * radius

    def norm(values: np.ndarray) -> np.ndarray:
        return np.sqrt(np.sum(weight[:, None] * values**2, axis=-2))

    def since(start: int, steps: slice) -> np.ndarray:
        true = field[steps] - field[start]
        return norm(model[steps] - model[start] - true) / norm(true)[:, 1:2]

    pressed = norm(model[0] - field[0]) / np.maximum(norm(field[0]), 1e-12)
    return pressed[[0, 2]], since(0, _RISING), since(_RISING.stop - 1, _BACK)


def tables(result: dict[Case, dict[str, Errors]]) -> dict[str, list[dict[str, object]]]:
    """A row for each case and way: errors in per cent, largest of the angles."""
    rows: list[dict[str, object]] = []
    for case, ways in result.items():
        for way, errors in ways.items():
            rows.append({
                "object": f"punch {case.flat_mm:g}" if case.flat_mm else f"R {case.edge_mm:g}",
                "thickness [mm]": case.thickness_mm,
                "depth/h": round(case.depth_mm / case.thickness_mm, 3),
                "μ": case.friction,
                "ν": case.poisson_ratio,
                "gel": "Mooney–Rivlin" if case.second_share else "neo-Hookean",
                "held out": case.held_out,
                "way": way,
                **{
                    name: round(100.0 * float(np.abs(value).max()), 1)
                    for name, value in (
                        ("pressed, u_r [%]", errors.pressed[0]),
                        ("pressed, u_z [%]", errors.pressed[1]),
                        ("u_θ, up [%]", errors.up[:, 1]),
                        ("u_r, up [%]", errors.up[:, 0]),
                        ("u_z, up [%]", errors.up[:, 2]),
                        ("u_θ, back [%]", errors.back[:, 1]),
                        ("force [%]", errors.force),
                        ("moment [%]", errors.moment),
                    )
                },
            })  # fmt: skip
    return {"": rows}


def plot(result: dict[Case, dict[str, Errors]]) -> Figure:
    """Largest error of u_θ over depth, up and back; open: held out; squares: Mooney–Rivlin gels."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for case, ways in result.items():
        depth, mark = case.depth_mm / case.thickness_mm, "s" if case.second_share else "o"
        for way in set(ways).intersection(_DRAWN):
            i = _DRAWN.index(way)
            face = "none" if case.held_out else f"C{i}"
            for axis, part in zip(axes, (ways[way].up, ways[way].back), strict=True):
                axis.plot(depth, 100.0 * part[:, 1].max(), mark, color=f"C{i}", mfc=face)
    for axis, name in zip(axes, ("up to 20°", "back to 10°, of the motion since"), strict=True):
        axis.set_title(f"u_θ, {name}", fontsize=10)
        axis.set_xlabel("depth over thickness [-]")
        axis.grid(alpha=0.3)
    for i, way in enumerate(_DRAWN):
        axes[0].plot([], [], "o", color=f"C{i}", label=way)
    axes[0].plot([], [], "ko", mfc="none", label="left out of the fit")
    axes[0].plot([], [], "ks", mfc="none", label="Mooney–Rivlin gel")
    axes[0].legend(fontsize=8)
    axes[0].set_ylabel("error [%]")
    return figure


def main() -> None:
    """Solve the cases, and write them to the stored file."""
    solved = []
    for case in CASES:
        solved.append(solve(case))
        print(f"{case}: contact radius {solved[-1].contact_mm:.2f} mm", flush=True)
    write_contacts(FILE, solved)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
