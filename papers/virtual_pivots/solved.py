"""Pivots that the contact model solves, and markers placed at random under them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import RectBivariateSpline

from contactmodel import Contact, Pose, make_path, solve_path
from contactmodel.solution import ContactSolution
from estimation.frames.recording import Recording
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import Camera, PivotModel, Timing, Truth, lay_out_markers
from papers.virtual_pivots.settings import Resolution

NOISELESS = Camera(noise=(0.0, 0.0), timing=Timing(dropped=0.0), noise_window=1, seed=0)
"""A camera that adds nothing to the positions."""


def solve_frames(
    contact: Contact,
    approach_mm: float,
    corners_deg: Sequence[float],
    resolution: Resolution,
    shift_mm_per_deg: tuple[float, float] = (0.0, 0.0),
) -> ContactSolution:
    """The contacts along a path of twists, with one kept step for each frame.

    The shape moves with the sliding, and lags by one step of the path.

    Args:
        contact: the bodies, indenter, grid and friction.
        approach_mm: how far the object is pressed in [mm].
        corners_deg: twists at the corners of the path, after the press [deg].
        resolution: frames and steps of its legs, the press first.
        shift_mm_per_deg: how far the object shifts with each degree of twist [mm/deg].
    """
    x, y = shift_mm_per_deg
    poses = [Pose(0.0)]
    poses += [
        Pose(approach_mm, twist=np.radians(angle), shift=(angle * x, angle * y))
        for angle in corners_deg
    ]
    steps = [n * per for n, per in zip(resolution.frames, resolution.steps, strict=True)]
    solved = solve_path(contact, make_path(poses, steps), rtol=1e-5, sliding=True)
    kept = np.cumsum(np.repeat(resolution.steps, resolution.frames)) - 1
    return solved.map_steps(lambda leaf: leaf[kept])


class Surface:
    """The elastomer's surface along a path, interpolated between the centres of the cells.

    The solver meets the condition of stick at the centres. Between them the displacement of its
    constant tractions ripples, by 0.7 µm at 20° and with cells of 0.25 mm. Cubic splines through
    the centres do not. Beyond the grid the splines pass through exact displacements. Where the
    slip jumps from cell to cell, they overshoot: markers that stick at the edge of a sharp cube
    lead it by up to 4 µm. Under the square punch of `few_markers`, markers that stick are within
    0.5 µm of their place at 10°.
    """

    def __init__(
        self, path: ContactSolution, reach_mm: float = 14.0, pitch_mm: float = 2.0
    ) -> None:
        """Read the surface.

        Args:
            path: contacts along the path.
            reach_mm: half-width of the square that is read [mm].
            pitch_mm: distance of the exact points beyond the grid [mm].
        """
        x, y = np.asarray(path.grid.x), np.asarray(path.grid.y)
        on_grid = np.asarray(path.elastomer_displacement())
        self.steps, self._half_width = len(on_grid), float(min(x[-1], y[-1]))
        self._near = [RectBivariateSpline(x, y, field) for step in on_grid for field in step]
        at = np.arange(-reach_mm, reach_mm + 0.5 * pitch_mm, pitch_mm)
        points = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
        near = self._is_near(points)
        fields = np.empty((len(self._near), len(points)))
        fields[:, near] = [spline(*points[near].T, grid=False) for spline in self._near]
        exact = np.asarray(path.elastomer_displacement_at(points[~near]))
        fields[:, ~near] = np.moveaxis(exact, 2, 1).reshape(len(fields), -1)
        square = (len(at), len(at))
        self._far = [RectBivariateSpline(at, at, field.reshape(square)) for field in fields]

    def move(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "steps n 3"]:
        """Displacement of some points at each step [mm]."""
        near = self._is_near(points)
        moved = np.empty((len(self._near), len(points)))
        for row, close, wide in zip(moved, self._near, self._far, strict=True):
            row[near] = close(*points[near].T, grid=False)
            row[~near] = wide(*points[~near].T, grid=False)
        return np.moveaxis(moved.reshape(self.steps, 3, -1), 1, 2)

    def _is_near(self, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        return np.all(np.abs(points) <= self._half_width, axis=1)


def place_at_random(model: PivotModel, rng: np.random.Generator) -> PivotModel:
    """The model with its axis and the direction of its rows of markers drawn at random."""
    x, y = rng.uniform(-0.5, 0.5, 2).tolist()
    return model._replace(offset=(x, y), grid_angle=float(rng.uniform(0.0, np.pi / 2)))


def record_at_random(
    path: ContactSolution,
    surface: Surface,
    rng: np.random.Generator,
    camera: Camera = NOISELESS,
) -> tuple[Recording, Truth]:
    """A recording of markers placed and turned at random, without noise if no camera is given."""
    sensor = lay_out_markers(place_at_random(PivotModel(), rng))
    moved = surface.move(sensor.reference[:, :2])
    return simulate_recording(path, sensor, camera, moved=moved)
