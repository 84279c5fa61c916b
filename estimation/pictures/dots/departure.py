"""Objects that leave the view in clips without a picture of the bare gel."""

import numpy as np
from jaxtyping import Bool, Float

from estimation.pictures.dots.rest import MOST_MOTION
from estimation.pictures.imprint.painted import Painted
from estimation.pictures.lattice import leave_cubic


class Departure:
    """Detects by the light that the object has gone and left the gel at rest.

    Lamps light a bare gel smoothly, and an object's slopes unevenly, even where it has no edges.
    The unevenness is what a cubic in the picture's coordinates leaves of the light around the dots.
    An object that is turned, moved or pressed less keeps more than half of its mean square. One
    that keeps more than a seventh may still touch a small part of the gel, which is then much more
    uneven than the rest.
    """

    def __init__(self) -> None:
        """Begin with the first frame, which may show an object whose dots count as at rest."""
        self._most = 0.0  # largest unevenness of the contact so far [-]
        self._gone = 0  # frames in a row in which the object has gone
        self._shown = 0  # frames in a row that show the contact
        self._touched = False  # whether there is a contact
        self._bare = False  # whether a contact has ended since the first frame
        self._places: np.ndarray | float = np.nan  # in the last picture that was judged

    def find(
        self,
        painted: Painted,
        places: Float[np.ndarray, "m 2"],
        pitch: float,
        contact: Bool[np.ndarray, " m"],
        shown: bool,
    ) -> bool:
        """Whether a contact is no contact any more: the dots have moved, but the object has gone.

        Args:
            painted: the picture without its dots.
            places: of the dots [px]; NaN where not visible.
            pitch: distance between neighbouring dots [px].
            contact: dots of the contact region.
            shown: whether a print or a change of light shows the contact.
        """
        # mean square over the largest so far, from which an object has not gone, and down to which
        # it may still touch a small part; there over that of the quarter of the dots with least [-]
        left, little, local = 0.5, 0.15, 4.5
        sure = 2  # frames in a row, since a single one may be wrong
        every = 4  # interval at which frames that show the contact are measured [frames]
        least = 30  # number of dots from which a cubic tells an object from the lamps
        moving = 0.1  # share of the dots that has moved further where the gel moves
        step = np.linalg.norm(places - self._places, axis=1) / pitch
        moves = (step > MOST_MOTION).sum() > moving * np.isfinite(step).sum()
        self._places = places
        touches = bool(contact.any())
        self._bare |= self._touched and not touches
        self._touched = touches
        if self._bare and not touches:
            self._most, self._gone = 0.0, 0
            return False
        self._shown = self._shown + 1 if shown else 0
        if shown and self._shown % every != 1:
            self._gone = 0
            return False
        light = painted.light(places, 0.5 * pitch)
        seen = np.isfinite(light[:, 0])
        if seen.sum() < least or not light[seen].any():
            return False
        squared = _find_unevenness(light[seen], places[seen])
        power = squared.mean()
        self._most = max(self._most, power)
        gone = touches and not shown and power < left * self._most
        if gone and self._gone < sure:
            even = max(little * self._most, local * np.quantile(squared, 0.25))
            gone = bool(not moves and power < even)
        self._gone = self._gone + 1 if gone else 0
        return self._gone >= sure


def _find_unevenness(
    light: Float[np.ndarray, "n k"], places: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """Squared deviation from a cubic, over all colours, for a mean light of 1 [-]."""
    shown = light / light.mean()  # an exposure that changes is no sign
    return (leave_cubic(places / np.ptp(places), shown) ** 2).sum(axis=1)
