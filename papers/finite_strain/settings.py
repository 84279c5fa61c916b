"""Cases of the reference, and the settings that both items share."""

from typing import NamedTuple

SHEAR_MODULUS = 0.2
"""G of the gel [MPa]; angles do not depend on it."""

THICKNESS = 8.0
"""h of the gel [mm]; all lengths scale with it."""

PRESSES = 8
"""Steps in which the object is pressed on."""

TURNS_DEG = (1, 2, 3.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 22.5, 25, 24, 22.5, 20, 17.5, 15)
"""Angles after pressing: up, and back [deg]."""

KEPT = (7, 11, 13, 15, 17, 19, 20, 22, 24)
"""Steps in the table: pressed, 5 to 25°, and 24, 20 and 15° on the way back."""


class Case(NamedTuple):
    """One contact of the reference.

    Attributes:
        flat_mm: radius of the flat face; 0 for a sphere [mm].
        edge_mm: radius of the rounded edge, or of the sphere [mm].
        depth_mm: indentation depth [mm].
        friction: μ [-].
        poisson_ratio: ν [-].
        pad_mm: radius of the gel, whose side is free [mm].
    """

    flat_mm: float = 0.0
    edge_mm: float = 20.0
    depth_mm: float = 1.28
    friction: float = 0.5
    poisson_ratio: float = 0.48
    pad_mm: float = 30.0


CASES = (
    *(Case(depth_mm=depth) for depth in (0.48, 1.28, 2.0)),
    *(Case(edge_mm=10.0, depth_mm=depth) for depth in (0.48, 1.28, 2.0)),
    *(Case(edge_mm=40.0, depth_mm=depth) for depth in (0.48, 1.28)),
    Case(flat_mm=3.0, edge_mm=1.0, depth_mm=0.64),
    Case(flat_mm=4.0, edge_mm=1.0, depth_mm=0.4),
    Case(depth_mm=0.48, pad_mm=12.0),
    *(Case(pad_mm=pad) for pad in (12.0, 16.0)),
)
"""Spheres and round punches on wide pads, and spheres on narrow ones."""
