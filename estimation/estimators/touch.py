"""Frames in which noise hides the markers that stick.

Slip releases the markers one by one, noise hides all of them at once. A slow press lasts for
hundreds of frames in a fast recording, and while the object touches lightly, few markers are in
contact, so that noise leaves none of them sticking in some of these frames. This is no slip unless
the gel has turned.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from estimation.estimators.keyframes import Keyframe
from estimation.estimators.plane import has_turned, in_contact_plane
from estimation.estimators.rigid import RigidFit
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils


class Touch:
    """Follows how firmly the object touches.

    Attributes:
        turned: whether the gel in contact may have turned since the contact began: it has clearly
            turned, or the contact did not begin in view.
        settled: whether the contact has been firm since then, or did not begin in view.
    """

    def __init__(
        self, stencils: Stencils, noise_mm: float, many_markers: int, memory: int, patience: int
    ) -> None:
        """Begin with a recording, which may start in contact.

        Args:
            stencils: stencils of the layout.
            noise_mm: noise per in-plane coordinate [mm]; 0 if unknown: any gel may have turned.
            many_markers: number of sticking markers of a firm contact.
            memory: frames in memory; a contact is firm if many markers stick in most of them.
            patience: frames in a row in which noise may hide the sticking markers of a firm
                contact.
        """
        self._stencils, self._noise, self._many = stencils, noise_mm, many_markers
        self._firm: deque[bool] = deque(maxlen=memory)
        self._memory, self._patience, self._hidden = memory, patience, 0
        self.turned, self.settled = True, True

    @property
    def light(self) -> bool:
        """Whether the contact has neither been firm nor turned the gel since it began in view."""
        return not (self.turned or self.settled)

    def update(self, fields: Fields) -> None:
        """Take the fields of the next frame."""
        if not fields.contact.any():
            self._firm.clear()
            self.turned = not self._noise or self._stencils.flat
            self.settled = False
        elif not self.turned:
            before, after = in_contact_plane(self._stencils, fields, fields.contact)
            self.turned = has_turned(before[fields.contact], after[fields.contact], self._noise)

    def hold(self, stick: int, clearly: bool = False) -> None:
        """Take the number of markers that stick in the frame.

        Args:
            stick: the number.
            clearly: whether they stick beyond doubt, though they may be few.
        """
        self._hidden = 0
        self._firm.append(clearly or stick >= self._many)
        self.settled = self.settled or 2 * sum(self._firm) > self._memory

    def lose(self) -> None:
        """Take a frame that has lost the angle."""
        self._firm.clear()

    def collapses(
        self,
        now: Keyframe,
        fit: RigidFit,
        last: tuple[Keyframe, Bool[np.ndarray, " n"]] | None,
        recent: Sequence[Keyframe],
    ) -> bool:
        """Whether noise seems to have hidden most of the markers that stuck in the last frame.

        Slip releases them one by one. Those that are left may be a few that noise has moved alike,
        which shows as an angle that contradicts the last one, even if the object has turned on by
        up to twice its last step. Markers in the plane are not misread one by one.

        Args:
            now: the angle by the sticking markers.
            fit: their fit.
            last: the last frame with an angle, and its sticking markers.
            recent: the last frames with an angle.
        """
        if last is None or len(recent) < 2 or self.light or self._stencils.flat:
            return False
        before, stick = last
        step = 2.0 * (before.angle - recent[-2].angle)
        low, high = before.low + min(step, 0.0), before.high + max(step, 0.0)
        return bool(2 * fit.stick.sum() < stick.sum()) and (now.low > high or now.high < low)

    def explain(self, none: bool, closed: bool) -> str:
        """Why too few markers seem to stick; empty if enough do, or if the object may slip.

        Args:
            none: whether too few markers seem to stick.
            closed: whether the law of friction shows that fewer than three markers stick.
        """
        if none and self.light:
            return "no marker seems to stick, but the touch is light and the gel has not turned"
        firm = 2 * sum(self._firm) > len(self._firm)
        if not none or closed or not firm or self._hidden >= self._patience:
            self._hidden = 0
            return ""
        self._hidden += 1
        return "too few markers seem to stick, but many did just before"
