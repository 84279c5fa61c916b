"""The contact model and the default method under cubes and ellipsoids, and on square pads.

The reference is `solids.csv`, from finite elements in three dimensions. Poses are plain, corotated,
and corotated on a `Layer` with `neo_hookean` and the radius of a round pad of the same area. The
table of angles follows markers on the surfaces of `solids.npz`. Square bars are solved in linear
torsion (extra `finite-elements`).
"""

import warnings
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel import (
    AbstractIndenter,
    Contact,
    Ellipsoid,
    Grid,
    Layer,
    Pose,
    Rigid,
    Sphere,
    SquarePunch,
    solve_path,
)
from papers.finite_strain.settings import SHEAR_MODULUS, THICKNESS
from papers.finite_strain.solids.angles import NOISES_UM, Followed, follow_markers, summarize
from papers.finite_strain.solids.bars import BARS, Bar, compare_bar
from papers.finite_strain.solids.cases import FIELDS, Case, Turned, read_fields, read_solids
from papers.items import Track

WAYS = {"plain": (False, False), "corotated": (True, False), "corrected": (True, True)}
"""Whether poses are corotated, and whether the layer is corrected."""

_POISSON_RATIO = 0.48
_PRESSES = 4
_RISING = slice(0, 5)
_DRAWS = 10


class Off(NamedTuple):
    """Relative errors of the model.

    Attributes:
        force: error of the force, by step [-].
        moment: error of the moment, by step; on the way back over the moment at the turn [-].
    """

    force: Float[np.ndarray, " steps"]
    moment: Float[np.ndarray, " steps"]


class Studied(NamedTuple):
    """Errors of the model by case and way, recordings by case and noise [µm], and square bars."""

    model: dict[Case, dict[str, Off]]
    angles: dict[tuple[Case, float], list[Followed]]
    bars: list[Bar]


def compute(quick: bool = False, track: Track = iter) -> Studied:
    """Compare all cases; the quick size has a cube, one recording and one bar."""
    cases = read_solids()
    chosen = FIELDS[:1] if quick else tuple(cases)
    model = {case: _compare(case, cases[case]) for case in track(chosen)}
    fields = [(case, noise) for case in FIELDS for noise in NOISES_UM]
    fields = [(FIELDS[-1], 3.0)] if quick else fields
    draws = range(1 if quick else _DRAWS)
    followed = {
        (case, noise): [follow_markers(read_fields()[case], noise, seed) for seed in draws]
        for case, noise in track(fields)
    }
    bars = [compare_bar(*bar) for bar in track(BARS[4:5] if quick else BARS)]
    return Studied(model, followed, bars)


def _compare(case: Case, reference: Turned) -> dict[str, Off]:
    scale = np.where(
        np.arange(len(reference.angle_deg)) < _RISING.stop,
        reference.moment_nmm,
        reference.moment_nmm[_RISING.stop - 1],
    )
    scale[0] = np.inf
    errors = {}
    for way, (corotated, corrected) in WAYS.items():
        force, moment = _solve(case, reference.angle_deg, corotated, corrected)
        lack = (moment - reference.moment_nmm) / scale
        errors[way] = Off(force / reference.force_n - 1.0, lack)
    return errors


def _solve(
    case: Case, angle_deg: np.ndarray, corotated: bool, corrected: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and moment [N·mm] when pressed, turned, and turned back."""
    gel = Layer(SHEAR_MODULUS, _POISSON_RATIO, THICKNESS)
    if corrected:
        radius = 2.0 * case.pad_mm / np.sqrt(np.pi)  # of the same area
        gel = Layer(SHEAR_MODULUS, _POISSON_RATIO, THICKNESS, radius, neo_hookean=True)
    contact = Contact(gel, Rigid(), *make_object(case), case.friction)
    depth = case.depth_mm
    pressed = depth * np.arange(1, _PRESSES) / _PRESSES
    approach = np.append(pressed, np.full(len(angle_deg), depth))
    twist = np.radians(np.append(np.zeros(_PRESSES - 1), angle_deg))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the corrections do not cover these contacts
        path = solve_path(contact, Pose(approach, twist=twist, corotated=corotated), rtol=1e-5)
    kept = slice(_PRESSES - 1, None)
    return -np.asarray(path.force[kept, 2]), np.asarray(path.moment[kept])


def make_object(case: Case) -> tuple[AbstractIndenter, Grid]:
    """The model's object, and a grid that its contact fills."""
    if case.flat_mm:
        width = 2.0 * (case.flat_mm + case.edge_mm)
        return SquarePunch(width, case.edge_mm), Grid((40, 40), (width, width))
    if case.edge_mm:
        side = 2.9 * np.sqrt(case.edge_mm * case.depth_mm)
        return Sphere(case.edge_mm), Grid((40, 40), (side, side))
    sides = 2.7 * np.sqrt(case.depth_mm / case.c_mm) * np.array([case.a_mm, case.b_mm])
    return Ellipsoid((case.a_mm, case.b_mm, case.c_mm)), Grid((48, 32), tuple(sides.tolist()))


def tables(result: Studied) -> dict[str, list[dict[str, object]]]:
    """The model's errors in per cent, and the angles' errors."""
    model: list[dict[str, object]] = []
    for case, ways in result.model.items():
        for way, off in ways.items():
            back = off.moment[_RISING.stop :]
            model.append({
                "object, mm": case.name,
                "pad [mm]": 2.0 * case.pad_mm,
                "depth/h": round(case.depth_mm / THICKNESS, 3),
                "μ": case.friction,
                "poses": way,
                "force [%]": _percent(off.force[0]),
                "force, 20° [%]": _percent(off.force[4]),
                "moment, 5° [%]": _percent(off.moment[1]),
                "moment, 10° [%]": _percent(off.moment[2]),
                "moment, 20° [%]": _percent(off.moment[4]),
                "moment, back [% of that at 20°]": _percent(back[np.abs(back).argmax()]),
            })  # fmt: skip
    angles = [
        row
        for (case, noise), draws in result.angles.items()
        for row in summarize(case, noise, draws)
    ]
    radii: list[dict[str, object]] = [
        {
            "object, mm": case.name,
            "depth [mm]": case.depth_mm,
            "noise [µm]": noise,
            "radius of the contact, mean error [%]": _percent(
                np.mean([d.radius_off for d in draws])
            ),
            "largest error [%]": _percent(np.max([abs(d.radius_off) for d in draws])),
        }
        for (case, noise), draws in result.angles.items()
    ]
    bars: list[dict[str, object]] = [
        {
            "height over width": bar.height,
            "contact's radius over width": bar.reach,
            "as a round bar [%]": _percent(bar.as_round),
            "as a plate [%]": _percent(bar.as_plate),
        }
        for bar in result.bars
    ]
    return {"": model, "_angles": angles, "_radii": radii, "_bars": bars}


def _percent(value: Any) -> float:
    return round(100.0 * float(value), 1)


def plot(result: Studied) -> Figure:
    """Errors by case: force and moment up to 20°, and moment on the way back."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained", sharey=True)
    for row, ways in enumerate(result.model.values()):
        for i, off in enumerate(ways.values()):
            spans = off.force[_RISING], off.moment[1:5], off.moment[5:]
            for axis, values in zip(axes, spans, strict=True):
                at = np.full(len(values), row + 0.2 * (i - 1))
                axis.plot(100.0 * values, at, "o-", ms=4, lw=1, color=f"C{i}")
    for axis, title in zip(axes, ("force", "moment, 5 to 20°", "moment, way back"), strict=True):
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("model over reference − 1 [%]")
        axis.axvline(0.0, color="k", lw=0.8)
        axis.grid(alpha=0.3)
    names = [f"{c.name}\n{c.depth_mm:g} deep, pad {2 * c.pad_mm:g} mm" for c in result.model]
    axes[0].set_yticks(range(len(names)), names, fontsize=7)
    axes[0].invert_yaxis()
    for i, way in enumerate(WAYS):
        axes[2].plot([], [], "o", color=f"C{i}", label=way)
    axes[2].legend(fontsize=8)
    return figure
