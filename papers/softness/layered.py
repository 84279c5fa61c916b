"""Soft objects on thin elastomers: k fitted on two grasps, tested on a smaller and a larger one.

The module `contacts` solves the contacts. Two kinds of softness are fitted to the same two grasps:
the number k of Eq. (13), which is exact for half-spaces, and the layered softness. A frame of the
other two grasps counts if at least ten markers have always stuck; a missing answer counts as an
error of the full angle.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Shaped
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from calibration.softness.layered import Grasp, fit_layered_softness
from calibration.softness.readings import Layer
from calibration.softness.references import Reference
from estimation.frames.neighbours import grid_neighbours
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout, Recording
from estimation.softness import ScalarSoftness, Softness
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import see_all
from papers.items import Track
from papers.softness import contacts
from papers.sweeps import run_study
from papers.virtual_pivots.few_markers import add_noise

NOISES_MM = (1e-3, 1e-2)
FIRM = 10
UNLOADED, HELD = 10, 12
"""Frames before the contact, and frames under full load before the turn."""

SHARE, FLOOR_DEG = 0.02, 0.1
"""Largest allowed error: a share of the angle [-], or an angle [deg], whichever is larger."""

REFERENCE_ERROR, MODEL_ERROR = 1e-3, 5e-3
"""Errors given to the fit: of the reference angle [rad], and of the models over the angle [-]."""

WAYS = ("none", "scalar", "layered")


Values = Mapping[str, Shaped[np.ndarray, "..."]]


class Cell(NamedTuple):
    """One object on one elastomer, at one noise."""

    shape: str  # shape of the object
    k: float  # true stiffness ratio [-]
    thickness: float  # thickness of the elastomer [mm]
    noise: float  # noise of the markers in the plane [mm]
    found: tuple[float, float]  # k by the scalar and the layered fit [-]; NaN if the fit failed
    error: dict[str, float]  # mean absolute error over the angle, by way [-]
    within: dict[str, float]  # share of the frames within the allowed error, by way [-]
    frames: int  # number of tested frames


@dataclass(frozen=True)
class _Seen:
    """A recording of one grasp, the object's angle, and the frames that count."""

    recording: Recording
    angle: Float[np.ndarray, " frames"]
    firm: Bool[np.ndarray, " frames"]


def compute(quick: bool = False, track: Track = iter) -> list[Cell]:
    """Solve the contacts missing in the sweep `papers.softness.contacts`, then fit and test."""
    solved = run_study("papers.softness.contacts", quick, track)
    table = {name: np.asarray(column) for name, column in solved.table.items()}
    objects = np.arange(len(table["grasp"])).reshape(-1, len(contacts.OFFSETS))  # by grasp
    noises = NOISES_MM[:1] if quick else NOISES_MM
    cells = []
    for rows in track(objects):
        for noise in noises:
            grasps = [_make(solved.values, table, int(row), noise) for row in rows]
            first = {name: column[rows[0]].item() for name, column in table.items()}
            cells.append(_test(first, grasps, noise))
    return cells


def _make(values: Values, table: Values, row: int, noise: float) -> _Seen:
    """A recording of a solved path, with unloaded and held frames before it."""
    grasp = int(table["grasp"][row])
    plane = contacts.markers(grasp)
    reference = np.pad(plane, ((0, 0), (0, 1)))
    moved, contact, stick = (values[name][row] for name in ("displacement", "contact", "stick"))
    positions = reference + np.concatenate(
        [np.zeros((UNLOADED, *reference.shape)), np.repeat(moved[:1], HELD, axis=0), moved]
    )
    before = UNLOADED + HELD
    turn = np.radians(contacts.TWISTS_DEG)
    angle = np.concatenate([np.full(UNLOADED, np.nan), np.zeros(HELD), turn])
    stuck = contact & ~np.logical_or.accumulate(contact & ~stick, axis=0)
    firm = np.append(np.zeros(before, dtype=bool), (stuck.sum(axis=1) >= FIRM) & (turn > 0.0))
    side = (contacts.MARKERS, contacts.MARKERS)
    layout = MarkerLayout(reference, grid_neighbours(side), side)
    name = f"{contacts.SHAPES[int(table['shape'][row])]}, grasp {grasp + 1}"
    source = "virtual contact from the contact model"
    recording = see_all(layout, positions, name=name, source=source)
    return _Seen(add_noise(recording, noise, np.random.default_rng(row)), angle, firm)


def _test(first: dict, grasps: list[_Seen], noise_mm: float) -> Cell:
    noise = Noise.from_std(noise_mm)
    k, h = first["stiffness_ratio"], first["thickness"]
    fitted = [grasps[i] for i in contacts.FITTED]
    ways: dict[str, Softness | None] = {
        "none": ScalarSoftness(),
        "scalar": _fit(fitted, noise, np.inf),
        "layered": _fit(fitted, noise, h),
    }
    error, within = {}, {}
    frames = 0
    for name, softness in ways.items():
        deviation, size = [], []
        for seen in (grasps[i] for i in contacts.TESTED):
            angle = np.zeros(len(seen.angle))
            if softness is not None:
                result = estimate_angles(
                    seen.recording, "incremental", noise=noise, softness=softness
                )
                angle = np.nan_to_num(result.angle)
            deviation.append(np.abs(angle - seen.angle)[seen.firm])
            size.append(seen.angle[seen.firm])
        deviation, size = np.concatenate(deviation), np.concatenate(size)
        frames = len(deviation)
        error[name] = float(np.mean(deviation / size))
        within[name] = float(np.mean(deviation <= np.maximum(SHARE * size, np.radians(FLOOR_DEG))))
    scalar, layered = (
        np.nan if softness is None else softness.stiffness_ratio
        for softness in (ways["scalar"], ways["layered"])
    )
    shape, found = contacts.SHAPES[first["shape"]], (scalar, layered)
    return Cell(shape, k, h, noise_mm, found, error, within, frames)


def _fit(grasps: list[_Seen], noise: Noise, thickness: float) -> Softness | None:
    """Fit k on an elastomer of known thickness; None if the fit fails."""
    turns = []
    for seen in grasps:
        error = np.hypot(REFERENCE_ERROR, MODEL_ERROR * seen.angle)
        truth = Reference(seen.recording.time, seen.angle, error, True, True, "truth")
        turns.append(Grasp(seen.recording, truth, noise))
    try:
        return fit_layered_softness(turns, Layer(thickness)).softness
    except ValueError:
        return None


def tables(result: list[Cell]) -> dict[str, list[dict[str, object]]]:
    """A row for each object, elastomer and noise."""
    return {
        "": [
            {
                "shape": cell.shape,
                "h [mm]": cell.thickness,
                "k": cell.k,
                "noise [µm]": round(1e3 * cell.noise, 3),
                "k, scalar": round(cell.found[0], 3),
                "k, layered": round(cell.found[1], 3),
                **{f"error, {way} [%]": round(100 * cell.error[way], 1) for way in WAYS},
                **{f"within, {way} [%]": round(100 * cell.within[way]) for way in WAYS},
                "frames": cell.frames,
            }
            for cell in result
        ]
    }


def plot(result: list[Cell]) -> Figure:
    """Mean error over k and thickness, a map for each shape, noise and way."""
    noises = sorted({cell.noise for cell in result})
    shapes = list(dict.fromkeys(cell.shape for cell in result))
    rows = [(noise, way) for noise in noises for way in WAYS]
    figure, axes = plt.subplots(
        len(rows), len(shapes), squeeze=False, layout="constrained",
        figsize=(1.5 + 3.2 * len(shapes), 0.8 + 1.9 * len(rows)),
    )  # fmt: skip
    images = []
    for (noise, way), line in zip(rows, axes, strict=True):
        for shape, axis in zip(shapes, line, strict=True):
            chosen = [cell for cell in result if (cell.shape, cell.noise) == (shape, noise)]
            images.append(_map(axis, chosen, way))
            axis.set_title(f"{shape}, {1e3 * noise:g} µm, {_TITLES[way]}", fontsize=8)
    figure.colorbar(images[0], ax=axes, label="mean error of the angle [%]", shrink=0.6)
    figure.suptitle(f"framed: all errors within {100 * SHARE:g} % or {FLOOR_DEG:g}°", fontsize=9)
    return figure


_TITLES = {"none": "uncorrected", "scalar": "scalar k", "layered": "layered"}


def _map(axis, cells: list[Cell], way: str):
    """Errors as colours and numbers; framed if all angles are within the allowed error."""
    ks = sorted({cell.k for cell in cells})
    heights = sorted({cell.thickness for cell in cells})
    shade = np.full((len(heights), len(ks)), np.nan)
    for cell in cells:
        i, j = heights.index(cell.thickness), ks.index(cell.k)
        shade[i, j] = 100 * cell.error[way]
        colour = "white" if shade[i, j] > 3.0 else "black"
        axis.text(j, i, f"{shade[i, j]:.1f}", ha="center", va="center", fontsize=7, color=colour)
        if cell.within[way] == 1.0:
            axis.add_patch(Rectangle((j - 0.44, i - 0.4), 0.88, 0.8, fill=False, lw=1.5))
    image = axis.imshow(
        shade, norm="log", vmin=0.3, vmax=100.0, cmap="viridis_r", aspect="auto", origin="lower"
    )
    axis.set_xticks(range(len(ks)), [f"{k:g}" for k in ks], fontsize=7)
    axis.set_yticks(range(len(heights)), [f"{h:g}" for h in heights], fontsize=7)
    axis.set_xlabel("k", fontsize=7)
    axis.set_ylabel("h [mm]", fontsize=7)
    return image
