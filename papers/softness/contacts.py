"""Soft objects pressed on a layer and turned, for `papers sweep`; input of `layered`.

Each case is a path of ten contacts: a cube, a sphere or a lying cylinder is pressed on and then
turned by 12°. Grasps differ in contact size: two are for fitting, and two, one smaller and one
larger, for testing.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    HeightMap,
    Layer,
    Paraboloid,
    Pose,
    SquarePunch,
    solve_path,
)
from papers.sweeps import Study

RATIOS = (0.1, 0.3, 0.5, 1.0, 2.0)
THICKNESSES = (2.0, 3.0, 5.0, np.inf)
"""Thickness of the bonded elastomer [mm]; inf is a half-space, solved as a layer of 60 mm."""

SHAPES = ("cube", "sphere", "cylinder")
SIZES = {
    "cube": (6.0, 7.0, 5.0, 9.0),
    "sphere": (3.0, 3.5, 2.5, 4.5),
    "cylinder": (6.0, 7.5, 5.0, 10.0),
}
"""Grasps: width of the cube's face, radius of a sphere's contact, length of the cylinder [mm].

The radii of spheres and cylinders follow from their contact between half-spaces.
"""

FITTED, TESTED = (0, 1), (2, 3)
"""Grasps for fitting, and for testing."""

TWISTS_DEG = np.array([0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0])
MARKERS, PITCH = 20, 1.0
"""Markers along a side, and their distance [mm]."""

OFFSETS = ((0.13, -0.21), (-0.32, 0.08), (0.4, 0.27), (-0.05, -0.44))
"""Offset of the markers from the object's axis, by grasp [mm]."""

SHEAR_MODULUS, POISSON_RATIO, FRICTION = 0.2, 0.48, 0.8
EDGE = 0.5
"""Radius of the cube's edges and of the cylinder's ends [mm]."""

_THICK = 60.0  # mm
_CELLS, _SIZE = 44, 15.0  # cells along a side of the grid, and its length [mm]
_INDENTATION = 0.3  # approximate indentation of the elastomer [mm]
_STIFFENING = 3.5  # a pressed layer is stiffer than a half-space by 1 + (this/h)² [mm]
_HALF_WIDTH = 2.5  # half-width of the cylinder's contact [mm]


def markers(grasp: int) -> Float[np.ndarray, "n 2"]:
    """Positions of a grasp's markers in the object's frame [mm]."""
    at = PITCH * (np.arange(MARKERS) - 0.5 * (MARKERS - 1))
    x, y = np.meshgrid(at, at)
    return np.stack([x, y], -1).reshape(-1, 2) + np.asarray(OFFSETS[grasp])


def cases(quick: bool) -> dict[str, np.ndarray]:
    """All combinations; the quick table has one object."""
    axes = (RATIOS, THICKNESSES, range(len(SHAPES)), range(4))
    if quick:
        axes = ((0.5,), (2.0,), (SHAPES.index("sphere"),), range(4))
    k, h, shape, grasp = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    return {"stiffness_ratio": k, "thickness": h, "shape": shape, "grasp": grasp}


def evaluate(
    stiffness_ratio: Float[Array, ""],
    thickness: Float[Array, ""],
    shape: Array,
    grasp: Array,
) -> dict[str, Array]:
    """Displacement of the markers [mm], and masks of contact and stick, along the path."""
    grid = Grid((_CELLS, _CELLS), (_SIZE, _SIZE))
    sizes = jnp.asarray([SIZES[name] for name in SHAPES])[shape, grasp]
    twist = jnp.radians(jnp.concatenate([jnp.zeros(1), jnp.asarray(TWISTS_DEG)]))
    points = jnp.asarray(grid.points)
    stiffening = 1.0 + (_STIFFENING / thickness) ** 2
    approach = _INDENTATION * (1.0 + stiffness_ratio * stiffening)  # adds the object's indentation
    heights = jnp.stack([
        SquarePunch(jnp.where(shape == 0, sizes, 5.0), EDGE).height(points),
        Paraboloid(sizes**2 / approach).height(points),
        _lying_cylinder(points, _HALF_WIDTH**2 / approach, jnp.where(shape == 2, sizes, 5.0)),
    ])  # fmt: skip
    path = solve_path(
        Contact(
            Layer(SHEAR_MODULUS, POISSON_RATIO, jnp.minimum(thickness, _THICK)),
            HalfSpace(SHEAR_MODULUS / stiffness_ratio, POISSON_RATIO),
            HeightMap(heights[shape], grid.spacing),
            grid,
            FRICTION,
        ),
        Pose(approach, twist=twist),
        rtol=1e-6,
    )
    at = jnp.stack([jnp.asarray(markers(i)) for i in range(4)])[grasp]
    pressed = path.at_step(0).elastomer_displacement_at(at)
    carried = at + pressed[:, :2]  # the turn starts from the pressed positions
    turned = path.elastomer_displacement_at(carried)
    index = jnp.floor(at / jnp.asarray(grid.spacing) + 0.5 * _CELLS).astype(int)
    inside = jnp.all((index >= 0) & (index < _CELLS), axis=1)
    i, j = jnp.clip(index, 0, _CELLS - 1).T
    return {
        "displacement": (pressed + turned - turned[0])[1:],
        "contact": (path.contact[:, i, j] & inside)[1:],
        "stick": (path.stick[:, i, j] & inside)[1:],
    }


def _lying_cylinder(points: Array, radius: Array, length: Array) -> Array:
    """Height of a cylinder along y: x²/2R across, with ends rounded like the cube's edges [mm]."""
    x, y = points
    ends = SquarePunch(length, EDGE).height(jnp.stack([jnp.zeros_like(y), y]))
    return x**2 / (2.0 * radius) + ends


# batches of one: a larger batch waits for its slowest path
STUDY = Study(cases, evaluate, uses=("contactmodel",))
