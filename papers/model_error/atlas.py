"""The atlas, for `papers sweep`: contacts under reversed twist over k, thickness, size, friction.

Each case is a path of 40 steps on 64² cells: a ball pressed onto an elastic layer, turned by 12°,
and turned back to −8°. 252 cases are 10,080 solves.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel import Contact, Grid, HalfSpace, Layer, Paraboloid, Pose, make_path, solve_path
from papers.model_error import settings
from papers.sweeps import Study

RATIOS = (0.0, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
THICKNESSES = (2.0, 3.0, 4.0, 6.0, 10.0, 60.0)
INDENTATIONS = (0.3, 0.8)
"""Approaches [mm], for contacts of two sizes."""

FRICTIONS = (0.3, 0.7, 1.5)
TURN_DEG, BACK_DEG = 12.0, -8.0
STEPS = (16, 24)
"""Steps of the turn, and of the way back."""

CELLS = 64
_RADIUS, _SIZE = 20.0, 13.0  # radius of the ball, side of the grid [mm]
_LEAST_RATIO = 1e-6  # the object's half-space must not be rigid


def cases(quick: bool) -> dict[str, np.ndarray]:
    """All combinations; the quick table has the extremes and a few values between."""
    axes = (RATIOS, THICKNESSES, INDENTATIONS, FRICTIONS)
    if quick:
        axes = ((0.0, 0.4, 1.0), (2.0, 60.0), INDENTATIONS, (0.3, 1.5))
    k, h, depth, mu = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    cells = np.full(len(k), 32 if quick else CELLS)
    return {
        "stiffness_ratio": k,
        "thickness": h,
        "indentation": depth,
        "friction": mu,
        "cells": cells,
    }


def evaluate(
    stiffness_ratio: Float[Array, ""],
    thickness: Float[Array, ""],
    indentation: Float[Array, ""],
    friction: Float[Array, ""],
    cells: int,
) -> dict[str, Array]:
    """Twist, φ of the stick region and of the contact, stick ratio and moment along the path.

    Angles are in rad, the moment in N·mm; `contact_radius` [mm] is that of the pressed contact.
    """
    modulus, nu = settings.SHEAR_MODULUS, settings.POISSON_RATIO
    turn, back = jnp.radians(TURN_DEG), jnp.radians(BACK_DEG)
    poses = [Pose(indentation, twist=twist, linear=True) for twist in (0.0, turn, back)]
    solution = solve_path(
        Contact(
            Layer(modulus, nu, thickness),
            HalfSpace(modulus / jnp.maximum(stiffness_ratio, _LEAST_RATIO), nu),
            Paraboloid(_RADIUS),
            Grid((cells, cells), (_SIZE, _SIZE)),
            friction,
        ),
        make_path(poses, STEPS),
        rtol=1e-6,
    )
    displacement = solution.elastomer_displacement()
    points = jnp.asarray(solution.grid.points)
    return {
        "twist": solution.pose.twist,
        "stick_rotation": _turn(displacement, points, solution.stick),
        "contact_rotation": _turn(displacement, points, solution.contact),
        "stick_ratio": solution.stick_ratio,
        "moment": solution.moment,
        "contact_radius": jnp.sqrt(jnp.sum(solution.contact[0]) * solution.grid.cell_area / jnp.pi),
    }


def _turn(displacement: Array, points: Array, mask: Array) -> Array:
    """Rigid fit Σ r × u / Σ r² about the axis, over the cells of a mask; NaN if it is empty.

    The displacement is exact at the cells' centres, but its curl is not at the stick region's edge.
    """
    x, y = points
    u_x, u_y = displacement[..., 0, :, :], displacement[..., 1, :, :]
    arm = jnp.sum((x**2 + y**2) * mask, axis=(-2, -1))
    turn = jnp.sum((x * u_y - y * u_x) * mask, axis=(-2, -1))
    return jnp.where(arm > 0, turn / jnp.where(arm > 0, arm, 1.0), jnp.nan)


# batches of one: a larger batch waits for its slowest path (42 ms a solve with four, 24 ms alone)
STUDY = Study(cases, evaluate, static=("cells",))
