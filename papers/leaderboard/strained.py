"""Cases of the finite-strain tier: markers on gels that are pressed deep and turned far.

`gels.npz` has the motion of the gels' surfaces. `python -m papers.leaderboard.strained` solves them
again with the finite elements of `papers.finite_strain` (extra `finite-elements`), in some minutes.
A case places markers on one of the surfaces at random.
"""

import io
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from estimation.frames.recording import Recording
from estimation.virtual.recording import PivotModel, lay_out_markers, see_all
from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.press import Round, press
from papers.finite_strain.steps import press_and_turn
from papers.finite_strain.surface import (
    Surface,
    move_markers,
    read_surface,
    surface_arrays,
    write_arrays,
)
from papers.leaderboard import settings
from papers.leaderboard.cases import Case, Truth, count_frames
from papers.leaderboard.virtual import generator, keep_frames, mirror

FILE = "gels.npz"


@cache
def read_surfaces() -> dict[str, Surface]:
    """The gels of `gels.npz` by group."""
    stored = np.load(io.BytesIO((files("papers.leaderboard") / FILE).read_bytes()))
    return {group: read_surface(stored, group) for group in settings.GELS}


@cache
def simulate(case: Case, seed: int) -> tuple[Recording, Truth]:
    """A recording of markers on a gel that is pressed, turned and turned back.

    Frames lie between the solved steps of one degree: the markers are interpolated.
    """
    rng, surface = generator(case, seed), read_surfaces()[case.group]
    x, y = rng.uniform(-0.5, 0.5, 2).tolist()
    layout = lay_out_markers(
        PivotModel(
            pitch=float(rng.uniform(0.9, 1.1)),
            offset=(x, y),
            grid_angle=float(rng.uniform(0.0, np.pi / 2)),
        )
    )
    displacement, stick = move_markers(surface, layout.reference)
    holding = stick.sum(axis=1)
    steps, presses = len(surface.twist), settings.GEL_PRESSES
    place = np.arange(steps, dtype=float)
    place[presses:-1] += rng.uniform(-0.3, 0.3, steps - presses - 1)
    before = np.minimum(place.astype(int), steps - 2)
    share = place - before
    at = share[:, None, None]
    moved = (1.0 - at) * displacement[before] + at * displacement[before + 1]
    unloaded = np.zeros((settings.UNLOADED, *layout.reference.shape))
    positions = layout.reference + np.concatenate([unloaded, moved])
    xy, z = settings.GEL_NOISES_MM
    positions += rng.normal(size=positions.shape) * np.array([xy, xy, z])
    twist = np.interp(place, np.arange(steps), surface.twist)
    holding = np.minimum(holding[before], holding[before + 1])
    whole, nothing = len(positions), settings.UNLOADED
    kept = keep_frames(whole, case.frames, rng)
    recording = see_all(layout, positions).take(kept)
    angle = np.append(np.full(nothing, np.nan), twist)[kept]
    sticking = np.append(np.zeros(nothing, dtype=int), holding)[kept]
    truth = Truth(angle, {case.group: count_frames(sticking)})
    return mirror(recording, truth) if rng.random() < 0.5 else (recording, truth)


def solve_surface(contact: settings.Gel) -> Surface:
    """Solve a contact: the object is pressed on, turned to the peak, and back."""
    peak, back, presses = settings.GEL_PEAK_DEG, settings.GEL_BACK_DEG, settings.GEL_PRESSES
    turns = np.append(np.arange(1, peak + 1), np.arange(peak - 1, back - 1, -1))
    path = press_and_turn(contact.depth_mm, presses, turns)
    touching = np.sqrt(2.0 * contact.edge_mm * contact.depth_mm)
    reach = contact.flat_mm + 1.8 if contact.flat_mm else 1.1 * touching + 0.8
    gel = Gel()
    elements = cut(gel, contact.cell_mm, reach, 1.3)
    shape = Round(contact.flat_mm, contact.edge_mm)
    solved = press(gel, elements, shape, settings.GEL_FRICTION, path, rtol=1e-6)
    twist = np.array([motion.twist for motion in path])
    return Surface(solved.radius, solved.moved, twist, solved.stick)


def main() -> None:
    """Solve the gels, and write them to the folder of this file."""
    arrays: dict[str, np.ndarray] = {}
    for group, contact in settings.GELS.items():
        arrays |= surface_arrays(solve_surface(contact), group)
        print(group)
    write_arrays(Path(__file__).with_name(FILE), arrays)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
