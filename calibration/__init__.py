"""Calibration of sensors and objects: properties that must be known before angles are measured."""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
