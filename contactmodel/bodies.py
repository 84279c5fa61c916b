"""The bodies in contact and how they give way."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from contactmodel.checks import poisson, positive
from contactmodel.compliance import CellIntegrals, Coefficients


class AbstractBody(eqx.Module):
    """A body with a plane surface: the elastomer S or the object B."""

    @abc.abstractmethod
    def coefficients(self, cell: CellIntegrals) -> Coefficients:
        """Displacement of the surface by unit tractions on a cell [mm/MPa]."""

    @property
    @abc.abstractmethod
    def softness(self) -> Float[Array, ""]:
        """1/G [1/MPa]."""


class HalfSpace(AbstractBody):
    """A homogeneous isotropic elastic half-space.

    Attributes:
        shear_modulus: G [MPa].
        poisson_ratio: ν [-], from 0 to 0.5.
    """

    shear_modulus: Float[Array, ""] = eqx.field(converter=positive)
    poisson_ratio: Float[Array, ""] = eqx.field(converter=poisson)

    def coefficients(self, cell: CellIntegrals) -> Coefficients:
        """The solutions of Boussinesq and Cerruti, integrated over the cell."""
        nu = self.poisson_ratio
        unit = 1.0 / (2.0 * jnp.pi * self.shear_modulus)
        pull = -0.5 * (1.0 - 2.0 * nu) * unit
        return Coefficients(
            zz=(1.0 - nu) * (cell.xx + cell.yy) * unit,
            xx=((1.0 - nu) * cell.yy + cell.xx) * unit,
            yy=((1.0 - nu) * cell.xx + cell.yy) * unit,
            xy=nu * cell.xy * unit,
            xz=pull * cell.x,
            yz=pull * cell.y,
            turn_x=0.5 * unit * cell.turn_x,
            turn_y=0.5 * unit * cell.turn_y,
        )

    @property
    def softness(self) -> Float[Array, ""]:
        """1/G [1/MPa]."""
        return 1.0 / self.shear_modulus


class Rigid(AbstractBody):
    """A body that does not give way; only one of the two can be."""

    def coefficients(self, cell: CellIntegrals) -> Coefficients:
        """All 0."""
        return Coefficients(*[jnp.zeros_like(jnp.asarray(cell.xx))] * len(Coefficients._fields))

    @property
    def softness(self) -> Float[Array, ""]:
        """0."""
        return jnp.zeros(())


def stiffness_ratio(elastomer: AbstractBody, object_: AbstractBody) -> Float[Array, ""]:
    """k = G_S/G_B; 0 for a rigid object."""
    return object_.softness / elastomer.softness
