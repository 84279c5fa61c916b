"""Friction laws: the largest traction under a pressure.

A law is one class with a `limit`. The solver also uses its derivative, which JAX computes.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from contactmodel.common.arrays import is_traced, refuse
from contactmodel.common.checks import Numbers, known, non_negative, positive


class AbstractFriction(eqx.Module):
    """A friction law between two bodies. Its numbers may be maps on the grid.

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import AbstractFriction
        >>> class Limited(AbstractFriction):  # Coulomb's law up to a largest traction
        ...     coefficient: float
        ...     largest: float
        ...     def limit(self, pressure):
        ...         return jnp.minimum(self.coefficient * pressure, self.largest)
        >>> law, pressure = Limited(0.5, largest=0.03), jnp.array([0.02, 0.1])
        >>> print(law.limit(pressure), law.slope(pressure))  # MPa, and its slope by JAX
        [0.01 0.03] [0.5 0. ]
    """

    @abc.abstractmethod
    def limit(self, pressure: Float[Array, "*grid"]) -> Float[Array, "*grid"]:
        """Largest traction under a pressure; 0 where the pressure is 0 [MPa].

        Args:
            pressure: p, from 0 [MPa].
        """

    def slope(self, pressure: Float[Array, "*grid"]) -> Float[Array, "*grid"]:
        """Derivative of the limit with respect to the pressure [-]."""
        return jax.jvp(self.limit, (pressure,), (jnp.ones_like(pressure),))[1]


class Coulomb(AbstractFriction):
    """Coulomb's law: the traction is at most μp.

    Attributes:
        coefficient: μ, a number or a map on the grid [-].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import Coulomb
        >>> print(Coulomb(0.5).limit(jnp.array([0.02, 0.1])))  # MPa
        [0.01 0.05]
    """

    coefficient: Float[Array, "..."] = eqx.field(converter=non_negative)

    def limit(self, pressure: Float[Array, "*grid"]) -> Float[Array, "*grid"]:
        """μp [MPa]."""
        return self.coefficient * pressure


class PowerLawFriction(AbstractFriction):
    """Friction that falls with pressure, as for rubber: μ(p) = μ₀ (p/p_ref)^(−γ).

    Attributes:
        coefficient: μ₀, the coefficient at the reference pressure [-].
        reference_pressure: p_ref [MPa].
        exponent: γ, from 0 (Coulomb's law) to below 1; ⅓ for smooth spheres [-].

    Examples:
        >>> import jax.numpy as jnp
        >>> from contactmodel import PowerLawFriction
        >>> law = PowerLawFriction(0.5, reference_pressure=0.1, exponent=1 / 3)
        >>> pressure = jnp.array([0.1, 0.8])  # MPa
        >>> print(law.limit(pressure) / pressure)  # μ halves at eight times the pressure
        [0.5  0.25]
    """

    coefficient: Float[Array, "..."]
    reference_pressure: Float[Array, "..."]
    exponent: Float[Array, "..."]

    def __init__(
        self, coefficient: Numbers, reference_pressure: Numbers, exponent: Numbers
    ) -> None:
        """Store the numbers.

        Raises:
            ValueError: a number is outside its range.
        """
        self.coefficient = non_negative(coefficient)
        self.reference_pressure = positive(reference_pressure)
        gamma = non_negative(exponent)
        message = "the exponent of friction that falls with pressure must be below 1"
        self.exponent = refuse(gamma, known(gamma) >= 1.0, message)

    def limit(self, pressure: Float[Array, "*grid"]) -> Float[Array, "*grid"]:
        """μ₀ p (p/p_ref)^(−γ) [MPa]."""
        pressed = pressure > 0.0
        ratio = jnp.where(pressed, pressure, 1.0) / self.reference_pressure
        return jnp.where(pressed, self.coefficient * pressure * ratio**-self.exponent, 0.0)


def as_friction(friction: Numbers | AbstractFriction) -> AbstractFriction:
    """A law unchanged, or Coulomb's law for a coefficient [-]."""
    return friction if isinstance(friction, AbstractFriction) else Coulomb(friction)


def is_smooth(friction: AbstractFriction) -> bool:
    """Whether friction is 0 everywhere; False inside `jit`, where its values are unknown."""
    leaves = jax.tree.leaves(friction)
    if any(map(is_traced, leaves)):
        return False
    with jax.ensure_compile_time_eval():
        pressure = jnp.ones(jnp.broadcast_shapes(*(leaf.shape for leaf in leaves)))
        return not np.any(np.asarray(friction.limit(pressure)))
