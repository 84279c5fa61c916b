"""Neighbours of markers on a regular grid or anywhere in the plane."""

import numpy as np
import scipy
from jaxtyping import Float, Int


def grid_neighbours(shape: tuple[int, int]) -> Int[np.ndarray, "n 4"]:
    """The four neighbours of each marker of a regular grid of so many rows and columns.

    Returns:
        For marker `row * columns + column` the markers in the previous row, the next row, the
        previous column and the next column; −1 beyond the rim.
    """
    rows, columns = shape
    index = np.pad(np.arange(rows * columns).reshape(shape), 1, constant_values=-1)
    around = (index[:-2, 1:-1], index[2:, 1:-1], index[1:-1, :-2], index[1:-1, 2:])
    return np.stack(around, axis=-1).reshape(-1, 4)


def delaunay_neighbours(
    reference: Float[np.ndarray, "n d"], longest: float = 1.8
) -> Int[np.ndarray, "n k"]:
    """The neighbours of each marker in the Delaunay triangulation of x and y.

    Args:
        reference: unloaded positions [mm].
        longest: edges longer than this multiple of the median edge are dropped, since they span
            gaps and hollows of the hull. The diagonal of a square cell, √2, stays by default.

    Returns:
        Indices in ascending order, padded with −1.

    Raises:
        ValueError: there are fewer than three markers, or all are on one line.
    """
    try:
        simplices = scipy.spatial.Delaunay(reference[:, :2]).simplices
    except (scipy.spatial.QhullError, ValueError) as error:
        raise ValueError(
            f"{len(reference)} markers give no triangulation: at least three are needed, not all "
            "on one line"
        ) from error
    edges = np.concatenate([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    length = np.linalg.norm(np.diff(reference[edges, :2], axis=1)[:, 0], axis=-1)
    edges = edges[length <= longest * np.median(length)]
    edges = np.concatenate([edges, edges[:, ::-1]])
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    count = np.bincount(edges[:, 0], minlength=len(reference))
    slot = np.arange(len(edges)) - np.repeat(np.cumsum(count) - count, count)
    neighbours = np.full((len(reference), count.max(initial=0)), -1)
    neighbours[edges[:, 0], slot] = edges[:, 1]
    return neighbours


def find_grid(reference: Float[np.ndarray, "n d"]) -> tuple[int, int] | None:
    """Rows and columns of markers that lie row by row on a regular grid; None if they do not.

    The grid may be rotated, mirrored and distorted. Every step along a row, and every step along a
    column, must differ by less than 0.35 of the mean step's length from it (published pads reach
    0.08). The two mean steps must be neither nearly parallel nor very different in length.
    """
    points = reference[:, :2]
    for rows in range(2, len(points) // 2 + 1):
        columns, rest = divmod(len(points), rows)
        if rest:
            continue
        lattice = points.reshape(rows, columns, 2)
        means, regular = [], True
        for step in (np.diff(lattice, axis=0), np.diff(lattice, axis=1)):
            mean = step.mean(axis=(0, 1))
            off = np.linalg.norm(step - mean, axis=-1)
            regular &= bool((off < 0.35 * np.linalg.norm(mean)).all())
            means.append(mean)
        (ax, ay), (bx, by) = means
        area = abs(ax * by - ay * bx)
        if regular and area > 0.5 * max(ax**2 + ay**2, bx**2 + by**2):
            return rows, columns
    return None


def list_neighbours(neighbours: Int[np.ndarray, "n k"]) -> list[list[int]]:
    """Indices of each marker's neighbours as lists, without the filling of −1."""
    return [[j for j in row if j >= 0] for row in neighbours.tolist()]
