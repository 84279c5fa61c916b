"""A path on which the object's shape goes along as it slides over the elastomer.

`solve_path` presses where the object lay when it touched. What has slipped since lies elsewhere on
it: above the elastomer's point X, where the slip is s and the object has turned by R, is the
object's point X − R⁻¹ s. Each step takes the heights from there, with the slip of the step before.
"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from contactmodel.bodies import AbstractBody
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter, Domed
from contactmodel.pose import Pose
from contactmodel.solution import ContactSolution, stack_steps
from contactmodel.solve import solve_contact


class Carried(AbstractIndenter):
    """A shape that has slipped, on the cells of a grid.

    Attributes:
        indenter: the shape.
        above: point of the shape that is above each cell now [mm].
    """

    indenter: AbstractIndenter
    above: Float[Array, "2 nx ny"]

    def height(self, points: Float[Array, "2 ..."]) -> Float[Array, "..."]:
        """Height of the shape above the cells, which are the only points it knows [mm]."""
        if points.shape != self.above.shape:
            raise ValueError(f"known on the grid's points only, shape {self.above.shape}")
        return self.indenter.height(self.above)


def solve_sliding(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    path: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    rtol: float = 1e-8,
    max_steps: int = 200,
    throw: bool = True,
) -> ContactSolution:
    """Solve a contact along a path from rest, the shape going along with what slides.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape; a `Domed` one's pad stays where it is.
        path: poses, the steps along the first axis (`make_path`); the shape lags by one of them.
        grid: cells, more than cover the contact.
        friction_coefficient: μ, a number or a map of the grid [-].
        rtol: as for `solve_contact`.
        max_steps: as for `solve_contact`.
        throw: as for `solve_contact`.

    Returns:
        The contacts, as from `solve_path`.

    Raises:
        ValueError: as for `solve_contact`.
        RuntimeError: a failure in any step.
    """
    points = jnp.asarray(grid.points)
    above, steps = points, []
    for i in range(len(path.twist)):
        pose = jax.tree.map(lambda leaf, i=i: leaf[i], path)
        step = solve_contact(
            elastomer,
            object_,
            _carry(indenter, above),
            pose,
            grid,
            friction_coefficient,
            previous=steps[-1] if steps else None,
            rtol=rtol,
            max_steps=max_steps,
            throw=throw,
        )
        steps.append(step)
        c, s = jnp.cos(pose.twist), jnp.sin(pose.twist)
        above = points - jnp.tensordot(jnp.array([[c, s], [-s, c]]), step.slip, 1)
    return stack_steps(steps)


def _carry(indenter: AbstractIndenter, above: Float[Array, "2 nx ny"]) -> AbstractIndenter:
    if isinstance(indenter, Domed):
        return Domed(Carried(indenter.indenter, above), indenter.pad_radius)
    return Carried(indenter, above)
