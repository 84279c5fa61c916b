"""Settings of the study."""

from typing import NamedTuple


class RuleSettings(NamedTuple):
    """The ten-line rule.

    Attributes:
        markers: those that move furthest, whose median shift is the shear.
        least: peak of the shear from which a fall counts [px].
        fallen: share of the peak by which it must fall to be a slip [-].
    """

    markers: int = 10
    least: float = 0.5
    fallen: float = 0.12


class FitSettings(NamedTuple):
    """How the numbers that make probabilities are fitted.

    The two outcomes separate without an error, so that the likelihood alone would make both
    spreads 0. They get a log-normal prior.

    Attributes:
        spread: its median [-].
        width: its standard deviation, of the logarithm [-].
        starts: values of `fallen` and `kept` that the fit begins with [-].
    """

    spread: float = 0.05
    width: float = 0.5
    starts: tuple[tuple[float, float], ...] = ((0.15, 0.5), (0.15, 0.65), (0.3, 0.5), (0.3, 0.65))


class View(NamedTuple):
    """What the outside camera sees of an object in the gripper.

    Attributes:
        object_: left, top, width and height of the part of the object near the fingers [px].
        gripper: the same of the finger with the sensor [px].
        vanishing: point that the object moves towards where it slides along itself [px].
    """

    object_: tuple[int, int, int, int]
    gripper: tuple[int, int, int, int]
    vanishing: tuple[float, float]


VIEWS = {
    "object001": View((315, 175, 110, 125), (60, 180, 230, 150), (308.0, 40.0)),
    "object003": View((332, 200, 72, 100), (60, 180, 260, 150), (348.0, 103.0)),
}
"""Lifts that the outside camera has seen. The vanishing points are the fixed points of the
similarities that take the first picture to the last one of the slips, medians."""

FINGER_PX_PER_MM = 3.64
"""By how much the fingers move apart in the outside pictures for 1 mm more of the gripper's width:
a line through the 19 lifts of both objects leaves 0.2 px at one finger and 0.3 px at the other."""

FOCAL_PX = 600.0
"""Focal length of the outside camera [px]. Nobody gives it; 500 to 700 px are the fields of view,
65° to 49°, of such cameras."""

SLID_MM = (1.0, 2.0, 3.0)
"""Motion of the object against the gripper at which frames are compared [mm]."""

WORST = 6
"""Least sure lifts of which pictures are shown."""

SHOWN = 8
"""Pictures of each of them."""

QUICK = "object003"
"""The object whose lifts alone are taken if quick."""
