"""A pivot by 20° between two pictures, with nothing in between, from the pixels to the angle."""

import numpy as np
import pytest

from estimation.frames.noise import Noise
from estimation.pictures.corners.pattern import Pattern, render_pattern
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import marker_readers
from estimation.pictures.render import project_discs, render_dots
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture
from estimation.tracking.tracker import Tracker
from estimation.virtual.recording import PivotModel
from estimation.virtual.surface import simulate_surface
from tests.estimation.pictures.speckles import CAMERA, PRINT, RADIUS

CODED = Pattern.coded((14, 19), 0.6, seed=1)


@pytest.fixture(scope="module")
def motions():
    model = PivotModel(friction_ratio=0.5, contact_radius=3.5, pitch=0.6, grid_shape=(14, 19))
    return simulate_surface(model, np.array([0.0, 1.0]), np.radians([0.0, 20.0])).motions


def photograph(kind, move, seed):
    rng = np.random.default_rng(seed)
    if kind == "corners":
        image = render_pattern(CAMERA, lambda p: CAMERA.project(move(p)[:, :2]), CODED, rng)
    else:
        image = render_dots(
            CAMERA, *project_discs(CAMERA, lambda p: move(p)[:, :2], PRINT, RADIUS), rng
        )
    return Picture(image, time=float(seed), number=seed)


# an edge that bends within a corner's window shifts its fit: at windows of 15 px by 0.05° here
@pytest.mark.parametrize(("kind", "tolerance"), [("corners", 0.1), ("speckle", 0.02)])
def test_twenty_degrees_at_once(motions, kind, tolerance):
    rest, turned = (photograph(kind, move, i) for i, move in enumerate(motions))
    settings = ImageSettings(Sensor(marker=kind, mm_per_px=CAMERA.mm_per_px), unloaded=0)
    reader = marker_readers()[kind](rest, settings)
    row = reader.read(turned)  # the first picture that it is asked about
    assert not row.flaw
    assert np.isfinite(row.position[:, 0]).mean() > 0.9
    tracker = Tracker(reader.layout, noise=Noise.from_std(0.01 * CAMERA.mm_per_px))
    found = tracker.update(reader.frame(row))
    assert np.degrees(found.angle) == pytest.approx(20.0, abs=tolerance)
