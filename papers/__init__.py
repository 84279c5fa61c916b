"""Regenerate published results, and run our own studies."""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
