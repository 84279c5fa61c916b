"""Rendered checkerboards with known corners."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from estimation.pictures.corners.pattern import Pattern, project_corners, render_pattern
from estimation.pictures.render import Camera

CAMERA = Camera(width=320, height=240, noise=2.0)
PITCH = 23.0 * CAMERA.mm_per_px
CODED = Pattern.coded((9, 12), PITCH, seed=1)
PLAIN = Pattern((9, 12), PITCH)


def twist(degrees, rigid=1.2, still=4.4, shift=(0.0, 0.0)):
    """Motion of the gel: turned rigidly up to one radius, not at all beyond another [mm]."""

    def move(points):
        share = np.clip((still - np.hypot(*points.T)) / (still - rigid), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        turned = (points @ np.array([1.0, 1.0j])) * np.exp(1j * np.radians(degrees) * share)
        return np.stack([turned.real, turned.imag], axis=1) + shift

    return move


class Scene(NamedTuple):
    """A picture and the true corners in it."""

    image: np.ndarray
    position: np.ndarray
    angles: np.ndarray


def scene(pattern, move, seed=0, camera=CAMERA):
    def project(points):
        return camera.project(move(points))

    truth = project_corners(project, pattern)
    image = render_pattern(camera, project, pattern, np.random.default_rng(seed))
    return Scene(image, truth.position, truth.angles)


def identities(rest, seen):
    """True numbers of the corners that a tracker knows, from the picture it learned them in."""
    off, number = KDTree(rest.position).query(seen.rest.position)
    assert off.max() < 0.2
    return number
