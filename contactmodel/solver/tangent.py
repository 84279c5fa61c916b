"""Small changes of pressure and traction while every cell keeps its state.

The gap of touching cells stays 0, and so does the slip of sticking cells. In sliding cells |τ|
stays at the limit of friction f(p), μp by Coulomb's law, and τ turns with the slip. These
conditions are linear equations for the changes of pressure and traction: dp and, in sliding cells
with n = τ/|τ|, dτ = w + f′ dp n, with w along their circle. Without f′ dp n they are symmetric.
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
    """Load of a step of a contact."""

    gap: Float[Array, "nx ny"]  # gap between the undeformed bodies, below 0 where they overlap [mm]
    # motion of the rigid object since the last step plus u_S − u_B at that step [mm]
    motion: Float[Array, "2 nx ny"]
    friction: AbstractFriction  # friction law between the bodies


class Tangent(NamedTuple):
    """The linear equations; their unknowns are dp and w, three components on the grid."""

    compliance: Compliance  # compliance of the pair
    contact: Bool[Array, "nx ny"]  # cells that touch
    sets: Sets  # sticking and sliding cells
    # f′, derivative of the limit of friction by the pressure; μ by Coulomb's law [-]
    slope: Float[Array, "..."]

    def apply(self, unknown: Float[Array, "3 nx ny"]) -> Float[Array, "3 nx ny"]:
        """Change of gap and slip by the unknowns; 0 in cells whose gap and slip are free."""
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
        """The parts of gap and slip that must vanish."""
        return self._join(gap, slip, 0.0)

    def changes(
        self, unknown: Float[Array, "3 nx ny"]
    ) -> tuple[Float[Array, "nx ny"], Float[Array, "2 nx ny"]]:
        """dp and dτ of a solution."""
        free = self._join(unknown[0], unknown[1:], 0.0)
        return free[0], free[1:] + self._by_pressure * free[0]

    def make_preconditioner(self) -> Operator:
        """Approximate inverse, without the effect of the pressure on sliding cells."""
        inverse = self.compliance.joint_inverse()
        weight, local = blend(inverse, self.sets)

        def precondition(defect: Array) -> Array:
            gap, slip = defect[0], defect[1:]
            pressure, traction = inverse.displace(gap, weight * slip)
            return self._join(pressure, weight * traction, local * slip)

        return precondition

    @property
    def _by_pressure(self) -> Array:
        """Derivative of τ by p in sliding cells."""
        return self.slope * self.sets.normal

    def _join(self, normal: Array, tangential: Array, free: ArrayLike) -> Array:
        """Join the normal part in touching cells and the free tangential part."""
        inside = jnp.where(self.contact, normal, 0.0)
        return jnp.stack([inside, *(self.sets.along(tangential) + free)])
