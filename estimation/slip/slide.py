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

MARKER_ERROR = 0.003
"""Standard error of a marker's way, along x and along y [pitches]: 5 µm of dots 1.9 mm apart."""


class Slide(NamedTuple):
    """How far the object has slid over the gel.

    Attributes:
        slip: over the gel that has followed it best [mm]: 0 while some of the contact sticks. NaN
            without contact, where no print is followed, and where it is not known to a marker's
            pitch nor to itself: a print that is alike along a line does not show slip that way.
        slip_error: half-width of its 95 % interval [mm]; NaN without contact or print.
        slip_since: time stamp of the frame that it counts from: the first that shows the print
            after the object touched, or after the print was lost for long [s].
        beyond: the slip that the print shows, over the radius that holds 95 % of its errors, where
            that is least [-]; a print that is alike along a line shows the slip across it.
    """

    slip: float = float("nan")
    slip_error: float = float("nan")
    slip_since: float = float("nan")
    beyond: float = float("nan")


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
        xx, yy, xy = point[4:]
        if not np.isfinite([*imprint, *point]).all() or xx < 0.0 or xx * yy < xy**2:
            return Slide()
        first, now = np.array(point[:2]), np.array(point[2:4])
        if self._before is None or (imprint[0] == 0.0 and np.array_equal(first, now)):
            self._before, self._since = positions.copy(), time
        turn, turn_error = imprint
        c, s = np.cos(turn), np.sin(turn)
        arms = positions - now
        # where each marker would have been at first had it gone with the object ever since
        with_object = first + arms @ np.array([[c, -s], [s, c]])
        slips = (with_object - self._before) @ np.array([[c, s], [-s, c]])
        seen = contact & np.isfinite(slips[:, 0])
        if not seen.any():
            return Slide()
        across = turn_error * arms[seen][:, ::-1] * [-1.0, 1.0]
        sheared = TILTED * np.linalg.norm((positions - self._before)[seen], axis=1)
        spread = np.array([[xx, xy], [xy, yy]]) + across[:, :, None] * across[:, None]
        read = MARKER_ERROR * self._pitch
        spread += (read**2 + sheared[:, None, None] ** 2) * np.eye(2)
        return self._judge(slips[seen], spread)

    def _judge(
        self, slips: Float[np.ndarray, "seen 2"], spread: Float[np.ndarray, "seen 2 2"]
    ) -> Slide:
        """What the slip over each marker and its covariance say."""
        radius = 2.4477  # that holds 95 % of a normal error in the plane, in standard errors
        far = np.linalg.norm(slips, axis=1)
        best = int(far.argmin())
        half = radius * float(np.sqrt(np.linalg.eigvalsh(spread[best])[-1]))
        known = half < max(far[best], self._pitch)
        apart = np.einsum("ki,ki->k", slips, np.linalg.solve(spread, slips[..., None])[..., 0])
        beyond = float(np.sqrt(apart.min())) / radius
        return Slide(float(far[best]) if known else np.nan, half, self._since, beyond)
