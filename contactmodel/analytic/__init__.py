"""Closed forms of axisymmetric contact under pressure, torsion (also reversed) and shift."""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
