"""Small changes of pressure and traction while every cell stays as it is.

Where a cell touches, the gap stays 0; where it sticks, its slip too; where it slides, |τ| stays at
the limit of friction f(p), μp by Coulomb's law, and τ turns with the slip. These are linear
equations for the changes of both: dp and, on sliding cells with n = τ/|τ|, dτ = w + f′ dp n, w
along their circle. But for f′ dp n they are symmetric.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from contactmodel.elasticity.compliance import Compliance
from contactmodel.friction import AbstractFriction
from contactmodel.grid import dot
from contactmodel.solver.friction import Sets, blend
from contactmodel.solver.linear import Operator


class Load(NamedTuple):
    """What a step of a contact is solved for.

    Attributes:
        gap: between the undeformed bodies, below 0 where they overlap [mm].
        motion: of the rigid object since the last step, with what was then left of the slip [mm].
        friction: between the bodies.
    """

    gap: Float[Array, "nx ny"]
    motion: Float[Array, "2 nx ny"]
    friction: AbstractFriction


class Tangent(NamedTuple):
    """The equations; unknowns are dp and w, three components on the grid.

    Attributes:
        compliance: of the pair.
        contact: cells that touch.
        sets: how they do.
        slope: f′, of the limit of friction by the pressure; μ by Coulomb's law [-].
    """

    compliance: Compliance
    contact: Bool[Array, "nx ny"]
    sets: Sets
    slope: Float[Array, "..."]

    def apply(self, unknown: Float[Array, "3 nx ny"]) -> Float[Array, "3 nx ny"]:
        """What the unknowns change in gap and slip. They are 0 where nothing may change."""
        dp, free = unknown[0], unknown[1:]
        w, u = self.compliance.displace(dp, free + self._by_pressure * dp)
        return self._join(w, u, self.sets.stiffness * free)

    def apply_transposed(self, unknown: Float[Array, "3 nx ny"]) -> Float[Array, "3 nx ny"]:
        """The transpose of `apply`."""
        dp, free = unknown[0], unknown[1:]
        w, u = self.compliance.displace(dp, free)
        return self._join(w + dot(self._by_pressure, u), u, self.sets.stiffness * free)

    def restrict(
        self, gap: Float[Array, "nx ny"], slip: Float[Array, "2 nx ny"]
    ) -> Float[Array, "3 nx ny"]:
        """What of gap and slip must vanish."""
        return self._join(gap, slip, 0.0)

    def changes(
        self, unknown: Float[Array, "3 nx ny"]
    ) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
        """dp and dτ of a solution."""
        free = self._join(unknown[0], unknown[1:], 0.0)
        return free[0], free[1:] + self._by_pressure * free[0]

    def make_preconditioner(self) -> Operator:
        """Roughly the inverse, but for what the pressure does to cells that slide."""
        inverse = self.compliance.joint_inverse()
        weight, local = blend(inverse, self.sets)

        def precondition(defect: Array) -> Array:
            gap, slip = defect[0], defect[1:]
            pressure, traction = inverse.displace(gap, weight * slip)
            return self._join(pressure, weight * traction, local * slip)

        return precondition

    @property
    def _by_pressure(self) -> Array:
        """dτ by dp of sliding cells."""
        return self.slope * self.sets.normal

    def _join(self, normal: Array, tangential: Array, free: ArrayLike) -> Array:
        """What of both may change, and what does so already."""
        there = jnp.where(self.contact, normal, 0.0)
        return jnp.stack([there, *(self.sets.along(tangential) + free)])
