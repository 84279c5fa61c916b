"""Rendered pads with known dots."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimation.frames.archive import write_archive
from estimation.frames.noise import Noise
from estimation.pictures.render import Camera, render_dots
from estimation.sources import read_recording
from estimation.tracking.tracker import estimate_angles

CAMERA = Camera(width=320, height=240, noise=2.0)
PITCH, RADIUS = 24.0, 4.3
GRID = np.stack(np.meshgrid(np.arange(12), np.arange(9), indexing="xy"), -1).reshape(-1, 2)
REST = GRID * PITCH + np.array([26.0, 24.0])


def twisted(degrees, rigid=0.0, still=118.0):
    """The dots at rest, turned: rigidly up to one radius, not at all beyond another [px]."""
    middle = np.array([160.0, 120.0])
    arm = REST - middle
    distance = np.linalg.norm(arm, axis=1)
    share = np.clip((still - distance) / (still - rigid), 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    turn = np.exp(1j * np.radians(degrees) * share)
    moved = (arm @ np.array([1.0, 1.0j])) * turn
    return middle + np.stack([moved.real, moved.imag], axis=1)


def picture(centre, rng, camera=CAMERA, radius=RADIUS):
    axes = np.broadcast_to(radius * np.eye(2), (len(centre), 2, 2))
    return render_dots(camera, centre, axes, rng)


def expect_same_answers(recording, path):
    """An archive of a recording is answered like the recording, the rotations it holds included."""
    write_archive(recording, path)
    asked = (recording, read_recording(path), replace(recording, rotation=None))
    same, again, bare = (estimate_angles(one, noise=Noise.from_std(1e-3)) for one in asked)
    assert same.answered.any()
    assert same.state == again.state
    assert np.array_equal(same.angle, again.angle, equal_nan=True)
    assert np.array_equal(same.rotation, again.rotation, equal_nan=True)
    assert not np.array_equal(same.rotation, bare.rotation, equal_nan=True)


def real(*parts):
    """A path of the published clips and stills, or a skip."""
    folder = os.environ.get("CONTACTMODEL_DATA")
    path = Path(folder or "", *parts)
    if not folder or not path.exists():
        pytest.skip("CONTACTMODEL_DATA names no folder with the published pictures")
    return path
