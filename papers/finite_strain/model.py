"""The model's contact under an object of the finite elements."""

from contactmodel import Contact, Grid, Layer, Rigid, RoundPunch, Sphere

CELLS = 40
"""Cells along a side of the grid."""

SIDE = 10.0
"""Side of the grid to which `find_scale` scales contacts, so that one program solves all [mm]."""


def find_scale(half: float, flat: float, edge: float) -> float:
    """Scale of lengths that makes a contact fill the common grid [-].

    Args:
        half: half of the side that it needs [mm].
        flat: radius of the flat face; 0 for a sphere [mm].
        edge: radius of the rounded edge, beyond which a punch has no contact [mm].
    """
    return 0.5 * SIDE / (min(half, flat + edge) if flat else half)


def make_contact(
    gel: Layer, flat: float, edge: float, friction: float, side: float = SIDE, cells: int = CELLS
) -> Contact:
    """A sphere, or a flat punch with a rounded edge, on a gel.

    Args:
        gel: the gel.
        flat: radius of the flat face; 0 for a sphere [mm].
        edge: radius of the rounded edge, or of the sphere [mm].
        friction: μ [-].
        side: of the grid [mm].
        cells: along a side of the grid.
    """
    shape = RoundPunch(flat + edge, edge) if flat else Sphere(edge)
    return Contact(gel, Rigid(), shape, Grid((cells, cells), (side, side)), friction)
