"""How far the object has slid over the gel: the place of the one against that of the other.

What the object prints shows where the object is, the markers show where the gel is. While the
object holds both go together, however the gel is sheared; how far they have parted is the slip, in
any direction and over any length.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.stencils import marker_pitch
from estimation.frames.recording import MarkerLayout

TILTED = 0.08
"""Share of the gel's shear by which a print goes ahead of gel that it holds [-]: a sheared contact
grows at its front. In 19 held published lifts it was 0.18 at most."""


class Slide(NamedTuple):
    """How far the object has slid over the gel.

    Attributes:
        slip: over the gel that has followed it best [mm]: 0 while some of the contact sticks. NaN
            without contact, where no print is followed, and where it is not known to a marker's
            pitch nor to itself: a print that is alike along a line does not show slip that way.
        slip_error: half-width of its 95 % interval [mm]; NaN without contact or print.
        slip_since: time stamp of the frame that it counts from: the first that shows the print
            after the object touched, or after the print was lost for long [s].
    """

    slip: float = float("nan")
    slip_error: float = float("nan")
    slip_since: float = float("nan")


class SlideWatch:
    """Follows the object's place on the gel from frame to frame.

    The slip differs from place to place: it is least in the core of the contact, where it is 0 as
    long as something sticks, and largest at the rim. The slip of the object is its slip over the
    marker that has followed it best, which stands for the gel that carries it. Between the markers
    the gel may have followed better.
    """

    def __init__(self, layout: MarkerLayout) -> None:
        """Begin before the object touches.

        Args:
            layout: markers and reference.
        """
        self._pitch = marker_pitch(layout)
        self._before: Float[np.ndarray, "n 2"] | None = None
        self._since = float("nan")

    def update(
        self,
        positions: Float[np.ndarray, "n 2"],
        contact: Bool[np.ndarray, " n"],
        imprint: tuple[float, float],
        point: Sequence[float],
        time: float,
    ) -> Slide:
        """What is known after the next frame.

        Args:
            positions: of the markers [mm]; NaN where not seen.
            contact: markers of the contact region.
            imprint: rotation of what the object prints, and its standard error [rad].
            point: of that print, as `Frame.print_point` has it [mm, mm²].
            time: time stamp [s].
        """
        if not contact.any():
            self._before = None
            return Slide()
        if not np.isfinite([*imprint, *point]).all():
            return Slide()
        first, now = np.array(point[:2]), np.array(point[2:4])
        if self._before is None or (imprint[0] == 0.0 and np.array_equal(first, now)):
            self._before, self._since = positions.copy(), time
        turn, turn_error = imprint
        c, s = np.cos(turn), np.sin(turn)
        arms = positions - now
        # where each marker would have been at first had it gone with the object ever since
        with_object = first + arms @ np.array([[c, -s], [s, c]])
        far = np.linalg.norm(with_object - self._before, axis=1)
        far[~contact] = np.nan
        if not np.isfinite(far).any():
            return Slide()
        best = int(np.nanargmin(far))
        xx, yy, xy = point[4:]
        across = turn_error * arms[best][::-1] * [-1.0, 1.0]
        place = np.linalg.eigvalsh(np.array([[xx, xy], [xy, yy]]) + np.outer(across, across))[-1]
        sheared = np.linalg.norm(positions[best] - self._before[best])
        return self._judge(float(far[best]), float(np.hypot(np.sqrt(place), TILTED * sheared)))

    def _judge(self, slip: float, error: float) -> Slide:
        radius = 2.4477  # that holds 95 % of a normal error in the plane, in standard errors
        half = radius * error
        known = half < max(slip, self._pitch)
        return Slide(slip if known else np.nan, half, self._since)
