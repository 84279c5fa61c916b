"""The search for gel at rest, in clips whose first frame may be loaded."""

import numpy as np
from jaxtyping import Float

from estimation.pictures.lattice import Reference, find_irregularity, index_lattice

MOST_MOTION = 0.02
"""Largest motion of dots at rest from frame to frame [pitches]."""


class RestSearch:
    """Finds the frame in which the dots have been regular and still for long enough.

    Attributes:
        first: irregularity of the first frame if it looked unloaded, which dots at rest must
            undercut. None if all dots at rest are a better reference.
    """

    def __init__(self, reference: Reference) -> None:
        """Begin with the reference of the first frame."""
        self._lattice, self._pitch = index_lattice(reference.position), reference.pitch
        assumed = reference.doubt is None  # to be unloaded
        self.first = find_irregularity(self._lattice, reference.position) if assumed else None
        self._before, self._count = reference.position, 0  # last picture, pictures at rest in a row

    def restart(self) -> None:
        """Begin again when an object has gone: the gel that it leaves is a better reference."""
        self.first, self._count = None, 0

    def finds(self, position: Float[np.ndarray, "m 2"], detected: int) -> bool:
        """Whether the dots of the next picture are at rest, and regular enough as the reference.

        Args:
            position: of the dots [px]; NaN where not visible.
            detected: number of dots in the picture.
        """
        # share of the picture's dots (or of the reference's, if fewer) that must be matched
        recognised = 0.9
        frames = 5  # in a row in which dots must be regular and still to count as at rest
        more_regular = 0.9  # largest irregularity, as a share of the first frame's [-]
        irregularity = find_irregularity(self._lattice, position)
        moved = np.linalg.norm(position - self._before, axis=1)
        self._before = position
        if np.nanmax(moved, initial=0.0) >= MOST_MOTION * self._pitch:
            self._count = 0
        needed = recognised * min(detected, len(self._lattice.dot))
        regular = irregularity.rests and np.isfinite(position[:, 0]).sum() >= needed
        self._count = self._count + 1 if regular else 0
        better = self.first is None or irregularity.mean < more_regular * self.first.mean
        return self._count >= frames and better
