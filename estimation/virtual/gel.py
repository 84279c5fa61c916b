"""The gel under an object along a path: its displacement, stick and slip, by the contact model."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from contactmodel.contact import Contact
from contactmodel.grid import Grid
from contactmodel.pose import Pose
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_path
from estimation.frames.stretches import find_stretches


class Gel(NamedTuple):
    """The gel's surface in each frame, on a grid in its undeformed state; zero without contact."""

    grid: Grid  # of the fields, with its origin at the point of first contact
    displacement: Float[np.ndarray, "frames 2 nx ny"]  # in the plane [mm]
    slip: Float[np.ndarray, "frames 2 nx ny"]  # of the object over the gel since first contact [mm]
    pressure: Float[np.ndarray, "frames nx ny"]  # of the object [MPa]
    # cells in contact that do not slide; all cells in contact while the object rests
    stick: Bool[np.ndarray, "frames nx ny"]
    force: Float[np.ndarray, "frames 3"]  # on the gel [N]
    moment: Float[np.ndarray, " frames"]  # on the gel about the object's axis [N·mm]

    @property
    def contact(self) -> Bool[np.ndarray, "frames nx ny"]:
        """Cells under pressure."""
        return self.pressure > 0.0

    def take(self, rows: slice) -> "Gel":
        """Select frames."""
        return Gel(self.grid, *(field[rows] for field in self[1:]))


class Press(NamedTuple):
    """The gel under an object that presses straight down, on a grid that turns with the object."""

    depth: Float[np.ndarray, "frames nx ny"]  # into the gel [mm]
    pressure: Float[np.ndarray, "frames nx ny"]  # of the object [MPa]


def press_object(contact: Contact, approach: Float[np.ndarray, " frames"]) -> Press:
    """Press an object onto the gel without friction, turn and shift.

    These hardly change the pressure on a nearly incompressible gel, and not at all the shape of the
    face. Turned with the object, the face has no steps of cells.

    Args:
        contact: pad, object, shape and grid.
        approach: of the object, in each frame [mm].
    """
    levels, index = np.unique(np.maximum(approach, 0.0), return_inverse=True)
    smooth = Contact(contact.elastomer, contact.object_, contact.indenter, contact.grid, 0.0)
    path = Pose(levels, np.zeros((len(levels), 2)), np.zeros(len(levels)))
    solved = solve_path(smooth, path, rtol=1e-5)
    depth = -np.asarray(solved.elastomer_displacement())[:, 2]
    return Press(depth[index], np.asarray(solved.pressure)[index])


def count_from_touch(path: Pose) -> Pose:
    """Count twist and shift of a path from the last pose before each contact."""
    twist, shift = np.array(path.twist), np.array(path.shift)
    for begin, end in find_stretches(np.asarray(path.approach) > 0.0):
        twist[begin:end] -= np.asarray(path.twist)[begin - 1] if begin else 0.0
        shift[begin:end] -= np.asarray(path.shift)[begin - 1] if begin else 0.0
    return Pose(path.approach, shift, twist, path.centre, path.linear, path.corotated)


def move_gel(contact: Contact, path: Pose, kinetic: float = 1.0, weakening: float = 0.3) -> Gel:
    """Compute the gel along a path.

    Friction that weakens in macro slip is applied afterwards: as long as everything slides in one
    direction, tractions and displacements are proportional to it.

    Args:
        contact: pad, object, shape, friction and grid.
        path: poses of the object, one for each frame.
        kinetic: friction after long macro slip, as a share of static friction [-].
        weakening: sliding distance over which friction falls to it [mm].
    """
    # tolerance of the contact's residuals [-]: 1e-5 of a displacement is invisible in a picture
    rtol = 1e-5
    poses = count_from_touch(path)
    frames, shape = len(np.asarray(path.approach)), contact.grid.shape
    sizes = ((2, *shape), (2, *shape), shape, shape, (3,), ())
    gel = Gel(contact.grid, *(np.zeros((frames, *size)) for size in sizes))
    gel = gel._replace(stick=np.zeros((frames, *shape), dtype=bool))
    for begin, end in find_stretches(np.asarray(path.approach) > 0.0):
        own = jax.tree.map(lambda leaf, b=begin, e=end: leaf[b:e], poses)
        moved, index = _find_moves(own)
        solved = solve_path(
            contact, jax.tree.map(lambda leaf, m=moved: leaf[m], own), sliding=True, rtol=rtol
        )
        own_gel = _weaken(_gather(solved), kinetic, weakening)
        for field, values in zip(gel[1:], own_gel[1:], strict=True):
            field[begin:end] = values[index]
        rests = begin + np.setdiff1d(np.arange(end - begin), moved)
        gel.stick[rests] = gel.contact[rests]
    return gel


def _find_moves(path: Pose) -> tuple[Int[np.ndarray, " moves"], Int[np.ndarray, " frames"]]:
    """Frames in which the object moves, and for each frame the number of the last of these."""
    numbers = np.column_stack([np.asarray(path.approach), np.asarray(path.shift), path.twist])
    moves = np.append(True, (np.diff(numbers, axis=0) != 0.0).any(axis=1))
    return np.flatnonzero(moves), np.cumsum(moves) - 1


def _gather(path: ContactSolution) -> Gel:
    surface = np.asarray(path.elastomer_displacement())
    return Gel(
        grid=path.grid,
        displacement=surface[:, :2],
        slip=np.asarray(path.slip),
        pressure=np.asarray(path.pressure),
        stick=np.asarray(path.stick),
        force=np.asarray(path.force),
        moment=np.asarray(path.moment),
    )


def _weaken(gel: Gel, kinetic: float, weakening: float) -> Gel:
    """Weaken the friction of a gel by the distance slid so far."""
    touching = gel.contact.sum(axis=(1, 2))
    increment = np.linalg.norm(np.diff(gel.slip, axis=0, prepend=gel.slip[:1]), axis=1)
    mean = np.sum(increment * gel.contact, axis=(1, 2)) / np.maximum(touching, 1)
    slid = np.cumsum(np.where(gel.stick.any(axis=(1, 2)), 0.0, mean))
    share = kinetic + (1.0 - kinetic) * np.exp(-slid / weakening)
    wide = share[:, None, None]
    return gel._replace(
        displacement=wide[:, None] * gel.displacement,
        slip=gel.slip + (1.0 - wide)[:, None] * gel.displacement,
        force=gel.force * np.column_stack([share, share, np.ones(len(share))]),
        moment=share * gel.moment,
    )
