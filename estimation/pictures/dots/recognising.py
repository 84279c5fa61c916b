"""Identification of dots by their rows and columns."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from estimation.pictures.lattice import Lattice, find_irregularity, index_lattice, nearest


class Recogniser:
    """Identifies the reference's dots among regular dots by their rows and columns."""

    def __init__(self, lattice: Lattice) -> None:
        """Begin before the first picture.

        Args:
            lattice: rows and columns of the reference's dots.
        """
        self._lattice = lattice
        self._uneven = np.zeros((0, 2))  # dots that did not rest when last indexed
        self._reach = 0.0  # motion of these dots up to which they cannot rest [px]

    def recognise(
        self, reference: Float[np.ndarray, "m 2"], dots: Float[np.ndarray, "k 2"]
    ) -> Float[np.ndarray, "m 2"]:
        """The positions of the reference's dots in a picture.

        The lattice coordinates of both differ only by an offset, which is found by a vote: most
        dots of the reference are nearest to themselves.

        Args:
            reference: dots at rest [px].
            dots: of the picture [px].

        Returns:
            Positions of the reference's dots [px]; NaN where missing, and NaN for all if the dots
            are not regular.
        """
        nowhere = np.full_like(reference, np.nan)
        if self._reach and nearest(KDTree(self._uneven), dots)[0].max(initial=0.0) < self._reach:
            return nowhere
        lattice = index_lattice(dots)
        irregularity = find_irregularity(lattice, dots[lattice.dot])
        if not irregularity.rests:
            self._uneven, self._reach = dots, irregularity.reach * lattice.pitch
            return nowhere
        near = nearest(KDTree(dots[lattice.dot]), reference[self._lattice.dot])[1]
        offsets = lattice.coordinates[near] - self._lattice.coordinates
        offset, votes = np.unique(offsets, axis=0, return_counts=True)
        index = self._lattice.coordinates + offset[votes.argmax()]
        same = (index[:, None] == lattice.coordinates).all(axis=2)
        there = same.any(axis=1)
        position = nowhere
        position[self._lattice.dot[there]] = dots[lattice.dot[same[there].argmax(axis=1)]]
        return position
