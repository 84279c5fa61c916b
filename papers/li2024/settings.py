"""Constants of the paper with their place, and apart from them what it leaves open.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

# Printed in the paper.

CUBE_MM = 15.0
"""Side of the test cube [mm], Section V-A."""

ANGLES_DEG = tuple(range(2, 21))
"""Static angles, "each integer scale" of 2 to 20 [deg], Section V-A."""

REPETITIONS = (25, 30)
"""Fewest and most repetitions of each angle, Section V-A."""

STAGE_ERROR_DEG = 0.1
"""Accuracy of the rotary stage and of the angular sensor [deg], Sections V-A and V-B."""

RATE_HZ = 30.0
"""Frames per second, Sections IV and V-B."""

LIFTS = (20, 25)
"""Fewest and most lifts of each of the ten objects, Section V-B."""

LIFT_RANGE_DEG = (2.0, 20.0)
"""Angles that an object is lifted by [deg], Section V-B."""

# Left open by the paper, chosen by us.

DOME_MM = 30.0
"""Radius of the pad's dome [mm]: that of pads whose recordings were published lies at 27 to 33."""

APPROACH_MM = 0.83
"""The cube's approach [mm]: on the dome it gives a contact of radius 5 mm, within its face."""

PITCH_MM = 1.0
MARKERS = (20, 20)
"""Markers of the pad and their distance [mm], those of published Tac3D recordings."""

FRICTION_RATIOS = (0.3, 0.6)
"""μp0/2G* of a repetition [-], drawn uniformly: at 20° some 5 to 40 markers still stick."""

NOISES_UM = (1.0, 10.0)
"""Noise per in-plane coordinate [µm]: what still Tac3D frames have, and a poor camera's."""

FIRM_MARKERS = 10
"""Frames count where at least this many markers truly stick."""

QUICK_REPETITIONS = (3, 4)

SEED = 20
