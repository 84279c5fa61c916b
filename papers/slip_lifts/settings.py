"""Settings of the study."""

from typing import NamedTuple


class RuleSettings(NamedTuple):
    """The ten-line rule."""

    markers: int = 10  # number of the markers that move most; their median motion is the shear
    least: float = 0.5  # least peak of the shear for which a fall counts [px]
    fallen: float = 0.12  # least fall of the shear, over its peak, that is called a slip [-]


class FitSettings(NamedTuple):
    """Settings of the fit of the probability.

    The two outcomes separate without error, so the likelihood alone would drive both spreads to 0,
    and it determines `fallen` only if some slips are not shown by the print. These three numbers
    therefore have log-normal priors.
    """

    fallen: float = RuleSettings().fallen  # median of the prior of `fallen` [-]
    spread: float = 0.05  # median of the priors of the spreads [-]
    width: float = 0.5  # standard deviation of the logarithm in the priors [-]
    starts: tuple[float, ...] = (0.5, 0.65)  # initial values of `kept` [-]


class View(NamedTuple):
    """Regions of the outside camera's view of an object in the gripper.

    Attributes:
        object_: left, top, width and height of the part of the object near the fingers [px].
        gripper: left, top, width and height of the finger with the sensor [px].
        vanishing: vanishing point, towards which the sliding object moves [px].
    """

    object_: tuple[int, int, int, int]
    gripper: tuple[int, int, int, int]
    vanishing: tuple[float, float]


VIEWS = {
    "object001": View((315, 175, 110, 125), (60, 180, 230, 150), (308.0, 40.0)),
    "object003": View((332, 200, 72, 100), (60, 180, 260, 150), (348.0, 103.0)),
}
"""Views of the objects recorded by the outside camera. A vanishing point is the median, over the
slips, of the fixed point of the similarity from the first picture to the last."""

FINGER_PX_PER_MM = 3.64
"""Distance by which the fingers move apart in the outside pictures per 1 mm of the gripper's width.
A line through the 19 lifts of both objects leaves 0.2 px at one finger and 0.3 px at the other."""

FOCAL_PX = 600.0
"""Focal length of the outside camera [px]. The data set does not give it; such cameras have 500 to
700 px, a field of view of 65° to 49°."""

SLID_MM = (1.0, 2.0, 3.0)
"""Motions of the object relative to the gripper for which the lead is measured [mm]."""

WORST = 6
"""Number of the least certain lifts that are shown."""

SHOWN = 8
"""Number of pictures for each of these lifts."""

QUICK = "object003"
"""The only object of the quick size."""
