"""Small changes of pressure and traction while every cell stays as it is.

Where a cell touches, the gap stays 0; where it sticks, its slip too; where it slides, |τ| stays μp
and τ turns with the slip. These are linear equations for the changes of both: dp and, on sliding
cells with n = τ/|τ|, dτ = w + μ dp n, w along their circle. But for μ dp n they are symmetric.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from contactmodel.compliance import Compliance
from contactmodel.friction import Sets, blend
from contactmodel.linear import Operator


class Tangent(NamedTuple):
    """The equations; unknowns are dp and w, three components on the grid.

    Attributes:
        compliance: of the pair.
        contact: cells that touch.
        sets: how they do.
        friction: μ [-].
    """

    compliance: Compliance
    contact: Bool[Array, "nx ny"]
    sets: Sets
    friction: Float[Array, "..."]

    def apply(self, unknown: Float[Array, "3 nx ny"]) -> Float[Array, "3 nx ny"]:
        """What the unknowns change in gap and slip; themselves where nothing may change."""
        dp, free = self._split(unknown)
        w, u = self.compliance.displace(dp, free + self._by_pressure * dp)
        return self._join(unknown, w, u, self.sets.stiffness, free)

    def apply_transposed(self, unknown: Float[Array, "3 nx ny"]) -> Float[Array, "3 nx ny"]:
        """The transpose of `apply`."""
        dp, free = self._split(unknown)
        w, u = self.compliance.displace(dp, free)
        w = w + jnp.sum(self._by_pressure * u, axis=0)
        return self._join(unknown, w, u, self.sets.stiffness, free)

    def restrict(
        self, gap: Float[Array, "nx ny"], slip: Float[Array, "2 nx ny"]
    ) -> Float[Array, "3 nx ny"]:
        """What of gap and slip must vanish."""
        return jnp.stack([jnp.where(self.contact, gap, 0.0), *self.sets.along(slip)])

    def changes(
        self, unknown: Float[Array, "3 nx ny"]
    ) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
        """dp and dτ of a solution."""
        dp = unknown[0]
        return dp, unknown[1:] + self._by_pressure * dp

    def make_preconditioner(self) -> Operator:
        """Roughly the inverse, but for what the pressure does to cells that slide."""
        inverse = self.compliance.joint_inverse()
        weight, local = blend(inverse, self.sets)

        def precondition(defect: Array) -> Array:
            gap, slip = self._split(defect)
            pressure, traction = inverse.displace(gap, weight * slip)
            return self._join(defect, pressure, weight * traction, local, slip)

        return precondition

    @property
    def _by_pressure(self) -> Array:
        """dτ by dp of sliding cells."""
        return self.friction * self.sets.normal

    def _split(self, unknown: Array) -> tuple[Array, Array]:
        return jnp.where(self.contact, unknown[0], 0.0), self.sets.along(unknown[1:])

    def _join(self, unknown: Array, w: Array, u: Array, local: Array, free: Array) -> Array:
        """What acts on both, and locally on what is free; the unknown where nothing does."""
        slip = self.sets.along(u) + local * free
        return jnp.stack([jnp.where(self.contact, w, unknown[0]), *(slip + unknown[1:] - free)])
