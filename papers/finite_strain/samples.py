"""Force and moment of neo-Hookean gels, to fit and to check the contact model's corrections.

The finite elements of `gel` and `press` solve the cases (extra `finite-elements`). The repository
contains this item's table as `samples.csv`. Rows with `held_out` are not used in the fit.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.press import Round, press
from papers.finite_strain.reference import read_steps
from papers.finite_strain.settings import SERIES, SHEAR_MODULUS, Series
from papers.finite_strain.steps import Motion
from papers.items import Track

FILE = Path(__file__).with_name("data") / "samples.csv"


class Sample(NamedTuple):
    """One contact that is pressed on and turned; lengths as in `Series`.

    Attributes:
        depth_mm: indentation depth [mm].
        growth: ratio of the sizes of neighbouring elements [-].
        held_out: whether the fit leaves the sample out.
        contact_mm: radius of the contact when pressed [mm].
        angle_deg: angle of the object, by step [deg].
        force_n: pressing force [N].
        moment_nmm: moment [N·mm].
    """

    flat_mm: float
    edge_mm: float
    depth_mm: float
    friction: float
    poisson_ratio: float
    pad_mm: float
    thickness_mm: float
    growth: float
    held_out: bool
    contact_mm: float
    angle_deg: Float[np.ndarray, " steps"]
    force_n: Float[np.ndarray, " steps"]
    moment_nmm: Float[np.ndarray, " steps"]


@cache
def read_samples() -> list[Sample]:
    """The shipped samples."""
    return [
        Sample._make(
            [
                *case[:8],
                bool(case[8]),
                case[9],
                *(np.array([row[name] for row in rows]) for name in Sample._fields[10:]),
            ]
        )
        for case, rows in read_steps(FILE, Sample._fields[:10]).items()
    ]


def compute(quick: bool = False, track: Track = iter) -> list[Sample]:
    """Solve all series, in about an hour; the quick size is one sample."""
    if quick:
        return [_solve(SERIES[-1], SERIES[-1].depths_mm[0])]
    return [_solve(series, depth) for series in track(SERIES) for depth in series.depths_mm]


def _solve(series: Series, depth: float) -> Sample:
    gel = Gel(series.thickness_mm, series.pad_mm, SHEAR_MODULUS, series.poisson_ratio)
    deepest = max(series.depths_mm)
    shape = Round(series.flat_mm, series.edge_mm)
    reach = shape.reach(deepest)
    elements = cut(gel, series.cell_mm, min(reach, series.pad_mm - 0.5), series.growth)
    even = np.linspace(0.0, deepest, series.presses + 1)[1:]
    presses = sorted({round(float(d), 9) for d in [*even, *series.depths_mm] if d <= depth + 1e-9})
    path = [Motion(d, 0.0) for d in presses]
    path += [Motion(depth, float(np.radians(angle))) for angle in series.turns_deg]
    solved = press(gel, elements, shape, series.friction, path, rtol=1e-6)
    turns = enumerate(series.turns_deg, len(presses))
    kept = [len(presses) - 1, *(i for i, angle in turns if angle in series.kept_deg)]
    return Sample(
        *series[:2],
        depth,
        *series[3:7],
        series.growth,
        series.held_out,
        float(solved.radius[solved.contact[kept[0]]].max()),
        np.degrees([path[i].twist for i in kept]),
        solved.normal_force[kept],
        solved.moment[kept],
    )


def tables(result: list[Sample]) -> dict[str, list[dict[str, object]]]:
    """A row for each sample and angle; with all samples the table equals `samples.csv`."""
    return {
        "": [
            {
                **{name: f"{value:g}" for name, value in zip(names, sample[:9], strict=True)},
                "contact_mm": round(sample.contact_mm, 2),
                "angle_deg": round(float(angle), 2),
                "force_n": float(f"{force:.5g}"),
                "moment_nmm": float(f"{moment:.5g}"),
            }
            for names in [Sample._fields[:9]]
            for sample in result
            for angle, force, moment in zip(*sample[10:], strict=True)
        ]
    }


def plot(result: list[Sample]) -> Figure:
    """Force over depth, each relative to gel and thickness; open symbols: held out."""
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for sample in result:
        height, face = sample.thickness_mm, "none" if sample.held_out else "C0"
        share = sample.force_n[0] / (SHEAR_MODULUS * height**2)
        axis.plot(sample.depth_mm / height, share, "o", ms=4, color="C0", mfc=face)
    axis.set_xlabel("depth over thickness [-]")
    axis.set_ylabel("force over Gh² [-]")
    axis.set_title("samples; open: held out of the fit", fontsize=10)
    axis.grid(alpha=0.3)
    return figure
