"""The default method on elongated contacts: into macro slip, and further by the outline.

An ellipsoid touches a half-space (ν = ½) in an ellipse of 2:1, with half-axes of 6.6 and 3.1 mm. It
is lifted to 10°, held and turned back to −25°; its shape moves with the sliding (`solve_path` with
`sliding`). The shape lags by one step of the path, which is 0.1° here. Frames are steps of it,
with more steps between them while it slides. Each draw has a new marker grid and new noise.
"""

from functools import cache
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel import Contact, Ellipsoid, Grid, HalfSpace, Rigid
from contactmodel.solution import ContactSolution
from estimation.estimators import DEFAULT_METHOD
from estimation.frames.recording import Recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import Camera, Truth
from papers.items import Track
from papers.tables import brief_cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.solved import Surface, record_at_random, solve_frames

METHODS = (DEFAULT_METHOD, "castano")
OBJECT = Ellipsoid((19.0, 11.0, 10.0))
PAD = HalfSpace(0.2, 0.5)
APPROACH_MM = 1.2
CORNERS_DEG = (0.0, 10.0, 10.0, -25.0)
WIDTH_MM = 18.0


class Elongated(NamedTuple):
    """One value per draw.

    Attributes:
        friction: μ [-].
        error: mean absolute error while at least ten markers do not slip, by method [deg].
        slipped: mean absolute error in macro slip, from its detection on, by method [deg].
        unanswered: share of the frames in contact without an answer [-].
        inside: share of the intervals that hold the truth while at least ten markers do not slip
            [-].
        inside_slipped: share of the intervals that hold the truth in detected macro slip [-].
        late: delay of the detection after the onset of macro slip [frames].
        lost: whether macro slip was reported while at least ten markers did not slip.
    """

    friction: Float[np.ndarray, " draws"]
    error: Float[np.ndarray, "draws methods"]
    slipped: Float[np.ndarray, "draws methods"]
    unanswered: Float[np.ndarray, " draws"]
    inside: Float[np.ndarray, " draws"]
    inside_slipped: Float[np.ndarray, " draws"]
    late: Float[np.ndarray, " draws"]
    lost: Float[np.ndarray, " draws"]


@cache
def solve_pivot(friction: float, resolution: settings.Resolution) -> ContactSolution:
    """The contact along the path, with one kept step for each frame."""
    grid = Grid((resolution.cells, resolution.cells), (WIDTH_MM, WIDTH_MM))
    contact = Contact(PAD, Rigid(), OBJECT, grid, friction)
    return solve_frames(contact, APPROACH_MM, CORNERS_DEG, resolution)


@cache
def read_pivot(friction: float, resolution: settings.Resolution) -> Surface:
    """The elastomer's surface along that path."""
    return Surface(solve_pivot(friction, resolution))


def simulate_elongated(
    friction: float, seed: int, resolution: settings.Resolution = settings.ELONGATED_FINE
) -> tuple[Recording, Truth]:
    """A recording of the path, with the marker grid placed and turned at random."""
    rng = np.random.default_rng((7, seed))
    path, surface = solve_pivot(friction, resolution), read_pivot(friction, resolution)
    return record_at_random(path, surface, rng, Camera(seed=seed))


def compute(quick: bool = False, track: Track = iter) -> Elongated:
    """Simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["elongated"]
    resolution = settings.COARSE if quick else settings.ELONGATED_FINE
    cases = [(friction, draw) for friction in settings.FRICTIONS for draw in range(draws)]
    rows = [_follow(friction, draw, resolution) for friction, draw in track(cases)]
    return Elongated(*(np.array(column, dtype=float) for column in zip(*rows, strict=True)))


def _follow(friction: float, draw: int, resolution: settings.Resolution) -> tuple:
    recording, truth = simulate_elongated(friction, draw, resolution)
    results = [estimate_angles(recording, method) for method in METHODS]
    main = results[0]
    firm = truth.sticking_now.sum(axis=1) >= settings.FIRM_MARKERS
    slipping = main.slipping
    began = int(np.argmax(truth.macro_slip))
    handed = truth.macro_slip & slipping
    inside = (main.low <= truth.angle) & (truth.angle <= main.high)
    touching = np.isfinite(truth.angle)

    def error(angle: np.ndarray, frames: np.ndarray) -> float:
        of = np.abs(np.degrees(angle - truth.angle))[frames]
        return float(np.nanmean(of)) if np.isfinite(of).any() else np.nan

    first = np.flatnonzero(slipping & truth.macro_slip)
    late = (
        recording.source_index[first[0]] - recording.source_index[began] if len(first) else np.nan
    )
    return (
        friction,
        [error(result.angle, firm) for result in results],
        [error(result.angle, handed) for result in results],
        np.mean(~main.answered[touching]),
        inside[firm & main.answered].mean(),
        inside[handed].mean() if handed.any() else np.nan,
        late if truth.macro_slip.any() else np.nan,
        (slipping & firm).any(),
    )


def tables(result: Elongated) -> dict[str, list[dict[str, object]]]:
    """A row for each friction and method."""
    rows = []
    for friction in np.unique(result.friction):
        chosen = result.friction == friction
        for i, method in enumerate(METHODS):
            of_default = {
                "interval holds, ten stick [%]": brief_cell(100 * result.inside[chosen]),
                "interval holds, handed over [%]": brief_cell(100 * result.inside_slipped[chosen]),
                "unanswered [%]": brief_cell(100 * result.unanswered[chosen]),
                "late, median [frames]": brief_cell(result.late[chosen], summary=np.median),
                "lost before [draws]": int(result.lost[chosen].sum()),
            }
            rows.append(
                {
                    "μ": float(friction),
                    "method": method,
                    "draws": int(chosen.sum()),
                    "error, ten stick [°]": brief_cell(result.error[chosen, i]),
                    "error, handed over [°]": brief_cell(result.slipped[chosen, i]),
                    "worst draw, handed over [°]": brief_cell(
                        result.slipped[chosen, i], summary=np.max
                    ),
                    **(of_default if method == DEFAULT_METHOD else dict.fromkeys(of_default)),
                }
            )
    return {"": rows}


def plot(result: Elongated) -> Figure:
    """Errors of the draws over μ, before macro slip (dots) and in it (crosses)."""
    figure, axis = plt.subplots(figsize=(7, 3.8), layout="constrained")
    for i, method in enumerate(METHODS):
        for values, mark, when in (
            (result.error, "o", "ten stick"),
            (result.slipped, "x", "slips"),
        ):
            spread = result.friction + 0.003 * (i - 0.5)
            axis.semilogy(spread, values[:, i], mark, color=f"C{i}", label=f"{method}, {when}")
    axis.axhline(0.5, color="0.6", ls=":", lw=1)
    error = "mean absolute error of a draw [°]"
    finish(axis, legend=8, minor=True, xlabel="μ [-]", ylabel=error)
    return figure
