"""Settings that several items of the study share."""

SHEAR_MODULUS = 0.2
"""G of the elastomer [MPa]; angles do not depend on it."""

POISSON_RATIO = 0.48
"""ν of the elastomer [-]: silicone."""

CONTACT_RADIUS = 5.0
"""a of the virtual pivots [mm]; it covers 80 markers at 1 mm."""

ANGLE_DEG = 10.0
"""Default angle of the object [deg]."""

SEED = 14
