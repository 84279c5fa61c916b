"""Rendered speckle with known motion."""

from typing import NamedTuple

import numpy as np

from estimation.pictures.render import Camera, project_discs, render_dots, scatter_speckle

CAMERA = Camera(width=320, height=240, noise=2.0)
RADIUS = 2.0 * CAMERA.mm_per_px
PRINT = scatter_speckle(
    (400 * CAMERA.mm_per_px, 320 * CAMERA.mm_per_px), RADIUS, 0.45, np.random.default_rng(0)
)


class Motion(NamedTuple):
    """Turns about the middle, rigidly up to one radius and not at all beyond another [px]."""

    degrees: float = 0.0
    rigid: float = 60.0
    still: float = 118.0
    shift: tuple[float, float] = (0.0, 0.0)

    def __call__(self, points):
        """Points [mm] moved."""
        arm = points @ np.array([1.0, 1.0j]) / CAMERA.mm_per_px
        share = np.clip((self.still - np.abs(arm)) / (self.still - self.rigid), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        moved = arm * np.exp(1j * np.radians(self.degrees) * share)
        return CAMERA.mm_per_px * (np.stack([moved.real, moved.imag], axis=1) + self.shift)

    def of_pixels(self, pixels):
        """Where pixels of the picture at rest are now [px]."""
        middle = CAMERA.project(np.zeros((1, 2)))
        return CAMERA.project(self((pixels - middle) * CAMERA.mm_per_px))


def whole(degrees, shift=(0.0, 0.0)):
    """A rigid motion of everything."""
    return Motion(degrees, rigid=1e6, still=2e6, shift=shift)


def speckle(motion, seed=0, camera=CAMERA):
    """A picture of the moved pattern."""
    centres, axes = project_discs(camera, motion, PRINT, RADIUS)
    return render_dots(camera, centres, axes, np.random.default_rng(seed))
