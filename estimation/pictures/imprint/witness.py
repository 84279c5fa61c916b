"""The turn of the gel that sticks to the object, beside that of a print that is mostly worn dots.

Worn dots that are not detected are darker than all that an object prints, and a registration
follows them. They move with the gel, which turns differently from place to place where it is
sheared, so such a print may lag behind the object or lead it. The gel that sticks to the object
moves with it as one body. Under an object that holds, it is therefore the better witness; under one
that slips, the print may be. The interval of the angle covers both.
"""

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.fields.plane import fit_motion
from estimation.pictures.imprint.follower import Imprint
from estimation.pictures.lattice import Reference


class GelWitness:
    """Compares the turn of a print that is mostly worn dots with that of the gel that sticks."""

    mostly = 0.5  # share of the print's power at worn dots, from which it is mostly these [-]
    # distance of a dot from the motion of a body, up to which the dot belongs to it; the same
    # strain over a pitch as `max_strain` of a rigid core [pitches]
    misfit = 0.01

    def __init__(self, reference: Reference) -> None:
        """Begin before the first print."""
        self._pitch = reference.pitch
        self._start: Complex[np.ndarray, " m"] | None = None

    def check(
        self,
        imprint: Imprint,
        position: Float[np.ndarray, "m 2"],
        contact: Bool[np.ndarray, " m"],
    ) -> Imprint:
        """The motion of the print in the next frame, between gel and print if it is worn dots.

        Args:
            imprint: motion of the print.
            position: of the dots, without the lens's distortion [px]; NaN where not visible.
            contact: dots in contact.
        """
        likely = 1.96  # standard errors of a 95 % interval
        if not np.isfinite(imprint.angle):
            return imprint
        place = position @ np.array([1.0, 1.0j])
        if imprint.angle == 0.0 or self._start is None:  # its rotation counts from this frame
            self._start = place
            return imprint
        if imprint.worn < self.mostly:
            return imprint
        shown = contact & np.isfinite(self._start + place)
        turn = self._find_turn(self._start[shown], place[shown])
        half = 0.5 * float(np.angle(np.exp(1j * (turn - imprint.angle))))
        if np.isnan(half):
            return imprint
        error = imprint.error + abs(half) / likely
        return imprint._replace(angle=imprint.angle + half, error=error)

    def _find_turn(
        self, before: Complex[np.ndarray, " m"], now: Complex[np.ndarray, " m"]
    ) -> float:
        """Turn of the most dots that have moved as one body [rad]; NaN if they are too few."""
        bodies = find_bodies(before, now, self._pitch, self.misfit)
        if not len(bodies):
            return np.nan
        largest = bodies[bodies.sum(axis=1).argmax()]
        return fit_motion(before[largest], now[largest]).angle


def find_bodies(
    before: Complex[np.ndarray, " m"],
    now: Complex[np.ndarray, " m"],
    pitch: float,
    misfit: float,
    within: Bool[np.ndarray, " m"] | None = None,
) -> Bool[np.ndarray, "k m"]:
    """Dots that have moved as one body, for each body.

    Bodies grow from each dot and those around it, until they neither gain nor lose a dot.

    Args:
        before: places of dots [px].
        now: their places later [px].
        pitch: distance between neighbouring dots [px].
        misfit: distance of a dot from the motion of a body, up to which it belongs to it [pitches].
        within: dots from which bodies grow; all if None.
    """
    fewest = 8  # dots of a body: a dot and its eight neighbours, of which one may be missing
    around, rounds = 1.6, 10  # reach of a dot's eight neighbours [pitches]
    bodies = np.abs(before - before[:, None]) < around * pitch
    bodies = bodies if within is None else bodies[within]
    last = ~bodies
    for _ in range(rounds):
        bodies = bodies[bodies.sum(axis=1) > fewest // 2]
        share = bodies / bodies.sum(axis=1, keepdims=True)
        origin, image = (share @ before)[:, None], (share @ now)[:, None]
        turn = np.angle(np.sum(share * np.conj(before - origin) * (now - image), axis=1))
        off = np.abs(now - image - np.exp(1j * turn[:, None]) * (before - origin))
        last, bodies = bodies, off < misfit * pitch
    return bodies[(last == bodies).all(axis=1) & (bodies.sum(axis=1) >= fewest)]
