"""Settings of the leaderboard."""

from typing import NamedTuple

from estimation.virtual.recording import PivotModel
from papers.virtual_pivots.settings import FINE

LIFT = {"angles_deg": (0.0, 15.0), "frames": (60,)}
"""A lift by 15° in two seconds."""

REVERSAL = {"angles_deg": (0.0, 10.0, 10.0, -30.0), "frames": (40, 15, 120)}
"""A lift, a hold, and back through zero on to macro slip."""

SHIFT_MM = (0.6, -0.4)
"""By how far the whole pad shifts while it is twisted, in `translating`. The slip that a shift of
the object would bring is not in it: the virtual pivot has no closed form for both at once."""

MISSING = 0.1
"""Share of markers that each frame of `gappy` does not show."""


class Condition(NamedTuple):
    """A virtual pivot to measure on.

    Attributes:
        model: what is pressed into what.
        path: of the object's angle, as `simulate_pivot` takes it.
        shift_mm: of the pad by the end of the path [mm].
        missing: share of markers not seen [-].
        dropped: share of frames lost [-].
    """

    model: PivotModel
    path: dict = LIFT
    shift_mm: tuple[float, float] = (0.0, 0.0)
    missing: float = 0.0
    dropped: float = 0.05


CONDITIONS = {
    "rigid": Condition(PivotModel(friction_ratio=0.3)),
    "soft": Condition(PivotModel(friction_ratio=0.3, stiffness_ratio=0.5)),
    "translating": Condition(PivotModel(friction_ratio=0.3), shift_mm=SHIFT_MM),
    "small": Condition(PivotModel(friction_ratio=0.3, contact_radius=2.5, approach=0.6)),
    "round": Condition(PivotModel(friction_ratio=0.3, offset=(0.0, 0.0))),
    "reversing": Condition(PivotModel(friction_ratio=0.15), path=REVERSAL),
    "noisy": Condition(PivotModel(friction_ratio=0.3, noise=10e-3, normal_noise=35e-3)),
    "gappy": Condition(PivotModel(friction_ratio=0.3), missing=MISSING, dropped=0.4),
}
"""Virtual pivots by name. Every one is round, as their closed forms are; `round` is so to the
markers as well, its axis in the middle of four of them."""

ELONGATED = (0.5, FINE)
"""Friction and resolution of the solved contact of 2:1, turned back through zero to macro slip."""

GRIPS = (0.05, 0.1, 0.15, 3.0)
"""μp0/2G* of the pivots that slip warnings are measured on [-]; at the last nothing slips."""

TWIST = {"angles_deg": (0.0, 30.0), "frames": (90,)}
"""The twist they are measured in: 10°/s."""

REAL = ("tac3d-pivot", "pivot-videos")
"""Data sets that are scored where they have been fetched. `tac3d-press` is not among them: it
presses many times and twists little, so no one constant relates its outline to the angle."""

AXIS_METHODS = ("castano", "outline")
"""Methods whose angle is the object's own: no softness correction."""

DRAWS = 5
QUICK_DRAWS = 1
