"""Cells of the tables, and the finish of the figures, of all items."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes


def cell(values: Any, digits: int, summary: Callable[[np.ndarray], Any] = np.mean) -> float | None:
    """A cell of a table: a summary of the known values, rounded; None without a known value.

    Args:
        values: a number or several; those that are not finite are unknown.
        digits: number of decimals.
        summary: maps the known values to a number.
    """
    known = _known(values)
    return round(float(summary(known)), digits) if known.size else None


def brief_cell(
    values: Any, digits: int = 3, summary: Callable[[np.ndarray], Any] = np.mean
) -> float | None:
    """A cell as by `cell`, rounded to a number of significant digits."""
    known = _known(values)
    return float(f"{summary(known):.{digits}g}") if known.size else None


def _known(values: Any) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    return values[np.isfinite(values)]


def finish(
    *axes: Axes,
    legend: int | None = None,
    minor: bool = False,
    title: str = "",
    size: int = 10,
    **labels: Any,
) -> None:
    """Label the axes of a figure, and draw their grid and, given its font size, their legend.

    Args:
        *axes: axes to finish in the same way.
        legend: font size of the legend; None for no legend.
        minor: whether minor ticks have grid lines too.
        title: title of the axes.
        size: font size of the title [pt].
        **labels: other properties of the axes, such as `xlabel`.
    """
    for axis in axes:
        axis.set(**labels)
        if title:
            axis.set_title(title, fontsize=size)
        axis.grid(alpha=0.3, which="both" if minor else "major")
        if legend is not None:
            axis.legend(fontsize=legend)
