"""Linear torsion of square bars: is a round bar of the same long twist a good stand-in?

A traction τ = r √(1 − r²/a²) around the axis turns the face of a bar that is gripped at its other
end. A round bar with 0.547 of the square's width turns by the same if both are long. Near the face
it is a guess, which `soft` objects use (`--side-mm`); here both are solved.
"""

from typing import NamedTuple

import numpy as np

from estimation.softness.bar import radius_of_square
from papers.finite_strain.gel import Gel, grow, law_of
from papers.finite_strain.solids.bricks import Bricks, lay_bricks
from papers.finite_strain.solids.press import assemble_stiffness, solve_ordered
from papers.finite_strain.steps import components
from papers.finite_strain.torsion import solve_torsion
from papers.finite_strain.two_bodies import Ball

BARS = tuple((height, reach) for height in (0.25, 0.5, 1.0, 2.0) for reach in (0.2, 0.3, 0.45))
"""Height of the bar and radius of the contact, over the width of the bar [-]."""

_WIDTH = 10.0
_INNER = 0.6


class Bar(NamedTuple):
    """Turn of the contact within 0.6 a, relative to that of a square bar.

    Attributes:
        height: height over width [-].
        reach: radius of the contact over width [-].
        as_round: error of a round bar [-].
        as_plate: error of a plate of the same height without sides [-].
    """

    height: float
    reach: float
    as_round: float
    as_plate: float


def compare_bar(height: float, reach: float, cells: int = 14) -> Bar:
    """Solve a square bar and its stand-ins.

    Args:
        height: height over width [-].
        reach: radius of the contact over width [-].
        cells: elements along half of the width.
    """
    tall, a = height * _WIDTH, reach * _WIDTH
    r, turned = _turn_square(tall, a, cells)

    def error(radius: float) -> float:
        body = Ball(radius=1e6, cone=_WIDTH, width=radius, height=tall)
        return float(np.mean(np.interp(r, *solve_torsion(body, a)) / turned) - 1.0)

    return Bar(height, reach, error(radius_of_square(_WIDTH)), error(20.0 * _WIDTH))


def _turn_square(height: float, a: float, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii within the contact [mm], and Gψ there, as by `solve_torsion`."""
    x = np.linspace(0.0, 0.5 * _WIDTH, cells + 1)
    bricks = lay_bricks(x, x, grow(height, a / 8.0, 1.2))
    rubber = law_of(Gel(shear_modulus=1.0))
    stiff, force = assemble_stiffness(bricks, 0.0 * bricks.place, rubber), _load(bricks, a)
    solved = solve_ordered(components(bricks.order).ravel(), stiff, force.ravel())
    moved = bricks.spread(solved.reshape(force.shape))[bricks.lattice]
    x, y = np.meshgrid(x, x, indexing="ij")
    r = np.hypot(x, y)
    inner = (r > 0.02 * a) & (r < _INNER * a)
    around = x * moved[..., 1] - y * moved[..., 0]
    return r[inner], around[inner] / r[inner] ** 2


def _load(bricks: Bricks, a: float, parts: int = 12) -> np.ndarray:
    """Forces of the traction on the nodes, by the midpoints of parts of each element [N]."""
    x = bricks.grid[0]
    size = x[1] / parts
    at = np.arange(0.5 * size, x[-1], size)
    px, py = np.meshgrid(at, at, indexing="ij")
    pull = size**2 * np.sqrt(np.maximum(1.0 - (px**2 + py**2) / a**2, 0.0))
    i, j = (np.minimum((along / x[1]).astype(int), len(x) - 2) for along in (px, py))
    across, along = px / x[1] - i, py / x[1] - j
    force = np.zeros(bricks.place.shape)
    for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = pull * np.abs(1 - k - across) * np.abs(1 - m - along)
        pushed = np.stack([-py * share, px * share, 0.0 * share], axis=-1)
        np.add.at(force, bricks.lattice[i + k, j + m], pushed)
    own = bricks.gather(force)
    own[bricks.fixed] = 0.0
    return own
