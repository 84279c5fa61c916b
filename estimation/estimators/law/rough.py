"""Whether an object slides in its first turn, where the law of friction explains it only roughly.

Under square faces the markers deviate from the law (`estimation.estimators.law.fit`) by more than
their noise, so that it gives no angle. With a noise that covers the deviation, it still shows when
fewer than three markers stick.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Complex

from estimation.estimators.law.contact import ContactLaw
from estimation.estimators.law.fit import LawFits
from estimation.estimators.law.settings import LawSettings
from estimation.fields.edge import Edge
from estimation.fields.stick import MIN_STICK_MARKERS


class RoughLaw:
    """Follows a contact by the law with a coarse noise."""

    noise = 0.01  # per coordinate; covers the deviation of square faces [mm]

    def __init__(self, noise: float, fits: LawFits) -> None:
        """Begin without contact; the noise of the markers is per coordinate [mm]."""
        # square faces do not explain their first frame better than others
        settings = LawSettings(first_misfit=LawSettings.worst_misfit)
        self._law = ContactLaw(max(noise, self.noise), settings, fits=fits)

    def restart(self) -> None:
        """Begin with the next contact."""
        self._law.restart()

    def reject(self) -> None:
        """Do not follow this contact any more."""
        self._law.reject()

    def slides(
        self,
        edge: Edge | None,
        motion: Callable[[], tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]],
        angle: float,
        stick: Bool[np.ndarray, " n"] | None,
    ) -> bool | None:
        """Whether fewer than three markers stick in the next frame; None if unknown.

        Args:
            edge: the contact's edge.
            motion: gives the positions in the contact's plane, unloaded and now [mm].
            angle: rotation by the sticking markers [rad]; NaN if unknown.
            stick: markers that seem to stick.
        """
        if not self._law.observe(edge):
            return None
        reading = self._law.update(*motion(), angle, stick)
        if self._law.turned:
            self.reject()
            return None
        if reading is None:
            return True if self._law.closed else None
        return bool(reading.stick.sum() < MIN_STICK_MARKERS)
