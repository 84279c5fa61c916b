"""Errors of the contact model at finite strain, with plain and corotated poses.

The reference is `reference.csv`, from finite elements. Left: error of the force when pressed.
Middle: error of the moment while the object turns up to 25°. Right: error of the moment in the last
steps back. The folder's README gives the errors that a user can expect.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel import Layer, Pose, solve_path
from papers.finite_strain.model import make_contact
from papers.finite_strain.reference import Turned, read_reference
from papers.finite_strain.settings import CASES, SHEAR_MODULUS, THICKNESS, Case
from papers.items import Track

WAYS = ("plain", "corotated")

_RISING, _BACK = slice(1, 6), slice(7, 9)


class Off(NamedTuple):
    """Relative errors of the model's force and moment.

    Attributes:
        force: error of the force over the reference's, by step [-].
        moment: error of the moment over the reference's, by step; on the way back over the
            reference's moment at the largest angle [-].
    """

    force: Float[np.ndarray, " steps"]
    moment: Float[np.ndarray, " steps"]


def compute(quick: bool = False, track: Track = iter) -> dict[Case, dict[str, Off]]:
    """Solve each case with plain and corotated poses; the quick size has three cases."""
    cases = (CASES[0], CASES[1], CASES[8]) if quick else CASES
    return {case: {way: _compare(case, way) for way in WAYS} for case in track(cases)}


def _compare(case: Case, way: str) -> Off:
    reference = read_reference()[case]
    force, moment = _solve(case, reference, corotated=way == "corotated")
    peak = reference.moment_nmm[_RISING.stop - 1]
    scale = np.where(np.arange(len(moment)) < _RISING.stop, reference.moment_nmm, peak)
    error = (moment - reference.moment_nmm) / np.where(scale == 0.0, np.inf, scale)
    error[0] = 0.0
    return Off(force / reference.force_n - 1.0, error)


def _solve(case: Case, reference: Turned, *, corotated: bool) -> tuple[np.ndarray, np.ndarray]:
    side = 2.0 * (1.15 * reference.contact_mm + 0.4)
    gel = Layer(SHEAR_MODULUS, case.poisson_ratio, THICKNESS)
    contact = make_contact(gel, case.flat_mm, case.edge_mm, case.friction, side)
    twist = np.radians(reference.angle_deg)
    path = solve_path(contact, Pose(case.depth_mm, twist=twist, corotated=corotated), rtol=1e-5)
    return -np.asarray(path.force[:, 2]), np.asarray(path.moment)


def tables(result: dict[Case, dict[str, Off]]) -> dict[str, list[dict[str, object]]]:
    """A row for each case and way."""
    rows: list[dict[str, object]] = []
    for case, ways in result.items():
        for way, error in ways.items():
            angles = read_reference()[case].angle_deg
            rows.append({
                "object": f"punch {case.flat_mm:g}" if case.flat_mm else f"R {case.edge_mm:g}",
                "depth/h": round(case.depth_mm / THICKNESS, 3),
                "a/h": round(read_reference()[case].contact_mm / THICKNESS, 2),
                "pad [mm]": case.pad_mm,
                "way": way,
                "force [%]": round(100.0 * float(error.force[0]), 1),
                **{
                    f"moment, {angles[i]:g}° [%]": round(100.0 * float(error.moment[i]), 1)
                    for i in (1, 2, 4, 5)
                },
                "moment, back [% of peak]": round(100.0 * float(error.moment[-1]), 1),
            })  # fmt: skip
    return {"": rows}


def plot(result: dict[Case, dict[str, Off]]) -> Figure:
    """Errors over depth; open symbols: pads narrower than 30 mm."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
    titles = "force, pressed", "moment, 5 to 25°", "moment, way back"
    for case, ways in result.items():
        depth = case.depth_mm / THICKNESS
        for shift, (way, error) in zip((-0.002, 0.002), ways.items(), strict=True):
            spans = error.force[:1], error.moment[_RISING], error.moment[_BACK]
            colour = "C0" if way == "plain" else "C1"
            face = colour if case.pad_mm >= 30.0 else "none"
            mark = "s" if case.flat_mm else "o"
            for axis, values in zip(axes, spans, strict=True):
                at = np.full(len(values), depth + shift)
                axis.plot(at, 100.0 * values, "-", color=colour, lw=1)
                axis.plot(at, 100.0 * values, mark, ms=5, color=colour, mfc=face)
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("depth over thickness [-]")
        axis.axhline(0.0, color="k", lw=0.8)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("model over reference − 1 [%]")
    for name, style in (
        ("plain", {"color": "C0", "marker": "o"}),
        ("corotated", {"color": "C1", "marker": "o"}),
        ("punch", {"color": "k", "marker": "s"}),
        ("pad of 12 or 16 mm", {"color": "k", "marker": "o", "mfc": "none"}),
    ):
        axes[2].plot([], [], ls="", label=name, **style)
    axes[2].legend(fontsize=8)
    return figure
