"""Errors of the surface field at finite strain, by pose and correction.

The finite elements of `gel` and `press` solve each case (extra `finite-elements`): pressed on in
eight steps, turned to 20°, and back to 10°. Errors are L2 norms over the surface up to three radii
of the contact, relative to the norm of u_θ: on the way up of the motion since the press, on the way
back since the turn.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from contactmodel import ContactSolution, Layer, Pose, solve_path
from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.model import find_scale, make_contact
from papers.finite_strain.press import Pressed, Round, press
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.steps import Motion, press_and_turn
from papers.items import Track

WAYS = {"plain": (False, False), "corotated": (True, False), "corrected": (True, True)}
"""Whether poses are corotated and whether the layer is `neo_hookean`."""

_PRESSES = 8
_TURNS_DEG = (1, 2, 3.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 19, 18, 17, 16, 15, 12.5, 10)
_KEPT = (1, 3, 5, 7, 9, 11, 13, 15, 17, 22, 24)  # steps of the model
_RISING, _BACK = slice(5, 9), slice(9, 11)  # of these: 5, 10, 15 and 20°, back to 15 and 10°
_AZIMUTHS = np.radians([0.0, 22.5, 45.0])


class Case(NamedTuple):
    """A contact; lengths as in `settings.Series`.

    Attributes:
        held_out: whether the fit of the coefficients leaves the case out.
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
)
"""Cases left out of the fit, then those of the fit; in each group the shallow ones first."""


class Errors(NamedTuple):
    """Relative errors of the field [-].

    Attributes:
        pressed: of u_r and u_z when pressed, each over its own norm.
        up: of u_r, u_θ and u_z, at 5, 10, 15 and 20°.
        back: of u_r, u_θ and u_z, back at 15 and 10°.
    """

    pressed: Float[np.ndarray, "2"]
    up: Float[np.ndarray, "4 3"]
    back: Float[np.ndarray, "2 3"]


def compute(quick: bool = False, track: Track = iter) -> dict[Case, dict[str, Errors]]:
    """Solve each case, in about a minute; the quick size is one case on coarse elements."""
    cases = [CASES[0]._replace(cell_mm=0.4)] if quick else CASES
    return {case: compare(case) for case in track(cases)}


def compare(case: Case) -> dict[str, Errors]:
    """Errors of the field by way."""
    reference = _solve_elements(case)
    touching = reference.radius[reference.contact[_PRESSES - 1]].max()
    seen = np.flatnonzero(reference.radius <= 3.0 * touching)
    radius = reference.radius[seen]
    field = reference.moved[list(_KEPT[3:])][:, seen]
    return {
        way: _measure(_solve(case, float(touching), radius, *how), field, radius)
        for way, how in WAYS.items()
    }


def _poses(case: Case) -> list[Motion]:
    return press_and_turn(case.depth_mm, _PRESSES, _TURNS_DEG)


def _solve_elements(case: Case) -> Pressed:
    gel = Gel(case.thickness_mm, case.pad_mm, SHEAR_MODULUS, case.poisson_ratio)
    shape = Round(case.flat_mm, case.edge_mm)
    elements = cut(gel, case.cell_mm, shape.reach(case.depth_mm), 1.15)
    return press(gel, elements, shape, case.friction, _poses(case), rtol=1e-6)


def _solve(
    case: Case, touching: float, radius: np.ndarray, corotated: bool, corrected: bool
) -> Float[np.ndarray, "steps points 3"]:
    """Field of the model when pressed and turned: u_r, u_θ and u_z [mm]."""
    scale = find_scale(1.1 * touching + 0.15, case.flat_mm, case.edge_mm)
    flat, edge, thickness = (scale * n for n in (case.flat_mm, case.edge_mm, case.thickness_mm))
    gel = Layer(SHEAR_MODULUS, case.poisson_ratio, thickness, neo_hookean=corrected)
    contact = make_contact(gel, flat, edge, case.friction)
    approach, twist = np.array([_poses(case)[i] for i in _KEPT]).T
    path = solve_path(contact, Pose(scale * approach, twist=twist, corotated=corotated), rtol=1e-5)
    return read_radially(path, scale * radius)[3:] / scale


def read_radially(path: ContactSolution, radius: np.ndarray) -> Float[np.ndarray, "steps n 3"]:
    """u_r, u_θ and u_z of a path at radii [mm], means over three azimuths [mm]."""
    c, s = np.cos(_AZIMUTHS)[:, None], np.sin(_AZIMUTHS)[:, None]
    points = np.stack([c * radius, s * radius], axis=-1).reshape(-1, 2)
    moved: Array = path.elastomer_displacement_at(points)
    x, y, z = np.moveaxis(np.asarray(moved).reshape(-1, 3, len(radius), 3), -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1).mean(axis=1)


def _measure(model: np.ndarray, field: np.ndarray, radius: np.ndarray) -> Errors:
    weight = np.gradient(radius) * radius

    def norm(values: np.ndarray) -> np.ndarray:
        return np.sqrt(np.sum(weight[:, None] * values**2, axis=-2))

    def since(start: int, steps: slice) -> np.ndarray:
        true = field[steps] - field[start]
        return norm(model[steps] - model[start] - true) / norm(true)[:, 1:2]

    rising, back = (slice(part.start - 3, part.stop - 3) for part in (_RISING, _BACK))
    pressed = norm(model[0] - field[0]) / np.maximum(norm(field[0]), 1e-12)
    return Errors(pressed[[0, 2]], since(0, rising), since(rising.stop - 1, back))


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
                "held out": case.held_out,
                "way": way,
                **{
                    name: round(100.0 * float(np.max(value)), 1)
                    for name, value in (
                        ("pressed, u_r [%]", errors.pressed[0]),
                        ("pressed, u_z [%]", errors.pressed[1]),
                        ("u_θ, up [%]", errors.up[:, 1]),
                        ("u_r, up [%]", errors.up[:, 0]),
                        ("u_z, up [%]", errors.up[:, 2]),
                        ("u_θ, back [%]", errors.back[:, 1]),
                    )
                },
            })  # fmt: skip
    return {"": rows}


def plot(result: dict[Case, dict[str, Errors]]) -> Figure:
    """Largest error of u_θ over depth, up and back; open symbols: held out of the fit."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for case, ways in result.items():
        for i, errors in enumerate(ways.values()):
            face = "none" if case.held_out else f"C{i}"
            for axis, part in zip(axes, (errors.up, errors.back), strict=True):
                worst = 100.0 * part[:, 1].max()
                axis.plot(case.depth_mm / case.thickness_mm, worst, "o", color=f"C{i}", mfc=face)
    for axis, name in zip(axes, ("up to 20°", "back to 10°, of the motion since"), strict=True):
        axis.set_title(f"u_θ, {name}", fontsize=10)
        axis.set_xlabel("depth over thickness [-]")
        axis.grid(alpha=0.3)
    for i, way in enumerate(WAYS):
        axes[0].plot([], [], "o", color=f"C{i}", label=way)
    axes[0].legend(fontsize=8)
    axes[0].set_ylabel("error [%]")
    return figure
