"""What the fit of fields and the look at a design write: numbers, pictures, a page."""

import json
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from calibration.field_result import FieldData, FieldFit
from calibration.forward import UNITS
from calibration.identifiability import Identifiability
from contactmodel import Pad
from estimation.frames.files import write_whole
from estimation.output.report import figure_png, render_page

_MOST_FRAMES = 4
_HELPS = 3


def write_fit(
    fit: FieldFit,
    data: FieldData,
    markers: Float[np.ndarray, "n 2"],
    frames: tuple[int, ...],
    folder: Path,
) -> None:
    """Write `field.json`, `report.html` and its pictures.

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
    """The pad with what a fit found of it and what it was fitted with; None if it found nothing.

    Args:
        fit: of numbers, some of which are the pad's.
        known: what was known of the pad before.
    """
    own = {one.name for one in fields(Pad)}
    sought = {name for name in fit.names if name in own}
    found = {
        name: float(value)
        for name, value in zip(fit.names, fit.values, strict=True)
        if name in own and fit.trusted and np.isfinite(value)
    }
    given = {name: float(fit.best[name]) for name in own - sought if name in fit.best}
    return replace(known, **given, **found) if found else None


def tell_numbers(fit: FieldFit) -> list[str]:
    """A line for each number that is determined: its value, and its interval or range."""
    lines = []
    for row in (_row(fit, i) for i in range(len(fit.names)) if fit.determined[i]):
        ends = (row["low"], row["high"]) if fit.trusted else row["left_out_range"]
        what = "95 % interval" if fit.trusted else "with a part of the data left out"
        lost = (
            "" if fit.trusted else "".join(f"; undetermined without {n}" for n in row["hangs_on"])
        )
        shown = f"{what} {ends[0]:.4g} to {ends[1]:.4g}{lost}"
        lines.append(f"{row['name']} = {row['value']:.4g} {row['unit']} ({shown})")
    return lines


def write_design(found: Identifiability, folder: Path) -> None:
    """Write `design.json`, `report.html` and its picture.

    Raises:
        OSError: a file cannot be written.
    """
    rows = [
        {
            "name": name,
            "unit": _unit(name),
            "value": _figure(found.values[i]),
            "determined": bool(found.determined[i]),
            "low": _figure(found.low[i]) if found.determined[i] else None,
            "high": _figure(found.high[i]) if found.determined[i] else None,
            "standard_error_of_coordinate": _figure(found.errors[i]),
            "shares": {what: _figure(share[i]) for what, share in found.shares.items()},
            "helps": [list(one) for one in found.helps[name][:_HELPS]],
        }
        for i, name in enumerate(found.names)
    ]
    summary = {"numbers": rows, "unseen": list(found.unseen)}
    images = {
        "correlation.png": figure_png(plot_correlation(found.names, found.correlation)),
    }
    _write(folder, "design", images, summary)


def plot_residuals(
    fit: FieldFit,
    data: FieldData,
    markers: Float[np.ndarray, "n 2"],
    frames: tuple[int, ...],
) -> Figure:
    """Measured displacement, and what the model leaves of it, of the first frames."""
    count = min(len(frames), _MOST_FRAMES)
    figure, axes = plt.subplots(
        count, 4, figsize=(13.0, 3.0 * count), squeeze=False, layout="constrained"
    )
    for row, frame in enumerate(frames[:count]):
        moved, left = data.displacement[row], 1e3 * fit.residual[row]
        shown = (
            (axes[row, 0], 1e3 * moved[:, 2], moved, f"frame {frame}: u_z [µm]", "viridis"),
            (axes[row, 1], left[:, 0], None, "residual of u_x [µm]", "RdBu"),
            (axes[row, 2], left[:, 1], None, "residual of u_y [µm]", "RdBu"),
            (axes[row, 3], left[:, 2], None, "residual of u_z [µm]", "RdBu"),
        )
        top = np.nanmax(np.abs(left))
        for axis, value, arrows, title, colours in shown:
            limits = {} if arrows is not None else {"vmin": -top, "vmax": top}
            points = axis.scatter(*markers.T, c=value, s=26, marker="s", cmap=colours, **limits)
            figure.colorbar(points, ax=axis, shrink=0.8)
            if arrows is not None:
                axis.quiver(*markers.T, arrows[:, 0], arrows[:, 1], angles="xy", width=4e-3)
            axis.set(title=title, aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    return figure


def plot_correlation(names: tuple[str, ...], correlation: Float[np.ndarray, "p p"]) -> Figure:
    """Correlations of what was sought."""
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
        "hangs_on": fit.hangs_on(i),
    }


def _unit(name: str) -> str:
    return UNITS.get(name.split("[")[0], "")


def _figure(value: Any) -> float | None:
    """Six digits, or none."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _plain(values: np.ndarray | None) -> list | None:
    return None if values is None else values.tolist()


def _write(
    folder: Path, kind: str, images: Mapping[str, bytes], summary: Mapping[str, Any], **others: Any
) -> None:
    """The result file, the pictures, and the page with the pictures inside."""
    write_whole(folder / f"{kind}.json", json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    for name, image in images.items():
        write_whole(folder / name, image)
    page = render_page(f"{kind}.html", images, package="calibration", summary=summary, **others)
    write_whole(folder / "report.html", page)
