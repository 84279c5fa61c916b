"""Force and moment of a neo-Hookean gel under an object that is pressed on, turned, turned back.

The finite elements of `gel` and `press` solve it (extra `finite-elements`). The repository contains
this item's table as `reference.csv`, so that the atlas and the tests need no finite elements. The
figure compares a new run with that table.
"""

import csv
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.press import Round, press
from papers.finite_strain.settings import (
    CASES,
    KEPT,
    PRESSES,
    SHEAR_MODULUS,
    THICKNESS,
    TURNS_DEG,
    Case,
)
from papers.finite_strain.steps import press_and_turn
from papers.items import Track

FILE = Path(__file__).with_name("data") / "reference.csv"


class Turned(NamedTuple):
    """Solution of a case.

    Attributes:
        contact_mm: radius of the contact [mm].
        angle_deg: angle of the object, by step [deg].
        force_n: pressing force [N].
        moment_nmm: moment on the gel [N·mm].
    """

    contact_mm: float
    angle_deg: Float[np.ndarray, " steps"]
    force_n: Float[np.ndarray, " steps"]
    moment_nmm: Float[np.ndarray, " steps"]


Rows = list[dict[str, float]]


def read_steps(file: Path, fields: Sequence[str]) -> dict[tuple[float, ...], Rows]:
    """The rows of a shipped table by the values of some columns: the steps of each case."""
    steps: dict[tuple[float, ...], Rows] = {}
    with file.open(encoding="utf-8", newline="") as text:
        for cells in csv.DictReader(text):
            row = {name: float(value) for name, value in cells.items()}
            steps.setdefault(tuple(row[name] for name in fields), []).append(row)
    return steps


@cache
def read_reference() -> dict[Case, Turned]:
    """The cases of `reference.csv`."""
    return {
        Case(*case): Turned(
            rows[0]["contact_mm"],
            *(np.array([row[name] for row in rows]) for name in Turned._fields[1:]),
        )
        for case, rows in read_steps(FILE, Case._fields).items()
    }


def compute(quick: bool = False, track: Track = iter) -> dict[Case, Turned]:
    """Solve all cases; the quick size is the first case on coarse elements."""
    coarse = 3.0 if quick else 1.0
    return {case: _solve(case, coarse) for case in track(CASES[:1] if quick else CASES)}


def _solve(case: Case, coarse: float) -> Turned:
    gel = Gel(THICKNESS, case.pad_mm, SHEAR_MODULUS, case.poisson_ratio)
    touching = np.sqrt(2.0 * case.edge_mm * case.depth_mm)
    reach = case.flat_mm + 1.8 if case.flat_mm else 1.1 * touching + 0.8
    cell = coarse * (0.1 if case.flat_mm else 0.15)
    elements = cut(gel, cell, min(reach, case.pad_mm - 0.5), 1.3)
    shape = Round(case.flat_mm, case.edge_mm)
    path = press_and_turn(case.depth_mm, PRESSES, TURNS_DEG)
    solved = press(gel, elements, shape, case.friction, path)
    steps = list(KEPT)
    return Turned(
        contact_mm=float(solved.radius[solved.contact[PRESSES - 1]].max()),
        angle_deg=np.degrees([path[i].twist for i in steps]),
        force_n=solved.normal_force[steps],
        moment_nmm=solved.moment[steps],
    )


def tables(result: dict[Case, Turned]) -> dict[str, list[dict[str, object]]]:
    """A row for each case and step; with all cases the table equals `reference.csv`."""
    return {
        "": [
            {
                **case._asdict(),
                "contact_mm": round(turned.contact_mm, 2),
                "step": step,
                "angle_deg": round(float(turned.angle_deg[i]), 2),
                "force_n": float(f"{turned.force_n[i]:.5g}"),
                "moment_nmm": float(f"{turned.moment_nmm[i]:.5g}"),
            }
            for case, turned in result.items()
            for i, step in enumerate(KEPT)
        ]
    }


def plot(result: dict[Case, Turned]) -> Figure:
    """Moment over angle: this run (dots) and `reference.csv` (lines)."""
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for i, (case, turned) in enumerate(result.items()):
        shipped, colour = read_reference()[case], f"C{i % 10}"
        name = f"R {case.edge_mm:g}, face {case.flat_mm:g}, depth {case.depth_mm:g} mm"
        axis.plot(turned.angle_deg, turned.moment_nmm, "o", ms=4, color=colour, label=name)
        axis.plot(shipped.angle_deg, shipped.moment_nmm, "-", lw=1, color=colour)
    axis.set_xlabel("angle of the object [°]")
    axis.set_ylabel("moment on the gel [N·mm]")
    axis.set_title("dots: this run; lines: reference.csv", fontsize=10)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    return figure
