"""From frames of a tactile sensor to the angle of the object it holds.

Angles are counter-clockwise, seen from the object, in rad unless a name ends in `_deg`. Lengths
are in mm.
"""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
