"""A path along which forces and moments are given in place of motion."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from contactmodel.bodies import AbstractBody
from contactmodel.checks import Numbers, number
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter
from contactmodel.pose import Pose
from contactmodel.resultants import find_given, get_motion, replace_motion, solve_resultant
from contactmodel.solution import ContactSolution, stack_steps


def solve_resultant_path(
    elastomer: AbstractBody,
    object_: AbstractBody,
    indenter: AbstractIndenter,
    path: Pose,
    grid: Grid,
    friction_coefficient: ArrayLike,
    *,
    normal_force: ArrayLike | None = None,
    shear_force: Numbers | None = None,
    moment: ArrayLike | None = None,
    previous: ContactSolution | None = None,
    rtol: float = 1e-8,
    max_steps: int = 200,
) -> ContactSolution:
    """Follow a path along which forces or moments are given in place of some of the motion.

    Each step is a `solve_resultant` with the step before as its history; the motion is looked for
    from where it was then.

    Args:
        elastomer: S.
        object_: B, made of this.
        indenter: and of this shape.
        path: motion where no resultant is given, the steps along the first axis (`make_path`);
            where one is, its first step is a first guess that touches.
        grid: cells, more than cover the contact.
        friction_coefficient: μ [-].
        normal_force: of each step, or one for all [N].
        shear_force: along x and y of each step, or one for all [N].
        moment: of each step, or one for all [N·mm].
        previous: the contact before the path; without it, the path starts from rest.
        rtol: as for `solve_resultant`.
        max_steps: as for `solve_resultant`.

    Returns:
        The contacts; every array has the steps as its first axis, materials and μ excepted.

    Raises:
        ValueError: as for `solve_resultant`, or numbers of steps that differ.
        RuntimeError: a failure in any step.
    """
    if path.approach.ndim != 1 or not path.approach.size:
        raise ValueError("expected a path of poses (make_path); solve_resultant takes one pose")
    given = {"normal_force": normal_force, "shear_force": shear_force, "moment": moment}
    find_given(**given)
    steps = {name: _spread(name, v, path) for name, v in given.items() if v is not None}
    contacts: list[ContactSolution] = []
    for index in range(path.approach.size):
        pose = jax.tree.map(lambda leaf, i=index: leaf[i], path)
        wanted: dict[str, Any] = {name: values[index] for name, values in steps.items()}
        if contacts:
            previous = contacts[-1]
            pose = continue_motion(pose, previous, **wanted)
        try:
            contact = solve_resultant(
                elastomer,
                object_,
                indenter,
                pose,
                grid,
                friction_coefficient,
                **wanted,
                previous=previous,
                rtol=rtol,
                max_steps=max_steps,
            )
        except RuntimeError as error:
            raise RuntimeError(f"step {index} of the path: {error}") from error
        contacts.append(contact)
    return stack_steps(contacts)


def continue_motion(
    pose: Pose,
    previous: ContactSolution | None,
    normal_force: ArrayLike | None = None,
    shear_force: Numbers | None = None,
    moment: ArrayLike | None = None,
) -> Pose:
    """The pose, with what the resultants are given for as it was in the contact before."""
    if previous is None:
        return pose
    which = find_given(normal_force, shear_force, moment)
    return replace_motion(pose, which, get_motion(previous.pose)[np.asarray(which)])


def _spread(name: str, value: Numbers, path: Pose) -> Array:
    """A resultant of each step of a path."""
    array = number(value)
    shape = path.shift.shape if name == "shear_force" else path.approach.shape
    try:
        return jnp.broadcast_to(array, shape)
    except ValueError as error:
        raise ValueError(
            f"{name} of the path must have the shape {shape}, or be the same in every step; got "
            f"{array.shape}"
        ) from error
