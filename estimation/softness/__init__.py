"""Softness of the object as it is applied to angles; `calibration.softness` fits it."""

from estimation.softness.contact import Contact, Lifting, Validity, disc_radius
from estimation.softness.files import Softness, expect_scale, read_softness, write_softness
from estimation.softness.layered import LayeredSoftness
from estimation.softness.scalar import RIGID_OBJECT, ScalarSoftness

__all__ = [
    "RIGID_OBJECT",
    "Contact",
    "LayeredSoftness",
    "Lifting",
    "ScalarSoftness",
    "Softness",
    "Validity",
    "disc_radius",
    "expect_scale",
    "read_softness",
    "write_softness",
]
