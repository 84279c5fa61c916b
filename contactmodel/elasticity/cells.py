"""A uniform traction on a grid cell: the displacement by point loads, integrated over the cell.

[Love1929] A. E. H. Love, "The stress produced in a semi-infinite solid by pressure on part of the
boundary"; the integrals of Boussinesq's and Cerruti's solutions over a rectangle.
"""

from typing import NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import AnyArray, root


class CellIntegrals(NamedTuple):
    """Integrals over a cell of the surface; r leads from a point of the cell to the field point.

    If the field point is at the surface, flat_xx = yy, flat_xy = −xy, and integrals with z are 0.
    """

    offset: tuple[AnyArray, AnyArray]  # field point minus centre of the cell along x and y [mm]
    depth: AnyArray  # depth z of the field point [mm]
    xx: AnyArray  # ∬x²/r³ [mm]
    yy: AnyArray  # ∬y²/r³ [mm]
    xy: AnyArray  # ∬xy/r³ [mm]
    zz: AnyArray  # ∬z²/r³ [mm]
    xz: AnyArray  # ∬xz/r³ [mm]
    yz: AnyArray  # ∬yz/r³ [mm]
    x: AnyArray  # ∬x/r(r+z) [mm]
    y: AnyArray  # ∬y/r(r+z) [mm]
    flat_xx: AnyArray  # ∬∂/∂x x/(r+z) [mm]
    flat_yy: AnyArray  # ∬∂/∂y y/(r+z) [mm]
    flat_xy: AnyArray  # ∬∂/∂x y/(r+z) [mm]
    turn_x: AnyArray  # ∬y/r³ [-]
    turn_y: AnyArray  # −∬x/r³ [-]


class Coefficients(NamedTuple):
    """Displacement of a body under unit tractions on a cell [mm/MPa].

    w is the displacement into the body. At the surface, w/τ = −u/p by reciprocity.
    """

    zz: Array  # w/p
    xx: Array  # u_x/τ_x
    yy: Array  # u_y/τ_y
    xy: Array  # u_x/τ_y = u_y/τ_x
    xz: Array  # u_x/p
    yz: Array  # u_y/p
    zx: Array  # w/τ_x
    zy: Array  # w/τ_y
    turn_x: Array  # ½ rot u / τ_x [1/MPa]
    turn_y: Array  # ½ rot u / τ_y [1/MPa]


def cell_integrals(
    x: Float[AnyArray, "*shape"],
    y: Float[AnyArray, "*shape"],
    spacing: tuple[float, float],
    depth: ArrayLike = 0.0,
) -> CellIntegrals:
    """Integrals at the distance (x, y) from the centre of a cell ([Love1929]) [mm].

    Args:
        x: field point minus centre of the cell along x [mm].
        y: field point minus centre of the cell along y [mm].
        spacing: lengths of the cell along x and y [mm].
        depth: depth z of the field point below the surface [mm].
    """
    point = _Below(x.__array_namespace__(), depth)
    z, length, angle = point.z, point.length, point.angle
    right, left = x + 0.5 * spacing[0], x - 0.5 * spacing[0]
    upper, lower = y + 0.5 * spacing[1], y - 0.5 * spacing[1]

    def corners(primitive):
        across = primitive(right, upper) - primitive(left, upper)
        return across - primitive(right, lower) + primitive(left, lower)

    return CellIntegrals(
        offset=(x, y),
        depth=z,
        xx=corners(lambda s, t: t * point.log(s, t) - z * angle(s, t)),
        yy=corners(lambda s, t: s * point.log(t, s) - z * angle(s, t)),
        xy=-corners(length),
        zz=corners(lambda s, t: z * angle(s, t)),
        xz=-corners(lambda s, t: z * point.log(t, s)),
        yz=-corners(lambda s, t: z * point.log(s, t)),
        x=corners(point.flux),
        y=corners(lambda s, t: point.flux(t, s)),
        flat_xx=corners(point.flat),
        flat_yy=corners(lambda s, t: point.flat(t, s)),
        flat_xy=corners(lambda s, t: length(s, t) - z * point.depth_log(s, t)),
        turn_x=-corners(point.log),
        turn_y=corners(lambda s, t: point.log(t, s)),
    )


class _Below:
    """Primitives of the integrals at a cell's corner (s, t), for field points at a depth."""

    def __init__(self, namespace, depth: ArrayLike) -> None:
        self.xp, self.z = namespace, namespace.asarray(depth)

    def length(self, s, t):
        """√(s²+t²+z²); its derivative is 0 at 0."""
        return root(s**2 + t**2 + self.z**2)

    def log(self, s, t):
        """ln(s + r), without cancellation for s < 0 and without its pole at r = |s|."""
        square = t**2 + self.z**2
        t = self.xp.sqrt(self.xp.where(square > 0.0, square, 1.0))
        return self.xp.asinh(s / t) + self.xp.log(t)

    def angle(self, s, t):
        """Angle atan(st/zr), the corner's part of the cell's solid angle."""
        xp, below = self.xp, self.z * self.length(s, t)
        steep = 0.5 * xp.pi * xp.sign(s * t)
        return xp.where(below > 0.0, xp.atan(s * t / xp.where(below > 0.0, below, 1.0)), steep)

    def turned(self, s, t):
        """The angle atan(t/s) − atan(zt/sr)."""
        xp, z, r = self.xp, self.z, self.length(s, t)
        up, along = s * t * (r - z), s**2 * r + z * t**2
        return xp.atan(up / xp.where(along > 0.0, along, 1.0)) * (along > 0.0)

    def depth_log(self, s, t):
        """ln(r + z)."""
        total = self.length(s, t) + self.z
        return self.xp.log(self.xp.where(total > 0.0, total, 1.0))

    def flux(self, s, t):
        """Primitive of ∬x/r(r+z)."""
        along = t * self.depth_log(s, t) + self.z * self.log(t, s)
        return along + s * self.turned(s, t)

    def flat(self, s, t):
        """Primitive of ∬∂/∂x x/(r+z)."""
        return s * self.log(t, s) - self.z * self.turned(s, t)
