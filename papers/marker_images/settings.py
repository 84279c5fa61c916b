"""Settings of the study."""

NOISES = (2.0, 5.0)
"""Standard deviation of a pixel [grey levels of 255]."""

CONTRAST, BLUR = 120.0, 1.0
"""Grey levels between bright and dark; standard deviation of the point spread [px]."""

PITCH = 23.0
"""Distance between corners [px]; 20 rows of them fill a picture of 640×480."""

CORNER_PICTURES, QUICK_CORNER_PICTURES = 10, 1
"""Pictures of 400 corners for each noise, each laid and turned at random."""

ANGLES_DEG = tuple(range(2, 21))
"""The range that the source paper gives its method [deg]."""

FRICTION_RATIOS = (0.2, 0.3, 0.5)
"""μp0/2G* of the pivots [-]."""

PIVOT_DRAWS, PIVOT_PITCH, FIRM_MARKERS = 1, 0.92, 10
"""Draws of each ratio; side of a cell [mm]; markers that must truly stick for a frame to count."""
