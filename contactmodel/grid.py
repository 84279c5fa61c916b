"""The grid of equal cells on which pressure and traction are sought."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Grid:
    """Equal rectangular cells in the undeformed contact plane, the origin in their middle.

    Fields on it are indexed `[..., i, j]` with i along x and j along y.

    Attributes:
        shape: number of cells along x and y.
        size: length along x and y [mm].

    Raises:
        ValueError: fewer than two cells or a size that is not positive.
    """

    shape: tuple[int, int]
    size: tuple[float, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        if min(self.shape) < 2:
            raise ValueError(f"a grid needs at least 2 cells along x and y, got {self.shape}")
        if not all(np.isfinite(length) and length > 0 for length in self.size):
            raise ValueError(f"the size of a grid must be above 0 mm, got {self.size}")

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
