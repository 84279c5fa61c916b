"""Displacement of a surface under tractions that are uniform on each cell of a grid.

[Love1929] A. E. H. Love, "The stress produced in a semi-infinite solid by pressure on part of the
boundary"; the integrals of Boussinesq's and Cerruti's solutions over a rectangle.
[Vollebregt2014] E. A. H. Vollebregt, "A new solver for the elastic normal contact problem using
conjugate gradients, deflation, and an FFT-based preconditioner".

The convolution runs by FFT on a grid of twice the size, so that there are no periodic images.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.arrays import AnyArray, is_traced
from contactmodel.grid import Grid


class CellIntegrals(NamedTuple):
    """Integrals over a cell at the surface, r from a point of the cell to a point at the depth z.

    At the surface flat_xx is yy and flat_xy is −xy, and what has z in it is 0.

    Attributes:
        offset: field point minus centre of the cell along x, y [mm].
        depth: z of the field point [mm].
        xx: ∬x²/r³ [mm].
        yy: ∬y²/r³ [mm].
        xy: ∬xy/r³ [mm].
        zz: ∬z²/r³ [mm].
        xz: ∬xz/r³ [mm].
        yz: ∬yz/r³ [mm].
        x: ∬x/r(r+z) [mm].
        y: ∬y/r(r+z) [mm].
        flat_xx: ∬∂/∂x x/(r+z) [mm].
        flat_yy: ∬∂/∂y y/(r+z) [mm].
        flat_xy: ∬∂/∂x y/(r+z) [mm].
        turn_x: ∬y/r³ [-].
        turn_y: −∬x/r³ [-].
    """

    offset: tuple[AnyArray, AnyArray]
    depth: AnyArray
    xx: AnyArray
    yy: AnyArray
    xy: AnyArray
    zz: AnyArray
    xz: AnyArray
    yz: AnyArray
    x: AnyArray
    y: AnyArray
    flat_xx: AnyArray
    flat_yy: AnyArray
    flat_xy: AnyArray
    turn_x: AnyArray
    turn_y: AnyArray


class Coefficients(NamedTuple):
    """Displacement of a body by unit tractions on a cell [mm/MPa].

    w is the displacement into the body. At the surface, w/τ = −u/p by reciprocity.

    Attributes:
        zz: w/p.
        xx: u_x/τ_x.
        yy: u_y/τ_y.
        xy: u_x/τ_y = u_y/τ_x.
        xz: u_x/p.
        yz: u_y/p.
        zx: w/τ_x.
        zy: w/τ_y.
        turn_x: ½ rot u / τ_x [1/MPa].
        turn_y: ½ rot u / τ_y [1/MPa].
    """

    zz: Array
    xx: Array
    yy: Array
    xy: Array
    xz: Array
    yz: Array
    zx: Array
    zy: Array
    turn_x: Array
    turn_y: Array


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


@runtime_checkable
class Deformable(Protocol):
    """What a body must be able to say."""

    def coefficients(self, cell: CellIntegrals, spacing: tuple[float, float]) -> Coefficients:
        """Displacement by unit tractions on a cell."""
        ...

    def checked(self, spacing: tuple[float, float], depth: ArrayLike | None = None) -> "Deformable":
        """The body, if they are made for such cells and a depth."""
        ...


def cell_integrals(
    x: Float[AnyArray, "*shape"],
    y: Float[AnyArray, "*shape"],
    spacing: tuple[float, float],
    depth: ArrayLike = 0.0,
) -> CellIntegrals:
    """The integrals at the distance (x, y) from the centre of a cell ([Love1929]) [mm].

    Args:
        x: field point minus centre of the cell [mm].
        y: the same along y [mm].
        spacing: length of the cell along x and y [mm].
        depth: z of the field point below the surface [mm].
    """
    xp = x.__array_namespace__()
    z = xp.asarray(depth)
    right, left = x + 0.5 * spacing[0], x - 0.5 * spacing[0]
    upper, lower = y + 0.5 * spacing[1], y - 0.5 * spacing[1]

    def corners(primitive):
        across = primitive(right, upper) - primitive(left, upper)
        return across - primitive(right, lower) + primitive(left, lower)

    def length(s, t):  # √(s²+t²+z²), its derivative 0 at 0
        square = s**2 + t**2 + z**2
        return xp.where(square > 0.0, xp.sqrt(xp.where(square > 0.0, square, 1.0)), 0.0)

    def logarithm(s, t):  # ln(s + r), free of cancellation for s < 0; r = |s| left out
        square = t**2 + z**2
        t = xp.sqrt(xp.where(square > 0.0, square, 1.0))
        return xp.asinh(s / t) + xp.log(t)

    def angle(s, t):  # of the solid angle of the corner
        below = z * length(s, t)
        steep = 0.5 * xp.pi * xp.sign(s * t)
        return xp.where(below > 0.0, xp.atan(s * t / xp.where(below > 0.0, below, 1.0)), steep)

    def turned(s, t):  # atan(t/s) − atan(zt/sr)
        r = length(s, t)
        up, along = s * t * (r - z), s**2 * r + z * t**2
        return xp.atan(up / xp.where(along > 0.0, along, 1.0)) * (along > 0.0)

    def depth_log(s, t):  # ln(r + z)
        total = length(s, t) + z
        return xp.log(xp.where(total > 0.0, total, 1.0))

    def flux(s, t):
        return t * depth_log(s, t) + z * logarithm(t, s) + s * turned(s, t)

    def flat(s, t):
        return s * logarithm(t, s) - z * turned(s, t)

    return CellIntegrals(
        offset=(x, y),
        depth=z,
        xx=corners(lambda s, t: t * logarithm(s, t) - z * angle(s, t)),
        yy=corners(lambda s, t: s * logarithm(t, s) - z * angle(s, t)),
        xy=-corners(length),
        zz=corners(lambda s, t: z * angle(s, t)),
        xz=-corners(lambda s, t: z * logarithm(t, s)),
        yz=-corners(lambda s, t: z * logarithm(s, t)),
        x=corners(flux),
        y=corners(lambda s, t: flux(t, s)),
        flat_xx=corners(flat),
        flat_yy=corners(lambda s, t: flat(t, s)),
        flat_xy=corners(lambda s, t: length(s, t) - z * depth_log(s, t)),
        turn_x=-corners(logarithm),
        turn_y=corners(lambda s, t: logarithm(t, s)),
    )


def grid_coefficients(
    body: Deformable, grid: Grid, depth: Float[Array, ""] | None = None
) -> Coefficients:
    """A body's coefficients for every distance on a grid that is not negative along x and y.

    Args:
        body: half-space, layer or rigid.
        grid: cells.
        depth: of the displaced points below the surface; none at the surface [mm].
    """
    body = body.checked(grid.spacing, depth)
    if depth is None:
        return body.coefficients(_at_surface(_surface_integrals(grid), grid), grid.spacing)
    x, y = jnp.meshgrid(*map(jnp.asarray, _distances(grid)), indexing="ij")
    return body.coefficients(cell_integrals(x, y, grid.spacing, depth), grid.spacing)


def convolve(spectrum: Array, field: Float[Array, "*batch nx ny"]) -> Float[Array, "*batch nx ny"]:
    """Sum over all cells of coefficient times field, by FFT.

    Args:
        spectrum: `transform` of the coefficient.
        field: traction on each cell.
    """
    return _mix(jnp.multiply, spectrum, field)


def transform(coefficient: Float[Array, "hx hy"], name: str) -> Array:
    """Spectrum on the doubled grid of a coefficient, waves along y first.

    Args:
        coefficient: for distances that are not negative, of `grid_coefficients`.
        name: which of `Coefficients` it is.
    """
    factor = {2: 1.0, 0: 1j, -2: -1.0}[sum(_PARITY[name])]
    return factor * _waves(coefficient, name)


class Compliance(eqx.Module):
    """Compliance of a pair of bodies, as spectra of the doubled grid, waves along y first.

    Attributes:
        normal: of w_S + w_B by p [mm/MPa].
        shear: xx, yy, xy of u_S − u_B by τ [mm/MPa].
        coupling: along x and y of u_S − u_B by p, over i; None where they do not couple [mm/MPa].
    """

    normal: Float[Array, "my mx"]
    shear: Float[Array, "3 #my #mx"]
    coupling: Float[Array, "2 my mx"] | None

    def press(self, pressure: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
        """w_S + w_B by a pressure [mm]."""
        return _mix(_scale, self.normal, pressure)

    def drag(self, traction: Float[Array, "2 nx ny"]) -> Float[Array, "2 nx ny"]:
        """u_S − u_B by a traction [mm]."""
        return _mix(_shear, self.shear, traction)

    def pull(self, pressure: Float[Array, "nx ny"]) -> Float[Array, "2 nx ny"]:
        """u_S − u_B by a pressure [mm]."""
        if self.coupling is None:
            return jnp.zeros((2, *pressure.shape), pressure.dtype)
        return jnp.stack([_mix(_scale_by_i, c, pressure) for c in self.coupling])

    def lift(self, traction: Float[Array, "2 nx ny"]) -> Float[Array, "nx ny"]:
        """w_S + w_B by a traction [mm]."""
        if self.coupling is None:
            return jnp.zeros_like(traction[0])
        x, y = _mix(_scale_by_i, self.coupling, traction)
        return -(x + y)

    def displace(
        self, pressure: Float[Array, "nx ny"], traction: Float[Array, "2 nx ny"]
    ) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
        """w_S + w_B and u_S − u_B by both: press and lift, pull and drag [mm]."""
        if self.coupling is None:
            return self.press(pressure), self.drag(traction)
        both = jnp.concatenate([pressure[None], traction])
        moved = _mix(_displace, (self.normal, self.shear, self.coupling), both)
        return moved[0], moved[1:]

    def inverse(self) -> "Compliance":
        """Roughly the inverse of `press` and of `drag`, each alone: that of each wave.

        [Vollebregt2014]. A uniform pressure does not move an incompressible layer; it counts as
        the next wave.
        """
        next_wave = jnp.minimum(self.normal[1, 0], self.normal[0, 1])
        xx, yy, xy = self.shear
        return Compliance(
            normal=1.0 / self.normal.at[0, 0].max(next_wave),
            shear=jnp.stack([yy, xx, -xy]) / (xx * yy - xy**2),
            coupling=None,
        )

    def joint_inverse(self) -> "Compliance":
        """Roughly the inverse of `displace`, wave by wave (Schur complement of the pressure)."""
        if self.coupling is None:
            return self.inverse()
        soft, (x, y), (xx, yy, xy) = self.inverse().normal, self.coupling, self.shear
        rest = jnp.stack([xx - soft * x**2, yy - soft * y**2, xy - soft * x * y])
        shear = Compliance(self.normal, rest, self.coupling).inverse().shear
        pull = soft * jnp.stack([shear[0] * x + shear[2] * y, shear[2] * x + shear[1] * y])
        normal = soft + soft * (x * pull[0] + y * pull[1])
        return Compliance(normal, shear, -pull)

    def coarsen(self, ratio: int) -> "Compliance":
        """Its long waves: the compliance of cells `ratio` times as long, roughly."""
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
        """The largest displacement by a unit traction of any wave, a bound on `drag` [mm/MPa]."""
        xx, yy, xy = self.shear
        return jnp.max(0.5 * (xx + yy) + jnp.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def pair_compliance(
    elastomer: Deformable, object_: Deformable, grid: Grid, *, smooth: bool = False
) -> Compliance:
    """Compliance of two bodies pressed against each other: the sum of theirs.

    Only the coupling is their difference, as the object carries −τ. Where that is known to be 0
    there is none.

    Args:
        elastomer: S.
        object_: B.
        grid: cells.
        smooth: without friction nothing is sheared, and `shear` is left at 0.
    """
    pair = _pair(elastomer, object_, _surface_integrals(grid), grid, smooth)
    pull = pair.coupling
    if pull is None or is_traced(pull) or bool(np.any(np.asarray(pull))):
        return pair
    return Compliance(pair.normal, pair.shear, None)


@eqx.filter_jit
def _pair(
    elastomer: Deformable,
    object_: Deformable,
    integrals: Mapping[str, AnyArray],
    grid: Grid,
    smooth: bool,
) -> Compliance:
    cell = _at_surface(integrals, grid)
    s, b = (body.coefficients(cell, grid.spacing) for body in (elastomer, object_))
    both = jax.tree.map(jnp.add, s, b)
    normal = _waves(both.zz, "zz")
    shear = [_waves(both.xx, "xx"), _waves(both.yy, "yy"), -_waves(both.xy, "xy")]
    return Compliance(
        normal=normal,
        shear=jnp.zeros((3, 1, 1), normal.dtype) if smooth else jnp.stack(shear),
        coupling=jnp.stack([_waves(s.xz - b.xz, "xz"), _waves(s.yz - b.yz, "yz")]),
    )


def _mix(mix: Callable, spectra: Any, field: Array) -> Array:
    """Transform a field, mix its waves by spectra, transform back.

    On a large grid some waves along y at a time: those stay in the processor's cache and take
    little memory. Lines of zeros are left out.
    """
    nx, ny = field.shape[-2:]

    def along_x(start: ArrayLike, count: int, waves: Array) -> Array:
        def cut(array: Array) -> Array:
            few = array.shape[-2] == 1
            return array if few else jax.lax.dynamic_slice_in_dim(array, start, count, -2)

        some = mix(jax.tree.map(cut, spectra), jnp.fft.fft(cut(waves), n=2 * nx))
        some = jnp.fft.ifft(some)[..., :nx]
        return jax.lax.dynamic_update_slice_in_dim(waves, some, start, -2)

    waves = jnp.swapaxes(jnp.fft.rfft(field, n=2 * ny), -2, -1)
    whole, rest = divmod(ny + 1, _ROWS) if ny > 2 * _ROWS else (0, ny + 1)
    if whole:
        waves = jax.lax.fori_loop(0, whole, lambda i, w: along_x(i * _ROWS, _ROWS, w), waves)
    if rest:
        waves = along_x(whole * _ROWS, rest, waves)
    return jnp.fft.irfft(jnp.swapaxes(waves, -2, -1), n=2 * ny)[..., :ny]


def _scale(factor: Array, waves: Array) -> Array:
    """Real times complex; XLA would make both complex."""
    return jax.lax.complex(factor * waves.real, factor * waves.imag)


def _scale_by_i(factor: Array, waves: Array) -> Array:
    """The same times i."""
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
    """The spectrum but for its factor, real; each axis by its parity."""
    waves = coefficient
    for parity in _PARITY[name]:
        half = jnp.fft.rfft(_mirror(waves, parity), axis=0)
        waves = (half.real if parity > 0 else half.imag).T
    return _mirror(waves, _PARITY[name][0]).T


def _mirror(half: Array, parity: int) -> Array:
    """Along the first axis, all in FFT order from those that are not negative.

    The distance of a whole grid is never used; there, what is odd has no definite sign and is 0.
    """
    last = half[-1:] if parity > 0 else jnp.zeros_like(half[-1:])
    return jnp.concatenate([half[:-1], last, parity * half[-2:0:-1]])


def _distances(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Distances along x and along y that are not negative [mm]."""
    x, y = (np.arange(n + 1) * d for n, d in zip(grid.shape, grid.spacing, strict=True))
    return x, y


@lru_cache(maxsize=8)
def _surface_integrals(grid: Grid) -> dict[str, np.ndarray]:
    """What does not vanish at the surface, for the distances on the grid.

    In double precision always, and by rows: what is needed on the way takes far more memory. On a
    square grid of square cells y is x, swapped.
    """
    x, y = _distances(grid)
    names = ("xx", "xy", "x", "turn_x")
    names = names if np.array_equal(x, y) else (*names, "yy", "y", "turn_y")
    kept = {name: np.empty((len(x), len(y))) for name in names}
    for row in range(0, len(x), _ROWS):
        here = slice(row, row + _ROWS)
        cell = cell_integrals(*np.meshgrid(x[here], y, indexing="ij"), grid.spacing)
        for name in names:
            kept[name][here] = getattr(cell, name)
    return kept


def _at_surface(integrals: Mapping[str, AnyArray], grid: Grid) -> CellIntegrals:
    """All integrals at the surface."""
    known = {name: jnp.asarray(value) for name, value in integrals.items()}
    if "yy" not in known:
        known |= {"yy": known["xx"].T, "y": known["x"].T, "turn_y": -known["turn_x"].T}
    x, y = jnp.meshgrid(*map(jnp.asarray, _distances(grid)), indexing="ij")
    none = jnp.zeros_like(x)
    return CellIntegrals(
        offset=(x, y),
        depth=jnp.zeros(()),
        zz=none,
        xz=none,
        yz=none,
        flat_xx=known["yy"],
        flat_yy=known["xx"],
        flat_xy=-known["xy"],
        **known,
    )
