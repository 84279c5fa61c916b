"""How well the markers show the contact's radius, by shape, thickness of the gel and noise.

Objects are pressed into layers and a half-space, solved with the contact model without friction.
Markers lie 1 or 1.5 mm apart, placed and turned at random; the noise of z is 3.5 times that of x
and y. No constant of the fit was chosen on these draws, but the power by which square corners fade
was chosen on the cube and the square punch, on layers of 2, 4 and 8 mm.
"""

from functools import cache
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy.interpolate import RectBivariateSpline

from contactmodel import (
    AbstractIndenter,
    Contact,
    Ellipsoid,
    Grid,
    HalfSpace,
    Layer,
    Pose,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
    solve_contact,
)
from estimation.fields.contact import CONTACT_SHARE, find_clear_edge
from estimation.fields.face import face_arm
from estimation.softness.contact import disc_radius
from papers.items import Track
from papers.virtual_pivots import settings

NOISES_MM = (1e-3, 3e-3, 1e-2)
"""Noise of x and y; that of z is 3.5 times larger [mm]."""
PITCHES_MM = (1.0, 1.5)
THICKNESSES_MM = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, np.inf)
DEEPEST = 0.22
"""Largest approach over the layer's thickness [-]."""
HERTZ_ARM = 3.0 * np.pi / 16.0
"""Arm of friction over the contact's radius under Hertz's pressure [-]."""
WIDTH_MM, CELLS = 27.0, 108


class Read(NamedTuple):
    """The contact's radius in one draw."""

    shape: str  # name of the object
    thickness: float  # of the gel [mm]
    noise: float  # of x and y [mm]
    before: float  # radius by half of the largest indentation over the true one, minus 1 [-]
    after: float  # the same by the fitted edge; NaN if none fits
    error: float  # standard error given with the edge [-]
    # share of the contact's markers wrongly in or out of the contact, by half of the largest
    # indentation and by the edge [-]
    wrong: tuple[float, float]
    # arm of friction over the true one, minus 1, by Hertz's pressure within half of the largest
    # indentation and by the edge [-]
    arm: tuple[float, float]


class _Pressed(NamedTuple):
    """A solved contact: indentation, cells in contact and their width, radius, arm of friction."""

    indentation: RectBivariateSpline
    contact: Bool[np.ndarray, "n n"]
    cell: float
    radius: float
    arm: float


@cache
def shapes() -> dict[str, tuple[AbstractIndenter, float]]:
    """The objects, and how far they are pressed in at most [mm]."""
    return {
        "sphere, 20 mm": (Sphere(20.0), 1.0),
        "sphere, 10 mm": (Sphere(10.0), 0.8),
        "ellipsoid": (Ellipsoid((19.0, 11.0, 10.0)), 0.9),
        "punch with a wide rounding": (RoundPunch(5.0, 4.0), 0.6),
        "round punch": (RoundPunch(4.0, 1.0), 0.4),
        "square punch": (SquarePunch(7.0, 1.0), 0.35),
        "cube": (SquarePunch(8.0, 0.3), 0.4),
    }


def compute(quick: bool = False, track: Track = iter) -> list[Read]:
    """Solve the contacts, and read their radius."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["contact_edge"]
    names = list(shapes())[:2] if quick else list(shapes())
    thicknesses = THICKNESSES_MM[2:3] if quick else THICKNESSES_MM
    cases = [(name, thickness) for name in names for thickness in thicknesses]
    return [
        _read(_press(name, thickness), name, thickness, noise, draw)
        for name, thickness in track(cases)
        for noise in NOISES_MM
        for draw in range(draws)
    ]


def _press(name: str, thickness: float) -> _Pressed:
    indenter, approach = shapes()[name]
    body = Layer(0.2, 0.48, thickness) if np.isfinite(thickness) else HalfSpace(0.2, 0.48)
    contact = Contact(body, Rigid(), indenter, Grid((CELLS, CELLS), (WIDTH_MM, WIDTH_MM)), 0.0)
    solution = solve_contact(contact, Pose(min(approach, DEEPEST * thickness)))
    x, pressure = np.asarray(solution.grid.x), np.asarray(solution.pressure)
    touching, distance = pressure > 0.0, np.hypot(*np.asarray(solution.grid.points))
    arm = float(np.sum(pressure * distance) / np.sum(pressure))
    surface = -np.asarray(solution.elastomer_displacement())[2]
    cell = float(x[1] - x[0])
    radius = float(np.sqrt(touching.sum() * cell**2 / np.pi))
    return _Pressed(RectBivariateSpline(x, x, surface), touching, cell, radius, arm)


def _read(pressed: _Pressed, name: str, thickness: float, noise: float, draw: int) -> Read:
    rng = np.random.default_rng((21, draw))
    pitch = PITCHES_MM[draw % len(PITCHES_MM)]
    points = _place_markers(pitch, rng)
    depth = pressed.indentation(*points.T, grid=False)
    depth = depth + 3.5 * noise * rng.standard_normal(len(points))
    cells = np.rint(points / pressed.cell + 0.5 * (CELLS - 1)).astype(int)
    touching = pressed.contact[tuple(cells.T)]
    half = depth >= CONTACT_SHARE * depth.max()
    before = pitch * np.sqrt(half.sum() / np.pi) / pressed.radius - 1.0
    edge = find_clear_edge(points, depth, None)
    after, error, within, share = np.nan, np.nan, half, HERTZ_ARM
    if edge is not None:
        after, error, within = edge.radius / pressed.radius - 1.0, edge.error, edge.distance <= 1.0
        share = face_arm(edge.thinness, edge.flat)
    wrong = [float(np.mean(one != touching) / np.mean(touching)) for one in (half, within)]
    arm = [
        by * disc_radius(points[one]) / pressed.arm - 1.0
        for by, one in ((HERTZ_ARM, half), (share, within))
    ]
    found = before, after, error, (wrong[0], wrong[1]), (arm[0], arm[1])
    return Read(name, thickness, noise, *found)


def _place_markers(pitch: float, rng: np.random.Generator) -> Float[np.ndarray, "n 2"]:
    """Markers on a grid of some pitch, 20 mm wide, placed and turned at random [mm]."""
    count = int(20.0 / pitch)
    line = pitch * (np.arange(count) - 0.5 * (count - 1))
    turned = np.add.outer(line, 1j * line).ravel() * np.exp(1j * rng.uniform(0.0, np.pi / 2))
    points = np.stack([turned.real, turned.imag], axis=1) + rng.uniform(-0.5, 0.5, 2)
    return points[np.abs(points).max(axis=1) < 0.5 * WIDTH_MM - 0.5]


def tables(result: list[Read]) -> dict[str, list[dict[str, object]]]:
    """Errors of the radius by shape and noise, and by thickness and noise."""
    return {
        "": [
            _row({"shape": name, "noise [µm]": 1e3 * noise}, some)
            for name in shapes()
            for noise in NOISES_MM
            if (some := [one for one in result if (one.shape, one.noise) == (name, noise)])
        ],
        "_thickness": [
            _row({"thickness [mm]": thickness, "noise [µm]": 1e3 * noise}, some)
            for thickness in THICKNESSES_MM
            for noise in NOISES_MM
            if (some := [o for o in result if (o.thickness, o.noise) == (thickness, noise)])
        ],
    }


def _row(label: dict[str, object], some: list[Read]) -> dict[str, object]:
    """Median and 90th percentile of the errors, before and after."""
    percent: dict[str, object] = dict(label)
    found = [one for one in some if np.isfinite(one.after)]
    for title, errors in (
        ("half of the depth", np.array([one.before for one in some])),
        ("edge", np.array([one.after for one in found])),
    ):
        percent[f"bias by {title} [%]"] = _percent(np.median(errors))
        percent[f"90 % by {title} [%]"] = _percent(np.percentile(np.abs(errors), 90))
    percent["stated error [%]"] = _percent(np.median([one.error for one in found]))
    for i, title in enumerate(("half of the depth", "edge")):
        percent[f"markers wrong by {title} [%]"] = _percent(np.mean([o.wrong[i] for o in some]))
    for i, title in enumerate(("Hertz", "edge")):
        arms = [abs(one.arm[i]) for one in some]
        percent[f"90 % of the arm by {title} [%]"] = _percent(np.percentile(arms, 90))
    percent["edge found [%]"] = _percent(len(found) / len(some))
    return percent


def _percent(share: float | np.floating) -> float:
    return round(100.0 * float(share), 1)


def plot(result: list[Read]) -> Figure:
    """Radius over the true one against the gel's thickness over it: a panel each noise."""
    figure, axes = plt.subplots(
        1, len(NOISES_MM), figsize=(11.0, 3.6), sharey=True, layout="constrained"
    )
    for axis, noise in zip(axes, NOISES_MM, strict=True):
        for i, name in enumerate(dict.fromkeys(one.shape for one in result)):
            some = [one for one in result if (one.shape, one.noise) == (name, noise)]
            thicknesses = list(dict.fromkeys(one.thickness for one in some))
            at = np.minimum(thicknesses, 20.0)
            for key, style, fill in (("before", "o--", "none"), ("after", "o-", "full")):
                middle = [
                    100.0 * np.nanmedian([getattr(o, key) for o in some if o.thickness == t])
                    for t in thicknesses
                ]
                label = name if key == "after" else None
                drawn = {"color": f"C{i}", "lw": 1, "ms": 4, "fillstyle": fill, "label": label}
                axis.plot(at, middle, style, **drawn)
        axis.axhspan(-5.0, 5.0, color="0.9")
        axis.set(xscale="log", xlabel="thickness of the gel [mm] (20: half-space)")
        axis.set_title(f"{1e3 * noise:g} µm", fontsize=9)
    axes[0].set_ylabel("error of the radius [%]")
    axes[0].legend(fontsize=7, title="open: half of the depth", title_fontsize=7)
    return figure
