"""Figures of a contact: pressure, traction, stick and slip, and the course of a path."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from contactmodel.solution import ContactSolution

_STATES = ("open", "slip", "stick")
_COLOURS = ("#e8e8e8", "#e08214", "#2166ac")
_ARROWS = 24  # largest number along the longer side


def plot_pressure(solution: ContactSolution) -> Figure:
    """Plot the pressure p [MPa]."""
    figure, axes = _frame("Pressure", solution)
    _map(figure, axes, solution, solution.pressure, "p [MPa]")
    return figure


def plot_traction(solution: ContactSolution) -> Figure:
    """Plot size and direction of the traction on the elastomer [MPa]."""
    figure, axes = _frame("Traction on the elastomer", solution)
    _map(figure, axes, solution, _size(solution.traction), "|τ| [MPa]")
    _arrows(axes, solution, solution.traction)
    return figure


def plot_states(solution: ContactSolution) -> Figure:
    """Plot which cells are open, slip or stick."""
    figure, axes = _frame("Stick and slip", solution)
    axes.set_title(f"Stick and slip: {float(solution.stick_ratio):.0%} of the contact sticks")
    state = np.where(solution.stick, 2, np.where(solution.sliding, 1, 0))
    norm = BoundaryNorm([-0.5, 0.5, 1.5, 2.5], 3)
    _image(axes, solution, state, cmap=ListedColormap(_COLOURS), norm=norm)
    patches = [Patch(color=c, label=s) for c, s in zip(_COLOURS, _STATES, strict=True)]
    axes.legend(handles=patches, loc="upper right")
    return figure


def plot_slip(solution: ContactSolution) -> Figure:
    """Plot the slip of the object against the elastomer inside the contact [µm]."""
    figure, axes = _frame("Slip of the object against the elastomer", solution)
    slip = np.where(solution.contact, solution.slip, 0.0)
    _map(figure, axes, solution, 1e3 * _size(slip), "|s| [µm]")
    _arrows(axes, solution, slip)
    return figure


def plot_path(path: ContactSolution) -> Figure:
    """Plot force, moment, twist and the sticking fraction along a path."""
    if path.pressure.ndim != 3:
        raise ValueError("this is a single solution: plot_path takes those of solve_path")
    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    top, middle, bottom = figure.subplots(3, sharex=True)
    steps = np.arange(1, len(path.pressure) + 1)
    for values, name in zip(np.asarray(path.force).T, ("F_x", "F_y", "F_z"), strict=True):
        top.plot(steps, values, label=name)
    top.legend()
    top.set_ylabel("force [N]")
    middle.plot(steps, path.moment)
    middle.set_ylabel("moment [N·mm]")
    twist = middle.twinx()
    twist.plot(steps, np.degrees(path.pose.twist), color="C1", linestyle="--")
    twist.set_ylabel("twist [°] (dashed)")
    bottom.plot(steps, path.stick_ratio)
    bottom.set(ylabel="sticking fraction [-]", xlabel="step", ylim=(-0.05, 1.05))
    return figure


def _frame(title: str, solution: ContactSolution) -> tuple[Figure, Axes]:
    if solution.pressure.ndim != 2:
        raise ValueError("this is a path: plot one of its steps, at_step(-1), or use plot_path")
    figure = Figure(figsize=(5.2, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return figure, axes


def _image(axes: Axes, solution: ContactSolution, values, **style):
    x, y = (0.5 * length for length in solution.grid.size)
    return axes.imshow(np.asarray(values).T, origin="lower", extent=(-x, x, -y, y), **style)


def _map(figure: Figure, axes: Axes, solution: ContactSolution, values, label: str) -> None:
    shown = np.where(solution.contact, values, np.nan)
    figure.colorbar(_image(axes, solution, shown, vmin=0.0), label=label)


def _arrows(axes: Axes, solution: ContactSolution, field) -> None:
    """Draw a thinned-out arrow field, without arrows of length 0."""
    every = max(1, max(solution.grid.shape) // _ARROWS)
    thin = (slice(None), slice(every // 2, None, every), slice(every // 2, None, every))
    (x, y), (u, v) = solution.grid.points[thin], np.asarray(field)[thin]
    moving = np.hypot(u, v) > 0.0
    if not moving.any():
        return
    x, y, u, v = (part[moving] for part in (x, y, u, v))
    axes.quiver(x, y, u, v, angles="xy", pivot="mid", color="white")


def _size(field) -> np.ndarray:
    return np.hypot(*np.asarray(field))
