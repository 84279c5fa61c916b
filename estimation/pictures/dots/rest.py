"""The search for gel at rest in pictures whose first may show it loaded."""

import numpy as np
from jaxtyping import Float

from estimation.pictures.lattice import Irregularity, Reference, find_irregularity, index_lattice

MOST_MOTION = 0.02
"""Largest motion of dots at rest from frame to frame [pitches]."""


class RestSearch:
    """Finds the picture in which the dots have been regular and still for long enough.

    Attributes:
        first: irregularity of the first frame, if it looked unloaded: only dots at rest that lie
            more regularly than these are found. None if any are a better reference.
    """

    def __init__(self, reference: Reference) -> None:
        """Begin with the reference of the first frame."""
        self._lattice, self._pitch = index_lattice(reference.position), reference.pitch
        self.first = None if reference.doubt is not None else self._measure(reference.position)
        self._before, self._count = reference.position, 0  # pictures at rest in a row
        self._passed: list[tuple[np.ndarray, int]] = []  # last picture in motion

    def restart(self) -> None:
        """Begin again when an object has gone: the gel that it leaves is a better reference."""
        self.first, self._count = None, 0

    def finds(self, position: Float[np.ndarray, "m 2"], detected: int, moves: bool) -> bool:
        """Whether the dots of the next picture are at rest, and a better reference.

        Judging takes milliseconds, so a picture in motion is only judged once the gel has stopped.

        Args:
            position: of the dots [px]; NaN where not visible.
            detected: number of dots in the picture.
            moves: whether the gel moves.
        """
        frames = 5  # in a row in which dots must be regular and still to count as at rest
        more_regular = 0.9  # largest irregularity, as a share of the first frame's [-]
        if moves:
            self._passed = [] if self._count else [(position, detected)]
            self._count = 0
            return False
        for picture in (*self._passed, (position, detected)):
            self._judge(*picture)
        self._passed = []
        if self._count < frames or self.first is None:
            return self._count >= frames
        return self._measure(position).mean < more_regular * self.first.mean

    def _judge(self, position: Float[np.ndarray, "m 2"], detected: int) -> None:
        """Count a picture whose dots are regular and still."""
        # share of the picture's dots (or of the reference's, if fewer) that must be matched
        recognised = 0.9
        needed = recognised * min(detected, len(self._lattice.dot))
        rests = self._measure(position).rests and np.isfinite(position[:, 0]).sum() >= needed
        moved = np.linalg.norm(position - self._before, axis=1)
        still = np.nanmax(moved, initial=0.0) < MOST_MOTION * self._pitch
        self._count = self._count + 1 if rests and (still or not self._count) else 0
        self._before = position

    def _measure(self, position: Float[np.ndarray, "m 2"]) -> Irregularity:
        return find_irregularity(self._lattice, position[self._lattice.dot])
