"""Touches that move the gel too little to be measured from its rest, from its motion."""

from collections import deque

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.pictures.lattice import Reference


class StirredGel:
    """Detects that an object moves a part of the gel, some frames after the last contact.

    The camera and the rim of the gel are one body, so only an object moves one part of the gel and
    not the rest. Its dots move together, while the errors of dots are independent. An object at
    rest shows no motion: a touch lasts for some frames after the last one.
    """

    def __init__(self) -> None:
        """Begin before the first frame."""
        recent = 4  # frames over which a motion is measured
        self._places: deque[np.ndarray] = deque(maxlen=recent + 1)
        self._part = np.zeros(0, dtype=bool)  # dots that have moved together
        self._left = 0  # frames that the touch still lasts
        self._free = 0  # frames since the last contact
        self._moves = False  # whether a part of the gel moved in the last frame

    def find(
        self, places: Float[np.ndarray, "m 2"], reference: Reference, touched: bool
    ) -> Bool[np.ndarray, " m"]:
        """The dots that an object has recently moved; none in a contact and shortly after one.

        Args:
            places: of the dots in the next picture [px]; NaN where not visible.
            reference: the dots at rest.
            touched: whether dots, print or light show a contact.
        """
        resting = 16  # frames after a contact in which the gel comes to rest
        lasts = 16  # frames after a motion that the touch lasts
        if touched:
            self._places.clear()
            self._free = self._left = 0
            return np.zeros(len(places), dtype=bool)
        self._places.append(places)
        self._free += 1
        part = _find_moving_part((places - self._places[0]) / reference.pitch, reference.neighbours)
        moves = bool(part.any()) and self._free > resting
        if moves and self._moves:  # a single frame may be wrong
            self._part, self._left = part, lasts
        elif self._left:
            self._left -= 1
        self._moves = moves
        seen = np.isfinite(places[:, 0])
        return seen & self._part if self._left else np.zeros_like(seen)


def _find_moving_part(
    step: Float[np.ndarray, "m 2"], neighbours: Int[np.ndarray, "m k"]
) -> Bool[np.ndarray, " m"]:
    """The dots that move together over the others; none if the gel rests.

    Args:
        step: motion of the dots [pitches]; NaN where unknown.
        neighbours: of each dot; −1 for none.
    """
    # root mean square motion that neighbours have in common, from which the gel moves [pitches];
    # empty pads of published clips reached 0.0015 in 1200 frames, lightly touched ones 0.017
    least = 0.005
    together = 0.5  # least share of the mean square motion that neighbours have in common [-]
    largest = 0.05  # motion of a dot above which it was taken for another one [pitches]
    share = 0.35  # motion at the part's boundary, over the largest [-]
    known = np.linalg.norm(np.nan_to_num(step, nan=np.inf), axis=1) < largest
    if not known.any():
        return known
    step = np.where(known[:, None], step - np.median(step[known], axis=0), 0.0)  # shaken pictures
    beside = (neighbours >= 0) & known[neighbours]
    around = (beside[..., None] * step[neighbours]).sum(axis=1)
    around /= np.maximum(beside.sum(axis=1), 1)[:, None]
    common, total = float((step * around).sum()), float((step**2).sum())
    if common < max(least**2 * known.sum(), together * total):
        return np.zeros_like(known)
    size = np.linalg.norm(step + around, axis=1)
    return known & (size > share * size.max())
