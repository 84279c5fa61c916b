"""Intervals while few markers stick, by shape, noise and number of sticking markers.

Spheres, ellipsoids, round and square punches on layers are turned to 20° and back to −8°, solved
with the contact model; their shapes move with the object. Each draw places and turns the markers at
random, and each noise is added to the same motion.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple, cast

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Int
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
from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.measurement import Z95
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import Recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import Truth
from papers.items import Track
from papers.limits import angle_limit, contact_limit, turned_contact_limits, turned_limits
from papers.tables import brief_cell, cell
from papers.virtual_pivots import settings
from papers.virtual_pivots.slides import GROUPS, measure_outside
from papers.virtual_pivots.solved import Surface, record_at_random, solve_frames

UP, BACK, LOST = "up", "back", "after macro slip"
CORNERS_DEG = (0.0, 20.0, 20.0, -8.0)
WIDTH_MM = 18.0
NOISES_MM = (1e-3, 3e-3, 1e-2)
"""Noise of x and y; that of z is 3.5 times larger [mm]."""

FEWEST_SHOWN = 20
"""Fewest frames of a cell in the figure."""

NEAR = 2
"""How close to a loss of the contact its report is on time [frames]."""


class Shape(NamedTuple):
    """An object on a layer."""

    indenter: AbstractIndenter  # its shape
    thickness_mm: float  # thickness of the layer [mm]
    approach_mm: float  # how far the object is pressed in [mm]


@cache
def shapes() -> dict[str, Shape]:
    """The objects by name."""
    return {
        "sphere": Shape(Sphere(20.0), 8.0, 1.0),
        "square punch": Shape(SquarePunch(7.0, 1.0), 5.0, 0.35),
        "small sphere": Shape(Sphere(10.0), 4.0, 0.8),
        "round punch": Shape(RoundPunch(4.0, 1.0), 5.0, 0.4),
        "ellipsoid": Shape(Ellipsoid((19.0, 11.0, 10.0)), 6.0, 0.9),
    }


class Followed(NamedTuple):
    """The frames in contact of one recording."""

    shape: str  # name of the object
    noise: float  # noise of x and y [mm]
    # `up`, `back`, or `after macro slip`: since fewer than three markers had never slipped, until
    # the recording's end
    phase: list[str]
    # number of markers that have never slipped; after the turn, that stick now
    sticking: Int[np.ndarray, " frames"]
    error: Float[np.ndarray, " frames"]  # angle minus truth [deg]; NaN without an answer
    half_width: Float[np.ndarray, " frames"]  # half-width of the interval [deg]
    outside: Float[np.ndarray, " frames"]  # distance of the truth from the interval [deg]; 0 inside
    # half-width of a 95 % interval at the Cramér–Rao bound of the markers that stick, from one
    # frame; after the turn, from all frames since it [deg]
    bound: Float[np.ndarray, " frames"]
    # the same of all markers, if all but the angles is known [deg]
    all_bound: Float[np.ndarray, " frames"]
    holding: Bool[np.ndarray, " frames"]  # whether three markers or more stick now
    slipping: Bool[np.ndarray, " frames"]  # whether macro slip is reported live

    @property
    def inside(self) -> Bool[np.ndarray, " frames"]:
        """Whether the interval holds the truth."""
        return self.outside == 0.0


@cache
def solve_turn(name: str, friction: float, resolution: settings.Resolution) -> ContactSolution:
    """The contacts of a shape along the path, with one kept step for each frame."""
    shape = shapes()[name]
    grid = Grid((resolution.cells, resolution.cells), (WIDTH_MM, WIDTH_MM))
    contact = Contact(Layer(0.2, 0.48, shape.thickness_mm), Rigid(), shape.indenter, grid, friction)
    return solve_frames(contact, shape.approach_mm, CORNERS_DEG, resolution)


@cache
def read_turn(name: str, friction: float, resolution: settings.Resolution) -> Surface:
    """The elastomer's surface along that path."""
    return Surface(solve_turn(name, friction, resolution))


def compute(quick: bool = False, track: Track = iter) -> list[Followed]:
    """Solve the contacts, simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["few_markers"]
    resolution = settings.FEW_COARSE if quick else settings.FEW_FINE
    names = list(shapes())[:2] if quick else list(shapes())
    frictions = settings.FEW_FRICTIONS[:1] if quick else settings.FEW_FRICTIONS
    first = settings.FIRST_DRAW["few_markers"]
    numbers = range(first, first + draws)
    cases = [(n, f, d) for n in names for f in frictions for d in numbers]
    return [
        followed
        for name, friction, draw in track(cases)
        for followed in _follow(name, friction, draw, resolution)
    ]


def _follow(
    name: str, friction: float, draw: int, resolution: settings.Resolution
) -> Iterator[Followed]:
    """Follow one draw with each noise."""
    rng = np.random.default_rng((11, draw))
    recording, truth = simulate_turn(name, friction, rng, resolution)
    yield from compare(name, shapes()[name].thickness_mm, recording, truth, rng)


def simulate_turn(
    name: str, friction: float, rng: np.random.Generator, resolution: settings.Resolution
) -> tuple[Recording, Truth]:
    """A turn of a shape without noise, under markers placed and turned at random, and its truth."""
    path = solve_turn(name, friction, resolution)
    return record_at_random(path, read_turn(name, friction, resolution), rng)


def add_noise(recording: Recording, noise: float, rng: np.random.Generator) -> Recording:
    """The recording with independent noise of x and y [mm], and of z 3.5 times larger."""
    spread = noise * np.array([1.0, 1.0, 3.5])
    noisy = recording.positions + spread * rng.normal(size=recording.positions.shape)
    return replace(recording, positions=noisy)


def compare(
    name: str,
    thickness_mm: float,
    recording: Recording,
    truth: Truth,
    rng: np.random.Generator,
) -> Iterator[Followed]:
    """The frames of a recording with each noise beside its truth; the layer's thickness in mm."""
    for noise in NOISES_MM:
        yield _compare(name, thickness_mm, noise, add_noise(recording, noise, rng), truth)


def _compare(
    name: str, thickness_mm: float, noise: float, recording: Recording, truth: Truth
) -> Followed:
    touching = np.isfinite(truth.angle)
    turned = np.arange(len(truth.angle)) > np.nanargmax(np.nan_to_num(truth.angle, nan=-np.inf))
    held, now = truth.stick.sum(axis=1), truth.sticking_now.sum(axis=1)
    lost = np.maximum.accumulate(touching & (held < MIN_STICK_MARKERS) & ~turned)
    phase = np.where(lost, LOST, np.where(turned, BACK, UP))
    sticking = np.where(turned | lost, now, held)
    points = recording.layout.reference[:, :2]
    bound, all_bound = Z95 * np.degrees(noise * _limits(points, thickness_mm, truth, turned))
    result = estimate_angles(recording, DEFAULT_METHOD)
    angle, low, high = (
        np.asarray(getattr(result, field))[touching] for field in ("angle", "low", "high")
    )
    true = truth.angle[touching]
    return Followed(
        shape=name,
        noise=noise,
        phase=phase[touching].tolist(),
        sticking=sticking[touching],
        error=np.degrees(angle - true),
        half_width=np.degrees(0.5 * (high - low)),
        outside=measure_outside(result, truth)[touching],
        bound=bound[touching],
        all_bound=all_bound[touching],
        holding=now[touching] >= MIN_STICK_MARKERS,
        slipping=result.slipping[touching],
    )


def _limits(
    points: Float[np.ndarray, "n 2"],
    thickness: float,
    truth: Truth,
    turned: Bool[np.ndarray, " frames"],
) -> Float[np.ndarray, "2 frames"]:
    """Cramér–Rao bounds of the sticking and of all markers, over their noise [rad/mm].

    Markers that come under the object later than others have no known place on it.
    """
    start = int(np.argmax(turned)) - 1  # the turn
    held = np.logical_and.accumulate(truth.stick[start:])
    some = truth.sticking_now[start:].any(axis=0)
    before = [
        (angle_limit(points, stick, 1.0), contact_limit(points, radius, thickness, 1.0))
        for stick, radius in zip(truth.stick[:start], truth.stick_radius, strict=False)
    ]
    since = (
        turned_limits(points[some], held[:, some], truth.sticking_now[start:, some], 1.0),
        turned_contact_limits(points, truth.stick_radius[start:], thickness, 1.0),
    )
    return np.concatenate([np.reshape(before, (-1, 2)).T, since], axis=1)


def tables(result: list[Followed]) -> dict[str, list[dict[str, object]]]:
    """Rows by noise, phase and sticking markers, over all shapes; and the same for each shape."""
    names = list(dict.fromkeys(followed.shape for followed in result))
    by_shape = [
        {"shape": name, **row}
        for name in names
        for row in _tabulate([followed for followed in result if followed.shape == name])
    ]
    rows = _tabulate(result)
    for row in rows:
        same = ("noise [µm]", "phase", "markers that stick")
        cells = [cell for cell in by_shape if all(cell[key] == row[key] for key in same)]
        covered = {cell["shape"]: cell[COVERS] for cell in cells if cell[COVERS] is not None}
        worst = min(covered, key=lambda name: covered[name], default=None)
        row["worst shape"] = None if worst is None else f"{worst}, {covered[worst]:g} %"
    return {"": rows, "_shapes": by_shape, "_slips": tabulate_slips(result)}


def tabulate_slips(result: list[Followed]) -> list[dict[str, object]]:
    """How macro slip is reported live, by noise and shape."""
    rows = []
    for noise, name in dict.fromkeys((followed.noise, followed.shape) for followed in result):
        chosen = [one for one in result if (one.noise, one.shape) == (noise, name)]
        delays = np.array([delay for one in chosen for delay in _delays(one)])
        held = np.concatenate([_holds_on(one) for one in chosen])
        false = np.concatenate([one.slipping for one in chosen]) & held
        rows.append(
            {
                "noise [µm]": 1e3 * noise,
                "shape": name,
                "losses": len(delays),
                "reported [%]": cell(100.0 * np.isfinite(delays), 0),
                "within 2 frames [%]": cell(100.0 * (np.abs(delays) <= NEAR), 0),
                "frames that hold": int(held.sum()),
                "falsely reported": int(false.sum()),
            }
        )
    return rows


def _holds_on(followed: Followed) -> Bool[np.ndarray, " frames"]:
    """Frames in which three markers stick and go on sticking for two more."""
    padded = np.append(followed.holding, [True] * NEAR)
    return np.all(np.lib.stride_tricks.sliding_window_view(padded, NEAR + 1), axis=1)


def _delays(followed: Followed) -> list[float]:
    """Frames from each loss of the contact to its report; NaN where it regains hold unreported."""
    holding, delays = followed.holding, []
    for loss in 1 + np.flatnonzero(holding[:-1] & ~holding[1:]):
        again = np.flatnonzero(holding[loss:])
        end = loss + int(again[0]) if len(again) else len(holding)
        seen = np.flatnonzero(followed.slipping[max(loss - NEAR, 0) : end])
        delays.append(float(seen[0] - min(NEAR, loss)) if len(seen) else np.nan)
    return delays


COVERS = "interval covers [%]"


def _tabulate(result: list[Followed]) -> list[dict[str, object]]:
    rows = []
    for noise in dict.fromkeys(followed.noise for followed in result):
        chosen = [followed for followed in result if followed.noise == noise]
        phase, sticking, bound, all_bound = join(chosen, "phase", "sticking", "bound", "all_bound")
        values, number = join(chosen, "error", "half_width", "inside"), number_frames(chosen)
        groups = [(when, *group) for when in (UP, BACK) for group in GROUPS.items()]
        for when, label, (least, most) in [*groups, (LOST, "any", (0, 400))]:
            frames = (phase == when) & (sticking >= least) & (sticking <= most)
            if frames.any():
                error, half_width, inside = (value[frames] for value in values)
                row: dict[str, object] = {
                    "noise [µm]": 1e3 * noise,
                    "phase": when,
                    "markers that stick": label,
                    "recordings": len(np.unique(number[frames])),
                }
                row |= _row(error, half_width, inside, bound[frames])
                bounded = frames & np.isfinite(bound)
                row["bound of all markers over it [-]"] = brief_cell(
                    all_bound[bounded] / bound[bounded], 2, np.median
                )
                rows.append(row)
    return rows


def join(chosen: list[Followed], *names: str) -> list[np.ndarray]:
    """Some fields of the frames of all recordings, one array for each."""
    return [np.concatenate([getattr(followed, name) for followed in chosen]) for name in names]


def number_frames(chosen: list[Followed]) -> Int[np.ndarray, " frames"]:
    """Number of the recording that each of these frames belongs to."""
    return np.repeat(np.arange(len(chosen)), [len(followed.phase) for followed in chosen])


def _row(
    error: Float[np.ndarray, " frames"],
    half_width: Float[np.ndarray, " frames"],
    inside: Bool[np.ndarray, " frames"],
    bound: Float[np.ndarray, " frames"],
) -> dict[str, object]:
    known = np.isfinite(error)
    wide = known & np.isfinite(bound)
    return {
        "frames": len(error),
        "answered [%]": brief_cell(100.0 * known, 2),
        "mean absolute error [°]": brief_cell(np.abs(error), 2),
        "bias [°]": brief_cell(error, 2),
        COVERS: cell(100.0 * inside[np.isfinite(error + half_width)], 1),
        "median half-width [°]": brief_cell(half_width[known], 2, np.median),
        "over the bound [-]": brief_cell(half_width[wide] / bound[wide], 2, np.median),
    }


def plot(result: list[Followed]) -> Figure:
    """Share of the intervals that cover the truth, by sticking markers: a panel for each noise."""
    by_shape = tables(result)["_shapes"]
    noises = sorted({1e3 * followed.noise for followed in result})
    size = (3.6 * len(noises), 3.8)
    figure, axes = plt.subplots(
        1, len(noises), sharey=True, figsize=size, squeeze=False, layout="constrained"
    )
    groups = list(reversed(GROUPS))
    for axis, noise in zip(axes[0], noises, strict=True):
        for i, name in enumerate(dict.fromkeys(row["shape"] for row in by_shape)):
            for when, mark in ((UP, "o-"), (BACK, "x--")):
                cells = {
                    row["markers that stick"]: row[COVERS]
                    for row in by_shape
                    if (row["shape"], row["noise [µm]"], row["phase"]) == (name, noise, when)
                    and cast(int, row["frames"]) >= FEWEST_SHOWN
                }
                covered = [np.nan if cells.get(g) is None else cells[g] for g in groups]
                label = name if when == UP else None
                axis.plot(range(len(groups)), covered, mark, color=f"C{i}", label=label, ms=4)
        axis.axhspan(92.0, 98.0, color="0.9", zorder=0)
        axis.set_xticks(range(len(groups)), groups, fontsize=8)
        axis.set_title(f"{noise:g} µm", fontsize=9)
        axis.set_xlabel("markers that stick")
    axes[0, 0].set_ylabel("interval covers [%]; dashed: turned back")
    axes[0, 0].legend(fontsize=7, frameon=False)
    return figure
