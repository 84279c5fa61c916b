"""Square gels and bars at finite strain: 8-node bricks on a sector of them.

Object, gel and path are unchanged by a half or a quarter turn about the axis, so that half or a
quarter of the gel is meshed. Displacements on one cut are those on the other, turned: each node of
the second cut belongs to one of the first. scikit-fem gives mesh, shape functions and integration
points. As in `gel`, only an element's mean dilatation enters the energy.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from papers.finite_strain.gel import shape_strain


class Bricks(NamedTuple):
    """Mesh of a sector of a gel, or of a bar: y ≥ 0, and with four sectors also x ≥ 0.

    The top is the surface that is touched, of a bar the lower face.

    Attributes:
        place: x, y and z of the nodes; z = 0 at the middle of the top [mm].
        nodes: indices of the nodes to which each element's nodes belong.
        turn: matrix by which an element's node is turned from the node it belongs to.
        slope: derivatives of the shape functions by x, y and z [1/mm].
        volume: volume of each integration point [mm³].
        grid: x and y of the top's nodes [mm].
        lattice: indices of the top's nodes on this grid.
        owner: index of the node to which each node belongs.
        top: indices of the top's nodes that belong to themselves.
        area: area of the top that belongs to each of these nodes [mm²].
        fixed: mask of the displacement components that are 0.
        sectors: number of sectors of the whole gel.
        order: order of the nodes in which a factorization fills in little.
    """

    place: Float[np.ndarray, "nodes 3"]
    nodes: Int[np.ndarray, "elements 8"]
    turn: Float[np.ndarray, "elements 8 3 3"]
    slope: Float[np.ndarray, "elements 8 3 points"]
    volume: Float[np.ndarray, "elements points"]
    grid: tuple[Float[np.ndarray, " nx"], Float[np.ndarray, " ny"]]
    lattice: Int[np.ndarray, "nx ny"]
    owner: Int[np.ndarray, " nodes"]
    top: Int[np.ndarray, " top"]
    area: Float[np.ndarray, " top"]
    fixed: Bool[np.ndarray, "nodes 3"]
    sectors: int
    order: Int[np.ndarray, " nodes"]

    @property
    def cell(self) -> float:
        """Side of the smallest square that belongs to a node of the top [mm]."""
        return float(np.sqrt(self.area.min()))

    @property
    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Turns, slopes and volumes of the elements."""
        return self.turn, self.slope, self.volume

    def spread(self, moved: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "nodes 3"]:
        """Displacement of all nodes of the sector from that of the nodes they belong to [mm]."""
        own = moved[self.owner]
        return np.where(self._turned, own @ turn_sector(self.sectors).T, own)

    def gather(self, force: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "nodes 3"]:
        """Forces on nodes, turned and added to those of the nodes they belong to [N]."""
        total = np.zeros_like(force)
        own = np.where(self._turned, force @ turn_sector(self.sectors), force)
        np.add.at(total, self.owner, own)
        return total

    @property
    def _turned(self) -> Bool[np.ndarray, "nodes 1"]:
        return (self.owner != np.arange(len(self.owner)))[:, None]


def lay_bricks(
    x: Float[np.ndarray, " nx"],
    y: Float[np.ndarray, " ny"],
    depth: Float[np.ndarray, " nz"],
    profile: Float[np.ndarray, "nx ny"] | None = None,
) -> Bricks:
    """Mesh a sector of a gel: a quarter if x starts at 0, else half of it.

    With a profile the mesh is that of a bar that stands on its face: its nodes lie above 0, and
    its upper end is the fixed one.

    Args:
        x: coordinates of the nodes, from 0 or symmetric about 0 [mm].
        y: coordinates of the nodes, from 0; those of x for a quarter [mm].
        depth: depths of the nodes, from 0 at the top to the bonded base; of a bar their heights
            on the axis, up to the grip [mm].
        profile: height of a bar's face at the nodes [mm].
    """
    from skfem import Basis, ElementHex1, MeshHex

    sectors = 4 if x[0] == 0.0 else 2
    along = -depth[::-1] if profile is None else depth
    mesh = MeshHex.init_tensor(x, y, along)
    place = mesh.p.T
    owner, turned = _owners(place, sectors)
    turns = np.where(turned[:, None, None], turn_sector(sectors), np.eye(3))
    tolerance = 1e-9 * depth[-1]
    fixed = np.zeros(place.shape, dtype=bool)
    fixed[np.abs(place[:, 2]) > depth[-1] - tolerance] = True
    fixed[np.hypot(place[:, 0], place[:, 1]) < tolerance, :2] = True
    fixed[owner != np.arange(len(owner))] = True
    lattice = np.flatnonzero(np.abs(place[:, 2]) < tolerance)
    lattice = lattice[np.lexsort(place[lattice, 1::-1].T)].reshape(len(x), len(y))
    area = np.zeros(len(place))
    np.add.at(area, owner[lattice], np.outer(_lengths(x), _lengths(y)))
    top = np.unique(owner[lattice])
    order = _dissect(place, owner)
    if profile is not None:
        mesh = MeshHex(_bend(mesh.p, (x, y), profile), mesh.t)
    basis = Basis(mesh, ElementHex1(), intorder=3)
    elements = basis.element_dofs.T
    slopes = [np.broadcast_to(np.asarray(s[0].grad), (3, *basis.dx.shape)) for s in basis.basis]
    return Bricks(
        place=mesh.p.T,
        nodes=owner[elements],
        turn=turns[elements],
        slope=np.stack(slopes, 1).transpose(2, 1, 0, 3),
        volume=np.asarray(basis.dx),
        grid=(x, y),
        lattice=lattice,
        owner=owner,
        top=top,
        area=area[top],
        fixed=fixed,
        sectors=sectors,
        order=order,
    )


def _bend(
    place: np.ndarray, grid: tuple[np.ndarray, np.ndarray], profile: np.ndarray
) -> np.ndarray:
    """Positions of a bar's nodes, raised by its profile, less and less up to the grip [mm]."""
    x, y, z = place
    i, j = (np.searchsorted(along, at - 1e-9) for along, at in zip(grid, (x, y), strict=True))
    return np.stack([x, y, z + profile[i, j] * (1.0 - z / z.max())])


def _dissect(place: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Nested dissection: both halves before the plane of nodes between them, the cut last."""
    number = np.stack([np.unique(along, return_inverse=True)[1] for along in place.T], axis=1)

    def sort(nodes: np.ndarray) -> list[np.ndarray]:
        at = number[nodes]
        if len(nodes) < 30 or np.ptp(at, axis=0).max() < 2:
            return [nodes]
        along = at[:, np.ptp(at, axis=0).argmax()]
        middle = (along.min() + along.max()) // 2
        halves = nodes[along < middle], nodes[along > middle]
        return [*sort(halves[0]), *sort(halves[1]), nodes[along == middle]]

    own = owner == np.arange(len(owner))
    cut = own & (place[:, 1] == 0.0)
    parts = sort(np.flatnonzero(own & ~cut)) + sort(np.flatnonzero(cut))
    return np.concatenate([*parts, np.flatnonzero(~own)])


def _owners(place: np.ndarray, sectors: int) -> tuple[np.ndarray, np.ndarray]:
    """The node to which each node belongs, and whether it is turned by a sector from it."""
    x, y, z = place.T
    turned = (y == 0.0) & (x < 0.0) if sectors == 2 else (x == 0.0) & (y > 0.0)
    kept = np.flatnonzero((y == 0.0) & (x > 0.0))
    there = np.flatnonzero(turned)
    owner = np.arange(len(place))
    owner[there[np.lexsort((z[there], np.hypot(x, y)[there]))]] = kept[
        np.lexsort((z[kept], x[kept]))
    ]
    return owner, turned


def turn_sector(sectors: int, count: int = 1) -> Float[np.ndarray, "3 3"]:
    """Matrix of the turn from one sector to the next, or by some of them.

    Args:
        sectors: number of sectors of the whole body.
        count: number of sectors to turn by.
    """
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.linalg.matrix_power(quarter, count * 4 // sectors)


def _lengths(along: np.ndarray) -> np.ndarray:
    """Length that belongs to each coordinate [mm]."""
    half = 0.5 * np.diff(along)
    return np.append(half, 0.0) + np.append(0.0, half)


@jax.jit
def element_forces(
    moved: Float[Array, "elements 8 3"],
    parts: tuple[Array, Array, Array],
    law: Float[Array, "3"],
) -> Float[Array, "elements 8 3"]:
    """Derivative of each element's energy by its owners' displacement [N].

    Args:
        moved: displacement of the nodes to which each element's nodes belong [mm].
        parts: `turn`, `slope` and `volume` of the `Bricks`.
        law: G [MPa], K [MPa] and m [-].
    """
    return jax.vmap(jax.grad(_energy), (0, 0, 0, 0, None))(moved, *parts, law)


def _energy(moved: Array, turn: Array, slope: Array, volume: Array, law: Array) -> Array:
    modulus, bulk, share = law
    f = _gradients(moved, turn, slope)
    swelling = _mean_dilatation(f, volume)
    shape = jax.vmap(shape_strain, (0, None))(f, share)
    return 0.5 * (modulus * jnp.sum(volume * shape) + bulk * jnp.sum(volume) * swelling**2)


def _gradients(moved: Array, turn: Array, slope: Array) -> Float[Array, "points 3 3"]:
    return jnp.eye(3) + jnp.einsum("aij,aj,akp->pik", turn, moved, slope)


def _mean_dilatation(f: Array, volume: Array) -> Array:
    return jnp.sum(volume * (jnp.linalg.det(f) - 1.0)) / jnp.sum(volume)


@jax.jit
def element_stiffness(
    moved: Float[Array, "elements 8 3"],
    parts: tuple[Array, Array, Array],
    law: Float[Array, "3"],
) -> Float[Array, "elements 24 24"]:
    """Second derivative of each element's energy by its owners' displacement [N/mm].

    By the gradients at the points, which takes two thirds of the time of the elements' Hessian.

    Args:
        moved: displacement of the nodes to which each element's nodes belong [mm].
        parts: `turn`, `slope` and `volume` of the `Bricks`.
        law: G [MPa], K [MPa] and m [-].
    """
    modulus, bulk, share = law

    def one(moved: Array, turn: Array, slope: Array, volume: Array) -> Array:
        f = _gradients(moved, turn, slope)
        pressure = bulk * _mean_dilatation(f, volume)

        def density(flat: Array) -> Array:
            f = flat.reshape(3, 3)
            return 0.5 * modulus * shape_strain(f, share) + pressure * jnp.linalg.det(f)

        flat, whole = f.reshape(-1, 9), jnp.sum(volume)
        by_moved = jnp.einsum("aik,ajp->pijak", turn, slope).reshape(-1, 9, 24)
        firm = volume[:, None, None] * jax.vmap(jax.hessian(density))(flat)
        swell = jax.vmap(jax.grad(lambda flat: jnp.linalg.det(flat.reshape(3, 3))))(flat)
        swell = jnp.einsum("p,pm,pmq->q", volume, swell, by_moved)
        inner = jnp.einsum("pmq,pmr->qr", by_moved, jnp.einsum("pmn,pnr->pmr", firm, by_moved))
        return inner + bulk / whole * jnp.outer(swell, swell)

    return jax.vmap(one)(moved, *parts)
