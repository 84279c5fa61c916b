"""The moment on a contact from the motion of the gel's markers, up to the gel's modulus.

By Betti's theorem the moment M on any contact within a circle of radius R follows from the
circumferential displacement u of the surface: M θ = ∫ τ u dA, where τ is the traction under a disc
of radius R that turns by θ. On a half-space τ = (4Gθ/π) r/√(R² − r²) ([Reissner1944] E. Reissner,
H. F. Sagoci, "Forced torsional oscillations of an elastic half-space"). This holds whatever the
contact's shape and pressure and wherever it slips. Shift and pressing do not count if the circle is
around the contact. On a layer of unknown thickness the result is too small, by a factor that hardly
changes as the contact slips.
"""

from collections import deque

import numpy as np
from scipy.spatial import ConvexHull

from estimation.fields.measure import Fields
from estimation.fields.stencils import marker_pitch
from estimation.frames.recording import MarkerLayout
from estimation.softness.contact import disc_radius


class GelMoment:
    """Follows the moment on the gel from frame to frame."""

    def __init__(self, layout: MarkerLayout) -> None:
        """Begin without contact.

        Args:
            layout: the markers of the sensor.
        """
        self._reference = layout.reference[:, :2]
        self._pitch = marker_pitch(layout)
        self._sides = ConvexHull(self._reference).equations  # normals and offsets
        self.restart()

    def restart(self) -> None:
        """The object has left."""
        smoothing = 20  # frames over which the contact's centre is averaged
        self._centres: deque[np.ndarray] = deque(maxlen=smoothing)
        self._first = np.nan

    def update(self, fields: Fields) -> float:
        """The moment in the next frame, as the turn of a disc that would take it [rad].

        The disc is the largest around the contact that the markers cover in the contact's first
        frame, on a half-space. NaN without contact, and if the markers reach less than a quarter
        beyond the contact.

        Args:
            fields: fields of the frame.
        """
        least_reach = 1.25  # radius of the circle over that of the contact
        if not fields.contact.any():
            self.restart()
            return np.nan
        contact = self._reference[fields.contact]
        self._centres.append(contact.mean(axis=0))
        centre = np.mean(self._centres, axis=0)
        reach = float(np.min(-(self._sides[:, :2] @ centre + self._sides[:, 2])))
        reach += 0.5 * self._pitch
        if not reach > least_reach * disc_radius(contact):
            return np.nan
        if np.isnan(self._first):
            self._first = reach
        arm = self._reference - centre
        distance = np.hypot(*arm.T)
        # within a pitch of the rim, where the traction is unbounded, its mean over that pitch
        rim = np.maximum(reach**2 - distance**2, 0.5 * self._pitch * reach)
        weight = np.where(distance < reach, 1.0 / np.sqrt(rim), 0.0)
        moved = fields.displacement[:, :2]
        swept = arm[:, 0] * moved[:, 1] - arm[:, 1] * moved[:, 0]
        seen = np.isfinite(swept)
        measured = float(weight[seen] @ distance[seen] ** 2)
        if not measured > 0.0:
            return np.nan
        there = float(weight @ distance**2) / measured
        whole = 4.0 / 3.0 * np.pi * self._first**3  # of a disc that turns by 1
        return float(weight[seen] @ swept[seen]) * there * self._pitch**2 / whole
