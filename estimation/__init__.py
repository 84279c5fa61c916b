"""Estimate the angle of an object from the frames of the tactile sensor that holds it.

Angles are counter-clockwise, seen from the object, in rad unless a name ends in `_deg`. Lengths
are in mm.
"""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
