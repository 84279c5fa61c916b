"""Settings of the study."""

from typing import NamedTuple

FRICTION_RATIOS = (0.2, 0.3, 0.5)
"""μp0/2G* [-]: from early slip to firm grip."""

ANGLES_DEG = tuple(range(2, 21))
"""The range that the source paper gives its method [deg]."""

NOISES_UM = (1.0, 10.0)
"""Noise per in-plane coordinate [µm]: what Tac3D pads have, and a poor camera's."""

FIRM_MARKERS = 10
"""Frames count in which at least this many markers truly stick."""

DRAWS = {
    "accuracy": 80,
    "reversal": 1000,
    "rendered": 25,
    "elongated": 50,
    "margin": 100,
    "slides": 60,
}
"""Draws per angle, ratio and noise (over 1000 for each ratio and noise); recordings; draws per
angle; recordings per friction."""

QUICK_DRAWS = {
    "accuracy": 2,
    "reversal": 4,
    "rendered": 1,
    "elongated": 1,
    "margin": 1,
    "slides": 3,
}

REVERSAL_FRICTION_RATIOS = (0.1, 0.22)
"""μp0/2G* of the reversals [-]: at 10° some 5 to 25 markers are left that have always stuck."""

PAPER_ERROR_DEG = 0.17
"""Mean absolute error that the source paper reports, on hardware [deg]."""

RATE = 30.0
"""Frames per second of the virtual pivots."""

FRICTIONS = (0.35, 0.5)
"""μ of the elongated contacts [-]: at 10° some 7 and 26 markers do not slip."""


class Resolution(NamedTuple):
    """How finely an elongated contact is solved.

    Attributes:
        cells: along each side of the grid.
        frames: of each leg of the path, the press first.
        steps: of the solver to a frame, by leg.
    """

    cells: int
    frames: tuple[int, ...]
    steps: tuple[int, ...]


FINE = Resolution(48, (5, 30, 8, 80), (1, 3, 1, 4))
COARSE = Resolution(24, (3, 10, 4, 40), (1, 1, 1, 2))
