"""Markers below the surface turn less than the object, even less on a thin elastomer.

Left: the missed share at the centre of a fully sticking disc on a half-space, from the closed form
and from the contact model. Right: the share that a rigid fit of the disc's inner 0.7 a misses, by
depth and thickness. The share is the same at every angle: calibrate the depth, or put the markers
at the surface.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel import Contact, Grid, HalfSpace, Layer, Pose, Rigid, RoundPunch, solve_contact
from estimation.fields.plane import fit_motion
from papers.items import Track
from papers.model_error import settings
from papers.tables import cell, finish

DEPTHS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)
"""z/a."""

THICKNESSES = (0.4, 0.6, 1.0, 2.0, np.inf)
"""h/a."""

INNER = 0.7
"""Share of the radius that the fit uses: the traction is singular at the edge."""

_CELLS = 48

_QUICK = (0.6, np.inf)


class Depth(NamedTuple):
    """Missed share of the turn [%]."""

    thicknesses: tuple[float, ...]  # solved values of h/a [-]
    closed: Float[np.ndarray, " depths"]  # share at the centre by the closed form, by depth
    centre: Float[np.ndarray, " depths"]  # share at the centre by the model, by depth
    fit: Float[np.ndarray, "thicknesses depths"]  # share of the rigid fit, by thickness and depth


def compute(quick: bool = False, track: Track = iter) -> Depth:
    """Solve a contact for each thickness; the quick size has two thicknesses."""
    thicknesses = _QUICK if quick else THICKNESSES
    missed = [_missed(thickness) for thickness in track(thicknesses)]
    z = np.array(DEPTHS)
    with np.errstate(divide="ignore"):
        closed = 2.0 / np.pi * (np.arctan2(1.0, z) - z / (1.0 + z**2))
    fits = np.array([fit for _, fit in missed])
    return Depth(thicknesses, 100.0 * (1.0 - closed), missed[-1][0], fits)


def _missed(thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Missed shares at the centre and of the rigid fit, by depth [%]."""
    radius, modulus, nu = settings.CONTACT_RADIUS, settings.SHEAR_MODULUS, settings.POISSON_RATIO
    pad = HalfSpace(modulus, nu) if np.isinf(thickness) else Layer(modulus, nu, thickness * radius)
    twist = 1e-3
    side = 2.5 * radius
    pose = Pose(0.5, twist=twist, linear=True)
    step = side / _CELLS  # at least a cell: the traction is constant over a cell
    grid = Grid((_CELLS, _CELLS), (side, side))
    # enough friction that all cells stick, even at the edge
    solution = solve_contact(Contact(pad, Rigid(), RoundPunch(radius), grid, 10.0), pose, rtol=1e-6)
    x, y = np.meshgrid(*[np.linspace(-INNER, INNER, 15) * radius] * 2)
    inner = np.hypot(x, y) < INNER * radius
    points = np.concatenate(
        [np.stack([x[inner], y[inner]], 1), np.eye(2) * step, -np.eye(2) * step]
    )
    centre, fit = [], []
    for depth in DEPTHS:
        moved = np.asarray(solution.elastomer_displacement_at(points, depth * radius))
        moved = moved[:, :2] @ [1.0, 1.0j]
        before = points @ [1.0, 1.0j]
        east, north, west, south = moved[-4:]
        curl = 0.5 * ((east - west).imag - (north - south).real) / (2.0 * step)
        turn = fit_motion(before[:-4], (before + moved)[:-4]).turn
        centre.append(100.0 * (1.0 - curl / twist))
        fit.append(100.0 * (1.0 - turn.imag / twist))  # pressing moves the markers radially
    return np.array(centre), np.array(fit)


def tables(result: Depth) -> dict[str, list[dict[str, object]]]:
    """A row for each depth."""
    return {
        "": [
            {
                "z/a": depth,
                "centre, closed form [%]": cell(result.closed[i], 2),
                "centre, model [%]": cell(result.centre[i], 2),
                **{
                    f"fit, h/a = {thickness:g} [%]": cell(result.fit[j, i], 2)
                    for j, thickness in enumerate(result.thicknesses)
                },
                "fit, thick, at 10° [°]": cell(0.1 * result.fit[-1, i], 3),
            }
            for i, depth in enumerate(DEPTHS)
        ]
    }


def plot(result: Depth) -> Figure:
    """Left: closed form and model at the centre. Right: the rigid fit by thickness."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    left.plot(DEPTHS, result.closed, "k-", label="closed form")
    left.plot(DEPTHS, result.centre, "o", label="contact model")
    left.set_ylabel("share of the turn that is missed [%]")
    for j, thickness in enumerate(result.thicknesses):
        name = f"h/a = {thickness:g}".replace("inf", "∞")
        right.plot(DEPTHS, result.fit[j], "o-", ms=4, label=name)
    titles = ("centre, half-space", f"rigid fit of the inner {INNER:g} a")
    for axis, title in zip((left, right), titles, strict=True):
        depth = "depth of the markers over contact radius z/a [-]"
        finish(axis, legend=8, title=title, xlabel=depth)
    return figure
