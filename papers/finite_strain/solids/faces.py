"""The whole face of a square bar: a smooth surface through the nodes of its four quarters.

Between four nodes, on a side, it is Catmull and Rom's of the 4 × 4 nodes around. Flat sides would
give a contact several solutions: its pressure would jump where a node goes from side to side.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from papers.finite_strain.solids.bricks import Bricks, turn_sector


class Face(NamedTuple):
    """The whole face of a bar, from that of the quarter; its nodes row by row.

    Attributes:
        row: number of nodes in a row.
        place: positions of the nodes, undeformed [mm].
        owner: the node of the quarter's mesh to which each belongs.
        turn: matrix by which it is turned from there.
    """

    row: int
    place: Float[np.ndarray, "nodes 3"]
    owner: Int[np.ndarray, " nodes"]
    turn: Float[np.ndarray, "nodes 3 3"]

    @classmethod
    def of(cls, bar: Bricks) -> "Face":
        """The face of a mesh of a quarter."""
        reach = len(bar.grid[0]) - 1
        j, i = np.meshgrid(*2 * (np.arange(-reach, reach + 1),))
        quarters = np.zeros(i.shape, dtype=int)
        for _ in range(3):  # back to x > 0, y ≥ 0, or the axis
            out = ((i != 0) | (j != 0)) & ~((i > 0) & (j >= 0))
            i, j, quarters = np.where(out, j, i), np.where(out, -i, j), quarters + out
        owner = bar.lattice[i, j].ravel()
        turns = np.stack([turn_sector(4, count) for count in range(4)])[quarters.ravel()]
        place = np.einsum("nij,nj->ni", turns, bar.place[owner])
        return cls(2 * reach + 1, place, owner, turns)

    def positions(self, moved: np.ndarray) -> Float[np.ndarray, "nodes 3"]:
        """Present positions of its nodes from the displacement of the quarter's [mm]."""
        return self.place + np.einsum("nij,nj->ni", self.turn, moved[self.owner])

    def around(self, side: Int[np.ndarray, "top 2"]) -> Int[np.ndarray, "top 16"]:
        """The 4 × 4 nodes around sides; at the rim those on it twice."""
        near = np.clip(side[..., None] + np.arange(-1, 3), 0, self.row - 1)
        return (self.row * near[:, 0, :, None] + near[:, 1, None, :]).reshape(-1, 16)

    def find(
        self, positions: np.ndarray, at: Float[np.ndarray, "top 2"]
    ) -> tuple[Int[np.ndarray, "top 2"], Float[np.ndarray, "top 2"], Bool[np.ndarray, " top"]]:
        """The sides over points, the place on them, and whether there is one.

        Goes from side to side, by Newton's method on each.

        Args:
            positions: present positions of the face's nodes [mm].
            at: x and y of the points [mm].
        """
        first = self.place[: self.row, 1]
        side = np.clip(np.searchsorted(first, at) - 1, 0, self.row - 2)
        share = np.full(at.shape, 0.5)
        for _ in range(30):
            patch = positions[self.around(side), :2]
            share = np.asarray(_find_places(patch, share, at))
            beyond = (share > 1.0 + 1e-9).astype(int) - (share < -1e-9)
            moved = np.clip(side + beyond, 0, self.row - 2)
            if np.array_equal(moved, side):
                break
            share = np.where(moved == side, share, 0.5)
            side = moved
        missed = np.asarray(meet(positions[self.around(side)], share))[:, :2] - at
        inside = np.all((share > -1e-6) & (share < 1.0 + 1e-6), axis=1)
        return side, share, inside & (np.abs(missed).max(axis=1) < 1e-9)


def _blend(share: Array) -> Float[Array, "4"]:
    """Weights of four nodes in a row, between the second and third, of Catmull and Rom's curve."""
    u = share
    return 0.5 * jnp.stack([
        -u * (1 - u) ** 2, 2 - u**2 * (5 - 3 * u), u * (1 + u * (4 - 3 * u)), -(u**2) * (1 - u)
    ])  # fmt: skip


def weigh(share: Float[Array, "2"]) -> Float[Array, "16"]:
    """Weights of the 4 × 4 nodes around a side at a place on it.

    Args:
        share: the place, from 0 to 1 along both [-].
    """
    return jnp.outer(_blend(share[0]), _blend(share[1])).ravel()


def find_step(patch: Array, share: Array, at: Array) -> Float[Array, "2"]:
    """Newton's step, with its sign turned, of the place on a side towards a point.

    Args:
        patch: x and y of the 4 × 4 nodes around the side [mm].
        share: the place [-].
        at: x and y of the point [mm].
    """
    (a, b), (c, d) = patch.T @ jax.jacfwd(weigh)(share)
    x, y = weigh(share) @ patch - at
    return jnp.stack([d * x - b * y, a * y - c * x]) / (a * d - b * c)


@jax.jit
def _find_places(patch: Array, share: Array, at: Array) -> Float[Array, "top 2"]:
    for _ in range(7):
        share = jnp.clip(share - jax.vmap(find_step)(patch, share, at), -0.5, 1.5)
    return share


@jax.jit
def meet(patch: Array, share: Array) -> Float[Array, "top 3"]:
    """Positions of places on sides [mm].

    Args:
        patch: positions of the 4 × 4 nodes around each side [mm].
        share: the places [-].
    """
    return jax.vmap(lambda patch, share: weigh(share) @ patch)(patch, share)
