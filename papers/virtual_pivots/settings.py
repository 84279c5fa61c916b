"""Settings of the study."""

from typing import NamedTuple

FRICTION_RATIOS = (0.2, 0.3, 0.5)
"""μp0/2G* [-]: from early slip to firm grip."""

ANGLES_DEG = tuple(range(2, 21))
"""Angles of the source paper's range [deg]."""

NOISES_UM = (1.0, 10.0)
"""Noise per in-plane coordinate [µm]: of Tac3D pads, and of a poor camera."""

FIRM_MARKERS = 10
"""Fewest truly sticking markers in a frame that counts."""

DRAWS = {
    "accuracy": 80,
    "reversal": 1000,
    "rendered": 25,
    "elongated": 50,
    "margin": 100,
    "slides": 60,
    "few_markers": 20,
    "contact_edge": 20,
    "assumptions": 10,
    "sheared": 25,
}
"""Number of draws by item. `accuracy`: per angle, friction ratio and noise, in total over 1000 per
ratio and noise; `rendered`: per angle; `elongated`: per μ; `few_markers`: per shape and μ;
`contact_edge`: per shape, thickness and noise; `assumptions`: per case; `sheared`: objects; others:
in total."""

QUICK_DRAWS = {
    "accuracy": 2,
    "reversal": 4,
    "rendered": 1,
    "elongated": 1,
    "margin": 1,
    "slides": 3,
    "few_markers": 1,
    "contact_edge": 4,
    "assumptions": 1,
    "sheared": 1,
}

PLACEMENTS = 2
"""Placements of the markers on each object of `sheared`."""

FIRST_DRAW = {"few_markers": 8100, "sheared": 25}
"""First draw by item: none from here on has chosen a rule or a number; earlier ones have."""

REVERSAL_FRICTION_RATIOS = (0.1, 0.22)
"""μp0/2G* of the reversals [-]: at 10° about 5 to 25 markers have always stuck."""

JUMP_DEG = 0.1
"""Change of the error between two answers that counts as a jump [deg]."""

PAPER_ERROR_DEG = 0.17
"""Mean absolute error of the source paper, on hardware [deg]."""

RATE = 30.0
"""Frames per second of the virtual pivots."""

FRICTIONS = (0.35, 0.5)
"""μ of the elongated contacts [-]: at 10° about 7 and 26 markers do not slip."""


class Resolution(NamedTuple):
    """Resolution of a solved contact."""

    cells: int  # number of cells along each side of the grid
    frames: tuple[int, ...]  # number of frames of each leg of the path, the press first
    steps: tuple[int, ...]  # number of solver steps per frame, by leg


FINE = Resolution(48, (5, 30, 8, 80), (1, 3, 1, 4))
COARSE = Resolution(24, (3, 10, 4, 40), (1, 1, 1, 2))
ELONGATED_FINE = FINE._replace(cells=128)
"""On 48 cells, errors of the solution leave markers that stick off their place."""

FEW_FRICTIONS = (0.6, 0.3)
"""μ of `few_markers` [-]: some markers stick up to 20°, or none does."""
FEW_FINE = Resolution(128, (8, 40, 6, 42), (1, 2, 1, 3))
FEW_COARSE = Resolution(32, (4, 10, 2, 10), (1, 1, 1, 1))
