"""Parameters of a turning contact, a fitted frame, and what is read from it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.torsion import TurningFace


class At:
    """Places of the fitted parameters.

    Those of a contact are its edge's, with the logarithm of the twist's scale in place of the
    depth, and the angle of the last turn [rad]. In a frame, the object's angle and shift, an even
    strain by pressing, smooth deviations of the slip and the press's waves are fitted too.
    """

    centre, radius, outline, thinness = slice(0, 2), 2, slice(3, 5), 5
    flat, scale, corners, turn = 6, 7, slice(8, 10), 10
    angle, shift, stretch = 0, slice(1, 3), 3
    contact, deviations, waves, count = slice(4, 15), slice(15, 24), slice(24, 26), 26


@dataclass(frozen=True)
class LawModel:
    """How far the contact may deviate from the law.

    Attributes:
        reach: distance from the centre up to which markers are used [radii of the contact].
        rough: independent relative error of each marker's slip [-].
        smooth: standard deviation of each smooth factor on the slip [-].
        shaped: what the outline's stretch and corners add to it, and half of it to `rough` [-].
        radial: error of the displacement away from the axis, over the slip [-].
        strain: the same over the distance, since pressing strains the gel unevenly [-].
        even: standard deviation of the even strain by pressing [-].
        waves: the same of the waves around the axis by pressing, over the gel's stretch [-].
        fewest: least number of markers within reach.
    """

    reach: float = 1.5
    rough: float = 0.003
    smooth: float = 0.02
    shaped: float = 0.3
    radial: float = 0.3
    strain: float = 0.002
    even: float = 0.03
    waves: float = 0.5
    fewest: int = 24


class Belief(NamedTuple):
    """What is known of a contact before a frame.

    Attributes:
        mean: its parameters.
        covariance: their covariance.
        way: direction of its first turn, ±1; 0 if the object has not turned back at any time.
        stretch: uneven stretch of the gel by the press (`Press.stretch`) [-].
    """

    mean: Float[np.ndarray, " 11"]
    covariance: Float[np.ndarray, "11 11"]
    way: float
    stretch: complex = 0j


class LawFit(NamedTuple):
    """A fitted frame.

    Attributes:
        angle: rotation of the object [rad].
        shift: how far the object has shifted at the contact's centre [mm].
        parameters: the contact's parameters.
        covariance: covariance of the angle and these parameters.
        known: share of the angle's variance that comes from what was known before the frame [-].
        misfit: mean square of the residuals around the axis over their variance [-].
        cost: twice the negative logarithm of the probability around the axis, up to a constant.
        stick_ratio: radius of the disc that sticks, over that of the contact [-].
        held_ratio: the same of the disc that has never slipped [-].
        places: distance of each marker from the centre, over that of the outline [-].
    """

    angle: float
    shift: float
    parameters: Float[np.ndarray, " 11"]
    covariance: Float[np.ndarray, "12 12"]
    known: float
    misfit: float
    cost: float
    stick_ratio: float
    held_ratio: float
    places: Float[np.ndarray, " n"]

    @property
    def error(self) -> float:
        """Standard error of the angle [rad]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def step_error(self) -> float:
        """Standard error of the angle against the last turn [rad]."""
        turn, both = 1 + At.turn, self.covariance
        return float(np.sqrt(max(both[0, 0] + both[turn, turn] - 2.0 * both[0, turn], 0.0)))

    @property
    def furthest(self) -> float:
        """The largest rotation so far, at least 0 [rad]."""
        return float(max(abs(self.angle), abs(self.parameters[At.turn])))

    def hold_further(self, further: float) -> float:
        """`held_ratio` if the object had turned further before it turned back [rad]."""
        contact = self.parameters
        face = TurningFace(contact[At.thinness], contact[At.flat])
        return face.stick_ratio((self.furthest + further) / float(np.exp(contact[At.scale])))


class Reading(NamedTuple):
    """What the law gives in a frame that it explains.

    Attributes:
        angle: rotation of the object since the unloaded shape [rad].
        error: its standard error [rad].
        step_error: standard error of the angle against the last turn [rad].
        stick: markers inside the disc that sticks; once the object has clearly turned back, those
            that slipped before stick again.
        firm: whether the disc would not close if the object had turned further by three errors.
        ahead: how far the object may be ahead of the angle, as friction that falls with pressure
            closes the disc under a flat face sooner [rad]; positive counter-clockwise.
        near: whether the disc is so small that it may have closed unseen.
        sheared: whether the object turns about a point outside the disc's inner part, around which
            other markers may slip last.
    """

    angle: float
    error: float
    step_error: float
    stick: Bool[np.ndarray, " n"]
    firm: bool
    ahead: float
    near: bool
    sheared: bool = False
