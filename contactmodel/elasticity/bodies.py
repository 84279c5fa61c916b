"""The bodies in contact: half-space, layer and rigid body, and their compliance."""

import abc
import math
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.common.arrays import refuse
from contactmodel.common.checks import Numbers, known, poisson, positive
from contactmodel.elasticity.cells import CellIntegrals, Coefficients
from contactmodel.elasticity.layer import REACH, base_kernels
from contactmodel.elasticity.pad import Material, Pad


def _positive_or_none(value: Numbers | None) -> Float[Array, ""] | None:
    return None if value is None else positive(value)


class AbstractBody(eqx.Module):
    """A body with a plane surface: the elastomer S or the object B.

    Examples:
        >>> import jax
        >>> from contactmodel import AbstractBody, HalfSpace, stiffness_ratio
        >>> class Twice(AbstractBody):  # twice as stiff as another body
        ...     body: AbstractBody
        ...     def coefficients(self, cell, spacing):
        ...         return jax.tree.map(lambda c: c / 2, self.body.coefficients(cell, spacing))
        ...     @property
        ...     def softness(self):
        ...         return self.body.softness / 2
        >>> gel = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
        >>> print(f"k = {stiffness_ratio(gel, Twice(gel)):.2f}")
        k = 0.50
    """

    @abc.abstractmethod
    def coefficients(self, cell: CellIntegrals, spacing: tuple[float, float]) -> Coefficients:
        """Displacement of the surface under unit tractions on a cell [mm/MPa].

        Args:
            cell: integrals of the point loads' displacement over the cell.
            spacing: lengths of a cell along x and y [mm].
        """

    def checked(
        self, spacing: tuple[float, float], depth: ArrayLike | None = None
    ) -> "AbstractBody":
        """The body, if its coefficients are valid for a grid's cells and a depth.

        The check runs before a compiled program, so that it can raise a plain error, and the
        program need not call the host.

        Args:
            spacing: lengths of a cell along x and y [mm].
            depth: depth of the displaced points below the surface; None at the surface [mm].

        Raises:
            ValueError: the coefficients are not valid.
        """
        return self

    @property
    def is_corrected(self) -> bool:
        """Whether force and moment of its contacts are corrected (`ContactSolution.correction`)."""
        return False

    @property
    def uncorrected(self) -> "AbstractBody":
        """The body without corrections; its coefficients are the same.

        Programs that need only coefficients take it, and are compiled once for all corrections.
        """
        return self

    @property
    @abc.abstractmethod
    def softness(self) -> Float[Array, ""]:
        """1/G [1/MPa]."""


class HalfSpace(AbstractBody):
    """A homogeneous isotropic elastic half-space.

    Attributes:
        shear_modulus: G [MPa].
        poisson_ratio: ν [-], from 0 to 0.5.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid
        >>> from contactmodel import solve_contact
        >>> grid, pose = Grid((24, 24), (24.0, 24.0)), Pose(approach=1.0)
        >>> for modulus in (0.2, 0.4):
        ...     gel = HalfSpace(shear_modulus=modulus, poisson_ratio=0.5)
        ...     solution = solve_contact(Contact(gel, Rigid(), Paraboloid(20.0), grid, 0.5), pose)
        ...     hertz = 16 / 3 * modulus * 20.0**0.5  # N
        ...     print(f"{-solution.force[2]:.2f} N, Hertz {hertz:.2f} N")
        4.78 N, Hertz 4.77 N
        9.55 N, Hertz 9.54 N
    """

    shear_modulus: Float[Array, ""] = eqx.field(converter=positive)
    poisson_ratio: Float[Array, ""] = eqx.field(converter=poisson)

    def coefficients(self, cell: CellIntegrals, spacing: tuple[float, float]) -> Coefficients:
        """The solutions of Boussinesq and Cerruti, integrated over the cell [mm/MPa]."""
        return _point_loads(self.shear_modulus, self.poisson_ratio, cell)

    @property
    def softness(self) -> Float[Array, ""]:
        """1/G [1/MPa]."""
        return 1.0 / self.shear_modulus


def _point_loads(
    shear_modulus: Float[Array, ""], poisson_ratio: Float[Array, ""], cell: CellIntegrals
) -> Coefficients:
    """The half-space's coefficients; the numbers are checked already, outside the program."""
    loose = 1.0 - 2.0 * poisson_ratio
    unit = 0.25 / (jnp.pi * shear_modulus)
    whole = cell.xx + cell.yy + cell.zz  # ∬1/r
    return Coefficients(
        zz=unit * (cell.zz + 2.0 * (1.0 - poisson_ratio) * whole),
        xx=unit * (whole + cell.xx + loose * cell.flat_xx),
        yy=unit * (whole + cell.yy + loose * cell.flat_yy),
        xy=unit * (cell.xy + loose * cell.flat_xy),
        xz=unit * (cell.xz - loose * cell.x),
        yz=unit * (cell.yz - loose * cell.y),
        zx=unit * (cell.xz + loose * cell.x),
        zy=unit * (cell.yz + loose * cell.y),
        turn_x=unit * cell.turn_x,
        turn_y=unit * cell.turn_y,
    )


class Layer(AbstractBody):
    """A homogeneous isotropic elastic layer, bonded to a rigid base.

    Attributes:
        shear_modulus: G [MPa].
        poisson_ratio: ν [-], from 0 to 0.5.
        thickness: h, at least the length of a grid cell [mm].
        radius: radius of a round pad with a free side, or side/√π of a square one; None for a wide
            pad [mm].
        neo_hookean: whether the gel stiffens with depth as a neo-Hookean gel does.

    `radius` and `neo_hookean` multiply a solution's force and moment by fitted factors
    (`ContactSolution.correction`). They require a rigid object and given motions. Under corotated
    poses, `neo_hookean` also changes the limit of friction and corrects the displacement of the
    surface (see `reading`). Otherwise fields and tractions stay those of the wide linear layer.

    Examples:
        >>> from contactmodel import Contact, Grid, Layer, Pose, Rigid, Sphere, solve_contact
        >>> grid, pose = Grid((24, 24), (24.0, 24.0)), Pose(approach=1.0)
        >>> for thickness in (3.0, 300.0):
        ...     gel = Layer(shear_modulus=0.2, poisson_ratio=0.5, thickness=thickness)
        ...     solution = solve_contact(Contact(gel, Rigid(), Sphere(20.0), grid, 0.0), pose)
        ...     print(f"{thickness:.0f} mm thick: {-solution.force[2]:.2f} N")
        3 mm thick: 47.32 N
        300 mm thick: 4.83 N
    """

    shear_modulus: Float[Array, ""] = eqx.field(converter=positive)
    poisson_ratio: Float[Array, ""] = eqx.field(converter=poisson)
    thickness: Float[Array, ""] = eqx.field(converter=positive)
    radius: Float[Array, ""] | None = eqx.field(converter=_positive_or_none, default=None)
    neo_hookean: bool = eqx.field(static=True, default=False)

    def coefficients(self, cell: CellIntegrals, spacing: tuple[float, float]) -> Coefficients:
        """The half-space's coefficients plus the effect of the base (see `layer`) [mm/MPa]."""
        h, depth = self.thickness, jnp.asarray(cell.depth)
        half = _point_loads(self.shear_modulus, self.poisson_ratio, cell)
        base = self._base(cell, h, depth, spacing)
        square = (cell.offset[0] ** 2 + cell.offset[1] ** 2) / h**2
        return jax.tree.map(lambda a, b: jnp.where(square < REACH**2, a + b, 0.0), half, base)

    def checked(self, spacing: tuple[float, float], depth: ArrayLike | None = None) -> "Layer":
        """The layer, if it is at least as thick as a cell and contains the depth.

        Args:
            spacing: lengths of a cell along x and y [mm].
            depth: depth of the displaced points below the surface; None at the surface [mm].

        Raises:
            ValueError: the layer is thinner than a cell, or the depth is below its base.
        """
        thin = "a layer must not be thinner than a cell of the grid: use smaller cells"
        h = refuse(self.thickness, known(self.thickness) < max(spacing), thin)
        if depth is not None:
            low = "a depth must not be larger than the layer's thickness"
            h = refuse(h, known(jnp.asarray(depth)) > known(h), low)
        return eqx.tree_at(lambda body: body.thickness, self, h)

    def _base(
        self, cell: CellIntegrals, h: Array, depth: Array, spacing: tuple[float, float]
    ) -> Coefficients:
        """Effect of the base; an oblong cell is replaced by two squares at a distance."""
        short = min(spacing)
        apart = [math.sqrt((d**2 - short**2) / 12.0) for d in spacing]  # the same second moment
        signs = (1.0,) if spacing[0] == spacing[1] else (1.0, -1.0)
        x, y = (jnp.asarray(offset) for offset in cell.offset)
        parts = [
            self._base_of_square((x + s * apart[0]) / h, (y + s * apart[1]) / h, h, depth, short)
            for s in signs
        ]
        area = spacing[0] * spacing[1] / len(parts)
        return jax.tree.map(lambda *terms: area * sum(terms), *parts)

    def _base_of_square(
        self, x: Array, y: Array, h: Array, depth: Array, side: float
    ) -> Coefficients:
        """Effect of the base on the displacement under a unit force on a square."""
        distance = jnp.sqrt(jnp.maximum(x**2 + y**2, 1e-24))  # its derivative is 0 at 0
        kernel = base_kernels(distance, self.poisson_ratio, depth / h, side / h)
        unit = 0.5 / (jnp.pi * self.shear_modulus * h)
        uneven = 0.5 * (x**2 - y**2) * kernel.split
        return Coefficients(
            zz=unit * kernel.normal,
            xx=unit * (kernel.mean - uneven),
            yy=unit * (kernel.mean + uneven),
            xy=-unit * x * y * kernel.split,
            xz=-unit * x * kernel.pull,
            yz=-unit * y * kernel.pull,
            zx=unit * x * kernel.lift,
            zy=unit * y * kernel.lift,
            turn_x=unit / h * y * kernel.turn,
            turn_y=-unit / h * x * kernel.turn,
        )

    @property
    def is_corrected(self) -> bool:
        """Whether force and moment are corrected."""
        return self.neo_hookean or self.radius is not None

    @property
    def uncorrected(self) -> "Layer":
        """The layer without corrections."""
        numbers = self.shear_modulus, self.poisson_ratio, self.thickness
        return jax.tree.unflatten(_plain_layer(), numbers)  # without checks

    @property
    def softness(self) -> Float[Array, ""]:
        """1/G [1/MPa]."""
        return 1.0 / self.shear_modulus


@lru_cache(maxsize=1)
def _plain_layer() -> Any:
    """Structure of a layer without corrections, made without tracing."""
    with jax.ensure_compile_time_eval():
        return jax.tree.structure(Layer(1.0, 0.5, 1.0))


class Rigid(AbstractBody):
    """A rigid body; at most one of the two bodies can be rigid.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, solve_contact
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> for object_ in (Rigid(), gel):  # as soft as the gel: half the force
        ...     solution = solve_contact(Contact(gel, object_, Sphere(20.0), grid, 0.5), Pose(1.0))
        ...     print(f"{-solution.force[2]:.3f} N")
        4.750 N
        2.375 N
    """

    def coefficients(self, cell: CellIntegrals, spacing: tuple[float, float]) -> Coefficients:
        """All 0."""
        return Coefficients(*[jnp.zeros_like(jnp.asarray(cell.xx))] * len(Coefficients._fields))

    @property
    def softness(self) -> Float[Array, ""]:
        """0."""
        return jnp.zeros(())


def stiffness_ratio(elastomer: AbstractBody, object_: AbstractBody) -> Float[Array, ""]:
    """k = G_S/G_B [-]; 0 for a rigid object. For the effect of a layer's base, see `layer_gain`.

    Args:
        elastomer: the elastomer S.
        object_: the object B.

    Examples:
        >>> from contactmodel import HalfSpace, stiffness_ratio
        >>> gel, foam = HalfSpace(0.2, poisson_ratio=0.5), HalfSpace(0.4, poisson_ratio=0.3)
        >>> print(f"k = {stiffness_ratio(gel, foam):.2f}")
        k = 0.50
    """
    return object_.softness / elastomer.softness


def make_body(material: Material) -> HalfSpace | Layer:
    """The body of a material: a layer if its thickness is known and finite, else a half-space.

    Args:
        material: elastic constants and thickness.

    Raises:
        ValueError: the shear modulus or Poisson's ratio is missing, or a correction of the pad
            lacks the thickness.

    Examples:
        >>> from contactmodel import Material, make_body
        >>> body = make_body(Material(shear_modulus=0.2, poisson_ratio=0.48, thickness=3.0))
        >>> print(f"{type(body).__name__}, {body.thickness:.1f} mm thick")
        Layer, 3.0 mm thick
        >>> body = make_body(Material(shear_modulus=0.2, poisson_ratio=0.48))
        >>> print(type(body).__name__)
        HalfSpace
    """
    modulus, ratio, thickness = material.shear_modulus, material.poisson_ratio, material.thickness
    if modulus is None or ratio is None:
        lacking = "shear_modulus_mpa" if modulus is None else "poisson_ratio"
        raise ValueError(f"the key {lacking!r} is missing")
    pad = material if isinstance(material, Pad) else Pad()
    if thickness is None or thickness == math.inf:
        if pad.radius is not None or pad.neo_hookean:
            key = "radius_mm" if pad.radius is not None else "neo_hookean"
            raise ValueError(f"{key} corrects a layer: it requires a finite thickness_mm")
        return HalfSpace(modulus, ratio)
    return Layer(modulus, ratio, thickness, pad.radius, bool(pad.neo_hookean))
