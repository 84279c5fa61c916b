"""A virtual sensor with two views, 0.05 mm/px."""

import numpy as np
from scipy.spatial.transform import Rotation

from estimation.pictures.rig import Rig, View

DISTANCE = 60.0


def make_rig(width=640, height=480, degrees=45.0, scale=20.0, error=0.0):
    """An orthographic left view, and a right one that looks at the origin from the side."""
    centre = (0.5 * (width - 1), 0.5 * (height - 1))
    left = View(True, scale, centre, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    turn = (0.0, float(np.radians(degrees)), 0.0)
    right = View(False, scale * DISTANCE, centre, -0.02, turn, (0.0, 0.0, DISTANCE))
    return Rig(left, right, width, height, error)


def tilted(target, rng, tilt=0.4, shift=3.0):
    """A plane target in a pose at random [mm]."""
    vector = rng.uniform(-tilt, tilt, 3) * np.array([1.0, 1.0, 0.5])
    turn = Rotation.from_rotvec(vector).as_matrix()
    flat = np.column_stack([target, np.zeros(len(target))])
    return flat @ turn.T + rng.uniform(-1.0, 1.0, 3) * np.array([1.0, 1.0, shift])


def dome(pitch=1.1, rows=20, radius=30.0):
    """Markers on a domed pad, their middle at the origin [mm]."""
    y, x = (pitch * (one.ravel() - 0.5 * (rows - 1)) for one in np.mgrid[:rows, :rows])
    return np.stack([x, y, np.sqrt(radius**2 - x**2 - y**2) - radius], axis=1)
