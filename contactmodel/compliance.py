"""Displacement of a surface under tractions that are uniform on each cell of a grid.

[Love1929] A. E. H. Love, "The stress produced in a semi-infinite solid by pressure on part of the
boundary"; the integrals of Boussinesq's and Cerruti's solutions over a rectangle.
[Vollebregt2014] E. A. H. Vollebregt, "A new solver for the elastic normal contact problem using
conjugate gradients, deflation, and an FFT-based preconditioner".

The convolution runs by FFT on a grid of twice the size, so that there are no periodic images.
"""

from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel.arrays import AnyArray
from contactmodel.grid import Grid


class CellIntegrals(NamedTuple):
    """Integrals over a cell, r from a point of the cell to the field point.

    Attributes:
        xx: ∬x²/r³ [mm].
        yy: ∬y²/r³ [mm].
        xy: ∬xy/r³ [mm].
        x: ∬x/r² [mm].
        y: ∬y/r² [mm].
        turn_x: ∬y/r³ [-].
        turn_y: −∬x/r³ [-].
    """

    xx: AnyArray
    yy: AnyArray
    xy: AnyArray
    x: AnyArray
    y: AnyArray
    turn_x: AnyArray
    turn_y: AnyArray


class Coefficients(NamedTuple):
    """Displacement of a body's surface by unit tractions on a cell [mm/MPa].

    w is the displacement into the body. By reciprocity w/τ_x = −u_x/p, w/τ_y = −u_y/p.

    Attributes:
        zz: w/p.
        xx: u_x/τ_x.
        yy: u_y/τ_y.
        xy: u_x/τ_y = u_y/τ_x.
        xz: u_x/p.
        yz: u_y/p.
        turn_x: ½ rot u / τ_x [1/MPa].
        turn_y: ½ rot u / τ_y [1/MPa].
    """

    zz: Array
    xx: Array
    yy: Array
    xy: Array
    xz: Array
    yz: Array
    turn_x: Array
    turn_y: Array


@runtime_checkable
class Deformable(Protocol):
    """What a body must be able to say."""

    def coefficients(self, cell: CellIntegrals) -> Coefficients:
        """Displacement by unit tractions on a cell."""
        ...


def cell_integrals(
    x: Float[AnyArray, "*shape"],
    y: Float[AnyArray, "*shape"],
    spacing: tuple[float, float],
) -> CellIntegrals:
    """The integrals at the distance (x, y) from the centre of a cell ([Love1929]) [mm].

    Args:
        x: field point minus centre of the cell [mm].
        y: the same along y [mm].
        spacing: length of the cell along x and y [mm].
    """
    xp = x.__array_namespace__()
    k, l = x + 0.5 * spacing[0], x - 0.5 * spacing[0]  # noqa: E741
    m, n = y + 0.5 * spacing[1], y - 0.5 * spacing[1]

    def logarithm(s, t):  # ln(s + √(s²+t²)), free of cancellation for s < 0; t = 0 left out
        t = xp.where(t == 0.0, 1.0, xp.abs(t))
        return xp.asinh(s / t) + xp.log(t)

    def half_log(s, t):
        square = s**2 + t**2
        return 0.5 * xp.log(xp.where(square == 0.0, 1.0, square))

    def angle(s, t):
        return xp.atan(s / xp.where(t == 0.0, 1.0, t))

    def flux(k, l, m, n):  # noqa: E741
        return (
            m * (half_log(k, m) - half_log(l, m))
            - n * (half_log(k, n) - half_log(l, n))
            + k * (angle(m, k) - angle(n, k))
            - l * (angle(m, l) - angle(n, l))
        )

    def turn(k, l, m, n):  # noqa: E741
        return logarithm(k, n) - logarithm(l, n) - logarithm(k, m) + logarithm(l, m)

    return CellIntegrals(
        xx=m * (logarithm(k, m) - logarithm(l, m)) + n * (logarithm(l, n) - logarithm(k, n)),
        yy=k * (logarithm(m, k) - logarithm(n, k)) + l * (logarithm(n, l) - logarithm(m, l)),
        xy=xp.hypot(n, k) - xp.hypot(m, k) + xp.hypot(m, l) - xp.hypot(n, l),
        x=flux(k, l, m, n),
        y=flux(m, n, k, l),
        turn_x=turn(k, l, m, n),
        turn_y=-turn(m, n, k, l),
    )


def grid_coefficients(body: Deformable, grid: Grid) -> Coefficients:
    """A body's coefficients for every distance on a grid, laid out for `convolve`."""
    cell = jax.tree.map(jnp.asarray, _grid_integrals(grid))
    return body.coefficients(cell)


def convolve(spectrum: Array, field: Float[Array, "*batch nx ny"]) -> Float[Array, "*batch nx ny"]:
    """Sum over all cells of coefficient times field, by FFT.

    Args:
        spectrum: `transform` of the coefficient.
        field: traction on each cell.
    """
    nx, ny = field.shape[-2:]
    padded = jnp.fft.rfft2(field, s=(2 * nx, 2 * ny))
    return jnp.fft.irfft2(spectrum * padded, s=(2 * nx, 2 * ny))[..., :nx, :ny]


def transform(coefficient: Float[Array, "*batch mx my"]) -> Array:
    """Spectrum of a coefficient that `grid_coefficients` has laid out."""
    return jnp.fft.rfft2(coefficient)


class Compliance(eqx.Module):
    """Compliance of a pair of bodies, as spectra of the doubled grid.

    Attributes:
        normal: of w_S + w_B by p [mm/MPa].
        shear: xx, yy, xy of u_S − u_B by τ [mm/MPa].
    """

    normal: Float[Array, "mx my"]
    shear: Float[Array, "3 mx my"]

    def press(self, pressure: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
        """w_S + w_B by a pressure [mm]."""
        return convolve(self.normal, pressure)

    def drag(self, traction: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """u_S − u_B by a traction [mm]."""
        return _apply(self.shear, traction)

    def unpress(self, displacement: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
        """Roughly the inverse of `press`: the inverse on the doubled grid ([Vollebregt2014])."""
        return convolve(1.0 / self.normal, displacement)

    def undrag(self, displacement: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """Roughly the inverse of `drag`."""
        xx, yy, xy = self.shear
        return _apply(jnp.stack([yy, xx, -xy]) / (xx * yy - xy**2), displacement)

    @property
    def stiffest(self) -> Float[Array, ""]:
        """The largest displacement by a unit traction of any wave, a bound on `drag` [mm/MPa]."""
        xx, yy, xy = self.shear
        return jnp.max(0.5 * (xx + yy) + jnp.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def pair_compliance(elastomer: Deformable, object_: Deformable, grid: Grid) -> Compliance:
    """Compliance of two bodies pressed against each other: the sum of theirs."""
    s, b = grid_coefficients(elastomer, grid), grid_coefficients(object_, grid)
    return Compliance(
        normal=transform(s.zz + b.zz).real,
        shear=transform(jnp.stack([s.xx + b.xx, s.yy + b.yy, s.xy + b.xy])).real,
    )


def _apply(matrix: Array, field: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
    """Convolve with a symmetric 2×2 matrix, given as xx, yy, xy."""
    nx, ny = field.shape[-2:]
    xx, yy, xy = matrix
    fx, fy = jnp.fft.rfft2(field, s=(2 * nx, 2 * ny))
    out = jnp.stack([xx * fx + xy * fy, xy * fx + yy * fy])
    return jnp.fft.irfft2(out, s=(2 * nx, 2 * ny))[..., :nx, :ny]


@lru_cache(maxsize=8)
def _grid_integrals(grid: Grid) -> CellIntegrals:
    """Integrals for all distances on the grid in FFT order; in double precision always."""
    nx, ny = grid.shape
    offset_x = np.fft.fftfreq(2 * nx, 1.0 / (2 * nx)) * grid.spacing[0]
    offset_y = np.fft.fftfreq(2 * ny, 1.0 / (2 * ny)) * grid.spacing[1]
    x, y = np.meshgrid(offset_x, offset_y, indexing="ij")
    cell = cell_integrals(x, y, grid.spacing)
    # The distance of a whole grid is never used; there, odd integrals have no definite sign.
    odd_x, odd_y = np.ones_like(x), np.ones_like(x)
    odd_x[nx, :] = 0.0
    odd_y[:, ny] = 0.0
    return cell._replace(
        xy=cell.xy * odd_x * odd_y,
        x=cell.x * odd_x,
        y=cell.y * odd_y,
        turn_x=cell.turn_x * odd_y,
        turn_y=cell.turn_y * odd_x,
    )
