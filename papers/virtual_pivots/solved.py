"""Pivots that the contact model solves, and markers placed at random under them."""

from collections.abc import Sequence

import numpy as np

from contactmodel import Contact, Pose, make_path, solve_path
from contactmodel.solution import ContactSolution
from estimation.virtual.recording import PivotModel
from papers.virtual_pivots.settings import Resolution


def solve_frames(
    contact: Contact, approach_mm: float, corners_deg: Sequence[float], resolution: Resolution
) -> ContactSolution:
    """The contacts along a path of twists, with one kept step for each frame.

    The shape moves with the sliding, and lags by one step of the path.

    Args:
        contact: the bodies, indenter, grid and friction.
        approach_mm: how far the object is pressed in [mm].
        corners_deg: twists at the corners of the path, after the press [deg].
        resolution: frames and steps of its legs, the press first.
    """
    poses = [Pose(0.0)]
    poses += [Pose(approach_mm, twist=np.radians(angle)) for angle in corners_deg]
    steps = [n * per for n, per in zip(resolution.frames, resolution.steps, strict=True)]
    solved = solve_path(contact, make_path(poses, steps), rtol=1e-5, sliding=True)
    kept = np.cumsum(np.repeat(resolution.steps, resolution.frames)) - 1
    return solved.map_steps(lambda leaf: leaf[kept])


def place_at_random(model: PivotModel, rng: np.random.Generator) -> PivotModel:
    """The model with its axis and the direction of its rows of markers drawn at random."""
    x, y = rng.uniform(-0.5, 0.5, 2).tolist()
    return model._replace(offset=(x, y), grid_angle=float(rng.uniform(0.0, np.pi / 2)))
