"""G, h, μ and R fitted to finite-strain fields, and whether their intervals hold.

The finite elements of `gel` and `press` press spheres and punches on in eight steps and turn them
to 20°. `data/fields.npz` has the surfaces; `python -m papers.finite_strain.field_fits` solves them
again (extra `finite-elements`, about twenty minutes). 20 × 20 markers, out to two radii of the
contact, show the pressed and the turned contact, with noise in the plane and three times as much
along z. Force and moment are known to 0.01 N and 0.05 N·mm. Five numbers are fitted: the approach
as well.
"""

from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from calibration.field_fit import fit_fields
from calibration.field_result import FieldData
from calibration.forward import FieldModel, Unknown, press_and_move
from contactmodel import Grid
from papers.finite_strain.fields import Case, solve_turned
from papers.finite_strain.model import SIDE
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.steps import press_and_turn
from papers.finite_strain.surface import (
    Surface,
    TurnedContact,
    move_markers,
    read_contacts,
    write_contacts,
)
from papers.items import Track
from papers.tables import finish

FILE = Path(__file__).with_name("data") / "fields.npz"

NUMBERS = ("shear_modulus", "thickness", "friction_coefficient", "radius")
WAYS = ("linear", "finite strain", "data of the model")
"""Model of the fit; in the last way it has made the data as well, and is right."""

_PRESSES = 8
_TURNS_DEG = (1, 2, 3.5, 5, 7.5, 10, 12.5, 15, 17.5, 20)
_KEPT = (7, 13, 17)  # pressed, 10 and 20°
_CELLS = 48
_BOUNDS = {
    "shear_modulus": (0.02, 2.0),
    "thickness": (1.0, 40.0),
    "friction_coefficient": (0.05, 4.0),
    "radius": (1.0, 100.0),
    "approach": (0.05, 4.0),
}
_OFF = 1.1  # first guess over the truth
_FORCE_N, _MOMENT_NMM = 0.01, 0.05


_SIZES = (  # flat face, edge or radius, depth, μ, thickness, element
    (0.0, 20.0, 0.5, 0.5, 8.0, 0.12),
    (0.0, 20.0, 1.04, 0.5, 8.0, 0.15),
    (0.0, 20.0, 1.04, 0.3, 8.0, 0.16),
    (0.0, 20.0, 1.04, 1.0, 8.0, 0.16),
    (0.0, 20.0, 2.0, 0.5, 8.0, 0.18),
    (0.0, 20.0, 0.5, 0.5, 4.0, 0.1),
    (0.0, 12.0, 0.26, 0.5, 4.0, 0.08),
    (0.0, 30.0, 1.0, 0.5, 10.0, 0.18),
    (0.0, 8.0, 0.5, 0.7, 4.0, 0.08),
    (0.0, 40.0, 1.0, 0.5, 8.0, 0.2),
    (0.0, 10.0, 1.04, 0.5, 8.0, 0.11),
    (0.0, 15.0, 0.78, 0.5, 6.0, 0.12),
    (0.0, 12.0, 1.6, 0.8, 8.0, 0.14),
    (0.0, 10.0, 2.0, 0.5, 8.0, 0.15),
    (0.0, 15.0, 1.5, 0.5, 6.0, 0.14),
    (0.0, 12.0, 1.0, 0.8, 4.0, 0.11),
    (3.0, 1.0, 0.64, 0.5, 8.0, 0.1),
    (3.5, 1.5, 1.0, 0.5, 8.0, 0.1),
    (2.5, 1.0, 0.5, 0.5, 4.0, 0.08),
)
CASES = tuple(
    Case(
        flat, edge, depth, friction, 0.48, 5.0 * thickness, thickness, cell, flat > 0 or edge != 20
    )
    for flat, edge, depth, friction, thickness, cell in _SIZES
)
"""Spheres of 20 mm, on which the size of the model's error was chosen, other spheres, punches."""


class Fit(NamedTuple):
    """Errors of fitted numbers.

    Attributes:
        case: the contact.
        way: model of the fit, one of `WAYS`.
        turn_deg: twist of the second frame [deg].
        noise_um: noise of the markers in the plane [µm].
        errors: relative errors of `NUMBERS`; NaN if undetermined [-].
        half_widths: relative half-widths of the 95 % intervals; NaN without one [-].
        held: whether the intervals hold the truth.
    """

    case: Case
    way: str
    turn_deg: int
    noise_um: float
    errors: Float[np.ndarray, "4"]
    half_widths: Float[np.ndarray, "4"]
    held: Bool[np.ndarray, "4"]


def compute(quick: bool = False, track: Track = iter) -> list[Fit]:
    """Fit every case, in about twenty minutes; the quick size is one case with the corrections."""
    stored = read_fields()
    if quick:
        return [fit_one(CASES[11], stored[11], "finite strain", 20, 1.0)]
    jobs = [
        (i, way, turn, noise)
        for way in WAYS
        for i in range(len(CASES))
        for turn in (10, 20)
        for noise in ((1.0, 10.0) if way == "finite strain" else (1.0,))
    ]
    return [fit_one(CASES[i], stored[i], *how) for i, *how in track(jobs)]


def read_fields() -> list[TurnedContact]:
    """The contacts of `CASES`, from the stored file: pressed, turned by 10° and by 20°."""
    return read_contacts(FILE, len(CASES))


def fit_one(case: Case, pressed: TurnedContact, way: str, turn_deg: int, noise_um: float) -> Fit:
    """Fit the numbers of a contact.

    Args:
        case: the contact.
        pressed: its solution.
        way: model of the fit, one of `WAYS`.
        turn_deg: twist of the second frame, 10 or 20 [deg].
        noise_um: noise of the markers in the plane [µm].
    """
    scale = SIDE / (4.0 * pressed.contact_mm)  # one grid, so that one program fits all contacts
    model, known, sought = _plan(case, way, turn_deg, scale)
    errors = 1e-3 * noise_um * scale * np.array([1.0, 1.0, 3.0])
    rows = [0, (0, 10, 20).index(turn_deg)]
    if way == WAYS[-1]:
        seen = _predict(model, {n: jnp.asarray(value) for n, value in (known | sought).items()})
        exact = [np.asarray(part) for part in seen[:3]]
    else:
        moved, _ = move_markers(_scaled(pressed.surface, scale), _at_top(model.markers))
        force = np.pad(-pressed.force[rows, None] * scale**2, [(0, 0), (2, 0)])
        exact = [moved[rows], force, pressed.moment[rows] * scale**3]
    scales = errors, _FORCE_N * scale**2, _MOMENT_NMM * scale**3
    rng = np.random.default_rng(0)
    noisy = [
        part + error * rng.normal(size=part.shape)
        for part, error in zip(exact, scales, strict=True)
    ]
    data = FieldData(noisy[0], tuple(errors), noisy[1], scales[1], noisy[2], scales[2])
    unknown = {name: Unknown(_OFF * value, *_BOUNDS[name]) for name, value in sought.items()}
    if case.flat_mm:
        low = 1.02 * case.edge_mm * scale
        unknown["radius"] = Unknown(_OFF * sought["radius"], low, _BOUNDS["radius"][1])
    fit = fit_fields(model, known | unknown, data, discrepancy=way != "linear")
    places = [fit.names.index(name) for name in NUMBERS]
    truth = np.array([sought[name] for name in NUMBERS])
    value, low, high = (part[places] for part in (fit.values, fit.low, fit.high))
    held = (low <= truth) & (truth <= high)
    return Fit(case, way, turn_deg, noise_um, value / truth - 1, 0.5 * (high - low) / truth, held)


_predict = eqx.filter_jit(FieldModel.predict)


def _plan(
    case: Case, way: str, turn_deg: int, scale: float
) -> tuple[FieldModel, dict[str, Any], dict[str, float]]:
    """Model, known numbers and true values of the others; lengths times a scale."""
    at = 0.5 * SIDE * 0.95 * np.linspace(-1.0, 1.0, 20)
    markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    shape = "disc" if case.flat_mm else "sphere"
    scene = press_and_move(shape, finite_strain=way != "linear")
    known = {"poisson_ratio": case.poisson_ratio, "twist": np.radians([0.0, turn_deg])}
    if case.flat_mm:
        known["edge_radius"] = scale * case.edge_mm
    sought = {
        "shear_modulus": SHEAR_MODULUS,
        "thickness": scale * case.thickness_mm,
        "friction_coefficient": case.friction,
        "radius": scale * (case.flat_mm + case.edge_mm),
        "approach": scale * case.depth_mm,
    }
    return FieldModel(scene, Grid((_CELLS, _CELLS), (SIDE, SIDE)), markers, 2), known, sought


def _scaled(surface: Surface, scale: float) -> Surface:
    return surface._replace(radius=scale * surface.radius, moved=scale * surface.moved)


def _at_top(markers: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    return np.pad(markers, [(0, 0), (0, 1)])


def solve(case: Case) -> TurnedContact:
    """Solve a contact with the finite elements."""
    path = press_and_turn(case.depth_mm, _PRESSES, _TURNS_DEG)
    return solve_turned(case, path, _KEPT, 3.2)


def tables(result: list[Fit]) -> dict[str, list[dict[str, object]]]:
    """A row for each fit, and a summary of each group of cases."""
    rows: list[dict[str, object]] = []
    for fit in result:
        row: dict[str, object] = {
            "group": _group(fit.case),
            "object": f"{fit.case.edge_mm:g}, flat {fit.case.flat_mm:g}",
            "thickness [mm]": fit.case.thickness_mm,
            "depth/h": round(fit.case.depth_mm / fit.case.thickness_mm, 3),
            "μ": fit.case.friction,
            "model": fit.way,
            "twist [°]": fit.turn_deg,
            "noise [µm]": fit.noise_um,
        }
        for name, error, width in zip(NUMBERS, fit.errors, fit.half_widths, strict=True):
            row[f"{name} [%]"] = f"{100 * error:.1f} ± {100 * width:.1f}"
        rows.append(row)
    return {"": rows, "_summary": _summarise(result)}


def _group(case: Case) -> str:
    return "punch" if case.flat_mm else "other sphere" if case.held_out else "sphere, 20 mm"


def _summarise(result: list[Fit]) -> list[dict[str, object]]:
    groups = {(fit.way, fit.noise_um, _group(fit.case)): None for fit in result}
    rows: list[dict[str, object]] = []
    for way, noise, group in groups:
        fits = [f for f in result if (f.way, f.noise_um, _group(f.case)) == (way, noise, group)]
        errors, widths, held = (
            np.stack([getattr(fit, name) for fit in fits])
            for name in ("errors", "half_widths", "held")
        )
        given = np.isfinite(widths)
        row: dict[str, object] = {
            "model": way,
            "noise [µm]": noise,
            "group": group,
            "numbers": errors.size,
            "within 3 % [%]": round(100 * float(np.mean(np.abs(errors) <= 0.03))),
            "with an interval": int(given.sum()),
            "hold [%]": round(100 * float(held[given].mean())) if given.any() else None,
        }
        for i, name in enumerate(NUMBERS):
            largest = 100 * float(np.nanmax(np.abs(errors[:, i])))
            half = 100 * float(np.nanmedian(widths[:, i])) if given[:, i].any() else np.nan
            row[f"{name}, largest error [%]"] = round(largest, 1)
            row[f"{name}, median half-width [%]"] = round(half, 2) if np.isfinite(half) else None
        rows.append(row)
    return rows


def plot(result: list[Fit]) -> Figure:
    """Errors of the numbers with their intervals, one row for each case, turned by 20°."""
    shown = [fit for fit in result if fit.way == "finite strain" and fit.turn_deg == 20]
    shown = [fit for fit in shown if fit.noise_um == 1.0]
    size = (12.0, 1.5 + 0.3 * len(shown))
    figure, axes = plt.subplots(1, len(NUMBERS), figsize=size, sharey=True, layout="constrained")
    for i, (axis, name) in enumerate(zip(axes, NUMBERS, strict=True)):
        for row, fit in enumerate(shown):
            error, half = 100 * fit.errors[i], 100 * np.nan_to_num(fit.half_widths[i])
            axis.errorbar(error, row, xerr=half, fmt="o", ms=3, color="C0" if fit.held[i] else "C3")
        axis.axvspan(-3.0, 3.0, color="0.9", zorder=0)
        finish(axis, title=name.replace("_", " "), xlabel="error [%]")
    names = [f"{_group(f.case)} {f.case.edge_mm:g}, h {f.case.thickness_mm:g}" for f in shown]
    axes[0].set_yticks(range(len(shown)), names, fontsize=8)
    axes[0].invert_yaxis()
    return figure


def main() -> None:
    """Solve the cases, and write them to the stored file."""
    solved = []
    for case in CASES:
        solved.append(solve(case))
        print(f"{case}: contact radius {solved[-1].contact_mm:.2f} mm")
    write_contacts(FILE, solved)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
