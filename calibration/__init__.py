"""What is found out about a sensor beforehand, before it is trusted with angles."""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
