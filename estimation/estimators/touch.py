"""Frames in which noise hides the markers that stick.

Slip releases the markers one by one, noise hides all of them at once. A slow press lasts for
hundreds of frames in a fast recording, and while the object touches lightly, few markers are in
contact, so that noise leaves none of them sticking in some of these frames. This is no slip unless
the gel has turned.
"""

from collections import deque

from estimation.fields.measure import Fields
from estimation.fields.plane import has_turned, in_contact_plane
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

    def explain(self, none: bool, closed: bool) -> str:
        """Why no marker seems to stick in the frame; empty if some do, or if the object may slip.

        Args:
            none: whether no marker seems to stick.
            closed: whether the law of friction shows that fewer than three markers stick.
        """
        if none and self.light:
            return "no marker seems to stick, but the touch is light and the gel has not turned"
        firm = 2 * sum(self._firm) > len(self._firm)
        if not none or closed or not firm or self._hidden >= self._patience:
            self._hidden = 0
            return ""
        self._hidden += 1
        return "no marker seems to stick, but many did just before"
