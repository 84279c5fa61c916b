"""Settings of the leaderboard: the cases, the tolerances of right answers, and the seeds.

This module imports nothing heavy, so that a wrong entry is rejected at once.
"""

from typing import Any, NamedTuple

TIERS = ("virtual", "finite strain", "real")

TUNING_SEED = 0
"""Seed of the tuning cases, whose truth is exported."""

PRACTICE_SEED = 2026
"""Default seed of the scored cases. It is public, and so is their truth."""

SCORED_DRAWS = 2
"""Scored recordings of each simulated group; one more recording is for tuning."""

TOLERANCE_DEG = {"virtual": 0.5, "finite strain": 0.5, "real": 2.0}
"""Largest error of a right answer [deg]: three times the 0.17° that [Li2024] prints. True angles of
the real tier are accurate to a degree or two."""

LEAST_STICKING = 3
"""Fewest sticking markers in a scored frame."""

UNLOADED, PRESSING = 10, 15
"""Frames before the object touches, and frames of the press."""

LIFT = {"corners_deg": (0.0, 15.0), "frames": (60,)}
REVERSAL = {"corners_deg": (0.0, 10.0, 10.0, -30.0), "frames": (40, 15, 120)}


class Condition(NamedTuple):
    """A virtual pivot by closed forms.

    Attributes:
        model: values of `estimation.virtual.PivotModel` that differ from its defaults.
        path: largest angles at its corners [deg], and frames between them. A draw turns to 0.7 to
            1 times these angles, clockwise or counter-clockwise.
        shift_mm: shift of the pad by the end of the path [mm].
        missing: share of hidden markers [-].
        lost: share of lost frames [-].
        laid_at_random: whether a draw also chooses the place of the object's axis and the
            direction of the markers' rows.
    """

    model: dict[str, Any]
    path: dict[str, Any] = LIFT
    shift_mm: tuple[float, float] = (0.0, 0.0)
    missing: float = 0.0
    lost: float = 0.05
    laid_at_random: bool = True


CONDITIONS = {
    "rigid": Condition({"friction_ratio": 0.3}),
    "soft": Condition({"friction_ratio": 0.3, "stiffness_ratio": 0.5}),
    "translating": Condition({"friction_ratio": 0.3}, shift_mm=(0.6, -0.4)),
    "small": Condition({"friction_ratio": 0.3, "contact_radius": 2.5, "approach": 0.6}),
    "round": Condition({"friction_ratio": 0.3, "offset": (0.0, 0.0)}, laid_at_random=False),
    "reversing": Condition({"friction_ratio": 0.15}, path=REVERSAL),
    "noisy": Condition({"friction_ratio": 0.3, "noise": 10e-3, "normal_noise": 35e-3}),
    "gappy": Condition({"friction_ratio": 0.3}, missing=0.1, lost=0.4),
}
"""Virtual pivots by group, all with round contacts. In `round` the axis is in the middle of four
markers. In `translating` the whole pad shifts, without the slip that a shift of the object would
cause, since no closed form covers both at once."""

ELONGATED_FRICTION = 0.5
"""μ of group `elongated` [-]: a solved contact of 2:1, turned back through zero to macro slip."""

ELONGATED_FRAMES = 120

RENDERED = "held, turned and back"
"""Condition of `papers.marker_images.scenes` for the pictures of group `rendered`."""

RENDERED_FRAMES = 80


class Gel(NamedTuple):
    """A contact of the finite-strain tier, solved by finite elements."""

    flat_mm: float  # radius of the flat face; 0 for a sphere [mm]
    edge_mm: float  # radius of the rounded edge, or of the sphere [mm]
    depth_mm: float  # indentation depth in 8 mm of gel [mm]
    cell_mm: float = 0.2  # side of the elements under the contact [mm]


GELS = {
    "sphere": Gel(0.0, 20.0, 1.0),
    "deep sphere": Gel(0.0, 20.0, 2.0),
    "small sphere": Gel(0.0, 10.0, 1.28),
    "punch": Gel(3.0, 1.0, 0.64, 0.15),
}
GEL_FRICTION = 0.5
GEL_PEAK_DEG, GEL_BACK_DEG = 25, -10
"""The object turns to the first angle and back to the second, one degree per step [deg]."""
GEL_PRESSES = 8
GEL_NOISES_MM = (1e-3, 3.5e-3)
"""Noise of x and y, and of z [mm]."""
GEL_LOST = 0.1
"""Share of frames lost [-]."""

TAC3D = {"HDL1-GWH0021": ("tuning", 120), "HDL1-GWH0022": ("scored", 114)}
"""Split and frames of the recordings of `tac3d-pivot`."""
CLIPS = {"camera_0": ("tuning", 450), "camera_2": ("scored", 450)}
"""Split and frames of the clips of `pivot-videos`."""
TUNING_LIFTS = ("object001", "object002")
"""Objects of `slip-lifts` for tuning; the others are scored."""

AXIS_METHODS = ("castano", "invariantcloud")
"""Methods that measure the object's own angle and need no softness correction."""

GRIPS = (0.05, 0.1, 0.15, 3.0)
"""μp0/2G* of the pivots for slip warnings [-]; at the last no marker slips."""

TWIST = {"angles_deg": (0.0, 30.0), "frames": (90,)}
"""Twist of these pivots: 10°/s."""

WARNING_DRAWS = 2
"""Number of these pivots per grip."""

SHOWN = 15
"""Printed rows of the table; the file has all rows."""
