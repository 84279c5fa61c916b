"""Differentiable contact of two elastic bodies with friction, in JAX.

Lengths are in mm, forces in N, stresses in MPa. Angles are in rad unless a name ends in `_deg`.
Rotations are counter-clockwise positive, seen from the object looking at the elastomer (the +z
axis points out of the elastomer). The source paper measures the object's angle clockwise. Only
functions that state one of its numbered equations keep that sign.

The library does not change `jax.config`. Switch to double precision yourself:
`jax.config.update("jax_enable_x64", True)`.
"""

from contactmodel.common.lazy import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
