"""Round bodies at finite strain: finite elements in r and z whose points also turn about the axis.

scikit-fem gives mesh, shape functions and integration points. Its elements take any number of
components, so u_r, u_θ and u_z may all depend on r and z; axisymmetric fields of other libraries
leave out u_θ. JAX differentiates the energy, SciPy solves. The contact model shares only these
libraries with this module.

In the basis of the undeformed point, F = I + [[u_r,r, −u_θ/r, u_r,z], [u_θ,r, u_r/r, u_θ,z],
[u_z,r, 0, u_z,z]], exact for any turn. Only an element's mean dilatation enters the energy, so that
nearly incompressible gels do not lock.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


@runtime_checkable
class Rubber(Protocol):
    """The law of a body."""

    @property
    def shear_modulus(self) -> float:
        """G [MPa]."""
        ...

    @property
    def poisson_ratio(self) -> float:
        """ν at small strain [-]."""
        ...

    @property
    def second_share(self) -> float:
        """m, the share of the second invariant [-]."""
        ...


class Gel(NamedTuple):
    """A rubber cylinder with a bonded base and a free side.

    W = G/2 [(1 − m)(Ī₁ − 3) + m (Ī₂ − 3)] + K/2 (J̄ − 1)²; neo-Hookean for m = 0, Mooney–Rivlin
    for m > 0.

    Attributes:
        thickness: h [mm].
        radius: radius of the pad [mm].
        shear_modulus: G [MPa].
        poisson_ratio: ν at small strain [-].
        second_share: m, the share of the second invariant [-].
    """

    thickness: float = 8.0
    radius: float = 30.0
    shear_modulus: float = 0.2
    poisson_ratio: float = 0.48
    second_share: float = 0.0


class Elements(NamedTuple):
    """Mesh of a gel, or of a ball, with quadrilateral elements.

    Attributes:
        place: r and z of the nodes; z = 0 at the middle of the top [mm].
        nodes: indices of each element's nodes, in the order of `value`.
        value: shape functions divided by r, at the integration points [1/mm].
        slope: derivatives of the shape functions by r and z [1/mm].
        volume: volume of each integration point [mm³].
        top: indices of the nodes at the top, or at the ball's surface, sorted by radius.
        area: area of the top, seen along z, that belongs to each of these nodes [mm²].
        free: indices of the free displacement components, three for each node.
    """

    place: Float[np.ndarray, "nodes 2"]
    nodes: Int[np.ndarray, "elements 4"]
    value: Float[np.ndarray, "elements 4 points"]
    slope: Float[np.ndarray, "elements 4 2 points"]
    volume: Float[np.ndarray, "elements points"]
    top: Int[np.ndarray, " top"]
    area: Float[np.ndarray, " top"]
    free: Int[np.ndarray, " free"]

    @property
    def cell(self) -> float:
        """Smallest distance between nodes of the top [mm]."""
        return float(np.diff(self.place[self.top, 0]).min())


def cut(gel: Gel, cell: float, fine: float, growth: float = 1.25) -> Elements:
    """Mesh a gel, with small elements under the contact.

    Args:
        gel: the gel to mesh.
        cell: side of the elements under the contact [mm].
        fine: radius of the finely meshed part [mm].
        growth: ratio of the sizes of neighbouring elements beyond the fine part [-].
    """
    across = space_radii(gel.radius, cell, fine, growth)
    return make_elements(across, -grow(gel.thickness, cell, growth)[::-1])


def make_elements(
    across: Float[np.ndarray, " columns"],
    along: Float[np.ndarray, " rows"],
    profile: Float[np.ndarray, " columns"] | None = None,
) -> Elements:
    """Elements of a body of revolution whose far end is fixed.

    Args:
        across: radii of the nodes, from 0 [mm].
        along: heights of the nodes on the axis; the surface is at 0, the last of the two ends [mm].
        profile: height of the surface at these radii; None for a flat one [mm].
    """
    from skfem import Basis, ElementQuad1, MeshQuad

    mesh = MeshQuad.init_tensor(across, along)
    r, z = mesh.p
    rigid, end = 1e-9 * float(np.ptp(along)), float(along[np.abs(along).argmax()])
    top = np.flatnonzero(np.abs(z) < rigid)
    fixed = np.zeros((len(r), 3), dtype=bool)
    fixed[np.abs(z - end) < rigid] = True
    fixed[r < rigid, :2] = True
    if profile is not None:
        mesh = MeshQuad(np.stack([r, z + np.interp(r, across, profile) * (1.0 - z / end)]), mesh.t)
    basis = Basis(mesh, ElementQuad1(), intorder=3)
    inside = np.asarray(basis.global_coordinates())[0]
    fields = [np.broadcast_to(np.asarray(shape[0]), inside.shape) for shape in basis.basis]
    slopes = [
        np.broadcast_to(np.asarray(shape[0].grad), (2, *inside.shape)) for shape in basis.basis
    ]
    place = mesh.p.T
    top = top[np.argsort(place[top, 0])]
    return Elements(
        place=place,
        nodes=basis.element_dofs.T,
        value=np.stack(fields, 1) / inside[:, None],
        slope=np.stack(slopes, 1).transpose(2, 1, 0, 3),
        volume=2.0 * np.pi * inside * basis.dx,
        top=top,
        area=_areas(place[top, 0]),
        free=np.flatnonzero(~fixed.ravel()),
    )


def space_radii(
    radius: float, cell: float, fine: float, growth: float
) -> Float[np.ndarray, " columns"]:
    """Radii of nodes from 0, evenly spaced under the contact [mm].

    Args:
        radius: the last radius [mm].
        cell: spacing under the contact [mm].
        fine: radius of the evenly spaced part [mm].
        growth: ratio of neighbouring spacings beyond it [-].
    """
    fine = min(fine, radius)
    inner = np.linspace(0.0, fine, max(round(fine / cell), 1) + 1)
    outer = fine + grow(radius - fine, cell, growth)[1:] if radius > fine else []
    return np.concatenate([inner, outer])


def strain_gradient(
    moved: Float[Array, "4 3"], value: Float[Array, "4 points"], slope: Float[Array, "4 2 points"]
) -> Float[Array, "3 3 points"]:
    """Deformation gradient F at the integration points of an element.

    Args:
        moved: displacement of the element's nodes [mm].
        value: shape functions divided by r [1/mm].
        slope: derivatives of the shape functions by r and z [1/mm].
    """
    r, t, z = 0, 1, 2
    by_r, by_z = jnp.einsum("ac,adp->dcp", moved, slope)
    over_r = jnp.einsum("ac,ap->cp", moved, value)
    none = jnp.zeros_like(over_r[r])
    return jnp.eye(3)[..., None] + jnp.stack([
        jnp.stack([by_r[r], -over_r[t], by_z[r]]),
        jnp.stack([by_r[t], over_r[r], by_z[t]]),
        jnp.stack([by_r[z], none, by_z[z]]),
    ])  # fmt: skip


def element_energy(
    moved: Float[Array, "4 3"],
    value: Float[Array, "4 points"],
    slope: Float[Array, "4 2 points"],
    volume: Float[Array, " points"],
    law: Float[Array, "3"],
) -> Float[Array, ""]:
    """Strain energy of an element [N·mm].

    Args:
        moved: displacement of the element's nodes [mm].
        value: shape functions divided by r [1/mm].
        slope: derivatives of the shape functions by r and z [1/mm].
        volume: volume of each integration point [mm³].
        law: G [MPa], K [MPa] and m [-].
    """
    modulus, bulk, share = law
    f = jnp.moveaxis(strain_gradient(moved, value, slope), -1, 0)
    shape = jax.vmap(shape_strain, (0, None))(f, share)
    whole = jnp.sum(volume)
    swelling = jnp.sum(volume * (jnp.linalg.det(f) - 1.0)) / whole
    return 0.5 * (modulus * jnp.sum(volume * shape) + bulk * whole * swelling**2)


def shape_strain(f: Float[Array, "3 3"], share: Float[Array, ""]) -> Float[Array, ""]:
    """(1 − m)(Ī₁ − 3) + m (Ī₂ − 3) of a deformation gradient [-].

    Args:
        f: deformation gradient.
        share: m [-].
    """
    c = f @ f.T
    first = jnp.trace(c)
    second = 0.5 * (first**2 - jnp.sum(c * c))
    cube = jnp.cbrt(jnp.linalg.det(f))
    return (1.0 - share) * (first / cube**2 - 3.0) + share * (second / cube**4 - 3.0)


@jax.jit
def forces_and_stiffness(
    moved: Float[Array, "elements 4 3"],
    parts: tuple[Array, Array, Array],
    law: Float[Array, "3"],
) -> tuple[Float[Array, "elements 12"], Float[Array, "elements 12 12"]]:
    """First and second derivatives of each element's energy by its nodes' displacement [N, N/mm].

    Args:
        moved: displacement of each element's nodes [mm].
        parts: `value`, `slope` and `volume` of the `Elements`.
        law: G [MPa], K [MPa] and m [-].
    """

    def energy(flat: Array, value: Array, slope: Array, volume: Array) -> Array:
        return element_energy(flat.reshape(4, 3), value, slope, volume, law)

    flat = moved.reshape(-1, 12)
    force = jax.vmap(jax.grad(energy))(flat, *parts)
    return force, jax.vmap(jax.jacfwd(jax.grad(energy)))(flat, *parts)


def law_of(body: Rubber) -> Float[Array, "3"]:
    """G [MPa], K [MPa] and m [-] of a body."""
    nu = body.poisson_ratio
    bulk = body.shear_modulus * 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    return jnp.array([body.shear_modulus, bulk, body.second_share])


def grow(length: float, first: float, growth: float) -> Float[np.ndarray, " nodes"]:
    """Coordinates from 0 to a length, each step longer than the last [mm].

    Args:
        length: the last coordinate [mm].
        first: length of the first step, reduced so that the steps fill the length [mm].
        growth: ratio of neighbouring steps [-].
    """
    count = int(np.ceil(np.log1p(length / first * (growth - 1.0)) / np.log(growth)))
    steps = first * growth ** np.arange(max(count, 1))
    return np.concatenate([[0.0], np.cumsum(steps)]) * (length / steps.sum())


def _areas(r: Float[np.ndarray, " top"]) -> Float[np.ndarray, " top"]:
    """Integral 2π ∫ N r dr of the linear shape functions N [mm²]."""
    left, right = r[:-1], r[1:]
    long = right - left
    area = np.zeros(len(r))
    area[:-1] += 2.0 * np.pi * long * (2.0 * left + right) / 6.0
    area[1:] += 2.0 * np.pi * long * (left + 2.0 * right) / 6.0
    return area
