"""The real presses `tac3d-press`: shear modulus and thickness of the pad from fields and forces.

In the last press a round object is twisted to and fro. Its frames are fitted one by one with a flat
bonded layer; the object's curvature includes the pad's. (In the earlier presses the object has two
bumps.) The pad's numbers must agree between frames. They must not change on a finer grid, nor
without the recorded moment, which is about 1.4 times that of the recorded marker forces.
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
"""The frame to which all variants are fitted."""

FINE_CELLS = 48
_SHOWN = ("shear_modulus", "thickness", "friction_coefficient", "radius", "twist")


class Press(NamedTuple):
    """The fit of one frame."""

    frame: int  # frame of the recording
    variant: str  # variant of the fit
    fit: FieldFit  # result of the fit
    moved: Float[np.ndarray, "n 3"]  # measured displacement of the markers [mm]
    markers: Float[np.ndarray, "n 2"]  # positions of the markers [mm]
    force: float  # recorded normal force [N]
    moment: float  # recorded moment about the grid's origin [N·mm]


def compute(quick: bool = False, track: Track = iter) -> list[Press]:
    """Fit the frames, and one of them in several variants."""
    recording = read_recording(find_recordings(datasets.fetch("tac3d-press"))[0])
    plan = read_experiment("tac3d_press")
    fine = replace(plan, grid=Grid((FINE_CELLS, FINE_CELLS), plan.grid.size))
    jobs = [(plan, frame, "all") for frame in FRAMES]
    stiff = replace(plan, numbers={**plan.numbers, "poisson_ratio": np.asarray(0.499)})
    jobs += [
        (plan, TESTED, "no moment"),
        (fine, TESTED, f"{FINE_CELLS}² cells"),
        (stiff, TESTED, "ν = 0.499"),
    ]
    return [_fit(recording, *job) for job in track(jobs[2:3] if quick else jobs)]


def _fit(recording: Recording, plan: Experiment, frame: int, variant: str) -> Press:
    model, data = replace(plan, frames=(frame,)).of(recording)
    assert data.force is not None
    assert data.moment is not None
    fitted_data = data._replace(moment=np.full(1, np.nan)) if variant == "no moment" else data
    fit = fit_fields(model, plan.numbers, fitted_data)
    force, moment = float(-data.force[0, 2]), float(data.moment[0])
    return Press(frame, variant, fit, data.displacement[0], model.markers, force, moment)


def tables(result: list[Press]) -> dict[str, list[dict[str, object]]]:
    """The fitted numbers, their ranges with parts of the data left out, residual and χ²."""
    return {
        "": [
            {
                "frame": press.frame,
                "fitted": press.variant,
                "force [N]": round(press.force, 2),
                "moment [N·mm]": round(press.moment, 1),
                **{_TITLES[name]: _show(press.fit, name) for name in _SHOWN},
                "residual motion [%]": round(100 * press.fit.residual_share, 1),
                "χ² by freedom": round(press.fit.misfit),
            }
            for press in result
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
    """A number with its range over the left-out parts (not an interval); or `undetermined`."""
    i = fit.names.index(name)
    if not fit.determined[i]:
        return "undetermined"
    scale = 180.0 / np.pi if name == "twist" else 1.0
    value, low, high = (scale * float(part[i]) for part in (fit.values, *fit.span))
    return f"{value:.3g} ({low:.3g} to {high:.3g}{', or none' if fit.depends_on(i) else ''})"


def plot(result: list[Press]) -> Figure:
    """Measured displacement, and its residual by component, in the variants' frame."""
    tested = next(press for press in result if press.frame == TESTED)
    residual = 1e3 * tested.fit.residual[0]
    top = float(np.nanmax(np.abs(residual)))
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.4), layout="constrained")
    about = {"cmap": "RdBu", "vmin": -top, "vmax": top}
    shown = (
        (1e3 * tested.moved[:, 2], "u_z [µm]", {"cmap": "viridis"}),
        *((residual[:, i], f"residual of u_{axis} [µm]", about) for i, axis in enumerate("xyz")),
    )
    for axis, (value, title, colours) in zip(axes, shown, strict=True):
        points = axis.scatter(*tested.markers.T, c=value, s=26, marker="s", **colours)
        figure.colorbar(points, ax=axis, shrink=0.8)
        axis.set(title=title, aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes[0].quiver(*tested.markers.T, *tested.moved[:, :2].T, angles="xy", width=4e-3)
    return figure
