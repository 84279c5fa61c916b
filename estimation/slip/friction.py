"""Friction of a contact from the forces on it, and the share of its limit in use.

The object slips when shear and moment together reach the limit curve, nearly an ellipse
([Howe1996] R. D. Howe, M. R. Cutkosky, "Practical Force-Motion Models for Sliding Manipulation"),
(Q/Q₀)² + (M/M₀)² = 1. Under a normal force P, Q₀ = μP, and for a round contact of radius a with
Hertz's pressure M₀ = (3π/16) μPa ([Lubkin1951]). Where the contact's edge is fitted, its face and
the gel's thickness give the pressure (`estimation.fields.face`), and M₀ is μP times the pressure's
mean distance from the centre. The friction in use is the μ at which the contact would slip now. It
is at most μ while the object holds, and equals μ while all of the contact slips. The coefficient
measured in a slip is kept for the whole recording, also for other normal forces.
"""

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.estimators.measurement import Z95
from estimation.fields.edge import Edge
from estimation.fields.face import face_arm
from estimation.slip.branch import Branch
from estimation.slip.load_path import Loads
from estimation.softness.contact import disc_radius


@dataclass(frozen=True)
class FrictionSettings:
    """How friction is estimated.

    Attributes:
        least_force: smallest normal force for an estimate [N].
        frames: largest number of frames of macro slip over which the median is taken [frames].
        steady: relative change of the friction in use over five frames, below which the load is
            steady [-].
        arm_error: relative standard error of the arm where the contact's edge is unknown: the arm
            is longer by a third for flat faces, since they carry more at their rims [-].
        edge_arm_error: the same where the edge is fitted, which gives the pressure [-].
        load_error: relative standard error of the forces and of the limit curve [-].
        most_doubt: relative standard error from which the coefficient is unknown [-].
        holding: friction in use over that of earlier slips, below which an object holds [-].
        holding_unseen: friction in use over its largest value, below which an object holds before
            the first slip [-].
    """

    least_force: float = 0.1
    frames: int = 50
    steady: float = 0.1
    arm_error: float = 0.12
    edge_arm_error: float = 0.04
    load_error: float = 0.05
    most_doubt: float = 0.25
    holding: float = 0.8
    holding_unseen: float = 0.5


class Friction(NamedTuple):
    """Friction after a frame; NaN where unknown.

    Attributes:
        used: friction in use, the coefficient at which the object would slip now [-].
        coefficient: coefficient of friction μ from earlier slips, else from the moment–angle curve
            of the present turn [-].
        low: lower end of its 95 % interval; before the first slip, the largest friction in use
            since the object touched [-].
        high: upper end [-].

    Examples:
        >>> from estimation import Friction, Noise, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers()
        >>> friction: Friction = last.friction
        >>> print(f"{friction.used:.2f} in use of {friction.coefficient:.2f}: {friction.share:.0%}")
        0.48 in use of 0.51: 93%
    """

    used: float = np.nan
    coefficient: float = np.nan
    low: float = np.nan
    high: float = np.nan

    @property
    def share(self) -> float:
        """Share of the limit in use [-]; NaN while the coefficient is unknown."""
        return self.used / self.coefficient


class FrictionWatch:
    """Follows the friction in use, and estimates the coefficient from slips.

    Attributes:
        loads: moment and shear in the last frame.
    """

    def __init__(self) -> None:
        """Begin without any frame."""
        self._settings = FrictionSettings()
        self._slips: deque[float] = deque(maxlen=self._settings.frames)
        self._turning = 1.0
        self._arm = np.nan
        self._arm_error = self._settings.arm_error
        self.restart()

    def restart(self) -> None:
        """The object has left; the coefficient from its slips is kept."""
        self._recent: deque[float] = deque(maxlen=5)
        self._most = self._used = np.nan
        self._turn = 1.0
        self.loads = Loads()

    def update(
        self, wrench: tuple[float, ...], contact: Float[np.ndarray, "n 2"], edge: Edge | None = None
    ) -> None:
        """Take the next frame.

        Args:
            wrench: force [N] and moment [N·mm] on the sensor, about its origin; the z component of
                the force is negative under pressure.
            contact: positions of the contact's markers [mm].
            edge: edge of the contact, whose face gives the arm; Hertz's if unknown.
        """
        if not len(contact):
            self.restart()
            return
        force, moment = wrench[:3], wrench[5]
        self._used, self.loads, pressed = np.nan, Loads(), -force[2]
        if not (np.isfinite([*force, moment]).all() and pressed > self._settings.least_force):
            return
        x, y = contact.mean(axis=0)
        share = 3.0 * np.pi / 16.0  # arm of friction over the contact's radius: M₀/(μPa) [-]
        self._arm_error = self._settings.arm_error
        if edge is not None and np.isfinite(edge.thinness):
            share = face_arm(edge.thinness, edge.flat)
            self._arm_error = self._settings.edge_arm_error
        self._arm = pressed * share * disc_radius(contact)
        about = moment - (x * force[1] - y * force[0])
        arm = self._arm / pressed
        self.loads = Loads(float(about), float(arm * force[0]), float(arm * force[1]))
        shear, twist = np.hypot(force[0], force[1]) / pressed, about / self._arm
        self._recent.append(float(np.hypot(shear, twist)))
        self._turn = float(twist**2 / max(shear**2 + twist**2, 1e-12))
        self._used = float(median(list(self._recent)[-3:]))
        self._most = float(np.fmax(self._most, self._used))

    @property
    def used(self) -> float:
        """Friction in use in the last frame [-]; NaN if unknown."""
        return self._used

    @property
    def holds(self) -> bool:
        """Whether too little friction is in use for a slip."""
        if self._slips:
            return self._used < self._settings.holding * float(np.median(self._slips))
        return self._used < self._settings.holding_unseen * self._most

    def learn(self) -> None:
        """Take the friction in use as the coefficient, if the load is steady: the contact slips."""
        recent = np.array(self._recent)
        enough = len(recent) == self._recent.maxlen and np.isfinite(self._used)
        if enough and np.ptp(recent) < self._settings.steady * recent.mean():
            self._slips.append(self._used)
            self._turning = self._turn

    def estimate(self, branch: Branch | None = None) -> Friction:
        """The friction after the last frame.

        Args:
            branch: moment–angle curve, whose limit gives the coefficient before the first slip.
        """
        coefficient = spread = np.nan
        if self._slips:
            coefficient = float(np.median(self._slips))
            spread = float(np.std(self._slips)) / coefficient
        elif branch is not None and not branch.by_markers:
            limit = float(np.hypot(branch.limit, branch.direction.across))
            coefficient, spread = limit / self._arm, float(np.sqrt(branch.covariance[0, 0]))
        if not (np.isfinite(self._used + coefficient) and spread < self._settings.most_doubt):
            return Friction(self._used, low=self._most)
        # the arm's error counts by the share of the twist in the coefficient
        errors = spread, self._settings.load_error, self._arm_error * self._turning
        half = Z95 * float(np.linalg.norm(errors))
        low, high = coefficient * np.exp([-half, half])
        return Friction(self._used, coefficient, float(low), float(high))
