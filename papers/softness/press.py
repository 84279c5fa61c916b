"""The real presses `tac3d-press`: shear modulus and thickness of the pad from fields and forces.

The last press, of something round that is then twisted to and fro, is fitted frame by frame with a
flat bonded layer, the pad's curvature counted to the object's. (The presses before are of two
bumps.) Numbers of one pad must agree between frames, and stay where they are without the recorded
moment, which is some 1.4 times that of the recorded marker forces, and on a finer grid.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from calibration.experiment import Experiment, read_experiment
from calibration.field_fit import fit_fields
from calibration.field_result import FieldFit
from contactmodel import Grid
from estimation.frames import datasets
from estimation.frames.recording import Recording
from estimation.sources import find_recordings, read_recording
from papers.items import Track

FRAMES = (180, 186, 192, 198, 204, 210)
TESTED = 192
"""The frame that the variants are fitted to."""

FINE_CELLS = 48
_SHOWN = ("shear_modulus", "thickness", "friction_coefficient", "radius", "twist")


class Press(NamedTuple):
    """One fit.

    Attributes:
        frame: of the recording.
        variant: how it was fitted.
        fit: what came out.
        moved: measured displacement of its markers [mm].
        markers: where they are [mm].
        force: recorded normal force [N].
        moment: recorded, about the grid's origin [N·mm].
    """

    frame: int
    variant: str
    fit: FieldFit
    moved: Float[np.ndarray, "n 3"]
    markers: Float[np.ndarray, "n 2"]
    force: float
    moment: float


def compute(quick: bool = False, track: Track = iter) -> list[Press]:
    """Fit the frames, and one of them in other ways."""
    recording = read_recording(find_recordings(datasets.fetch("tac3d-press"))[0])
    plan = read_experiment("tac3d_press")
    fine = replace(plan, grid=Grid((FINE_CELLS, FINE_CELLS), plan.grid.size))
    jobs = [(plan, frame, "all") for frame in FRAMES]
    jobs += [
        (plan, TESTED, "no moment"),
        (fine, TESTED, f"{FINE_CELLS}² cells"),
        (_incompressible(plan), TESTED, "ν = 0.499"),
    ]
    return [_fit(recording, *job) for job in track(jobs[2:3] if quick else jobs)]


def _incompressible(plan: Experiment) -> Experiment:
    return replace(plan, numbers={**plan.numbers, "poisson_ratio": np.asarray(0.499)})


def _fit(recording: Recording, plan: Experiment, frame: int, variant: str) -> Press:
    model, data = replace(plan, frames=(frame,)).of(recording)
    assert data.force is not None
    assert data.moment is not None
    told = data._replace(moment=np.full(1, np.nan)) if variant == "no moment" else data
    fit = fit_fields(model, plan.numbers, told)
    force, moment = float(-data.force[0, 2]), float(data.moment[0])
    return Press(frame, variant, fit, data.displacement[0], model.markers, force, moment)


def tables(result: list[Press]) -> dict[str, list[dict[str, object]]]:
    """Numbers, their ranges where data are left out, the residual and χ²."""
    return {
        "": [
            {
                "frame": one.frame,
                "fitted": one.variant,
                "force [N]": round(one.force, 2),
                "moment [N·mm]": round(one.moment, 1),
                **{_TITLES[name]: _show(one.fit, name) for name in _SHOWN},
                "residual motion [%]": round(100 * one.fit.residual_share, 1),
                "χ² by freedom": round(one.fit.misfit),
            }
            for one in result
        ]
    }


_TITLES: Mapping[str, str] = {
    "shear_modulus": "G [MPa]",
    "thickness": "h [mm]",
    "friction_coefficient": "μ",
    "radius": "R [mm]",
    "twist": "twist [°]",
}


def _show(fit: FieldFit, name: str) -> str:
    """A number with its range over the parts left out (no interval), or that there is none."""
    i = fit.names.index(name)
    if not fit.determined[i]:
        return "undetermined"
    scale = 180.0 / np.pi if name == "twist" else 1.0
    value, low, high = (scale * float(part[i]) for part in (fit.values, *fit.span))
    return f"{value:.3g} ({low:.3g} to {high:.3g}{', or none' if fit.hangs_on(i) else ''})"


def plot(result: list[Press]) -> Figure:
    """Measured displacement, and what the model leaves of it, of the variants' frame."""
    one = next(press for press in result if press.frame == TESTED)
    left = 1e3 * one.fit.residual[0]
    top = float(np.nanmax(np.abs(left)))
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.4), layout="constrained")
    shown = (
        (1e3 * one.moved[:, 2], "u_z [µm]", {"cmap": "viridis"}),
        *(
            (left[:, i], f"residual of u_{axis} [µm]", {"cmap": "RdBu", "vmin": -top, "vmax": top})
            for i, axis in enumerate("xyz")
        ),
    )
    for axis, (value, title, colours) in zip(axes, shown, strict=True):
        points = axis.scatter(*one.markers.T, c=value, s=26, marker="s", **colours)
        figure.colorbar(points, ax=axis, shrink=0.8)
        axis.set(title=title, aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes[0].quiver(*one.markers.T, *one.moved[:, :2].T, angles="xy", width=4e-3)
    return figure
