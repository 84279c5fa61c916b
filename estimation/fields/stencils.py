"""Tangent planes and difference stencils of a marker layout."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.frames.neighbours import list_neighbours
from estimation.frames.recording import MarkerLayout


@dataclass(frozen=True)
class Stencils:
    """Difference stencils of a marker layout, made once and used for every frame.

    Attributes:
        reference: unloaded positions [mm]; two-dimensional layouts have z = 0.
        neighbours: indices of neighbours, filled up with −1.
        normals: unit normals of the unloaded surface, towards +z.
        tangents: two orthonormal tangents per marker, as columns; on a grid, the pair closest to
            its rows and columns.
        offsets: reference offsets to the neighbours in these tangents [mm]; 0 without neighbour.
        flat: whether the recording has no z coordinate and therefore no indentation.
        gridded: whether the markers form a regular grid.
    """

    reference: Float[np.ndarray, "n 3"]
    neighbours: Int[np.ndarray, "n k"]
    normals: Float[np.ndarray, "n 3"]
    tangents: Float[np.ndarray, "n 3 2"]
    offsets: Float[np.ndarray, "n k 2"]
    flat: bool
    gridded: bool

    def fit_planes(
        self, valid: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n 2 2"]]:
        """Weights of the neighbours, and the inverse normal matrix of each marker's plane fit."""
        return self._whole_fit if valid.all() else self._fit_planes(valid)

    @cached_property
    def _whole_fit(self) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n 2 2"]]:
        return self._fit_planes(np.ones(len(self.reference), dtype=bool))

    def _fit_planes(
        self, valid: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n 2 2"]]:
        weights = ((self.neighbours >= 0) & valid[self.neighbours] & valid[:, None]) * 1.0
        weighted = self.offsets * weights[..., None]
        normal_matrix = weighted.transpose(0, 2, 1) @ self.offsets
        a, b, d = normal_matrix[:, 0, 0], normal_matrix[:, 0, 1], normal_matrix[:, 1, 1]
        determinant = a * d - b * b
        enough = determinant > 1e-3 * (a + d) ** 2
        determinant = np.where(enough, determinant, np.nan)
        adjugate = np.stack([np.stack([d, -b], -1), np.stack([-b, a], -1)], -2)
        return weights, adjugate / determinant[:, None, None]

    @cached_property
    def adjacent(self) -> list[list[int]]:
        """Indices of each marker's neighbours, as lists."""
        return list_neighbours(self.neighbours)

    def rotation_noise(self, noise_mm: float) -> float:
        """Typical standard error of φ for a marker noise per in-plane coordinate [rad]."""
        pitch = np.sqrt(np.sum(self.offsets**2, axis=(1, 2)) / 2.0)
        return float(noise_mm / np.sqrt(2.0) / np.median(pitch))


def marker_pitch(layout: MarkerLayout) -> float:
    """Median distance between neighbouring markers [mm]; NaN without neighbours."""
    inner, slot = np.nonzero(layout.neighbours >= 0)
    pairs = layout.reference[inner] - layout.reference[layout.neighbours[inner, slot]]
    return float(np.median(np.linalg.norm(pairs, axis=1))) if len(pairs) else np.nan


def make_stencils(layout: MarkerLayout) -> Stencils:
    """Tangent planes and neighbour offsets of the unloaded markers."""
    reference = in_space(layout.reference)
    neighbours = layout.neighbours
    there = neighbours >= 0
    edges = np.where(there[..., None], reference[neighbours] - reference[:, None], 0.0)
    normals = _plane_normals(edges)
    first = _tangent(edges[:, 0], normals)
    if layout.grid_shape is not None:
        grid = reference.reshape(*layout.grid_shape, 3)
        columns, rows = (
            _tangent(line.reshape(-1, 3), normals) for line in np.gradient(grid, axis=(0, 1))
        )
        first = unit(unit(rows + columns) + unit(rows - columns))
    tangents = np.stack([first, cross(normals, first)], axis=-1)
    return Stencils(
        reference=reference,
        neighbours=neighbours,
        normals=normals,
        tangents=tangents,
        offsets=edges @ tangents,
        flat=layout.reference.shape[1] == 2,
        gridded=layout.grid_shape is not None,
    )


def _plane_normals(edges: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals, towards +z, of the planes fitted to each marker's edges."""
    _, vectors = np.linalg.eigh(edges.transpose(0, 2, 1) @ edges)
    normals = vectors[..., 0]
    return np.where(normals[:, 2:] < 0, -normals, normals)


def _tangent(
    vectors: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors in the planes across the normals."""
    return unit(vectors - np.sum(vectors * normals, axis=-1, keepdims=True) * normals)


def in_space(points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 3"]:
    """Points in three dimensions; z = 0 for points in the plane."""
    none = np.zeros((len(points), 3 - points.shape[1]))
    return np.concatenate([points, none], axis=1) if none.size else points


def cross(
    a: Float[np.ndarray, "*#batch 3"], b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Vector products; for few vectors much faster than `numpy.cross`."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = ay * bz - az * by
    product[..., 1] = az * bx - ax * bz
    product[..., 2] = ax * by - ay * bx
    return product


def unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Vectors of length 1 in the same directions; NaN for vectors of length 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def mean_around(stencils: Stencils, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Mean value of each marker and its neighbours; 0 where none is known."""
    there = stencils.neighbours >= 0
    around = np.where(there, values[stencils.neighbours], np.nan)
    values = np.column_stack([values, around])
    known = np.isfinite(values)
    return np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def erode(markers: Bool[np.ndarray, " n"], stencils: Stencils) -> Bool[np.ndarray, " n"]:
    """The markers of a region whose neighbours all belong to it."""
    return markers & (markers[stencils.neighbours] | (stencils.neighbours < 0)).all(axis=1)
