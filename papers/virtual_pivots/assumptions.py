"""Intervals where the gel or the friction differs from what the law of friction assumes.

The law takes no thickness and no modulus: it fits what it needs. It assumes dry friction with one
coefficient, and a flat pad. Here layers are 30 % thinner and thicker than the sphere's of
`few_markers`, friction falls with the cube root of the pressure, and the pad is a dome. An object
with two feet has a second contact, which slides around the first.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from contactmodel import (
    AbstractIndenter,
    Contact,
    Grid,
    Layer,
    PowerLawFriction,
    Rigid,
    RoundPunch,
    Sphere,
)
from contactmodel.solution import ContactSolution
from estimation.frames.recording import Recording
from estimation.virtual.recording import Truth
from papers.items import Track
from papers.tables import brief_cell, cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.few_markers import (
    BACK,
    CORNERS_DEG,
    COVERS,
    LOST,
    UP,
    WIDTH_MM,
    Followed,
    Shape,
    compare,
    join,
)
from papers.virtual_pivots.slides import FAR_DEG, GROUPS
from papers.virtual_pivots.solved import Surface, record_at_random, solve_frames

MODULUS_MPA, DOME_MM, FALL = 0.2, 30.0, 1.0 / 3.0
"""Shear modulus of the gel, radius of the dome, and exponent by which friction falls."""


class Feet(AbstractIndenter):
    """Two spheres on one object, the first around the origin.

    Attributes:
        sphere: each foot.
        apart: distance of the second from the first, along x [mm].
    """

    sphere: Sphere
    apart: float

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Height of the lower foot [mm]."""
        x, y = points
        return jnp.minimum(
            self.sphere.height(points), self.sphere.height(jnp.stack([x - self.apart, y]))
        )


class Case(NamedTuple):
    """A contact that differs from the law's."""

    shape: Shape
    friction: float  # μ, at the reference pressure if it falls [-]
    fall: float = 0.0  # exponent by which friction falls with pressure [-]
    domed: bool = False  # whether the pad is a dome
    width_mm: float = WIDTH_MM  # side of the grid that it is solved on [mm]


@cache
def cases() -> dict[str, Case]:
    """The contacts by name."""
    # on a dome, the gap is that of a smaller sphere
    smaller = Sphere(1.0 / (1.0 / 20.0 + 1.0 / DOME_MM))
    return {
        "sphere, layer 30 % thinner": Case(Shape(Sphere(20.0), 5.6, 1.0), 0.4),
        "sphere, layer 30 % thicker": Case(Shape(Sphere(20.0), 10.4, 1.0), 0.4),
        "sphere, μ falls with pressure": Case(Shape(Sphere(20.0), 8.0, 1.0), 0.4, FALL),
        "round punch, μ falls with pressure": Case(
            Shape(RoundPunch(4.0, 1.0), 5.0, 0.4), 0.4, FALL
        ),
        "sphere, domed pad": Case(Shape(smaller, 8.0, 1.0), 0.4, domed=True),
        "two feet, turned about one": Case(
            Shape(Feet(Sphere(10.0), 7.0), 6.0, 0.7), 0.4, width_mm=24.0
        ),
    }


@cache
def _solve(name: str, resolution: settings.Resolution) -> tuple[ContactSolution, Surface]:
    case = cases()[name]
    grid = Grid((resolution.cells, resolution.cells), (case.width_mm, case.width_mm))
    # the reference is about the mean pressure
    law = PowerLawFriction(case.friction, 0.1, case.fall) if case.fall else case.friction
    layer = Layer(MODULUS_MPA, 0.48, case.shape.thickness_mm)
    contact = Contact(layer, Rigid(), case.shape.indenter, grid, law)
    path = solve_frames(contact, case.shape.approach_mm, CORNERS_DEG, resolution)
    return path, Surface(path)


def compute(quick: bool = False, track: Track = iter) -> list[Followed]:
    """Solve the contacts, simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["assumptions"]
    resolution = settings.FEW_COARSE if quick else settings.FEW_FINE
    names = list(cases())[:1] if quick else list(cases())
    todo = [(name, draw) for name in names for draw in range(draws)]
    return [one for name, draw in track(todo) for one in _follow(name, draw, resolution)]


def _follow(name: str, draw: int, resolution: settings.Resolution) -> Iterator[Followed]:
    """Follow one draw with each noise."""
    rng = np.random.default_rng((17, draw))
    recording, truth = _simulate(name, rng, resolution)
    yield from compare(name, cases()[name].shape.thickness_mm, recording, truth, rng)


def _simulate(
    name: str, rng: np.random.Generator, resolution: settings.Resolution
) -> tuple[Recording, Truth]:
    path, surface = _solve(name, resolution)
    recording, truth = record_at_random(path, surface, rng)
    if not cases()[name].domed:
        return recording, truth
    layout = recording.layout
    x, y, _ = layout.reference.T
    lower = np.zeros_like(layout.reference)
    lower[:, 2] = np.sqrt(DOME_MM**2 - x**2 - y**2) - DOME_MM
    layout = replace(layout, reference=layout.reference + lower)
    return replace(recording, layout=layout, positions=recording.positions + lower), truth


def tables(result: list[Followed]) -> dict[str, list[dict[str, object]]]:
    """Rows by case, noise and phase, with the lowest coverage of its groups of markers."""
    keys = dict.fromkeys((one.shape, one.noise) for one in result)
    rows = []
    for name, noise in keys:
        chosen = [one for one in result if (one.shape, one.noise) == (name, noise)]
        phase = np.concatenate([one.phase for one in chosen])
        for when in (UP, BACK, LOST):
            frames = phase == when
            if frames.any():
                rows.append({"case": name, "noise [µm]": 1e3 * noise, "phase": when})
                rows[-1] |= _row(chosen, frames)
    return {"": rows}


def _row(chosen: list[Followed], frames: np.ndarray) -> dict[str, object]:
    error, outside, inside, sticking = (
        values[frames] for values in join(chosen, "error", "outside", "inside", "sticking")
    )
    known = np.isfinite(error)
    groups = {}
    for label, (least, most) in GROUPS.items():
        some = known & (sticking >= least) & (sticking <= most)
        if some.any():
            groups[label] = cell(100.0 * inside[some], 0)
    return {
        "frames": len(error),
        "answered [%]": cell(100.0 * known, 0),
        "mean absolute error [°]": brief_cell(np.abs(error[known]), 2),
        COVERS: cell(100.0 * inside[known], 1),
        **{f"{label} [%]": groups.get(label) for label in GROUPS},
        f"more than {FAR_DEG:g}° outside": int((outside > FAR_DEG).sum()),
    }


def plot(result: list[Followed]) -> Figure:
    """Share of the intervals that cover the truth before macro slip, by case and noise."""
    rows: list[dict[str, Any]] = [row for row in tables(result)[""] if row["phase"] == UP]
    names = list(dict.fromkeys(str(row["case"]) for row in rows))
    figure, axis = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for noise in dict.fromkeys(row["noise [µm]"] for row in rows):
        covers = {row["case"]: row[COVERS] for row in rows if row["noise [µm]"] == noise}
        axis.plot([covers[name] for name in names], names, "o", label=f"{noise:g} µm")
    axis.axvline(95.0, color="0.6", lw=0.8)
    finish(axis, xlabel="interval covers [%], before macro slip", ylabel="")
    figure.legend(loc="outside right upper", fontsize=8)
    return figure
