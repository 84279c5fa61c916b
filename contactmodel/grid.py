"""The grid of equal cells on which pressure and traction are computed."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Float

from contactmodel.common.arrays import root

MOST_CELLS = 2**26
"""Largest number of cells. One field on the doubled grid of a convolution then takes 2 GB."""


@dataclass(frozen=True)
class Grid:
    """Equal rectangular cells in the undeformed contact plane; the origin is in the middle.

    Fields on the grid are indexed `[..., i, j]`, with i along x and j along y.

    Attributes:
        shape: number of cells along x and y.
        size: length of the grid along x and y [mm].

    Raises:
        ValueError: the shape is not two whole numbers from 2, there are more cells than
            `MOST_CELLS`, or the size is not two positive lengths.

    Examples:
        >>> from contactmodel import Grid
        >>> grid = Grid(shape=(16, 8), size=(8.0, 6.0))
        >>> grid.spacing, grid.points.shape
        ((0.5, 0.75), (2, 16, 8))
        >>> grid.x[:3]
        array([-3.75, -3.25, -2.75])
    """

    shape: tuple[int, int]
    size: tuple[float, float]

    def __post_init__(self) -> None:
        """Check the numbers and store them as tuples, which `jit` can compare."""
        shape, size = np.asarray(self.shape), np.asarray(self.size)
        if shape.shape != (2,) or shape.dtype.kind not in "iu" or shape.min() < 2:
            raise ValueError(
                "the shape of a grid must be two whole numbers, at least 2 cells along x and y, "
                f"got {self.shape}"
            )
        lengths = size.shape == (2,) and size.dtype.kind in "iuf"
        if not lengths or not np.all(np.isfinite(size) & (size > 0)):
            raise ValueError(
                f"the size of a grid along x and y must be above 0 mm, got {self.size}"
            )
        if math.prod(shape.tolist()) > MOST_CELLS:
            raise ValueError(f"a grid may have at most {MOST_CELLS} cells, got {self.shape}")
        object.__setattr__(self, "shape", tuple(shape.tolist()))
        object.__setattr__(self, "size", tuple(size.astype(float).tolist()))

    @property
    def spacing(self) -> tuple[float, float]:
        """Length of a cell along x and y [mm]."""
        return self.size[0] / self.shape[0], self.size[1] / self.shape[1]

    @property
    def cell_area(self) -> float:
        """Area of a cell [mm²]."""
        return self.spacing[0] * self.spacing[1]

    @property
    def x(self) -> Float[np.ndarray, " nx"]:
        """Centres of the cells along x [mm]."""
        return (np.arange(self.shape[0]) - 0.5 * (self.shape[0] - 1)) * self.spacing[0]

    @property
    def y(self) -> Float[np.ndarray, " ny"]:
        """Centres of the cells along y [mm]."""
        return (np.arange(self.shape[1]) - 0.5 * (self.shape[1] - 1)) * self.spacing[1]

    @property
    def points(self) -> Float[np.ndarray, "2 nx ny"]:
        """Centres of the cells [mm]."""
        return np.stack(np.meshgrid(self.x, self.y, indexing="ij"))


def dot(first: Float[Array, "2 nx ny"], second: Float[Array, "2 nx ny"]) -> Float[Array, "nx ny"]:
    """Scalar product of two vector fields, written out because XLA's sum takes far longer."""
    return first[0] * second[0] + first[1] * second[1]


def length(points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
    """Distance from the origin; its derivative is 0 at the origin [mm].

    Args:
        points: positions [mm].
    """
    return root(points[0] ** 2 + points[1] ** 2)


def interpolate(
    grid: Grid, field: Float[Array, "nx ny"], points: Float[Array, "2 ..."]
) -> Float[Array, "..."]:
    """A field at points [mm], bilinear; beyond the grid the value of the nearest cell."""
    axes = zip(points, grid.spacing, grid.shape, strict=True)
    place = [along / cell + 0.5 * (count - 1) for along, cell, count in axes]
    return map_coordinates(field, place, order=1, mode="nearest")


def make_points(grid: Grid, dtype: np.dtype) -> Float[Array, "2 nx ny"]:
    """Centres of the cells, computed inside a compiled program instead of stored in it [mm]."""
    axes = (jnp.asarray(axis, dtype) for axis in (grid.x, grid.y))
    return jnp.stack(jnp.meshgrid(*axes, indexing="ij"))
