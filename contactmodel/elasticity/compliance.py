"""Displacement of a surface under tractions that are uniform on each cell of a grid, by FFT.

[Vollebregt2014] E. A. H. Vollebregt, "A new solver for the elastic normal contact problem using
conjugate gradients, deflation, and an FFT-based preconditioner".

The FFT uses a grid of twice the size, so that there are no periodic images.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import AnyArray, is_traced
from contactmodel.elasticity.bodies import AbstractBody
from contactmodel.elasticity.cells import CellIntegrals, Coefficients, cell_integrals
from contactmodel.grid import Grid

_ROWS = 32  # of a large grid at a time; 16 to 64 take as long
_EVEN, _ODD_X, _ODD_Y, _ODD = (1, 1), (-1, 1), (1, -1), (-1, -1)
_PARITY = {  # along x and y: +1 even, -1 odd
    "zz": _EVEN,
    "xx": _EVEN,
    "yy": _EVEN,
    "xy": _ODD,
    "xz": _ODD_X,
    "yz": _ODD_Y,
    "zx": _ODD_X,
    "zy": _ODD_Y,
    "turn_x": _ODD_Y,
    "turn_y": _ODD_X,
}


def grid_coefficients(
    body: AbstractBody, grid: Grid, depth: Float[Array, ""] | None = None
) -> Coefficients:
    """Coefficients of a `checked` body for every non-negative distance on a grid [mm/MPa].

    The depth [mm] is None at the surface.
    """
    if depth is None:
        return body.coefficients(_at_surface(_surface_integrals(grid), grid), grid.spacing)
    x, y = jnp.meshgrid(*map(jnp.asarray, _distances(grid)), indexing="ij")
    return body.coefficients(cell_integrals(x, y, grid.spacing, depth), grid.spacing)


def convolve(spectrum: Array, field: Float[Array, "*batch nx ny"]) -> Float[Array, "*batch nx ny"]:
    """Sum of coefficient times field over all cells, by FFT.

    Args:
        spectrum: spectrum of the coefficient, made by `transform`.
        field: traction on each cell [MPa].
    """
    return _mix(jnp.multiply, spectrum, field)


def transform(coefficient: Float[Array, "hx hy"], name: str) -> Array:
    """Spectrum of a coefficient on the doubled grid; waves along y are the first axis.

    Args:
        coefficient: values for non-negative distances, made by `grid_coefficients`.
        name: name of the coefficient in `Coefficients`.
    """
    factor = {2: 1.0, 0: 1j, -2: -1.0}[sum(_PARITY[name])]
    return factor * _waves(coefficient, name)


class Compliance(eqx.Module):
    """Compliance of a pair of bodies as spectra on the doubled grid; waves along y come first.

    Attributes:
        normal: w_S + w_B by p [mm/MPa].
        shear: components xx, yy, xy of u_S − u_B by τ [mm/MPa].
        coupling: components x, y of u_S − u_B by p, over i; None if pressure and traction are not
            coupled [mm/MPa].
    """

    normal: Float[Array, "my mx"]
    shear: Float[Array, "3 #my #mx"]
    coupling: Float[Array, "2 my mx"] | None

    def press(self, pressure: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
        """w_S + w_B under a pressure [mm]."""
        return _mix(_scale, self.normal, pressure)

    def drag(self, traction: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """u_S − u_B under a traction [mm]."""
        return _mix(_shear, self.shear, traction)

    def pull(self, pressure: Float[Array, "nx ny"]) -> Float[Array, "2 nx ny"]:
        """u_S − u_B under a pressure [mm]."""
        if self.coupling is None:
            return jnp.zeros((2, *pressure.shape), pressure.dtype)
        return jnp.stack([_mix(_scale_by_i, c, pressure) for c in self.coupling])

    def lift(self, traction: Float[Array, "2 nx ny"]) -> Float[Array, "nx ny"]:
        """w_S + w_B under a traction [mm]."""
        if self.coupling is None:
            return jnp.zeros_like(traction[0])
        x, y = _mix(_scale_by_i, self.coupling, traction)
        return -(x + y)

    def displace(
        self, pressure: Float[Array, "nx ny"], traction: Float[Array, "2 nx ny"]
    ) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
        """w_S + w_B and u_S − u_B under pressure and traction: press, lift, pull and drag [mm]."""
        if self.coupling is None:
            return self.press(pressure), self.drag(traction)
        loads = jnp.concatenate([pressure[None], traction])
        moved = _mix(_displace, (self.normal, self.shear, self.coupling), loads)
        return moved[0], moved[1:]

    def inverse(self) -> "Compliance":
        """Approximate inverse of `press` and of `drag` alone, wave by wave ([Vollebregt2014]).

        A uniform pressure does not move an incompressible layer, so the longest wave is treated
        like the next.
        """
        next_wave = jnp.minimum(self.normal[1, 0], self.normal[0, 1])
        xx, yy, xy = self.shear
        return Compliance(
            normal=1.0 / self.normal.at[0, 0].max(next_wave),
            shear=jnp.stack([yy, xx, -xy]) / (xx * yy - xy**2),
            coupling=None,
        )

    def joint_inverse(self) -> "Compliance":
        """Approximate inverse of `displace`, wave by wave (Schur complement of the pressure)."""
        if self.coupling is None:
            return self.inverse()
        soft, (x, y), (xx, yy, xy) = self.inverse().normal, self.coupling, self.shear
        rest = jnp.stack([xx - soft * x**2, yy - soft * y**2, xy - soft * x * y])
        shear = Compliance(self.normal, rest, self.coupling).inverse().shear
        pull = soft * jnp.stack([shear[0] * x + shear[2] * y, shear[2] * x + shear[1] * y])
        normal = soft + soft * (x * pull[0] + y * pull[1])
        return Compliance(normal, shear, -pull)

    def coarsen(self, ratio: int) -> "Compliance":
        """Approximate compliance of cells `ratio` times as long, from the long waves."""
        my, mx = self.normal.shape
        rows, half = (my - 1) // ratio + 1, mx // (2 * ratio)

        def long_waves(spectrum: Array) -> Array:
            if spectrum.shape[-1] == 1:  # the shear of smooth bodies
                return spectrum
            low = spectrum[..., :rows, :]
            return jnp.concatenate([low[..., :half], low[..., -half:]], axis=-1)

        return jax.tree.map(long_waves, self)

    @property
    def stiffest(self) -> Float[Array, ""]:
        """Largest displacement under a unit traction wave, a bound on `drag` [mm/MPa]."""
        xx, yy, xy = self.shear
        return jnp.max(0.5 * (xx + yy) + jnp.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def pair_compliance(
    elastomer: AbstractBody, object_: AbstractBody, grid: Grid, *, smooth: bool = False
) -> Compliance:
    """Compliance of two bodies pressed against each other: the sum of both compliances.

    The coupling is their difference, because the object carries −τ. It is None if the difference is
    known to be 0. Without friction (`smooth`), `shear` is not computed and is 0.
    """
    integrals = _surface_integrals(grid)
    pair = _pair(elastomer.uncorrected, object_.uncorrected, integrals, grid, smooth)
    pull = pair.coupling
    if pull is None or is_traced(pull) or bool(np.any(np.asarray(pull))):
        return pair
    return Compliance(pair.normal, pair.shear, None)


@eqx.filter_jit
def _pair(
    elastomer: AbstractBody,
    object_: AbstractBody,
    integrals: Mapping[str, AnyArray],
    grid: Grid,
    smooth: bool,
) -> Compliance:
    cell = _at_surface(integrals, grid)
    s, b = (body.coefficients(cell, grid.spacing) for body in (elastomer, object_))
    total = jax.tree.map(jnp.add, s, b)
    normal = _waves(total.zz, "zz")
    shear = [_waves(total.xx, "xx"), _waves(total.yy, "yy"), -_waves(total.xy, "xy")]
    return Compliance(
        normal=normal,
        shear=jnp.zeros((3, 1, 1), normal.dtype) if smooth else jnp.stack(shear),
        coupling=jnp.stack([_waves(s.xz - b.xz, "xz"), _waves(s.yz - b.yz, "yz")]),
    )


def _mix(mix: Callable, spectra: Any, field: Array) -> Array:
    """Transform a field, mix its waves by spectra, transform back.

    A large grid is mixed in blocks of waves along y, which stay in the processor's cache and take
    little memory. The padding with zeros is not transformed.
    """
    nx, ny = field.shape[-2:]

    def along_x(start: ArrayLike, count: int, waves: Array) -> Array:
        def cut(array: Array) -> Array:
            single = array.shape[-2] == 1
            return array if single else jax.lax.dynamic_slice_in_dim(array, start, count, -2)

        block = mix(jax.tree.map(cut, spectra), jnp.fft.fft(cut(waves), n=2 * nx))
        block = jnp.fft.ifft(block)[..., :nx]
        return jax.lax.dynamic_update_slice_in_dim(waves, block, start, -2)

    waves = jnp.swapaxes(jnp.fft.rfft(field, n=2 * ny), -2, -1)
    whole, rest = divmod(ny + 1, _ROWS) if ny > 2 * _ROWS else (0, ny + 1)
    if whole:
        waves = jax.lax.fori_loop(0, whole, lambda i, w: along_x(i * _ROWS, _ROWS, w), waves)
    if rest:
        waves = along_x(whole * _ROWS, rest, waves)
    return jnp.fft.irfft(jnp.swapaxes(waves, -2, -1), n=2 * ny)[..., :ny]


def _scale(factor: Array, waves: Array) -> Array:
    """Real factor times complex waves; XLA would convert the factor to complex numbers."""
    return jax.lax.complex(factor * waves.real, factor * waves.imag)


def _scale_by_i(factor: Array, waves: Array) -> Array:
    """Real factor times i times complex waves."""
    return jax.lax.complex(-factor * waves.imag, factor * waves.real)


def _shear(shear: Array, waves: Array) -> Array:
    (xx, yy, xy), (x, y) = shear, waves
    return jnp.stack([_scale(xx, x) + _scale(xy, y), _scale(xy, x) + _scale(yy, y)])


def _displace(spectra: tuple[Array, Array, Array], waves: Array) -> Array:
    normal, shear, (x, y) = spectra
    p, f = waves[0], waves[1:]
    pull = jnp.stack([_scale_by_i(x, p), _scale_by_i(y, p)])
    lift = -_scale_by_i(x, f[0]) - _scale_by_i(y, f[1])
    return jnp.concatenate([(_scale(normal, p) + lift)[None], pull + _shear(shear, f)])


def _waves(coefficient: Array, name: str) -> Array:
    """The spectrum without its complex factor, real; each axis is transformed by its parity."""
    waves = coefficient
    for parity in _PARITY[name]:
        half = jnp.fft.rfft(_mirror(waves, parity), axis=0)
        waves = (half.real if parity > 0 else half.imag).T
    return _mirror(waves, _PARITY[name][0]).T


def _mirror(half: Array, parity: int) -> Array:
    """Extend values at non-negative distances along the first axis to all, in FFT order.

    The distance of a whole grid is never used. Odd coefficients have no definite sign there and
    are set to 0.
    """
    last = half[-1:] if parity > 0 else jnp.zeros_like(half[-1:])
    return jnp.concatenate([half[:-1], last, parity * half[-2:0:-1]])


def _distances(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Non-negative distances along x and along y [mm]."""
    x, y = (np.arange(n + 1) * d for n, d in zip(grid.shape, grid.spacing, strict=True))
    return x, y


@lru_cache(maxsize=8)
def _surface_integrals(grid: Grid) -> dict[str, np.ndarray]:
    """Integrals that do not vanish at the surface, for the distances on the grid.

    They are computed in double precision and in blocks of rows, because intermediate arrays take
    far more memory. On a square grid of square cells, those along y are the transposes of those
    along x.
    """
    x, y = _distances(grid)
    names = ("xx", "xy", "x", "turn_x")
    names = names if np.array_equal(x, y) else (*names, "yy", "y", "turn_y")
    integrals = {name: np.empty((len(x), len(y))) for name in names}
    for row in range(0, len(x), _ROWS):
        here = slice(row, row + _ROWS)
        cell = cell_integrals(*np.meshgrid(x[here], y, indexing="ij"), grid.spacing)
        for name in names:
            integrals[name][here] = getattr(cell, name)
    return integrals


def _at_surface(integrals: Mapping[str, AnyArray], grid: Grid) -> CellIntegrals:
    """All integrals at the surface."""
    arrays = {name: jnp.asarray(value) for name, value in integrals.items()}
    if "yy" not in arrays:
        arrays |= {"yy": arrays["xx"].T, "y": arrays["x"].T, "turn_y": -arrays["turn_x"].T}
    x, y = jnp.meshgrid(*map(jnp.asarray, _distances(grid)), indexing="ij")
    zero = jnp.zeros_like(x)
    return CellIntegrals(
        offset=(x, y),
        depth=jnp.zeros(()),
        zz=zero,
        xz=zero,
        yz=zero,
        flat_xx=arrays["yy"],
        flat_yy=arrays["xx"],
        flat_xy=-arrays["xy"],
        **arrays,
    )
