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


class Series(NamedTuple):
    """Contacts at several depths on one mesh, for the corrections.

    Attributes:
        flat_mm: radius of the flat face; 0 for a sphere [mm].
        edge_mm: radius of the rounded edge, or of the sphere [mm].
        depths_mm: indentation depths [mm].
        friction: μ [-].
        poisson_ratio: ν [-].
        pad_mm: radius of the gel, whose side is free [mm].
        thickness_mm: h [mm].
        cell_mm: side of the elements under the contact [mm].
        growth: ratio of the sizes of neighbouring elements [-].
        presses: steps to the largest depth, besides the depths [-].
        held_out: whether the fit leaves the series out.
        turns_deg: angles after pressing [deg].
        kept_deg: angles in the table [deg].
    """

    flat_mm: float = 0.0
    edge_mm: float = 20.0
    depths_mm: tuple[float, ...] = (0.64, 1.04, 1.6)
    friction: float = 0.5
    poisson_ratio: float = 0.48
    pad_mm: float = 48.0
    thickness_mm: float = 8.0
    cell_mm: float = 0.2
    growth: float = 1.2
    presses: int = 6
    held_out: bool = False
    turns_deg: tuple[float, ...] = (2.5, 5, 7.5, 10, 15, 20)
    kept_deg: tuple[float, ...] = (2.5, 5, 10, 15, 20)


_FINE = Series(
    pad_mm=56.0,
    growth=1.12,
    presses=8,
    turns_deg=(1, 2.5, 5, 7.5, 10, 15, 20, 25),
    kept_deg=(2.5, 5, 10, 15, 20, 25),
)
_DEEP = (0.32, 0.64, 1.04, 1.28, 1.6, 2.0)
_PAD = Series(presses=4, turns_deg=(2.5, 5, 10, 15, 20), kept_deg=(5, 10, 20))
_HELD = _PAD._replace(presses=5, growth=1.15, held_out=True)

SERIES = (
    _FINE._replace(depths_mm=_DEEP, cell_mm=0.13),
    _FINE._replace(edge_mm=10.0, depths_mm=_DEEP, cell_mm=0.09),
    _FINE._replace(flat_mm=3.0, edge_mm=1.0, depths_mm=(0.24, 0.48, 0.8), cell_mm=0.07, presses=6),
    Series(edge_mm=40.0, depths_mm=(0.32, 0.64, 1.04, 1.6), cell_mm=0.25),
    Series(edge_mm=6.0, depths_mm=(0.48, 1.04, 1.6, 2.0), cell_mm=0.12),
    Series(depths_mm=(1.04, 2.0), poisson_ratio=0.45),
    Series(depths_mm=(1.04, 2.0), poisson_ratio=0.49),
    Series(flat_mm=4.0, edge_mm=2.0, depths_mm=(0.4, 0.8, 1.28)),
    Series(edge_mm=10.0, depths_mm=(1.04, 2.0), cell_mm=0.15, friction=1.0),
    Series(edge_mm=10.0, depths_mm=(1.04, 2.0), cell_mm=0.15, friction=0.25),
    Series(depths_mm=(1.04, 2.0), friction=1.0),
    Series(depths_mm=(0.64, 2.0)),
    _PAD._replace(pad_mm=12.0),
    _PAD._replace(pad_mm=16.0),
    _PAD._replace(edge_mm=10.0, cell_mm=0.15, pad_mm=12.0),
    _PAD._replace(edge_mm=40.0, depths_mm=(0.32, 0.64, 1.04), cell_mm=0.25, pad_mm=12.0),
    _PAD._replace(pad_mm=10.0),
    _PAD._replace(depths_mm=(0.64, 1.6), pad_mm=20.0),
    _PAD._replace(depths_mm=(1.04,), pad_mm=12.0, poisson_ratio=0.45),
    _PAD._replace(depths_mm=(1.04,), pad_mm=12.0, poisson_ratio=0.49),
    _PAD._replace(edge_mm=40.0, depths_mm=(0.64, 1.6), cell_mm=0.25, pad_mm=16.0),
    _PAD._replace(edge_mm=10.0, depths_mm=(0.64, 1.6), cell_mm=0.15, pad_mm=8.0),
    _PAD._replace(flat_mm=4.0, edge_mm=2.0, depths_mm=(0.4, 1.28), pad_mm=12.0),
    _HELD._replace(
        edge_mm=15.0, depths_mm=(0.36, 0.78, 1.5), cell_mm=0.13, thickness_mm=6.0, pad_mm=30.0
    ),
    _HELD._replace(
        edge_mm=30.0, depths_mm=(0.5, 1.0, 2.0), cell_mm=0.25, thickness_mm=10.0, pad_mm=40.0
    ),
    _HELD._replace(flat_mm=3.0, edge_mm=1.0, depths_mm=(0.64,), cell_mm=0.125, pad_mm=30.0),
    _HELD._replace(
        edge_mm=8.0,
        depths_mm=(0.5, 0.8),
        cell_mm=0.12,
        thickness_mm=5.0,
        pad_mm=25.0,
        poisson_ratio=0.47,
    ),
    _HELD._replace(edge_mm=15.0, depths_mm=(0.5, 0.9), cell_mm=0.15, pad_mm=12.0),
    _HELD._replace(edge_mm=25.0, depths_mm=(0.6, 1.3), thickness_mm=6.0, pad_mm=12.0),
    _HELD._replace(edge_mm=10.0, depths_mm=(0.5, 1.2), cell_mm=0.12, thickness_mm=4.0, pad_mm=12.0),
    _HELD._replace(depths_mm=(1.0,), cell_mm=0.15, thickness_mm=10.0, pad_mm=12.0, friction=0.8),
)
"""Series of the fit on wide and on narrow pads, then the series that the fit leaves out."""
