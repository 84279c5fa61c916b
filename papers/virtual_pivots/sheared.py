"""Intervals and macro slip where the object shifts as it turns.

Spheres, ellipsoids, round and square punches of random size, on layers of random thickness, are
turned and shifted in proportion, in a random direction, then moved back by two fifths. The markers
that stick lie beside the contact's middle, about which the law of friction assumes the turn.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Int
from matplotlib.figure import Figure

from contactmodel import (
    AbstractIndenter,
    Contact,
    Ellipsoid,
    Grid,
    Layer,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
)
from contactmodel.solution import ContactSolution
from papers.items import Track
from papers.tables import brief_cell, cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.few_markers import (
    BACK,
    COVERS,
    LOST,
    UP,
    WIDTH_MM,
    Followed,
    Shape,
    compare,
    join,
    number_frames,
    tabulate_slips,
)
from papers.virtual_pivots.slides import FAR_DEG, GROUPS
from papers.virtual_pivots.solved import Surface, record_at_random, solve_frames

KINDS = ("sphere", "square punch", "round punch", "ellipsoid", "small sphere")
BACK_TO = -0.4
"""Where the motion ends, over where it turns back."""

COVERS_RANGE = f"{COVERS.removesuffix(' [%]')}, range [%]"
RESAMPLED = 2000
"""Draws of the objects, with replacement, that give the range of a coverage."""


class Motion(NamedTuple):
    """An object, and how it moves."""

    shape: Shape  # the object on its layer
    friction: float  # μ [-]
    turn_deg: float  # where it turns back [deg]
    shift_mm_per_deg: tuple[float, float]  # how far it shifts with each degree [mm/deg]


def draw_motion(draw: int) -> Motion:
    """The object of one draw, and how it moves."""
    rng = np.random.default_rng((23, draw))
    indenter, approach = _draw_object(KINDS[draw % len(KINDS)], rng)
    way, rate = rng.uniform(0.0, 2.0 * np.pi), np.exp(rng.uniform(*np.log([0.01, 0.08])))
    return Motion(
        shape=Shape(indenter, float(rng.uniform(4.0, 9.0)), approach),
        friction=float(rng.uniform(0.2, 0.6)),
        turn_deg=float(rng.uniform(10.0, 22.0)),
        shift_mm_per_deg=(float(rate * np.cos(way)), float(rate * np.sin(way))),
    )


def _draw_object(kind: str, rng: np.random.Generator) -> tuple[AbstractIndenter, float]:
    """A shape of random size, and how far it is pressed in [mm]."""
    pressed = float(rng.uniform(0.3, 0.45))
    if kind == "sphere":
        radius = float(rng.uniform(14.0, 25.0))
        return Sphere(radius), 16.0 / radius
    if kind == "small sphere":
        radius = float(rng.uniform(8.0, 12.0))
        return Sphere(radius), 8.0 / radius
    if kind == "square punch":
        return SquarePunch(float(rng.uniform(5.5, 7.5)), 1.0), pressed
    if kind == "round punch":
        return RoundPunch(float(rng.uniform(3.0, 4.5)), 1.0), pressed
    return Ellipsoid((float(rng.uniform(13.0, 18.0)), 11.0, 10.0)), 0.9


def _solve(draw: int, resolution: settings.Resolution) -> tuple[ContactSolution, Surface]:
    shape, friction, turn, shift = draw_motion(draw)
    grid = Grid((resolution.cells, resolution.cells), (WIDTH_MM, WIDTH_MM))
    contact = Contact(Layer(0.2, 0.48, shape.thickness_mm), Rigid(), shape.indenter, grid, friction)
    corners = (0.0, turn, turn, BACK_TO * turn)
    path = solve_frames(contact, shape.approach_mm, corners, resolution, shift)
    return path, Surface(path)


def compute(quick: bool = False, track: Track = iter) -> list[Followed]:
    """Solve the contacts, simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["sheared"]
    resolution = settings.FEW_COARSE if quick else settings.FEW_FINE
    first = settings.FIRST_DRAW["sheared"]
    numbers = range(first, first + draws)
    return [one for draw in track(numbers) for one in _follow(draw, resolution)]


def _follow(draw: int, resolution: settings.Resolution) -> Iterator[Followed]:
    """Follow one object with each placement of the markers and each noise."""
    path, surface = _solve(draw, resolution)
    thickness = draw_motion(draw).shape.thickness_mm
    for placement in range(settings.PLACEMENTS):
        rng = np.random.default_rng((29, draw, placement))
        recording, truth = record_at_random(path, surface, rng)
        yield from compare(KINDS[draw % len(KINDS)], thickness, recording, truth, rng)


def tables(result: list[Followed]) -> dict[str, list[dict[str, object]]]:
    """Rows by noise, phase and sticking markers, for all objects and each kind; reported slips."""
    by_shape = [
        {"shape": name, **row}
        for name in dict.fromkeys(one.shape for one in result)
        for row in _tabulate([one for one in result if one.shape == name])
    ]
    return {"": _tabulate(result), "_shapes": by_shape, "_slips": tabulate_slips(result)}


def _tabulate(result: list[Followed]) -> list[dict[str, object]]:
    rows = []
    groups = [(UP, *group) for group in GROUPS.items()]
    groups += [(when, "any", (0, 400)) for when in (BACK, LOST)]
    for noise in dict.fromkeys(one.noise for one in result):
        chosen = [one for one in result if one.noise == noise]
        phase, sticking, slipping, holding = join(
            chosen, "phase", "sticking", "slipping", "holding"
        )
        error, half_width, outside = join(chosen, "error", "half_width", "outside")
        known = np.isfinite(error)
        number = number_frames(chosen)
        for when, label, (least, most) in groups:
            frames = (phase == when) & (sticking >= least) & (sticking <= most)
            if not frames.any():
                continue
            answered = frames & known
            objects = number[answered] // settings.PLACEMENTS
            spread = find_cover_range(outside[answered] == 0.0, objects)
            rows.append(
                {
                    "noise [µm]": 1e3 * noise,
                    "phase": when,
                    "markers that stick": label,
                    "recordings": len(np.unique(number[frames])),
                    "frames": int(frames.sum()),
                    "answered [%]": cell(100.0 * known[frames], 0),
                    "mean absolute error [°]": brief_cell(np.abs(error[answered]), 2),
                    "median half-width [°]": brief_cell(half_width[answered], 2, np.median),
                    COVERS: cell(100.0 * (outside[answered] == 0.0), 1),
                    COVERS_RANGE: spread and "{:.0f} to {:.0f}".format(*spread),
                    f"more than {FAR_DEG:g}° outside": int((outside[frames] > FAR_DEG).sum()),
                    "falsely in macro slip": int((slipping & holding & frames).sum()),
                }
            )
    return rows


def find_cover_range(
    inside: Bool[np.ndarray, " n"], objects: Int[np.ndarray, " n"]
) -> tuple[float, float] | None:
    """The 95 % range of a coverage [%] by resampling the objects; None with fewer than two.

    The answers under one object depend on each other, whatever their frame and placement.
    """
    values, place = np.unique(objects, return_inverse=True)
    if len(values) < 2:
        return None
    counts = np.stack([np.bincount(place, inside), np.bincount(place)], axis=1)
    draws = np.random.default_rng(0).integers(0, len(values), (RESAMPLED, len(values)))
    covered, answered = counts[draws].sum(axis=1).T
    low, high = np.percentile(100.0 * covered / answered, [2.5, 97.5])
    return float(low), float(high)


def plot(result: list[Followed]) -> Figure:
    """Share of the intervals that cover the truth, by sticking markers and noise.

    Only frames before the turn back count.
    """
    rows: list[dict[str, Any]] = [row for row in tables(result)[""] if row["phase"] == UP]
    names = list(dict.fromkeys(row["markers that stick"] for row in rows))
    figure, axis = plt.subplots(figsize=(5.2, 3.4), layout="constrained")
    for noise in dict.fromkeys(row["noise [µm]"] for row in rows):
        covers = {
            row["markers that stick"]: row[COVERS] for row in rows if row["noise [µm]"] == noise
        }
        known = [name for name in names if covers.get(name) is not None]
        axis.plot(known, [covers[name] for name in known], "o-", label=f"{noise:g} µm")
    axis.axhspan(92.0, 98.0, color="0.9", zorder=0)
    finish(axis, xlabel="markers that stick", ylabel="interval covers [%]")
    axis.legend(fontsize=8, frameon=False)
    return figure
