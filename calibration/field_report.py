"""Results of field fits and designs: numbers, figures and a page."""

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from calibration.field_result import NOT_COVERED, FieldData, FieldFit
from calibration.forward import UNITS
from calibration.identifiability import Identifiability
from contactmodel import Pad
from estimation.frames.files import write_json
from estimation.output.report import figure_png, render_page, write_page

_MOST_FRAMES = 4
_HELPS = 3


def write_fit(
    fit: FieldFit,
    data: FieldData,
    markers: Float[np.ndarray, "n 2"],
    frames: tuple[int, ...],
    folder: Path,
) -> None:
    """Write `field.json`, `report.html` and its pictures, with markers [mm] and a recording's rows.

    Raises:
        OSError: a file cannot be written.
    """
    rows = [_row(fit, i) for i in range(len(fit.names))]
    summary = {
        "numbers": rows,
        "misfit": fit.misfit,
        "misfit_by_kind": dict(fit.misfits),
        "p_value": fit.p_value,
        "model_describes_data": fit.trusted,
        "model_error_share": fit.discrepancy,
        "converged": fit.converged,
        "steps": fit.steps,
        "share_of_starts_that_agree": fit.agreeing,
        "covariance_of_coordinates": fit.covariance.tolist(),
        "best": {name: np.asarray(value).tolist() for name, value in fit.best.items()},
        "forces_N": {"measured": _plain(data.force), "model": fit.predicted.force.tolist()},
        "moments_Nmm": {"measured": _plain(data.moment), "model": fit.predicted.moment.tolist()},
        "verdict": fit.verdict,
    }
    images = {
        "residuals.png": figure_png(plot_residuals(fit, data, markers, frames)),
        "correlation.png": figure_png(plot_correlation(fit.names, fit.correlation)),
    }
    _write(folder, "field", images, summary, fit=fit, data=data, frames=frames)


def find_pad(fit: FieldFit, known: Pad) -> Pad | None:
    """The pad with its fitted numbers and those that the fit assumed.

    Returns:
        The pad; None if the fit determined no number of it.
    """
    own = {field.name for field in fields(Pad)} - {"radius"}  # the fitted radius is the object's
    unknown = {name for name in fit.names if name in own}
    fitted = {
        name: float(value)
        for name, value in zip(fit.names, fit.values, strict=True)
        if name in own and fit.trusted and np.isfinite(value)
    }
    assumed = {name: float(fit.best[name]) for name in own - unknown if name in fit.best}
    return replace(known, **assumed, **fitted) if fitted else None


def format_numbers(fit: FieldFit) -> list[str]:
    """A line for each determined number: its value, and its interval or range."""
    lines = []
    for row in (_in_degrees(_row(fit, i)) for i in range(len(fit.names)) if fit.determined[i]):
        ends = (row["low"], row["high"]) if fit.trusted else row["left_out_range"]
        what = "95 % interval" if fit.trusted else "with a part of the data left out"
        lost = (
            "" if fit.trusted else "".join(f"; undetermined without {n}" for n in row["depends_on"])
        )
        shown = f"{what} {ends[0]:.4g} to {ends[1]:.4g}{lost}"
        unit = {"-": "", "°": "°"}.get(row["unit"], f" {row['unit']}")
        lines.append(f"{row['name']} = {row['value']:.4g}{unit} ({shown})")
    return lines


def write_design(prediction: Identifiability, folder: Path) -> None:
    """Write `design.json`, `report.html` and its picture.

    Raises:
        OSError: a file cannot be written.
    """
    rows = [
        {
            "name": name,
            "unit": _unit(name),
            "value": _figure(prediction.values[i]),
            "determined": bool(prediction.determined[i]),
            "low": _figure(prediction.low[i]) if prediction.determined[i] else None,
            "high": _figure(prediction.high[i]) if prediction.determined[i] else None,
            "standard_error_of_coordinate": _figure(prediction.errors[i]),
            "shares": {what: _figure(share[i]) for what, share in prediction.shares.items()},
            "helps": [list(improvement) for improvement in prediction.helps[name][:_HELPS]],
        }
        for i, name in enumerate(prediction.names)
    ]
    warnings = [] if prediction.covered else [NOT_COVERED]
    summary = {"numbers": rows, "unseen": list(prediction.unseen), "warnings": warnings}
    images = {
        "correlation.png": figure_png(plot_correlation(prediction.names, prediction.correlation)),
    }
    _write(folder, "design", images, summary)


def plot_residuals(
    fit: FieldFit,
    data: FieldData,
    markers: Float[np.ndarray, "n 2"],
    frames: tuple[int, ...],
) -> Figure:
    """Plot measured displacements and residuals of the first frames."""
    count = min(len(frames), _MOST_FRAMES)
    figure, axes = plt.subplots(
        count, 4, figsize=(13.0, 3.0 * count), squeeze=False, layout="constrained"
    )
    for row, frame in enumerate(frames[:count]):
        moved, residual = data.displacement[row], 1e3 * fit.residual[row]
        shown = (
            (axes[row, 0], 1e3 * moved[:, 2], moved, f"frame {frame}: u_z [µm]", "viridis"),
            (axes[row, 1], residual[:, 0], None, "residual of u_x [µm]", "RdBu"),
            (axes[row, 2], residual[:, 1], None, "residual of u_y [µm]", "RdBu"),
            (axes[row, 3], residual[:, 2], None, "residual of u_z [µm]", "RdBu"),
        )
        top = np.nanmax(np.abs(residual))
        for axis, value, arrows, title, colours in shown:
            limits = {} if arrows is not None else {"vmin": -top, "vmax": top}
            points = axis.scatter(*markers.T, c=value, s=26, marker="s", cmap=colours, **limits)
            figure.colorbar(points, ax=axis, shrink=0.8)
            if arrows is not None:
                axis.quiver(*markers.T, arrows[:, 0], arrows[:, 1], angles="xy", width=4e-3)
            axis.set(title=title, aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    return figure


def plot_correlation(names: tuple[str, ...], correlation: Float[np.ndarray, "p p"]) -> Figure:
    """Plot the correlations of the fitted numbers."""
    size = 3.0 + 0.4 * len(names)
    figure, axis = plt.subplots(figsize=(size + 1.0, size), layout="constrained")
    image = axis.imshow(correlation, cmap="RdBu", vmin=-1.0, vmax=1.0)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axis.set_yticks(range(len(names)), names)
    if len(names) <= 12:
        for (i, j), value in np.ndenumerate(correlation):
            dark = abs(value) > 0.6
            colour = "white" if dark else "black"
            axis.text(j, i, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    figure.colorbar(image, ax=axis, shrink=0.8, label="correlation")
    return figure


def _row(fit: FieldFit, i: int) -> dict[str, Any]:
    return {
        "name": fit.names[i],
        "unit": _unit(fit.names[i]),
        "determined": bool(fit.determined[i]),
        "value": _figure(fit.values[i]),
        "low": _figure(fit.low[i]),
        "high": _figure(fit.high[i]),
        "left_out": {what: _figure(values[i]) for what, values in fit.left_out.items()},
        "left_out_range": [_figure(end[i]) for end in fit.span],
        "depends_on": fit.depends_on(i),
    }


def _in_degrees(row: dict[str, Any]) -> dict[str, Any]:
    """A row for readers: an angle is in degrees there, and in rad in the JSON file."""
    if row["unit"] != "rad":
        return row

    def turned(value: float | None) -> float | None:
        return None if value is None else float(np.degrees(value))

    shown = row | {name: turned(row[name]) for name in ("value", "low", "high")}
    if "left_out_range" in row:
        shown["left_out_range"] = [turned(end) for end in row["left_out_range"]]
    return shown | {"unit": "°"}


def _unit(name: str) -> str:
    return UNITS.get(name.split("[")[0], "")


def _figure(value: Any) -> float | None:
    """A value with six digits; None if it is not finite."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _plain(values: np.ndarray | None) -> list | None:
    return None if values is None else values.tolist()


def _write(
    folder: Path, kind: str, images: Mapping[str, bytes], summary: Mapping[str, Any], **others: Any
) -> None:
    """Write the result file, the pictures, and the page that contains the pictures."""
    write_json(folder / f"{kind}.json", summary)
    shown = {**summary, "numbers": [_in_degrees(row) for row in summary["numbers"]]}
    page = render_page(f"{kind}.html", images, package="calibration", summary=shown, **others)
    write_page(folder, images, page)
