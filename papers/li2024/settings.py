"""The paper's constants with their place, and our choices where it gives none.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from typing import NamedTuple

# Printed in the paper.

CUBE_MM = 15.0
"""Side of the test cube [mm], Section V-A."""

ANGLES_DEG = tuple(range(2, 21))
"""Static angles, "each integer scale" of 2 to 20 [deg], Section V-A."""

REPETITIONS = (25, 30)
"""Fewest and most repetitions of each angle, Section V-A."""

RATE_HZ = 30.0
"""Frames per second, Sections IV and V-B."""

LIFTS = (20, 25)
"""Fewest and most lifts of each of the ten objects, Section V-B."""

LIFT_RANGE_DEG = (2.0, 20.0)
"""Angles that an object is lifted by [deg], Section V-B."""

# Not given in the paper; our choices.

DOME_MM = 30.0
"""Radius of the pad's dome [mm]; pads with published recordings have 27 to 33."""

APPROACH_MM = 0.83
"""The cube's approach [mm]; on the dome it gives a contact of radius 5 mm, within the face."""

PITCH_MM = 1.0
MARKERS = (20, 20)
"""Markers of the pad, and their distance [mm]: the values of published Tac3D recordings."""

FRICTION_RATIOS = (0.3, 0.6)
"""μp0/2G* of a repetition [-], drawn uniformly; at 20° about 5 to 40 markers still stick."""

NOISES_UM = (1.0, 10.0)
"""Noise per in-plane coordinate [µm]: of Tac3D at rest, and of a poor camera."""

FIRM_MARKERS = 10
"""Fewest truly sticking markers in a frame that counts."""

QUICK_REPETITIONS = (3, 4)

SEED = 20


class ObjectShape(NamedTuple):
    """One of the ten objects; the paper does not say which household objects it used."""

    # semi-axes of the ellipsoid that describes the held surface [mm]
    semi_axes: tuple[float, float, float]
    approach: float  # approach, which sets the grip [mm]
    stiffness_ratio: float = 0.0  # k [-]
    thickness: float = 4.0  # thickness of the elastomer [mm]
    friction_coefficient: float = 1.0  # μ [-]
    # turn of the object between finger and angular sensor over the moment [rad/(N·mm)]
    deflection: float = 0.0


_FLAT = 1e4
OBJECTS = {
    "1 box": ObjectShape((_FLAT, _FLAT, _FLAT), 0.6),
    "2 can": ObjectShape((30.0, _FLAT, 30.0), 0.7, thickness=5.0),
    "3 ball": ObjectShape((25.0, 25.0, 25.0), 0.9, thickness=5.0),
    "4 bottle": ObjectShape((40.0, 80.0, 20.0), 0.8, 0.05),
    "5 light box": ObjectShape((_FLAT, _FLAT, _FLAT), 0.4, 0.02, thickness=3.0),
    "6 heavy box": ObjectShape((_FLAT, _FLAT, _FLAT), 0.8, 0.02, thickness=5.0),
    "7 slender": ObjectShape((_FLAT, 40.0, 40.0), 0.7, 0.0, deflection=6e-4),
    "8 soft tube": ObjectShape((20.0, 60.0, 20.0), 1.2, 1.0, thickness=3.0),
    "9 sponge": ObjectShape((_FLAT, _FLAT, _FLAT), 0.7, 0.3, thickness=2.0),
    "10 rubber": ObjectShape((30.0, 30.0, 30.0), 1.0, 0.5, thickness=5.0),
}

LIFT_MARKERS = (16, 16)
"""Markers for the ten objects, whose contacts are up to 13 mm long."""

LIFT_NOISE_MM = (3e-3, 10e-3)
"""Noise of the lifts in the plane and along z [mm]."""

DROPPED = 0.1
"""Share of lost frames in the lifts."""

QUICK_LIFTS = (4, 4)
