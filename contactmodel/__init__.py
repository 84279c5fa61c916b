"""Differentiable contact of two elastic bodies with Coulomb friction, in JAX.

Lengths are in mm, forces in N, stresses in MPa, angles in rad (degrees only where a name ends in
`_deg`). Rotations are counter-clockwise positive, seen from the object looking at the elastomer
(the +z axis points out of the elastomer). The source paper measures the object's angle clockwise;
functions that state one of its numbered equations keep its sign, everything else does not.

The library never touches `jax.config`; use double precision:
`jax.config.update("jax_enable_x64", True)`.
"""

from contactmodel.bodies import AbstractBody, HalfSpace, Layer, Rigid, stiffness_ratio
from contactmodel.grid import Grid
from contactmodel.indenters import (
    AbstractIndenter,
    Cylinder,
    Domed,
    Ellipsoid,
    HeightMap,
    Paraboloid,
    Placed,
    RoundPunch,
    Sphere,
    SquarePunch,
)
from contactmodel.pose import Pose, make_path
from contactmodel.resultant_path import solve_resultant_path
from contactmodel.resultants import solve_resultant
from contactmodel.sliding import solve_sliding
from contactmodel.solution import RESULTS, ContactSolution
from contactmodel.solve import solve_contact, solve_path
from contactmodel.transfer import ScalarTransfer, fit_scalar_transfer, transfer_function

__all__ = [
    "RESULTS",
    "AbstractBody",
    "AbstractIndenter",
    "ContactSolution",
    "Cylinder",
    "Domed",
    "Ellipsoid",
    "Grid",
    "HalfSpace",
    "HeightMap",
    "Layer",
    "Paraboloid",
    "Placed",
    "Pose",
    "Rigid",
    "RoundPunch",
    "ScalarTransfer",
    "Sphere",
    "SquarePunch",
    "fit_scalar_transfer",
    "make_path",
    "solve_contact",
    "solve_path",
    "solve_resultant",
    "solve_resultant_path",
    "solve_sliding",
    "stiffness_ratio",
    "transfer_function",
]
